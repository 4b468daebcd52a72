// Share of the sky that nearby surfaces leave open (screen-space ambient occlusion).
in vec2 spot;
uniform sampler2D depth;
uniform vec2 planes;          // [m] near and far
uniform vec2 slope;           // half extents of the picture at a distance of 1
uniform float reach;          // [m] within which surfaces occlude each other
out float open;

const int SAMPLES = 10;

float away(vec2 where) {
    float z = 2.0 * texture(depth, where).r - 1.0;
    return 2.0 * planes.x * planes.y / (planes.y + planes.x - z * (planes.y - planes.x));
}

vec3 place(vec2 where) {
    float d = away(where);
    return vec3((2.0 * where - 1.0) * slope * d, -d);
}

void main() {
    vec3 here = place(spot);
    open = 1.0;
    if (-here.z > 0.98 * planes.y) return;
    vec3 facing = normalize(cross(dFdx(here), dFdy(here)));
    vec2 size = min(reach / (2.0 * slope * -here.z), vec2(0.12));
    float fade = smoothstep(0.003, 0.010, size.y);  // too far away to be resolved
    if (fade == 0.0) return;
    float turn = 6.2831853 * fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715))));
    float held = 0.0;
    for (int i = 0; i < SAMPLES; ++i) {
        float angle = turn + 2.3999632 * float(i), radius = sqrt((float(i) + 0.5) / float(SAMPLES));
        vec3 between = place(spot + size * radius * vec2(cos(angle), sin(angle))) - here;
        float far = length(between);
        held += max(0.0, dot(facing, between) / max(far, 1e-4) - 0.15)
                * max(0.0, 1.0 - far / (2.5 * reach));
    }
    open = clamp(1.0 - 1.7 * fade * held / float(SAMPLES), 0.25, 1.0);
}
