// A linear picture on screen: sRGB(clip(exposure * linear)) as in prtnet.score, beside or against another, under help.
uniform sampler2D shown, other, overlay;
uniform float exposure;
uniform bool split, error;
uniform float bar;      // pixels from the left
uniform vec2 corner;    // the pixel of the overlay's lowest left texel
uniform float covering; // of the overlay, 0 to 1
out vec4 colour;

vec3 tone_map(sampler2D picture, ivec2 pixel) {
    vec3 linear = clamp(exposure * texelFetch(picture, pixel, 0).rgb, 0.0, 1.0);
    vec3 curve = 1.055 * pow(max(linear, 0.0031308), vec3(1.0 / 2.4)) - 0.055;
    return mix(curve, 12.92 * linear, lessThanEqual(linear, vec3(0.0031308)));
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 result = tone_map(shown, pixel);
    if ((split || error) && !(split && gl_FragCoord.x < bar)) {
        vec3 texture_method = tone_map(other, pixel);
        result = error ? min(8.0 * abs(result - texture_method), 1.0) : texture_method;
    }
    if (split && abs(gl_FragCoord.x - bar) < 1.0) result = vec3(1.0);
    ivec2 place = pixel - ivec2(corner), size = textureSize(overlay, 0);
    if (all(greaterThanEqual(place, ivec2(0))) && all(lessThan(place, size))) {
        vec4 text = texelFetch(overlay, place, 0);
        result = mix(result, text.rgb, covering * text.a);
    }
    colour = vec4(result, 1.0);
}
