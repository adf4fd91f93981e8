// The unit normal of the triangle, towards the eye, since only fronts are drawn.
vec3 geometric_normal() { return normalize(cross(dFdx(position), dFdy(position))); }

