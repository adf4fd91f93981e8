// Radiance towards the eye: DIFFUSE * albedo * sum t_i L_i, and the specular part where there is one.
// The caller defines DECLARE (vec4 t0, t1, ...), TRANSFER (statements that fill them), SUM (light[0] * t0 + ...),
// DIFFUSE (weight / pi) and, for a glossy material, GLOSS (an expression of t0, t1, ...).
out vec4 colour;

void main() {
    DECLARE;
    TRANSFER;
    vec3 radiance = albedo() * (SUM) * DIFFUSE;
#ifdef GLOSS
    radiance += GLOSS;
#endif
    colour = vec4(radiance, 1.0);
}
