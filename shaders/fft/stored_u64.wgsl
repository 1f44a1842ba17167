// How complex numbers lie in a buffer: as they are, but each is read and written as one number of 64 bits. A driver that
// runs shaders on the processor makes a loop of every access to a scalar, and so needs half as many.

alias Stored = u64;

fn stored(value: vec2f) -> Stored {
    let bits = bitcast<vec2u>(value);
    return u64(bits.x) | (u64(bits.y) << 32u);
}

fn restored(value: Stored) -> vec2f {
    return bitcast<vec2f>(vec2u(u32(value), u32(value >> 32u)));
}
