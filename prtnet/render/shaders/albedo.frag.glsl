out vec4 colour;

void main() { colour = vec4(albedo(), 1.0); }
