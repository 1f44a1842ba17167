// Adds weight·|field|² to the intensity on the modulator's area, or stores it: frames and sources add incoherently.
// Twin: holoview/light/engine/torch_executor.py, accumulate.
//#include "lib/grid.wgsl"

override accumulates: bool = true;

@group(0) @binding(0) var<uniform> grid: Grid;
@group(0) @binding(1) var<uniform> params: Weight;

@group(1) @binding(0) var<storage, read> field: array<vec2f>;
@group(1) @binding(1) var<storage, read_write> intensity: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= grid.shape.y) {
        return;
    }
    let value = field[index_padded(grid, id.y + grid.offset.x, id.x + grid.offset.y)];
    let at = params.first + id.y * grid.shape.y + id.x;
    let before = select(0.0, intensity[at], accumulates);
    intensity[at] = before + params.weight * dot(value, value);
}
