// Diffuse: albedo / pi * sum t_i L_i. Column j of light[l] is the RGB light coefficient 4 l + j.
// The caller defines DECLARE (vec4 t0, t1, ...), TRANSFER (statements that fill them), SUM (light[0] * t0 + ...).
uniform mat4x3 light[LAYERS];
out vec4 colour;

void main() {
    DECLARE;
    TRANSFER;
    colour = vec4(albedo() * (SUM) * 0.318309886, 1.0);
}
