// sum t_i L_i at each vertex, t from a texture of GROUPS * LAYERS texels per vertex, PER_ROW vertices in a row, row 0 on
// top. Of four groups the last three are for red, green and blue. With OWN_TRANSFER another text finds t.
uniform mat4x3 light[LIGHT_LAYERS];
#ifndef OWN_TRANSFER
uniform sampler2D vertex_transfer;
out vec3 lit;

vec4 transfer_of_vertex(int layer) {
    int row = textureSize(vertex_transfer, 0).y - 1 - gl_VertexID / PER_ROW;
    return texelFetch(vertex_transfer, ivec2(gl_VertexID % PER_ROW * (GROUPS * LAYERS) + layer, row), 0);
}
#endif

vec3 light_of_vertex() {
    vec3 sum = vec3(0.0);
    for (int layer = 0; layer < LAYERS; ++layer) {
#if GROUPS == 1
        sum += light[layer] * transfer_of_vertex(layer);
#else
        mat3x4 colours = transpose(light[layer]);
        for (int colour = 0; colour < 3; ++colour)
            sum[colour] += dot(colours[colour], transfer_of_vertex((colour + 1) * LAYERS + layer));
#endif
    }
    return sum;
}
