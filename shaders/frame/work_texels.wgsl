// Intermediate values between the shaders of one transform: in the rows that the transform will write, read as texels.

fn load_work(position: vec3u) -> vec2f {
    let at = texel_place(index_of_sample(work_layout, position.z, position.y, position.x));
    return textureLoad(source_texels, at).xy;
}

fn store_work(position: vec3u, value: vec2f) {
    target_rows[index_of_sample(work_layout, params.work_field + position.z, position.y, position.x)] = encode_complex(value);
}
