// A phase modulator: field × exp(2πi·opd/λ), or × a transmission given for each sample; 0 outside the modulator's area.
// Twin: holoview/light/engine/torch_executor.py, modulate.
//#include "lib/modulator.wgsl"
//#include "lib/grid.wgsl"

// Whether `dense` holds the transmission of each sample.
override is_dense: bool = false;

@group(0) @binding(0) var<uniform> grid: Grid;
@group(0) @binding(1) var<uniform> modulator: Modulator;

// Optical path of each modulator pixel, in strokes; transmission of each sample.
@group(1) @binding(0) var<storage, read> opd: array<f32>;
@group(1) @binding(1) var<storage, read> dense: array<vec2f>;
@group(1) @binding(2) var<storage, read_write> field: array<vec2f>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= grid.padded.y) {
        return;
    }
    let at = index_padded(grid, id.y, id.x);
    var value = vec2f(0.0);
    if (is_inside(grid, id.y, id.x)) {
        let y = id.y - grid.offset.x;
        let x = id.x - grid.offset.y;
        if (is_dense) {
            value = cmul(field[at], dense[y * grid.shape.y + x]);
        } else {
            value = cmul(field[at], phasor(opd[pixel_index(grid, y, x)], modulator));
        }
    }
    field[at] = value;
}
