// Gaussian puffs that fade before what they touch, at half the size of the picture.
in vec2 place;
in float thickness;
in float near;                // radius of the puff [m]
in vec3 world;
uniform sampler2D depth;
uniform vec2 planes;
uniform vec3 colour;
out vec4 pixel;

float metres(float z) {
    z = 2.0 * z - 1.0;
    return 2.0 * planes.x * planes.y / (planes.y + planes.x - z * (planes.y - planes.x));
}

void main() {
    float square = dot(place, place);
    if (square > 1.0) discard;
    float room = metres(texelFetch(depth, 2 * ivec2(gl_FragCoord.xy), 0).r) - metres(gl_FragCoord.z);
    float soft = clamp(room / max(0.6 * near, 0.02), 0.0, 1.0);
    if (soft <= 0.0) discard;
    // Two deviations from the middle to the edge, and nothing left at the edge.
    float share = (exp(-2.0 * square) - 0.1353) / 0.8647;
    pixel = soft * (1.0 - exp(-thickness * share)) * vec4(hazed(colour, world), 1.0);
}
