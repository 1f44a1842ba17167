// CIE XYZ from intensities: XYZ = Σ (XYZ of unit intensity) × intensity over wavelengths and frames, or added to another
// XYZ image. Each invocation computes eight pixels. Link it after `pixels_f32.wgsl` or `pixels_u64.wgsl`, which read and
// write them. Twin: holoview/light/engine/torch_executor.py, composite.

// Whether to add to the stored XYZ, or to the XYZ of another image.
override accumulates: bool = false;
override has_base: bool = false;

@group(0) @binding(0) var<uniform> blend: Blend;
@group(0) @binding(1) var<uniform> terms: array<BlendTerm, 64>;  // the first `blend.count` are filled

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) workgroups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let octet = (workgroup.y * workgroups.x + workgroup.x) * 64u + local;
    if (octet >= blend.octets) {
        return;
    }
    var left = mat4x3f();
    var right = mat4x3f();
    if (accumulates) {
        left = read_xyz(2u * octet);
        right = read_xyz(2u * octet + 1u);
    }
    if (has_base) {
        left = read_base(2u * octet);
        right = read_base(2u * octet + 1u);
    }
    for (var i = 0u; i < blend.count; i++) {
        let term = terms[i];
        let eight = read_intensities(term.intensity_index * blend.octets + octet);
        left += xyz_of_four(eight[0], term.xyz);
        right += xyz_of_four(eight[1], term.xyz);
    }
    write_xyz(2u * octet, left);
    write_xyz(2u * octet + 1u, right);
}

fn xyz_of_four(intensities: vec4f, response: vec3f) -> mat4x3f {
    let i = intensities;
    return mat4x3f(i.x * response, i.y * response, i.z * response, i.w * response);
}
