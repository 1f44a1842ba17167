// Storage of complex numbers as two f32.

alias StoredComplex = vec2f;

fn encode_complex(value: vec2f) -> StoredComplex {
    return value;
}

fn decode_complex(value: StoredComplex) -> vec2f {
    return value;
}
