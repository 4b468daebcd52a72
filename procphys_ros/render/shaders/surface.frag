// Lit surfaces: what is opaque, leaves that are cut out, and glass.
#if defined(KIND_SPRAY)
#define KIND_LEAF
#endif
in vec3 world;
in vec3 normal;
in vec3 tone;
in vec2 share;                // of sun and sky that the leaves around let through
#if defined(KIND_LEAF)
in vec3 leaf_light;
sample in vec2 uv;            // leaves are finer than pixels
#else
in vec2 uv;
#endif

uniform sampler2D image;
uniform bool plain;           // there is no image
uniform bool stony;           // the image has no direction
uniform float opacity;

out vec4 pixel;

#if !defined(KIND_LEAF)
// What has no direction is seen in three sizes at once, turned against each other (by the golden
// angle, and scaled by the golden section), so that it does not come again every tile.
vec4 paint_of(vec2 uv) {
    if (plain) return vec4(1.0);
    vec4 paint = texture(image, uv);
    if (!stony) return paint;
    const mat2 other = 0.618034 * mat2(-0.737369, 0.675490, -0.675490, -0.737369);
    return (paint + texture(image, other * uv) + texture(image, other * other * uv)) / 3.0;
}
#endif

void main() {
    vec3 towards = normalize(eye - world);
#if defined(KIND_LEAF)
    vec4 paint = plain ? vec4(1.0) : texture(image, uv, -2.0);
    if (paint.a < 0.45) discard;
    // Leaves know what shades them: no need to guess it from the depths around, see compose.frag.
    vec3 flat_ = vec3(0.0, 0.0, abs(normalize(normal).z));
    pixel = vec4(hazed(snowed(tone * paint.rgb, flat_, world, share.y) * leaf_light, world), 0.0);
#else
    vec4 paint = paint_of(uv);
    vec3 facing = normalize(normal);
    if (!gl_FrontFacing) facing = -facing;
    float lit = max(dot(facing, sun), 0.0);
    if (lit > 0.0) lit *= sunlit(world, facing, gl_FragCoord.xy);
    float up = 0.5 + 0.5 * facing.z;
    vec3 light = lit * sunshine + up * share.y * skylight + (1.0 - up) * bounce;
    vec3 colour = snowed(tone * paint.rgb, facing, world, share.y) * light;
    float cover = opacity;
    if (opacity < 1.0) {      // glass: the flatter the view, the more it mirrors (Schlick)
        vec3 mirrored = reflect(-towards, facing);
        float mirror = 0.08 + 0.92 * pow(1.0 - abs(dot(towards, facing)), 5.0);
        vec3 seen = mirrored.z > 0.0 ? sky(mirrored) : 0.45 * sky_low;
        colour = mix(0.35 * colour, seen, clamp(mirror + 0.25, 0.0, 1.0));
        cover = mix(opacity, 1.0, mirror);
    }
#if defined(KIND_BALL)
    vec3 half_ = normalize(towards + sun);
    colour += lit * 0.25 * sunshine * pow(max(dot(facing, half_), 0.0), 40.0);
#endif
    pixel = vec4(hazed(colour, world), cover);
#endif
}
