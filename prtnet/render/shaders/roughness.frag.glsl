// (roughness, 0, 0, 1) as the file gives it, below 0 where it says nothing; reflectance.frag.glsl stands before.
out vec4 colour;

void main() { colour = vec4(roughness(), 0.0, 0.0, 1.0); }
