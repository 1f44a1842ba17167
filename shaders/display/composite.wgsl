// CIE XYZ from intensities: XYZ = Σ (XYZ of unit intensity) × intensity over wavelengths and frames. Each invocation
// computes four pixels. Twin: holoview/engine/torch_executor.py, composite.

// Whether to add to the stored XYZ.
override accumulates: bool = false;

@group(0) @binding(0) var<uniform> blend: Blend;
@group(0) @binding(1) var<uniform> terms: array<BlendTerm, 64>;  // the first `blend.count` are filled

@group(1) @binding(0) var<storage, read> intensity: array<vec4f>;
@group(1) @binding(1) var<storage, read_write> xyz: array<vec4f>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) workgroups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let quad = (workgroup.y * workgroups.x + workgroup.x) * 64u + local;
    if (quad >= blend.quads) {
        return;
    }
    var a = vec4f(0.0);
    var b = vec4f(0.0);
    var c = vec4f(0.0);
    var d = vec4f(0.0);
    if (accumulates) {
        a = xyz[4u * quad];
        b = xyz[4u * quad + 1u];
        c = xyz[4u * quad + 2u];
        d = xyz[4u * quad + 3u];
    }
    for (var i = 0u; i < blend.count; i++) {
        let term = terms[i];
        let response = vec4f(term.xyz, 0.0);
        let four = intensity[term.intensity_index * blend.quads + quad];
        a += four.x * response;
        b += four.y * response;
        c += four.z * response;
        d += four.w * response;
    }
    xyz[4u * quad] = a;
    xyz[4u * quad + 1u] = b;
    xyz[4u * quad + 2u] = c;
    xyz[4u * quad + 3u] = d;
}
