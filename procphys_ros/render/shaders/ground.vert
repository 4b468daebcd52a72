uniform mat4 projection;
in vec3 in_corner;            // [m], world
in vec3 in_normal;
out vec3 world;
out vec3 normal;

void main() {
    world = in_corner;
    normal = in_normal;
    gl_Position = projection * vec4(world, 1.0);
}
