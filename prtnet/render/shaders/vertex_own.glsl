// What a vertex reflects: specular RGB and the diffuse weight, and the exponent of its lobe.
in vec4 in_reflectance;
in float in_exponent;

