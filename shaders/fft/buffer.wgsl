// Hooks of a plain FFT: complex numbers in one buffer, transformed in place.
// Link it after `complex_f32.wgsl` or `complex_u64.wgsl`, which define `StoredComplex`, and after `buffer_plain.wgsl` or
// `buffer_texels.wgsl`, which read a number.

// Complex numbers from one row to the next (padding included), and from one field of the batch to the next.
override row_stride: u32;
override field_stride: u32;
// Factor of the final result.
override scale: f32 = 1.0;

@group(1) @binding(0) var<storage, read_write> values: array<StoredComplex>;

// Index of position (x, y, field).
fn index_of(position: vec3u) -> u32 {
    return position.z * field_stride + position.y * row_stride + position.x;
}

fn begin(line: u32, field: u32) {}

fn load(position: vec3u) -> vec2f {
    return read_value(index_of(position));
}

fn store(position: vec3u, value: vec2f) {
    values[index_of(position)] = encode_complex(scale * value);
}

fn load_work(position: vec3u) -> vec2f {
    return read_value(index_of(position));
}

fn store_work(position: vec3u, value: vec2f) {
    values[index_of(position)] = encode_complex(value);
}
