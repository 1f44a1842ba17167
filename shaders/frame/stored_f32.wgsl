// Fields between the kernels of a frame: only the rows that the modulator has, at full padded width, as f32.

alias Stored = vec2f;

fn stored(value: vec2f) -> Stored {
    return value;
}

fn restored(value: Stored) -> vec2f {
    return value;
}
