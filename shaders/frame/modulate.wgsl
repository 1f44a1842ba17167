// Kernel 3 of a frame: row IFFT × modulator 2 → row FFT. Hooks of a transform along x, backwards and forwards.
//#include "lib/modulator.wgsl"
//#include "lib/grid.wgsl"

override is_dense: bool = false;

@group(1) @binding(3) var<storage, read> lights: array<Light>;
@group(1) @binding(4) var<storage, read> opd: array<f32>;
@group(1) @binding(5) var<storage, read> dense: array<vec2f>;  // transmission of samples, in place of the pixels'

var<private> light: Light;

fn begin(line: u32, field: u32) {
    light = lights[batch.wavelength + field];
}

fn load(position: vec3u) -> vec2f {
    return fetched(position.z, position.y, position.x);
}

// What the samples of a modulator's pixel have in common.
fn joint(position: vec3u) -> vec2f {
    return phasor(opd[pixel_under(grid, position.y, position.x - grid.offset.y)], light);
}

fn middle_with(position: vec3u, value: vec2f, pixel: vec2f) -> vec2f {
    let x = position.x - grid.offset.y;
    if (is_padded && x >= grid.shape.y) {
        return vec2f(0.0);
    }
    if (is_dense) {
        return cmul(value, dense[position.y * grid.shape.y + x]);
    }
    return cmul(value, pixel);
}

fn store(position: vec3u, value: vec2f) {
    put(position.z, position.y, position.x, value);
}
