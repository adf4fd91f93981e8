// What a vertex reflects, handed on to the fragments: specular RGB and the diffuse weight, and the exponent of its lobe,
// below 0 where that follows from the file's roughness.
in vec4 in_reflectance;
in float in_exponent;
out vec4 reflectance;
out float own_exponent;
#ifdef ROUGHNESS
in float in_roughness;
out float own_roughness;
#endif

void hand_on_reflectance() {
    reflectance = in_reflectance;
    own_exponent = in_exponent;
#ifdef ROUGHNESS
    own_roughness = in_roughness;
#endif
}

