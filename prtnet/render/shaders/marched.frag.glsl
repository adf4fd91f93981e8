// Stands after a fragment shader of the mesh, whose main is called `shade` here: gives it what pass one found of its pixel
// (march.frag.glsl) in place of what vertices hand on. What is an attribute of vertices there is an array by part here.
#undef main
uniform sampler2D places, facings;
uniform vec3 in_factor[PARTS];
#ifdef OWN
uniform vec4 in_reflectance[PARTS];
uniform float in_exponent[PARTS];
#endif

void main() {
    vec4 place = texelFetch(places, ivec2(gl_FragCoord.xy), 0);
    if (place.w == 0.0) discard;
    int part = int(place.w) - 1;
    position = place.xyz;
    normal = texelFetch(facings, ivec2(gl_FragCoord.xy), 0).xyz;
    factor = in_factor[part];
#ifdef OWN
    reflectance = in_reflectance[part];
    own_exponent = in_exponent[part];
#endif
    shade();
}
