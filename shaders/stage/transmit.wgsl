// Propagation through a relay: spectrum × H × pupil.
//   H = exp(−2πi·(z/λ)·A/(1 + √(1 − A))), A = (λ·df_y·k_y)² + (λ·df_x·k_x)²
// −A/(1+√(1−A)) = −A/2 − A²/(2·(1+√(1−A))²): the first term, hundreds of turns, is exact in fixed point; the second
// goes in f32. It is about (z/λ)·A²/8: at 4 µm samples half a turn at 10 mm, and 8 turns at 200 mm and 700 nm. Twin: holoview/engine/torch.py, transmit.
//#include "lib/complex.wgsl"
//#include "lib/fixed.wgsl"
//#include "lib/grid.wgsl"

override has_pupil: bool = false;

@group(0) @binding(0) var<uniform> grid: Grid;
@group(0) @binding(1) var<uniform> path: Path;

// Signed frequency index at each position of the (digit-reversed) spectrum, and the smallest and largest |k_x| that
// passes in each row of frequencies, 0, 1, …, −1.
@group(1) @binding(0) var<storage, read> frequency_y: array<i32>;
@group(1) @binding(1) var<storage, read> frequency_x: array<i32>;
@group(1) @binding(2) var<storage, read> support: array<vec2i>;
@group(1) @binding(3) var<storage, read> pupil: array<vec2f>;
@group(1) @binding(4) var<storage, read> spectrum: array<vec2f>;
@group(1) @binding(5) var<storage, read_write> transmitted: array<vec2f>;

fn transfer(ky: i32, kx: i32) -> vec2f {
    let ky2 = u32(ky * ky);
    let kx2 = u32(kx * kx);
    let paraxial = turns_times(ky2, path.paraxial_y) + turns_times(kx2, path.paraxial_x);
    let a = path.sine_step2.x * f32(ky2) + path.sine_step2.y * f32(kx2);
    let root = 1.0 + sqrt(max(1.0 - a, 0.0));
    let rest = path.waves * a * a / (2.0 * root * root);
    return cis(-(f32(bitcast<i32>(paraxial)) * 2.3283064365386963e-10 + fract(rest)));
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= grid.padded.y) {
        return;
    }
    let ky = frequency_y[id.y];
    let kx = frequency_x[id.x];
    let row = u32(select(ky, ky + i32(grid.padded.x), ky < 0));
    let passes = support[row];
    let at = index_padded(grid, id.y, id.x);
    var value = vec2f(0.0);
    if (abs(kx) >= passes.x && abs(kx) <= passes.y) {
        value = cmul(spectrum[at], transfer(ky, kx));
        if (has_pupil) {
            let column = u32(select(kx, kx + i32(grid.padded.y), kx < 0));
            value = cmul(value, pupil[row * grid.padded.y + column]);
        }
    }
    transmitted[at] = value;
}
