// What the observer makes of intensities: XYZ = Σ share × intensity, over wavelengths and frames, four pixels a thread.
// Twin: holoview/engine/torch_executor.py, composite.

// Whether it is added to what was seen.
override adds: bool = false;

@group(0) @binding(0) var<uniform> blend: Blend;
@group(0) @binding(1) var<storage, read> shares: array<Share>;

@group(1) @binding(0) var<storage, read> intensity: array<vec4f>;
@group(1) @binding(1) var<storage, read_write> seen: array<vec4f>;

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
    if (adds) {
        a = seen[4u * quad];
        b = seen[4u * quad + 1u];
        c = seen[4u * quad + 2u];
        d = seen[4u * quad + 3u];
    }
    for (var i = 0u; i < blend.count; i++) {
        let share = shares[i];
        let response = vec4f(share.xyz, 0.0);
        let four = intensity[share.slice * blend.quads + quad];
        a += four.x * response;
        b += four.y * response;
        c += four.z * response;
        d += four.w * response;
    }
    seen[4u * quad] = a;
    seen[4u * quad + 1u] = b;
    seen[4u * quad + 2u] = c;
    seen[4u * quad + 3u] = d;
}
