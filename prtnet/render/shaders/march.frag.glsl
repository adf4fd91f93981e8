// What each pixel shows of an implicit surface; prt_meet and prt_part stand before.
uniform vec2 size;  // of the frame in pixels
layout(location = 0) out vec4 place;   // w: the part + 1; where nothing is met all are 0
layout(location = 1) out vec4 facing;  // unit normal

void main() {
    vec3 position, normal;
    if (!prt_meet(2.0 * gl_FragCoord.xy / size - 1.0, position, normal)) discard;
    place = vec4(position, float(prt_part(position) + 1));
    facing = vec4(normal, 0.0);
    gl_FragDepth = 0.0;
}
