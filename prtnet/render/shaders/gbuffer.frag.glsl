// What each pixel shows, for kernels that shade it: four channels each, since CUDA registers no textures of three.
// albedo.glsl and shading_normal.glsl stand before, and reflectance.frag.glsl where points reflect otherwise (OWN).
layout(location = 0) out vec4 to_position;  // w: v in the atlas, above 0: where nothing is drawn all are 0
layout(location = 1) out vec4 to_normal;    // w: the exponent of the lobe, where points have their own
layout(location = 2) out vec4 to_albedo;    // w: u in the atlas
#ifdef OWN
layout(location = 3) out vec4 to_reflectance;  // specular RGB, diffuse weight
#endif

in vec2 atlas_uv;

void main() {
    to_position = vec4(position, max(atlas_uv.y, 1e-30));
    to_albedo = vec4(albedo(), atlas_uv.x);
#ifdef OWN
    to_normal = vec4(shading_normal(), exponent());
    to_reflectance = reflectance;
#else
    to_normal = vec4(shading_normal(), 0.0);
#endif
}
