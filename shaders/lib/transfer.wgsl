// The transfer function of free space (angular spectrum) at one spatial frequency (k_y, k_x), in frequency bins df:
//   H = exp(−2πi·[(z/λ)·A/(1 + √(1 − A)) + u·d]), A = (λ·df_y·k_y)² + (λ·df_x·k_x)², the squared sine of the angle, with
// a displacement d of the picture.
// The phase is split by −A/(1 + √(1 − A)) = −A/2 − A²/(2·(1 + √(1 − A))²). The first term, the paraxial phase of up to
// thousands of turns, is evaluated in fixed point. The second, about (z/λ)·A²/8, is small enough for f32: with samples
// of 4 µm half a turn at 10 mm, and 8 turns at 200 mm and 700 nm.
// `Propagation` is defined in holoview/light/engine/shader_structs.py. Twin: holoview/light/optics/propagate.py.
//#include "lib/complex.wgsl"
//#include "lib/fixed.wgsl"

// The terms that all frequencies of one k_x share: the phase, paraxial and of the displacement, in 2⁻³² turns, and
// (λ·df_x·k_x)².
struct ColumnTerms {
    paraxial: u32,
    sine2: f32,
}

fn column_terms(propagation: Propagation, kx: i32) -> ColumnTerms {
    let kx2 = u32(kx * kx);
    let phase = multiply_turns(kx2, propagation.paraxial_x) + bitcast<u32>(kx) * propagation.shift.y;
    return ColumnTerms(phase, propagation.sine_step2.y * f32(kx2));
}

// H at k_y of a column.
fn transfer(propagation: Propagation, column: ColumnTerms, ky: i32) -> vec2f {
    let ky2 = u32(ky * ky);
    let displacement = bitcast<u32>(ky) * propagation.shift.x;
    let paraxial = multiply_turns(ky2, propagation.paraxial_y) + column.paraxial + displacement;
    let a = propagation.sine_step2.x * f32(ky2) + column.sine2;
    let root = 1.0 + sqrt(max(1.0 - a, 0.0));
    let rest = propagation.distance_waves * a * a / (2.0 * root * root);
    let turns = rest - trunc(rest);  // not fract, which makes a small negative number nearly 1 and rounds it
    return cis(-(f32(bitcast<i32>(paraxial)) * 2.3283064365386963e-10 + turns));
}

// Whether k_y lies within the support of a column: (smallest |k_y|, lowest k_y, highest k_y) that pass.
fn is_in_support(support: vec4i, ky: i32) -> bool {
    return abs(ky) >= support.x && ky >= support.y && ky <= support.z;
}

// Index of a frequency along an axis of n in tables in the order 0, 1, …, −1.
fn frequency_index(k: i32, n: u32) -> u32 {
    return u32(select(k, k + i32(n), k < 0));
}

// Index of a frequency in a pupil.
fn pupil_index(grid: Grid, ky: i32, kx: i32) -> u32 {
    return frequency_index(ky, grid.padded.x) * grid.padded.y + frequency_index(kx, grid.padded.y);
}
