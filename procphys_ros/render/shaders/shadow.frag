// Depth from the sun; leaves are cut out.
#if defined(KIND_SPRAY)
#define KIND_LEAF
#endif
#if defined(KIND_LEAF)
sample in vec2 uv;
#else
in vec2 uv;
#endif
uniform sampler2D image;
uniform bool plain;

void main() {
#if defined(KIND_LEAF)
    if (!plain && texture(image, uv).a < 0.4) discard;
#endif
}
