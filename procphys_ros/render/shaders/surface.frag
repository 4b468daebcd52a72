// Lit surfaces: what is opaque, leaves that are cut out, and glass.
in vec3 world;
in vec3 normal;
in vec3 tone;
in vec2 share;                // of sun and sky that the leaves around let through
#if defined(KIND_LEAF)
sample in vec2 uv;            // leaves are finer than pixels
#else
in vec2 uv;
#endif

uniform sampler2D image;
uniform bool plain;           // there is no image
uniform float opacity;

out vec4 pixel;

const vec3 BOUNCE = vec3(0.20, 0.20, 0.16);  // light from the ground below
const float THROUGH = 0.35;   // share of the sun that a leaf lets through to its far side

void main() {
    vec3 towards = normalize(eye - world);
#if defined(KIND_LEAF)
    vec4 paint = plain ? vec4(1.0) : texture(image, uv, -2.0);
    if (paint.a < 0.45) discard;
    vec3 outward = normalize(normal);
    float facing = THROUGH + (1.0 - THROUGH) * clamp(0.25 + 0.75 * dot(outward, sun), 0.0, 1.0);
    float lit = share.x * (0.55 + 0.45 * sunlit(world, sun));
    vec3 light = 1.35 * facing * lit * sunshine + (0.65 + 0.35 * outward.z) * share.y * skylight
                 + 0.6 * BOUNCE;
    pixel = vec4(hazed(tone * paint.rgb * light, world), 1.0);
#else
    vec4 paint = plain ? vec4(1.0) : texture(image, uv);
    vec3 facing = normalize(normal);
    if (!gl_FrontFacing) facing = -facing;
    float lit = max(dot(facing, sun), 0.0);
    if (lit > 0.0) lit *= sunlit(world, facing);
    float up = 0.5 + 0.5 * facing.z;
    vec3 light = lit * sunshine + up * share.y * skylight + (1.0 - up) * BOUNCE;
    vec3 colour = tone * paint.rgb * light;
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
