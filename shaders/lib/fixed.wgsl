// Phases as fixed-point fractions of a turn: u32, 2³² to the turn, so that sums and products wrap modulo one turn exactly.

// n times a fraction of a turn given in 48 bits, as words.x (the high 32) and words.y (16 guard bits), modulo one turn.
// Exact but for the guard bits' own rounding: below 2⁻²² of a turn for n < 2²⁶, that is |k| ≤ 8192 for n = k².
fn turns_times(n: u32, words: vec2u) -> u32 {
    let low = (n >> 16u) * words.y + (((n & 0xffffu) * words.y) >> 16u);
    return n * words.x + low;
}
