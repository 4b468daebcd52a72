// A triangle that covers the picture.
out vec2 spot;                // 0 to 1 from the lower left corner

void main() {
    spot = vec2(gl_VertexID == 1 ? 2.0 : 0.0, gl_VertexID == 2 ? 2.0 : 0.0);
    gl_Position = vec4(2.0 * spot - 1.0, 1.0, 1.0);
}
