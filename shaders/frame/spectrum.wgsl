// Column FFT of the field behind the last modulator, for several focal planes. Hooks of a forward transform along y.
// Positions are (column of the spectrum along x, y on the padded grid or stored frequency, field).
//#include "frame/columns.wgsl"

fn begin(line: u32, field: u32) {
    source_column = line;
}

fn load(position: vec3u) -> vec2f {
    return load_column(position.y, position.z);
}

fn store(position: vec3u, value: vec2f) {
    write_sample(position.z, position.y, position.x, value);
}
