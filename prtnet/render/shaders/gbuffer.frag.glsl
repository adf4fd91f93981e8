// What each pixel shows, for kernels that shade it: four channels each, since CUDA registers no textures of three.
// albedo.glsl and shading_normal.glsl stand before, and reflectance.frag.glsl where points reflect otherwise (OWN).
layout(location = 0) out vec4 to_position;  // w: 1 where a surface is
layout(location = 1) out vec4 to_normal;    // w: the exponent of the lobe, where points have their own
layout(location = 2) out vec4 to_albedo;
#ifdef OWN
layout(location = 3) out vec4 to_reflectance;  // specular RGB, diffuse weight
#endif

void main() {
    to_position = vec4(position, 1.0);
    to_albedo = vec4(albedo(), 1.0);
#ifdef OWN
    to_normal = vec4(shading_normal(), exponent());
    to_reflectance = reflectance;
#else
    to_normal = vec4(shading_normal(), 0.0);
#endif
}
