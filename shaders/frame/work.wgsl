// Intermediate values between the shaders of one transform: in the rows that the transform will write.

fn load_work(position: vec3u) -> vec2f {
    return decode_complex(target_rows[index_of_sample(params.work_field + position.z, position.y, position.x)]);
}

fn store_work(position: vec3u, value: vec2f) {
    target_rows[index_of_sample(params.work_field + position.z, position.y, position.x)] = encode_complex(value);
}
