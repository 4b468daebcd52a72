in vec2 spot;
uniform mat4 unproject;
out vec4 pixel;

void main() {
    vec4 far = unproject * vec4(2.0 * spot - 1.0, 1.0, 1.0);
    pixel = vec4(sky(normalize(far.xyz / far.w - eye)), 1.0);
}
