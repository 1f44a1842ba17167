// 8-bit sRGB from CIE XYZ: matrix including the exposure, each channel clipped to 0…1, encoded and rounded.
// Twin: holoview/light/colour.py, to_srgb8.
//#include "lib/srgb.wgsl"

@group(0) @binding(0) var<uniform> encoding: SrgbEncoding;

@group(1) @binding(0) var<storage, read> xyz: array<vec4f>;
@group(1) @binding(1) var<storage, read_write> rgba: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= encoding.width) {
        return;
    }
    let value = xyz[id.y * encoding.width + id.x].xyz;
    let linear = value.x * encoding.x_to_rgb.xyz + value.y * encoding.y_to_rgb.xyz + value.z * encoding.z_to_rgb.xyz;
    let colour = srgb_encode(clamp(linear, vec3f(0.0), vec3f(1.0)));
    rgba[id.y * encoding.pitch + id.x] = pack4x8unorm(vec4f(colour, 1.0));
}
