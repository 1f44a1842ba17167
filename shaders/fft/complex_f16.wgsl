// Storage of complex numbers as two f16: the real part in the low half of a u32. Neither part may exceed 65504.

alias StoredComplex = u32;

fn encode_complex(value: vec2f) -> StoredComplex {
    return pack2x16float(value);
}

fn decode_complex(value: StoredComplex) -> vec2f {
    return unpack2x16float(value);
}
