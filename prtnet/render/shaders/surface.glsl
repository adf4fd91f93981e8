// What a fragment knows of its surface, and the light: column j of light[l] is the RGB coefficient 4 l + j.
// VARYING: `in` where vertices hand it on, nothing where marched.frag.glsl fills it in.
uniform mat4x3 light[LAYERS];
uniform vec3 eye;
VARYING vec3 position;
VARYING vec3 normal;

vec3 shading_normal();

vec3 mirrored() { return reflect(normalize(position - eye), shading_normal()); }

