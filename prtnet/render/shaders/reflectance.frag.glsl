// What a fragment reflects; albedo.glsl stands before. e = 2 / r^4 - 2 and its limits are those of data/roughness.py.
VARYING vec4 reflectance;
VARYING float own_exponent;
#ifdef ROUGHNESS
in float own_roughness;
uniform sampler2D roughness_map;

float roughness() { return own_roughness * texture(roughness_map, albedo_uv).r; }

float exponent() {
    float r = roughness();
    return own_exponent < 0.0 ? clamp(2.0 / max(r * r * r * r, 1e-6) - 2.0, 1.0, 1e4) : own_exponent;
}
#else
float exponent() { return own_exponent; }
#endif

