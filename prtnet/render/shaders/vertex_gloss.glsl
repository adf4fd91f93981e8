// The specular part at each vertex, for the eye as that vertex sees it; vertex_light.glsl stands before.
uniform vec3 eye;
out vec3 shine;

