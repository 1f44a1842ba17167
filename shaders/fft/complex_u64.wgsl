// Storage of complex numbers as two f32 that are read and written as one 64-bit integer: the bytes of complex_f32.wgsl.
// A driver that executes shaders on the CPU turns each access to a scalar into a loop, and so needs half as many loops.

alias StoredComplex = u64;

fn encode_complex(value: vec2f) -> StoredComplex {
    let bits = bitcast<vec2u>(value);
    return u64(bits.x) | (u64(bits.y) << 32u);
}

fn decode_complex(value: StoredComplex) -> vec2f {
    return bitcast<vec2f>(vec2u(u32(value), u32(value >> 32u)));
}
