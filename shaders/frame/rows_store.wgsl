// Output of a transform along x: a stored row.

fn store(position: vec3u, value: vec2f) {
    write_sample(position.z, position.y, position.x, value);
}
