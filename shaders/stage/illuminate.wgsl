// The plane wave that illuminates the first modulator: |field| = 1 on the modulator's area and 0 outside.
// Twin: holoview/light/engine/torch_executor.py, illuminate.
//#include "lib/source.wgsl"
//#include "lib/grid.wgsl"

@group(0) @binding(0) var<uniform> grid: Grid;
@group(0) @binding(1) var<uniform> illumination: PlaneWave;

@group(1) @binding(0) var<storage, read_write> field: array<vec2f>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= grid.padded.y) {
        return;
    }
    var value = vec2f(0.0);
    if (is_inside(grid, id.y, id.x)) {
        value = plane_wave(illumination, id.y - grid.offset.x, id.x - grid.offset.y);
    }
    field[index_padded(grid, id.y, id.x)] = value;
}
