// How complex numbers lie in a buffer: as they are.

alias Stored = vec2f;

fn stored(value: vec2f) -> Stored {
    return value;
}

fn restored(value: Stored) -> vec2f {
    return value;
}
