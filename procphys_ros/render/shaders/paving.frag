// Stone and tar, worn and stained.
in vec3 world;
in vec3 normal;
uniform vec3 paving;
out vec4 pixel;

void main() {
    vec2 place = world.xy;
    vec4 wide = texture(noise, place / 31.0), stain = texture(noise, place / 5.3 + 0.37);
    vec4 grain = texture(noise, place / 0.9);
    vec3 colour = paving * (0.74 + 0.22 * wide.x + 0.18 * stain.y + 0.16 * grain.z);
    vec3 facing = normalize(normal);
    colour = snowed(colour, facing, world, 1.0);
    float lit = max(dot(facing, sun), 0.0) * sunlit(world, facing, gl_FragCoord.xy);
    float far = exp(-length(world.xy - eye.xy) / (0.35 * visibility));
    pixel = vec4(mix(sky_low, colour * (lit * sunshine + skylight), far), 1.0);
}
