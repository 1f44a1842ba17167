// Complex arithmetic on vec2f(real, imaginary), and exp(2πi·t) without the built-in sin and cos, whose absolute error
// may be 2⁻¹¹ by the WGSL specification. Angles are in turns: 1 turn = 2π.

// a·b
fn cmul(a: vec2f, b: vec2f) -> vec2f {
    return vec2f(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x);
}

// a·conj(b)
fn cmul_conj(a: vec2f, b: vec2f) -> vec2f {
    return vec2f(a.x * b.x + a.y * b.y, a.y * b.x - a.x * b.y);
}

// exp(2πi·t) for |t| ≤ 1/4 turn.
// Minimax polynomials in t²: their errors, 3.4e-9 of the sine and 2.5e-10 of the cosine, are negligible beside
// rounding, with which the error stays below 3e-7. Taylor series of the same accuracy would be four terms longer.
fn cis_half_circle(t: f32) -> vec2f {
    let s = t * t;
    let sine = t * (6.283185160089216 + s * (-41.341655031360474 + s * (81.60100407004795 + s * (-76.54978222495677
        + s * 39.536705577164724))));
    let cosine = 1.0 + s * (-19.739208624346624 + s * (64.93935359558762 + s * (-85.4538306870612
        + s * (60.148204526412364 + s * -25.006794011124466))));
    return vec2f(cosine, sine);
}

// exp(2πi·turns), with an error below 3e-7 in either part for the given f32.
// t − round(2t)/2 is exact in f32, so that thousands of turns add no error but the rounding of `turns` itself.
fn cis(turns: f32) -> vec2f {
    let half_turns = round(2.0 * turns);
    let odd = abs(half_turns - 2.0 * round(0.5 * half_turns));
    return (1.0 - 2.0 * odd) * cis_half_circle(turns - 0.5 * half_turns);
}

// exp(2πi·turns/2³²), with an error below 3e-7 in either part. See lib/fixed.wgsl for fixed-point turns.
fn cis_fixed(turns: u32) -> vec2f {
    let half_turns = (turns + 0x40000000u) >> 31u;
    let rest = bitcast<i32>(turns - (half_turns << 31u));
    return (1.0 - 2.0 * f32(half_turns)) * cis_half_circle(f32(rest) * 2.3283064365386963e-10);
}
