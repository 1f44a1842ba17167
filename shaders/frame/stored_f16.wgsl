// Fields between the kernels of a frame: only the rows that the modulator has, at full padded width, as f16.

alias Stored = u32;

fn stored(value: vec2f) -> Stored {
    return pack2x16float(value);
}

fn restored(value: Stored) -> vec2f {
    return unpack2x16float(value);
}
