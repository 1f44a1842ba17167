// Source × modulator 1 → row FFT. Hooks of a forward transform along x. Positions are (x on the padded grid, row of the
// field, field). `grid` is that of the computed samples: all, or the first one of each pixel. `wave_step` tells how many
// samples of the field lie between two of them.
//#include "lib/source.wgsl"
//#include "lib/modulator.wgsl"
//#include "lib/grid.wgsl"

override is_tilted: bool = true;
// Whether `dense` holds the transmission of each sample.
override is_dense: bool = false;

@group(1) @binding(3) var<storage, read> plane_waves: array<PlaneWave>;
@group(1) @binding(4) var<storage, read> modulators: array<Modulator>;
@group(1) @binding(5) var<storage, read> opd: array<f32>;  // of each modulator pixel, in strokes
@group(1) @binding(6) var<storage, read> dense: array<vec2f>;  // transmission of each sample

var<private> illumination: PlaneWave;
var<private> modulator: Modulator;

fn begin(line: u32, field: u32) {
    illumination = plane_waves[params.first_wave + field];
    modulator = modulators[params.first_wavelength + field];
}

// Transmission of the modulator pixel, which all its samples share.
fn shared_value(position: vec3u) -> vec2f {
    return phasor(opd[pixel_index(grid, position.y, position.x - grid.offset.y)], modulator);
}

fn load_shared(position: vec3u, pixel: vec2f) -> vec2f {
    let x = position.x - grid.offset.y;
    var value = pixel;
    if (is_dense) {
        value = dense[position.y * grid.shape.y + x];
    }
    if (is_tilted) {
        value = cmul(value, plane_wave(illumination, position.y * wave_step, x * wave_step));
    }
    return select(value, vec2f(0.0), is_padded && x >= grid.shape.y);
}
