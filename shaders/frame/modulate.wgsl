// Row IFFT × modulator 2 → row FFT. Hooks of an inverse and a forward transform along x.
// Positions are (x on the padded grid, row of the field, field).
//#include "lib/modulator.wgsl"
//#include "lib/grid.wgsl"

// Whether `dense` holds the transmission of each sample.
override is_dense: bool = false;

@group(1) @binding(3) var<storage, read> modulators: array<Modulator>;
@group(1) @binding(4) var<storage, read> opd: array<f32>;  // of each modulator pixel, in strokes
@group(1) @binding(5) var<storage, read> dense: array<vec2f>;  // transmission of each sample

var<private> modulator: Modulator;

fn begin(line: u32, field: u32) {
    modulator = modulators[params.first_wavelength + field];
}

// Transmission of the modulator pixel, which all its samples share.
fn shared_value(position: vec3u) -> vec2f {
    return phasor(opd[pixel_index(grid, position.y, position.x - grid.offset.y)], modulator);
}

fn middle_shared(position: vec3u, value: vec2f, pixel: vec2f) -> vec2f {
    let x = position.x - grid.offset.y;
    var transmission = pixel;
    if (is_dense) {
        transmission = dense[position.y * grid.shape.y + x];
    }
    return select(cmul(value, transmission), vec2f(0.0), is_padded && x >= grid.shape.y);
}
