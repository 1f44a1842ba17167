// Adds weight·|field|² to the intensity on the modulator's area: frames and sources add incoherently.
// Twin: holoview/light/engine/torch_executor.py, accumulate.
//#include "lib/grid.wgsl"

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
    intensity[id.y * grid.shape.y + id.x] += params.weight * dot(value, value);
}
