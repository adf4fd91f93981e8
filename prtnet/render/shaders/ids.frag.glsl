// (face + 1, b1, b2, 1): which point of which face a pixel shows.
in vec2 bary;
out vec4 colour;

void main() { colour = vec4(float(gl_PrimitiveID + 1), bary, 1.0); }
