// A disc that faces the camera.
uniform mat4 projection;
uniform vec3 side, up;
in vec3 in_position;          // [m]
in vec2 in_puff;              // diameter [m], optical depth in its middle
in vec2 in_corner;            // -1 to 1
out vec2 place;
out float thickness;
out float near;
out vec3 world;

void main() {
    world = in_position + 0.5 * in_puff.x * (in_corner.x * side + in_corner.y * up);
    place = in_corner;
    thickness = in_puff.y;
    near = 0.5 * in_puff.x;
    gl_Position = projection * vec4(world, 1.0);
}
