// Conservative rasterisation without an extension: the triangle and, round each of its edges, a rectangle that
// contains the centre of every texel that the edge touches. The fragment shader decides which of them count.
layout(triangles) in;
layout(triangle_strip, max_vertices = 15) out;
uniform float size;
// half the diagonal of a texel, and a little
const float REACH = 0.72;
in vec2 texel[3];
flat out vec2 corner0;
flat out vec2 corner1;
flat out vec2 corner2;
flat out int face;

void vertex(vec2 p) {
    corner0 = texel[0];
    corner1 = texel[1];
    corner2 = texel[2];
    face = gl_PrimitiveIDIn;
    gl_Position = vec4(p * (2.0 / size) - 1.0, 0.0, 1.0);
    EmitVertex();
}

void edge(vec2 a, vec2 b) {
    float span = length(b - a);
    vec2 along = (span > 0.0 ? (b - a) / span : vec2(1.0, 0.0)) * REACH;
    vec2 across = vec2(-along.y, along.x);
    vertex(a - along - across);
    vertex(b + along - across);
    vertex(a - along + across);
    vertex(b + along + across);
    EndPrimitive();
}

void main() {
    vertex(texel[0]);
    vertex(texel[1]);
    vertex(texel[2]);
    EndPrimitive();
    edge(texel[0], texel[1]);
    edge(texel[1], texel[2]);
    edge(texel[2], texel[0]);
}
