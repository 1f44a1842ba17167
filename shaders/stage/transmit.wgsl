// Propagation through a relay: spectrum × transfer function × pupil; 0 outside the support.
// Twin: holoview/light/engine/torch_executor.py, transmit.
//#include "lib/transfer.wgsl"
//#include "lib/grid.wgsl"

override has_pupil: bool = false;

@group(0) @binding(0) var<uniform> grid: Grid;
@group(0) @binding(1) var<uniform> propagation: Propagation;

// Signed frequency index at each position of the spectrum; smallest |k_y|, lowest and highest k_y that
// pass, for each k_x.
@group(1) @binding(0) var<storage, read> frequency_y: array<i32>;
@group(1) @binding(1) var<storage, read> frequency_x: array<i32>;
@group(1) @binding(2) var<storage, read> support: array<vec4i>;
@group(1) @binding(3) var<storage, read> pupil: array<vec2f>;
@group(1) @binding(4) var<storage, read> spectrum: array<vec2f>;
@group(1) @binding(5) var<storage, read_write> transmitted: array<vec2f>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= grid.padded.y) {
        return;
    }
    let ky = frequency_y[id.y];
    let kx = frequency_x[id.x];
    let at = index_padded(grid, id.y, id.x);
    var value = vec2f(0.0);
    if (is_in_support(support[frequency_index(kx, grid.padded.y)], ky)) {
        value = cmul(spectrum[at], transfer(propagation, column_terms(propagation, kx), ky));
        if (has_pupil) {
            value = cmul(value, pupil[pupil_index(grid, ky, kx)]);
        }
    }
    transmitted[at] = value;
}
