// Every pass over the mesh shares this text: the colour pass tests depth for equality, so positions must be identical.
// A program that defines AT_VERTEX runs it here as well.
uniform mat4 camera;
in vec3 in_position;
in vec3 in_normal;
in vec2 in_atlas_uv;
in vec2 in_albedo_uv;
in vec3 in_factor;
#ifdef NORMAL_MAP
in vec4 in_tangent;
out vec4 tangent;
#endif
out vec3 position;
out vec3 normal;
out vec2 atlas_uv;
out vec2 albedo_uv;
out vec3 factor;
invariant gl_Position;

void main() {
    position = in_position;
    normal = in_normal;
    atlas_uv = in_atlas_uv;
    albedo_uv = in_albedo_uv;
    factor = in_factor;
#ifdef NORMAL_MAP
    tangent = in_tangent;
#endif
    gl_Position = camera * vec4(in_position, 1.0);
#ifdef AT_VERTEX
    AT_VERTEX;
#endif
}
