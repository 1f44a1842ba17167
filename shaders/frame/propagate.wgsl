// Kernels 2 and 4 of a frame: column FFT × transfer function × pupil → column IFFT. Hooks of a forward and an inverse
// transform along y. Positions are (column of the spectrum along x, y or its frequency on the padded grid, field).
//#include "lib/transfer.wgsl"
//#include "lib/grid.wgsl"

override has_pupil: bool = false;

@group(1) @binding(3) var<storage, read> propagations: array<Propagation>;
// Smallest |k_y|, lowest and highest k_y that pass, for each k_x of each wavelength.
@group(1) @binding(4) var<storage, read> support: array<vec4i>;
@group(1) @binding(5) var<storage, read> pupil: array<vec2f>;

var<private> propagation: Propagation;
var<private> column: ColumnTerms;
var<private> column_support: vec4i;

fn begin(line: u32, field: u32) {
    let kx = frequency_x(line);
    propagation = propagations[params.first_wavelength + field];
    column = column_terms(propagation, kx);
    column_support = support[(params.first_wavelength + field) * grid.padded.y + frequency_index(kx, grid.padded.y)];
}

fn load(position: vec3u) -> vec2f {
    let y = position.y - grid.offset.x;
    if (is_padded && y >= grid.shape.x) {
        return vec2f(0.0);
    }
    return read_sample(position.z, y, position.x);
}

fn middle(position: vec3u, value: vec2f) -> vec2f {
    let ky = frequency_y(position.y);
    let mask = select(0.0, inverse_scale, is_in_support(column_support, ky));
    let propagated = cmul(value, transfer(propagation, column, ky)) * mask;
    if (has_pupil) {
        let index = pupil_index(grid, ky, frequency_x(position.x));
        return cmul(propagated, pupil[position.z * grid.padded.x * grid.padded.y + index]);
    }
    return propagated;
}

fn store(position: vec3u, value: vec2f) {
    let y = position.y - grid.offset.x;
    if (is_padded && y >= grid.shape.x) {
        return;
    }
    write_sample(position.z, y, position.x, value);
}
