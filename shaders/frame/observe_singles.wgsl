// Output of `observe.wgsl` sample by sample.

@group(1) @binding(3) var<storage, read_write> intensity: array<f32>;

fn store(position: vec3u, value: vec2f) {
    let x = position.x - grid.offset.y;
    let at = index_of_intensity(position.z, position.y, x);
    var sum = params.weight * dot(value, value);
    if (accumulates) {
        sum += intensity[at];
    }
    if (!is_padded || x < grid.shape.y) {
        intensity[at] = sum;
    }
}
