// Radiance towards the eye: DIFFUSE * albedo * sum t_i L_i, and the specular part where there is one.
// The caller defines DECLARE (vec4 t0, t1, ...), TRANSFER (statements that fill them), SUM (light[0] * t0 + ...),
// DIFFUSE (weight / pi) and, for a glossy material, GLOSS (an expression of t0, t1, ...). One of several programs has
// SHARE: its weight, and the sum of the weights of all programs so far. Each is blended over those before it by its part
// of that sum, which comes to the weighted mean, and never to more light where faces coincide.
out vec4 colour;

void main() {
    // textures are looked up first: their level of detail needs the neighbours of a fragment
    vec3 reflected = albedo();
#ifdef SHARE
    vec2 share = SHARE;
    // at weights this small nothing shows, and products of them are no numbers any more
    if (share.x < 1e-6) discard;
#endif
    DECLARE;
    TRANSFER;
    vec3 radiance = reflected * (SUM) * DIFFUSE;
#ifdef GLOSS
    radiance += GLOSS;
#endif
    colour = vec4(radiance, 1.0);
#ifdef SHARE
    colour *= share.x / share.y;
#endif
}
