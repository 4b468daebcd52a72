// Sun, sky and the shadow of the scene, shared by all that is lit.
uniform vec3 sun;             // towards it, unit
uniform vec3 sunshine;        // colour of its light on a surface that faces it
uniform vec3 skylight;        // colour of the light from above
uniform vec3 bounce;          // and from the ground below
uniform vec3 sky_low, sky_high;
uniform float clouds;         // share of the sky, 0 to 1
uniform float visibility;     // [m]
uniform float snow;           // 0 to 1, that lies on level surfaces
uniform vec3 eye;             // [m]
uniform mat4 to_shadow;
uniform float texel;          // of the shadow map, over its side
uniform float texel_size;     // [m] and across
uniform sampler2DShadow shadow_map;
uniform sampler2D noise;      // four independent channels, mean 0.5

vec3 sky(vec3 towards) {
    float rise = clamp(towards.z, 0.0, 1.0);
    vec3 colour = mix(sky_low, sky_high, pow(rise, 0.6));
    float glow = max(dot(towards, sun), 0.0);
    colour += (1.0 - clouds) * vec3(0.35, 0.30, 0.20) * (pow(glow, 24.0) * 0.35 + pow(glow, 400.0));
    if (clouds > 0.0 && rise > 0.0) {
        vec2 place = towards.xy / (towards.z + 0.12) * 0.055;
        vec4 coarse = texture(noise, place);
        vec4 fine = texture(noise, 3.7 * place + 0.31);
        float puff = 0.62 * coarse.x + 0.25 * fine.y + 0.13 * texture(noise, 11.0 * place).z;
        float cover = smoothstep(0.70 - 0.55 * clouds, 0.84 - 0.46 * clouds, puff);
        vec3 white = mix(vec3(0.97), vec3(0.66, 0.69, 0.73), 0.8 * clouds * coarse.w + 0.25 * clouds);
        colour = mix(colour, white, cover * smoothstep(0.02, 0.22, rise));
    }
    // Wooded hills far away, which haze has nearly the colour of the horizon.
    float along = atan(towards.y, towards.x) / 6.2831853;
    float crest = 0.030 * texture(noise, vec2(along, 0.13)).x
                  + 0.010 * texture(noise, vec2(5.0 * along, 0.71)).y - 0.006;
    vec3 wood = mix(vec3(0.24, 0.32, 0.26), sky_low, 1.0 - 0.55 * exp(-900.0 / visibility));
    wood = mix(sky_low, wood, smoothstep(-0.3, 0.9, towards.z / max(crest, 1e-3)));
    return mix(wood, colour, smoothstep(crest, crest + 0.0025, towards.z));
}

// Share of the sun that arrives, over a few spots around, which makes the edge soft; their turn is
// drawn from a seed.
float sunlit(vec3 place, vec3 facing, vec2 seed) {
    // Off the surface, by as much as it falls away from the furthest of these spots.
    float steep = length(cross(facing, sun));
    float off = 0.012 + 3.1 * steep * texel_size;
    vec4 spot = to_shadow * vec4(place + off * facing + 0.006 * sun, 1.0);
    vec3 where = 0.5 * spot.xyz + 0.5;
    if (any(lessThan(where.xy, vec2(0.001))) || any(greaterThan(where.xy, vec2(0.999)))) return 1.0;
    // What lies behind all that throws shadows is shaded, too: low sun throws them far.
    where.z = min(where.z, 0.9999);
    float turn = 6.2831853 * fract(52.9829189 * fract(dot(seed, vec2(0.06711056, 0.00583715))));
    vec2 a = vec2(cos(turn), sin(turn)) * texel, b = vec2(-a.y, a.x);
    float lit = texture(shadow_map, where);
    lit += texture(shadow_map, vec3(where.xy + 1.4 * a, where.z));
    lit += texture(shadow_map, vec3(where.xy - 1.4 * a, where.z));
    lit += texture(shadow_map, vec3(where.xy + 2.4 * b, where.z));
    lit += texture(shadow_map, vec3(where.xy - 2.4 * b, where.z));
    return 0.2 * lit;
}

// Snow hides what is level, and slides off what is steep; where it is thin it has holes.
vec3 snowed(vec3 colour, vec3 facing, vec3 place, float open) {
    if (snow <= 0.0) return colour;
    float deep = 1.6 * snow * open - 0.6 * texture(noise, place.xy / 1.3).x;
    return mix(colour, vec3(0.88, 0.90, 0.93), clamp(deep, 0.0, 1.0)
               * smoothstep(0.5, 0.87, facing.z));
}

vec3 hazed(vec3 colour, vec3 place) {
    float away = length(place - eye) / visibility;
    return mix(colour, sky_low, 1.0 - exp(-away));
}
