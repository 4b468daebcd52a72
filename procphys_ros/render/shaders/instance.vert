// One copy of a unit mesh: a box, a hexahedron, a ball, a branch, a leaf or a free triangle.
// KIND_... chooses which; SHADOW asks for the depth from the sun only. The leaves of a spray have
// no image; in the place of its coordinates stands their brightness.
#if defined(KIND_SPRAY)
#define KIND_LEAF
#endif
uniform mat4 projection;
uniform float swell;          // [m] that boxes grow by, so that their joints let no sun through

in vec3 in_position;          // of the copy [m], world
in vec4 in_turn;              // its attitude, xyzw
in vec3 in_size;              // its extents [m], by kind
in vec3 in_tone;              // its colour
in vec2 in_share;             // sun and sky light that the leaves around it let through; of
                              // branches sky light at the base and at the tip
in float in_offset;           // along the image, so that no two bricks look alike

#if defined(KIND_TRIANGLE)
in vec3 in_a, in_b, in_c;
#elif defined(KIND_HEXAHEDRON)
in vec4 in_face;              // numbers of the corners of the face
in float in_own;              // which of these four the vertex is
in vec3 in_c0, in_c1, in_c2, in_c3, in_c4, in_c5, in_c6, in_c7;
#elif defined(KIND_BRANCH)
in vec4 in_ring;              // tip or base, height and radius of the ring, share of a turn
#elif defined(KIND_LEAF)
in vec3 in_corner;
in vec2 in_uv;
in vec3 in_outward;           // out of the crown, in the frame of the leaf
#else
in vec3 in_corner;
in vec3 in_normal;
#endif

#if defined(KIND_LEAF) && !defined(SHADOW)
out vec3 leaf_light;
const float THROUGH = 0.35;   // share of the sun that a leaf lets through to its far side
#endif
out vec3 world;
out vec3 normal;
out vec3 tone;
out vec2 share;
#if defined(KIND_LEAF)
sample out vec2 uv;
#else
out vec2 uv;
#endif

const float TURN = 6.2831853;
const vec2 BARK_TILE = vec2(0.25, 0.5);  // [m] around and along the branch that one image covers
const float BRICK_TILE = 0.6;            // [m] of wall that one image covers

vec3 rotate(vec4 q, vec3 v) { return v + 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v); }

// The two coordinates along a face, by the axis that it faces most.
vec2 across(vec3 point, vec3 facing) {
    vec3 side = abs(facing);
    return side.x > max(side.y, side.z) ? point.yz : side.y > side.z ? point.zx : point.xy;
}

#if defined(KIND_HEXAHEDRON)
vec3 corner_of(float number) {
    vec3 low = number < 1.5 ? (number < 0.5 ? in_c0 : in_c1) : (number < 2.5 ? in_c2 : in_c3);
    vec3 high = number < 5.5 ? (number < 4.5 ? in_c4 : in_c5) : (number < 6.5 ? in_c6 : in_c7);
    return number < 3.5 ? low : high;
}

// Unit vector from one corner to another; nothing where both are the same.
vec3 way(vec3 from, vec3 to) {
    return (to - from) / max(distance(from, to), 1e-6);
}
#endif

void main() {
    vec3 local, facing;
#if defined(KIND_TRIANGLE)
    int corner = gl_VertexID % 3;
    local = corner == 0 ? in_a : corner == 1 ? in_b : in_c;
    facing = normalize(cross(in_b - in_a, in_c - in_a) + vec3(0.0, 0.0, 1e-12));
    uv = across(local, facing) / BRICK_TILE + in_offset * vec2(1.0, 7.31);
#elif defined(KIND_HEXAHEDRON)
    vec3 a = corner_of(in_face.x), b = corner_of(in_face.y);
    vec3 c = corner_of(in_face.z), d = corner_of(in_face.w);
    facing = normalize(cross(c - a, d - b) + vec3(0.0, 0.0, 1e-12));
    local = in_own < 1.5 ? (in_own < 0.5 ? a : b) : (in_own < 2.5 ? c : d);
    vec3 before = in_own < 1.5 ? (in_own < 0.5 ? d : a) : (in_own < 2.5 ? b : c);
    vec3 after = in_own < 1.5 ? (in_own < 0.5 ? b : c) : (in_own < 2.5 ? d : a);
    local += 0.5 * swell * (facing + way(before, local) + way(after, local));
    uv = across(local, facing) / BRICK_TILE + in_offset * vec2(1.0, 7.31);
#elif defined(KIND_BRANCH)
    float radius = 0.5 * mix(in_size.x, in_size.y, in_ring.x);
    vec2 circle = vec2(cos(TURN * in_ring.w), sin(TURN * in_ring.w));
    local = vec3(radius * in_ring.z * circle, (in_ring.x - 0.5) * in_size.z + in_ring.y * radius);
    facing = vec3(in_ring.z * circle, in_ring.y);
    uv = vec2(max(1.0, round(0.5 * TURN * in_size.x / BARK_TILE.x)) * in_ring.w,
              (local.z + in_offset) / BARK_TILE.y);
#elif defined(KIND_LEAF)
    // What lies, with its own x upright, is pressed flat: clusters do not stand on the ground.
    local = in_corner * vec3(in_size.x * in_size.yy, in_size.x) * vec3(in_size.z, 1.0, 1.0);
    facing = in_outward;
    uv = in_uv;
#elif defined(KIND_BALL)
    local = 0.5 * in_corner * in_size;
    facing = normalize(in_corner / in_size);
    uv = vec2(atan(in_corner.y, in_corner.x) / TURN, in_corner.z);
#else
    local = in_corner * (in_size + swell);
    facing = in_normal;
    // Images run along the longer edge of a face, as grain runs along a beam.
    vec2 place = across(local, in_normal), edges = across(in_size, in_normal);
    uv = (edges.x > edges.y ? place.yx : place) / BRICK_TILE + in_offset * vec2(1.0, 7.31);
#endif
    world = in_position + rotate(in_turn, local);
    normal = rotate(in_turn, facing);
    tone = in_tone;
#if defined(KIND_BRANCH)
    share = vec2(mix(in_share.x, in_share.y, in_ring.x));
#else
    share = in_share;
#endif
#if defined(KIND_LEAF) && !defined(SHADOW)
    float sunny = THROUGH + (1.0 - THROUGH) * clamp(0.25 + 0.75 * dot(normal, sun), 0.0, 1.0);
    // Half of the shade is that of the crown, which is smooth, and half that of single leaves.
    float lit = share.x * (0.5 + 0.5 * sunlit(world, sun, vec2(gl_VertexID, gl_InstanceID)));
    leaf_light = 1.35 * sunny * lit * sunshine + (0.65 + 0.35 * normal.z) * share.y * skylight
                 + (0.65 - 0.35 * normal.z) * bounce;
#if defined(KIND_SPRAY)
    leaf_light *= in_uv.x;
#endif
#endif
    gl_Position = projection * vec4(world, 1.0);
}
