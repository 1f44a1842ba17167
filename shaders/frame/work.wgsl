// Intermediate values between the shaders of one transform: in the rows that the transform will write.

fn work_index(position: vec3u) -> u32 {
    return index_of_sample(work_layout, params.work_field + position.z, position.y, position.x);
}

fn load_work(position: vec3u) -> vec2f {
    return decode_complex(target_rows[work_index(position)]);
}

fn store_work(position: vec3u, value: vec2f) {
    target_rows[work_index(position)] = encode_complex(value);
}
