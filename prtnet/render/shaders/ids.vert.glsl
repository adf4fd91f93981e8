// Faces drawn without an index buffer: three vertices each, so that a vertex knows which corner it is.
uniform mat4 camera;
in vec3 in_position;
out vec2 bary;
invariant gl_Position;

void main() {
    int corner = gl_VertexID % 3;
    bary = vec2(corner == 1, corner == 2);
    gl_Position = camera * vec4(in_position, 1.0);
}
