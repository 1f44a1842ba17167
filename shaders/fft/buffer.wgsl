// Where a plain FFT pass reads and writes: one buffer of complex numbers, transformed in place.
// A stage that computes what it transforms brings its own `load` or `store` instead of this file.

// Complex numbers from one row to the next (padding included), and from one field of the batch to the next.
override row_stride: u32;
override field_stride: u32;

@group(1) @binding(0) var<storage, read_write> values: array<vec2f>;

// Index of position (x, y, field).
fn index_of(position: vec3u) -> u32 {
    return position.z * field_stride + position.y * row_stride + position.x;
}

fn load(position: vec3u) -> vec2f {
    return values[index_of(position)];
}

fn store(position: vec3u, value: vec2f) {
    values[index_of(position)] = value;
}
