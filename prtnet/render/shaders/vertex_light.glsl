// sum t_i L_i at each vertex, t from a texture of LAYERS texels per vertex, PER_ROW vertices in a row, row 0 on top.
uniform sampler2D vertex_transfer;
uniform mat4x3 light[LIGHT_LAYERS];
out vec3 lit;

vec4 transfer_of_vertex(int layer) {
    int row = textureSize(vertex_transfer, 0).y - 1 - gl_VertexID / PER_ROW, first = gl_VertexID % PER_ROW * LAYERS;
    return texelFetch(vertex_transfer, ivec2(first + layer, row), 0);
}

vec3 light_of_vertex() {
    vec3 sum = vec3(0.0);
    for (int layer = 0; layer < LAYERS; ++layer)
        sum += light[layer] * transfer_of_vertex(layer);
    return sum;
}
