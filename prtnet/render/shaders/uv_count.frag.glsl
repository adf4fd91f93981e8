// Drawn with additive blending: how many faces cover each texel centre.
out vec4 colour;

void main() { colour = vec4(1.0); }
