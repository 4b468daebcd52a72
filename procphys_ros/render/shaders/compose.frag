// The picture, darkened where little of the sky is seen.
in vec2 spot;
uniform sampler2D picture;
uniform sampler2D occlusion;
out vec4 pixel;

void main() {
    vec2 step = 1.0 / vec2(textureSize(occlusion, 0));
    float open = 0.0;
    for (int x = -1; x <= 2; ++x)
        for (int y = -1; y <= 2; ++y)
            open += texture(occlusion, spot + (vec2(x, y) - 0.5) * step).r;
    pixel = vec4(texture(picture, spot).rgb * open / 16.0, 1.0);
}
