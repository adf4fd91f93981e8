// A mesh laid out by its texture coordinates. `texel` is in texels of a square atlas.
uniform float size;
in vec2 atlas_uv;
out vec2 texel;

void main() {
    texel = atlas_uv * size;
    gl_Position = vec4(atlas_uv * 2.0 - 1.0, 0.0, 1.0);
}
