// The sRGB transfer function, IEC 61966-2-1. Twin: holoview/light/colour.py, srgb_encode.

// Encoded channels of linear ones; both from 0 (black) to 1 (white).
fn srgb_encode(linear: vec3f) -> vec3f {
    let curve = 1.055 * pow(max(linear, vec3f(0.0031308)), vec3f(1.0 / 2.4)) - 0.055;
    return select(curve, 12.92 * linear, linear <= vec3f(0.0031308));
}
