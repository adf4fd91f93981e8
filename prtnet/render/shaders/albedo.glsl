// Linear RGB albedo of the part: its factor times its texture (white where it has none). Implicit surfaces have none.
VARYING vec3 factor;
#ifdef MARCHED
vec3 albedo() { return factor; }
#else
uniform sampler2D albedo_map;
in vec2 albedo_uv;

vec3 albedo() { return factor * texture(albedo_map, albedo_uv).rgb; }
#endif
