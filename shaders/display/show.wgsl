// XYZ → 8-bit sRGB: exposure, matrix, each channel clipped to the gamut, encoded (IEC 61966-2-1) and rounded.
// Twin: holoview/colour.py, to_srgb8.

@group(0) @binding(0) var<uniform> screen: Screen;

@group(1) @binding(0) var<storage, read> seen: array<vec4f>;
@group(1) @binding(1) var<storage, read_write> rgba: array<u32>;

fn srgb_encoded(linear: vec3f) -> vec3f {
    let curve = 1.055 * pow(max(linear, vec3f(0.0031308)), vec3f(1.0 / 2.4)) - 0.055;
    return select(curve, 12.92 * linear, linear <= vec3f(0.0031308));
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= screen.width) {
        return;
    }
    let xyz = seen[id.y * screen.width + id.x].xyz;
    let linear = xyz.x * screen.from_x.xyz + xyz.y * screen.from_y.xyz + xyz.z * screen.from_z.xyz;
    let colour = srgb_encoded(clamp(linear, vec3f(0.0), vec3f(1.0)));
    rgba[id.y * screen.pitch + id.x] = pack4x8unorm(vec4f(colour, 1.0));
}
