// Input of a transform along x: a stored row.

fn load(position: vec3u) -> vec2f {
    return read_sample(position.z, position.y, position.x);
}
