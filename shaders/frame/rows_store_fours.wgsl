// Output of a transform along x: four neighbouring samples of a stored row at a time.

fn store_four(position: vec3u, values: mat4x2f) {
    let index = index_of_sample(target_layout, params.target_field + position.z, position.y, position.x) / 4u;
    target_rows[index] = vec4<u64>(
        encode_complex(values[0]),
        encode_complex(values[1]),
        encode_complex(values[2]),
        encode_complex(values[3]),
    );
}
