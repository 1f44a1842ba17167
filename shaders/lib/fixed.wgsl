// Fixed-point phases: fractions of a turn as u32 in units of 2⁻³² turns, so that sums and products wrap exactly modulo
// one turn.

// n times a phase of 48 bits, modulo one turn. words.x: the high 32 bits; words.y: 16 guard bits.
// The error, from the rounding of the guard bits, is below 2⁻²² turns for n < 2²⁶, that is |k| ≤ 8192 for n = k².
fn multiply_turns(n: u32, words: vec2u) -> u32 {
    let low = (n >> 16u) * words.y + (((n & 0xffffu) * words.y) >> 16u);
    return n * words.x + low;
}
