// The picture, darkened where little of the sky is seen, behind dust.
in vec2 spot;
uniform sampler2D picture;
uniform sampler2D occlusion;
uniform sampler2D haze;       // half as large: colour of dust times its opacity, and opacity
uniform sampler2D depth;
uniform vec2 planes;          // [m] near and far
uniform bool dusty;
out vec4 pixel;

float metres(ivec2 where) {
    float z = 2.0 * texelFetch(depth, where, 0).r - 1.0;
    return 2.0 * planes.x * planes.y / (planes.y + planes.x - z * (planes.y - planes.x));
}

// The dust before a pixel, from those neighbours that are about as far away as it.
vec4 dust() {
    ivec2 last = textureSize(haze, 0) - 1;
    vec2 place = spot * vec2(last + 1) - 0.5;
    vec2 share = fract(place);
    float here = metres(ivec2(gl_FragCoord.xy)), total = 0.0;
    vec4 sum = vec4(0.0);
    for (int x = 0; x < 2; ++x)
        for (int y = 0; y < 2; ++y) {
            ivec2 at = clamp(ivec2(floor(place)) + ivec2(x, y), ivec2(0), last);
            vec2 near = abs(vec2(1 - x, 1 - y) - share);
            float weight = (near.x * near.y + 1e-4) / (0.01 + abs(metres(2 * at) / here - 1.0));
            sum += weight * texelFetch(haze, at, 0);
            total += weight;
        }
    return sum / total;
}

void main() {
    vec2 step = 1.0 / vec2(textureSize(occlusion, 0));
    float open = 0.0;
    for (int x = -1; x <= 2; ++x)
        for (int y = -1; y <= 2; ++y)
            open += texture(occlusion, spot + (vec2(x, y) - 0.5) * step).r;
    vec4 before = dusty ? dust() : vec4(0.0);
    vec4 seen = texture(picture, spot);
    vec3 lit = seen.rgb * mix(1.0, open / 16.0, seen.a);
    pixel = vec4(lit * (1.0 - before.a) + before.rgb, 1.0);
}
