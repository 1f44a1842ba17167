// How complex numbers lie in a buffer: both parts as f16, the real one in the low half. Neither may exceed 65504.

alias Stored = u32;

fn stored(value: vec2f) -> Stored {
    return pack2x16float(value);
}

fn restored(value: Stored) -> vec2f {
    return unpack2x16float(value);
}
