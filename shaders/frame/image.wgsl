// Spectrum × transfer function × pupil → column IFFT. Hooks of an inverse transform along y.
// Positions are (column of the spectrum along x, stored frequency or y on the padded grid, field).
//#include "frame/propagation.wgsl"

fn begin(line: u32, field: u32) {
    begin_column(frequency_x(line), field);
}

fn load(position: vec3u) -> vec2f {
    return propagated(frequency_y(position.y), read_sample(position.z, position.y, position.x));
}

fn store(position: vec3u, value: vec2f) {
    let y = position.y - grid.offset.x;
    if (!is_padded || y < grid.shape.x) {
        write_sample(position.z, y, position.x, value);
    }
}
