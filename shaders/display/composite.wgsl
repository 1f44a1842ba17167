// What the observer makes of one wavelength: XYZ += intensity × response, summed over wavelengths.
// Twin: holoview/engine/torch.py, composite.

@group(0) @binding(0) var<uniform> grid: Grid;
@group(0) @binding(1) var<uniform> observer: Response;

@group(1) @binding(0) var<storage, read> intensity: array<f32>;
@group(1) @binding(1) var<storage, read_write> seen: array<vec4f>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= grid.shape.y) {
        return;
    }
    let at = id.y * grid.shape.y + id.x;
    seen[at] += intensity[at] * observer.xyz;
}
