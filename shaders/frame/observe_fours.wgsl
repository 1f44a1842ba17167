// Output of `observe.wgsl`: four neighbouring samples at a time, as two 64-bit integers.

@group(1) @binding(3) var<storage, read_write> intensity: array<vec2<u64>>;

fn store_four(position: vec3u, values: mat4x2f) {
    let x = position.x - grid.offset.y;
    if (is_padded && x >= grid.shape.y) {
        return;
    }
    let at = index_of_intensity(position.z, position.y, x) / 4u;
    let low = vec2f(dot(values[0], values[0]), dot(values[1], values[1]));
    let high = vec2f(dot(values[2], values[2]), dot(values[3], values[3]));
    var sum = params.weight * vec4f(low, high);
    if (accumulates) {
        sum += vec4f(decode_complex(intensity[at].x), decode_complex(intensity[at].y));
    }
    intensity[at] = vec2<u64>(encode_complex(sum.xy), encode_complex(sum.zw));
}
