// Hooks of a plain FFT: one buffer of complex numbers, transformed in place.
// Link it after `stored_f32.wgsl` or `stored_u64.wgsl`. A stage that computes what it transforms brings its own `load` or `store` instead of this file.

// Complex numbers from one row to the next (padding included), and from one field of the batch to the next.
override row_stride: u32;
override field_stride: u32;
// What is stored at the end is multiplied by this.
override scale: f32 = 1.0;

@group(1) @binding(0) var<storage, read_write> values: array<Stored>;

// Index of position (x, y, field).
fn index_of(position: vec3u) -> u32 {
    return position.z * field_stride + position.y * row_stride + position.x;
}

fn begin(line: u32, field: u32) {}

fn load(position: vec3u) -> vec2f {
    return restored(values[index_of(position)]);
}

fn store(position: vec3u, value: vec2f) {
    values[index_of(position)] = stored(scale * value);
}

fn load_work(position: vec3u) -> vec2f {
    return restored(values[index_of(position)]);
}

fn store_work(position: vec3u, value: vec2f) {
    values[index_of(position)] = stored(value);
}
