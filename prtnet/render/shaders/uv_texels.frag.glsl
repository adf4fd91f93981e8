// The point of a face nearest to the texel centre, as barycentric coordinates: (face + 1, b1, b2, distance).
// Depth is the distance, so a face that covers the centre (distance 0) wins over one that only touches the texel.
flat in vec2 corner0;
flat in vec2 corner1;
flat in vec2 corner2;
flat in int face;
out vec4 colour;

float cross2(vec2 a, vec2 b) { return a.x * b.y - a.y * b.x; }

// (parameter, squared distance) of the point of segment a-b nearest to the origin
vec2 segment(vec2 a, vec2 b) {
    vec2 along = b - a;
    float span = dot(along, along);
    float t = span > 0.0 ? clamp(-dot(a, along) / span, 0.0, 1.0) : 0.0;
    vec2 away = a + t * along;
    return vec2(t, dot(away, away));
}

void main() {
    vec2 a = corner0 - gl_FragCoord.xy, b = corner1 - gl_FragCoord.xy, c = corner2 - gl_FragCoord.xy;
    vec3 bary = vec3(cross2(b, c), cross2(c, a), cross2(a, b));
    float area = bary.x + bary.y + bary.z, away = 0.0;
    bary /= area;
    if (area == 0.0 || min(bary.x, min(bary.y, bary.z)) < 0.0) {
        vec2 ab = segment(a, b), bc = segment(b, c), ca = segment(c, a);
        away = ab.y;
        bary = vec3(1.0 - ab.x, ab.x, 0.0);
        if (bc.y < away) { away = bc.y; bary = vec3(0.0, 1.0 - bc.x, bc.x); }
        if (ca.y < away) { away = ca.y; bary = vec3(ca.x, 0.0, 1.0 - ca.x); }
        // the face lies beyond the line through its nearest point: does the texel's square reach that line?
        vec2 nearest = bary.x * a + bary.y * b + bary.z * c;
        if (away > 0.5001 * (abs(nearest.x) + abs(nearest.y))) discard;
        away = sqrt(away);
    }
    gl_FragDepth = min(away * 0.5, 1.0);
    colour = vec4(float(face + 1), bary.y, bary.z, away);
}
