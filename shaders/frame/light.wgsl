// Kernel 1 of a frame: source × modulator 1 → row FFT. Hooks of a transform along x.
//#include "lib/source.wgsl"
//#include "lib/modulator.wgsl"
//#include "lib/grid.wgsl"

override is_tilted: bool = true;
override is_dense: bool = false;

@group(1) @binding(3) var<storage, read> waves: array<Wave>;
@group(1) @binding(4) var<storage, read> lights: array<Light>;
@group(1) @binding(5) var<storage, read> opd: array<f32>;
@group(1) @binding(6) var<storage, read> dense: array<vec2f>;  // transmission of samples, in place of the pixels'

var<private> wave: Wave;
var<private> light: Light;

fn begin(line: u32, field: u32) {
    wave = waves[batch.wave + field];
    light = lights[batch.wavelength + field];
}

// What the samples of a modulator's pixel have in common.
fn joint(position: vec3u) -> vec2f {
    return phasor(opd[pixel_under(grid, position.y, position.x - grid.offset.y)], light);
}

fn load_with(position: vec3u, pixel: vec2f) -> vec2f {
    let x = position.x - grid.offset.y;
    if (is_padded && x >= grid.shape.y) {
        return vec2f(0.0);
    }
    var value = pixel;
    if (is_dense) {
        value = dense[position.y * grid.shape.y + x];
    }
    if (is_tilted) {
        return cmul(value, plane_wave(wave, position.y, x));
    }
    return value;
}

fn store(position: vec3u, value: vec2f) {
    put(position.z, position.y, position.x, value);
}
