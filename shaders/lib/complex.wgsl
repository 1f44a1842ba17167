// Complex numbers as vec2f(real, imaginary), and exp(2πi·t) without the built-in sin and cos, of which WGSL promises
// only 2⁻¹¹ absolute. Angles are in turns: 1 turn = 2π.

// a·b
fn cmul(a: vec2f, b: vec2f) -> vec2f {
    return vec2f(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x);
}

// a·conj(b)
fn cmul_conj(a: vec2f, b: vec2f) -> vec2f {
    return vec2f(a.x * b.x + a.y * b.y, a.y * b.x - a.x * b.y);
}

// exp(2πi·t) for |t| ≤ 1/4 turn.
// Taylor series (coefficients (2π)ⁿ/n!) of the sine to t¹³ and of the cosine to t¹⁴: what they leave out is below
// 7e-10, so that rounding decides the error, which stays below 3e-7.
fn cis_half_circle(t: f32) -> vec2f {
    let s = t * t;
    let sine = t * (6.283185307179586 + s * (-41.341702240399755 + s * (81.60524927607504 + s * (-76.70585975306136
        + s * (42.058693944897634 + s * (-15.094642576822984 + s * 3.8199525848482803))))));
    let cosine = 1.0 + s * (-19.739208802178716 + s * (64.93939402266828 + s * (-85.45681720669371
        + s * (60.24464137187664 + s * (-26.426256783374388 + s * (7.903536371318465 + s * -1.7143907110886711))))));
    return vec2f(cosine, sine);
}

// exp(2πi·turns), error below 3e-7 in either part for the f32 that `turns` is.
// t − round(2t)/2 is exact in f32, so that thousands of turns cost nothing but the rounding of `turns` itself.
fn cis(turns: f32) -> vec2f {
    let half_turns = round(2.0 * turns);
    let odd = abs(half_turns - 2.0 * round(0.5 * half_turns));
    return (1.0 - 2.0 * odd) * cis_half_circle(turns - 0.5 * half_turns);
}

// exp(2πi·turns/2³²), error below 3e-7 in either part. Whole turns wrap, so that sums and products of fixed-point turns
// in u32 arithmetic are exact modulo one turn.
fn cis_fixed(turns: u32) -> vec2f {
    let half_turns = (turns + 0x40000000u) >> 31u;
    let rest = bitcast<i32>(turns - (half_turns << 31u));
    return (1.0 - 2.0 * f32(half_turns)) * cis_half_circle(f32(rest) * 2.3283064365386963e-10);
}
