// Kernel 3 of a frame: row IFFT × modulator 2 → row FFT. Hooks of a transform along x, backwards and forwards.
//#include "lib/modulator.wgsl"
//#include "lib/grid.wgsl"

@group(1) @binding(3) var<storage, read> lights: array<Light>;
@group(1) @binding(4) var<storage, read> opd: array<f32>;

var<private> light: Light;

fn begin(line: u32, field: u32) {
    light = lights[batch.wavelength + field];
}

fn load(position: vec3u) -> vec2f {
    return fetched(position.z, position.y, position.x);
}

fn middle(position: vec3u, value: vec2f) -> vec2f {
    let x = position.x - grid.offset.y;
    if (is_padded && x >= grid.shape.y) {
        return vec2f(0.0);
    }
    return cmul(value, phasor(opd[pixel_under(grid, position.y, x)], light));
}

fn store(position: vec3u, value: vec2f) {
    put(position.z, position.y, position.x, value);
}
