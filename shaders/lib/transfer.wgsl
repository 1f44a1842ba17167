// Free-space propagation of one frequency. `Path` comes from holoview/engine/shader_structs.py. Twin: holoview/optics/propagate.py.
//   H = exp(−2πi·(z/λ)·A/(1 + √(1 − A))), A = (λ·df_y·k_y)² + (λ·df_x·k_x)²
// −A/(1+√(1−A)) = −A/2 − A²/(2·(1+√(1−A))²): the first term, hundreds of turns, is exact in fixed point; the second
// goes in f32. It is about (z/λ)·A²/8: at 4 µm samples half a turn at 10 mm, and 8 turns at 200 mm and 700 nm.
//#include "lib/complex.wgsl"
//#include "lib/fixed.wgsl"

// What all frequencies of one k_x have in common: the paraxial phase, 2³² to the turn, and the squared direction sine.
struct Column {
    paraxial: u32,
    sine2: f32,
}

fn column_of(path: Path, kx: i32) -> Column {
    let kx2 = u32(kx * kx);
    return Column(turns_times(kx2, path.paraxial_x), path.sine_step2.y * f32(kx2));
}

fn transfer(path: Path, column: Column, ky: i32) -> vec2f {
    let ky2 = u32(ky * ky);
    let paraxial = turns_times(ky2, path.paraxial_y) + column.paraxial;
    let a = path.sine_step2.x * f32(ky2) + column.sine2;
    let root = 1.0 + sqrt(max(1.0 - a, 0.0));
    let rest = path.waves * a * a / (2.0 * root * root);
    return cis(-(f32(bitcast<i32>(paraxial)) * 2.3283064365386963e-10 + fract(rest)));
}

// Whether the stops of a column, the smallest and largest |k_y|, let a frequency pass.
fn is_passed(stops: vec2i, ky: i32) -> bool {
    return abs(ky) >= stops.x && abs(ky) <= stops.y;
}

// Where the pupil of a relay holds a frequency: rows and columns 0, 1, …, −1.
fn pupil_index(grid: Grid, ky: i32, kx: i32) -> u32 {
    let row = u32(select(ky, ky + i32(grid.padded.x), ky < 0));
    return row * grid.padded.y + u32(select(kx, kx + i32(grid.padded.y), kx < 0));
}
