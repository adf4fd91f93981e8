// Where the ray of each pixel meets the surface prt_distance = 0, by sphere tracing (Hart 1996). The plain twin, and what
// the numbers in capitals mean, is render/sphere_tracing.py. The text of the surface stands before.
uniform mat3 window;  // columns: half of the frame to the right, half of it upwards, forward, seen from a distance of 1
uniform vec3 middle;  // what the middle of the frame shows `ahead` of the eye, before the cube: numbers that stay small
uniform float ahead;  // however far the eye is
uniform vec2 size;    // of the frame in pixels
uniform float pixel;  // what the middle pixel covers at a distance of 1
uniform float lipschitz;
uniform int steps, refinements;
layout(location = 0) out vec4 place;   // w: the part + 1; where nothing is met all are 0
layout(location = 1) out vec4 facing;

void main() {
    vec2 across = 2.0 * gl_FragCoord.xy / size - 1.0;
    vec3 through = window * vec3(across, 1.0), ray = normalize(through), begin = middle + ahead * (mat2x3(window) * across);
    vec3 apart = mix(ray, vec3(1e-20), lessThan(abs(ray), vec3(1e-20)));
    vec3 low = (-BOX - begin) / apart, high = (BOX - begin) / apart;
    vec3 first = min(low, high), last = max(low, high);
    float enter = max(max(first.x, first.y), max(first.z, 0.0));
    float leave = min(last.x, min(last.y, last.z)) - enter;
    vec3 start = begin + enter * ray;
    float before = ahead * length(through) + enter;
    float t = 0.0, near = 0.0, found = 1.0;
    for (int i = 0; i < steps && t <= leave && found > near; ++i) {
        t += i == 0 ? 0.0 : found / lipschitz;
        found = prt_distance(start + t * ray);
        near = max(NEAR * pixel * (before + t), LEAST);
    }
    if (t > leave || !(found <= max(pixel * (before + t), LEAST))) discard;
    vec3 p = start + t * ray, slope;
    for (int i = 0; i <= refinements; ++i) {
        slope = prt_gradient(p);
        vec3 along = ray / min(dot(slope, ray), -GRAZING), steepest = slope / max(dot(slope, slope), 1e-12);
        p -= prt_distance(p) * (i < refinements ? along : steepest);
    }
    float length_of = length(slope);
    place = vec4(p, float(prt_part(p) + 1));
    facing = vec4(length_of > 1e-12 ? slope / length_of : vec3(0.0, 1.0, 0.0), 0.0);
    gl_FragDepth = 0.0;
}
