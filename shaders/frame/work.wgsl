// What lies between the shaders of one transform, where it has several: in the rows that it is going to write.

fn load_work(position: vec3u) -> vec2f {
    return restored(target_rows[index_of_sample(batch.work_field + position.z, position.y, position.x)]);
}

fn store_work(position: vec3u, value: vec2f) {
    target_rows[index_of_sample(batch.work_field + position.z, position.y, position.x)] = stored(value);
}
