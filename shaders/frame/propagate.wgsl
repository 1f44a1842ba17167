// Kernels 2 and 4 of a frame: column FFT × H × pupil → column IFFT. Hooks of a transform along y and back.
//#include "lib/transfer.wgsl"
//#include "lib/grid.wgsl"

override has_pupil: bool = false;

// The smallest and largest |k_y| that passes, for each |k_x| of each wavelength.
@group(1) @binding(3) var<storage, read> paths: array<Path>;
@group(1) @binding(4) var<storage, read> stops: array<vec2i>;
@group(1) @binding(5) var<storage, read> pupil: array<vec2f>;

var<private> path: Path;
var<private> column: Column;
var<private> passed: vec2i;

fn begin(line: u32, field: u32) {
    let kx = frequency_x(line);
    path = paths[batch.wavelength + field];
    column = column_of(path, kx);
    passed = stops[(batch.wavelength + field) * (grid.padded.y / 2u + 1u) + u32(abs(kx))];
}

fn load(position: vec3u) -> vec2f {
    let y = position.y - grid.offset.x;
    if (is_padded && y >= grid.shape.x) {
        return vec2f(0.0);
    }
    return fetched(position.z, y, position.x);
}

fn middle(position: vec3u, value: vec2f) -> vec2f {
    let ky = frequency_y(position.y);
    let mask = select(0.0, inverse_scale, is_passed(passed, ky));
    let sent = cmul(value, transfer(path, column, ky)) * mask;
    if (has_pupil) {
        return cmul(sent, pupil[position.z * grid.padded.x * grid.padded.y + pupil_index(grid, ky, frequency_x(position.x))]);
    }
    return sent;
}

fn store(position: vec3u, value: vec2f) {
    let y = position.y - grid.offset.x;
    if (is_padded && y >= grid.shape.x) {
        return;
    }
    put(position.z, y, position.x, value);
}
