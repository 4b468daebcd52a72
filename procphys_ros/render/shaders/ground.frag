// Short grass with bare and dry patches.
in vec3 world;
in vec3 normal;
uniform vec3 grass;
out vec4 pixel;

// The golden angle: noise of several sizes must not repeat along the same lines.
const mat2 OTHER = mat2(-0.737369, 0.675490, -0.675490, -0.737369);

void main() {
    vec2 place = world.xy, turned = OTHER * place;
    vec4 wide = texture(noise, place / 97.0), patchy = texture(noise, place / 23.0 + 0.37);
    vec4 tuft = texture(noise, turned / 3.7), blade = texture(noise, OTHER * turned / 1.1);
    vec4 sward = texture(noise, OTHER * OTHER * turned / 1.9);
    float dry = smoothstep(0.35, 0.75, 0.55 * wide.x + 0.45 * patchy.y);
    float bare = smoothstep(0.70, 0.82, 0.6 * patchy.z + 0.4 * tuft.w);
    vec3 colour = mix(grass * vec3(0.88, 0.98, 0.82), grass * vec3(1.14, 1.04, 0.94), dry);
    colour = mix(colour, grass * vec3(1.12, 0.94, 0.90), 0.8 * bare);
    colour *= 0.56 + 0.36 * tuft.x + 0.24 * blade.y + 0.24 * sward.z;
    vec3 facing = normalize(normal);
    colour = snowed(colour, facing, world, 1.0);
    float lit = max(dot(facing, sun), 0.0) * sunlit(world, facing, gl_FragCoord.xy);
    float far = exp(-length(world.xy - eye.xy) / (0.35 * visibility));
    pixel = vec4(mix(sky_low, colour * (lit * sunshine + skylight), far), 1.0);
}
