// Weights of a vertex from a texture of WEIGHT_LAYERS texels per vertex, PER_ROW vertices in a row, row 0 on top; what
// they are weights of is found by linear_decode (prtnet.export.linear).
uniform sampler2D vertex_transfer;
in float in_cluster;
out vec3 lit;

vec4 weight_of_vertex(int layer) {
    int row = textureSize(vertex_transfer, 0).y - 1 - gl_VertexID / PER_ROW;
    return texelFetch(vertex_transfer, ivec2(gl_VertexID % PER_ROW * WEIGHT_LAYERS + layer, row), 0);
}

