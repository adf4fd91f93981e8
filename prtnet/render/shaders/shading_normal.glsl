// The unit shading normal: the interpolated one, bent by the part's normal map where the scene has any. Without mip
// levels, so that every method and every reference sees the same relief.
#ifdef NORMAL_MAP
uniform sampler2D normal_map;
in vec4 tangent;

vec3 shading_normal() {
    vec3 bent = textureLod(normal_map, albedo_uv, 0.0).xyz;
    vec3 across = tangent.w * cross(normal, tangent.xyz);
    return normalize(bent.x * tangent.xyz + bent.y * across + bent.z * normal);
}
#else
vec3 shading_normal() { return normalize(normal); }
#endif

