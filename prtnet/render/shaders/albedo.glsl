// Linear RGB albedo of the part: its factor times its texture (white where it has none).
uniform sampler2D albedo_map;
in vec2 albedo_uv;
in vec3 factor;

vec3 albedo() { return factor * texture(albedo_map, albedo_uv).rgb; }
