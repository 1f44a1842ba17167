// Kernel 1 of a frame: source × modulator 1 → row FFT. Hooks of a transform along x.
//#include "lib/source.wgsl"
//#include "lib/modulator.wgsl"
//#include "lib/grid.wgsl"

override is_tilted: bool = true;

@group(1) @binding(0) var<uniform> batch: Batch;
@group(1) @binding(1) var<storage, read> waves: array<Wave>;
@group(1) @binding(2) var<storage, read> lights: array<Light>;
@group(1) @binding(3) var<storage, read> opd: array<f32>;
@group(1) @binding(4) var<storage, read_write> target_rows: array<Stored>;

var<private> wave: Wave;
var<private> light: Light;

fn begin(line: u32, field: u32) {
    wave = waves[batch.wave + field];
    light = lights[batch.wavelength + field];
}

fn load(position: vec3u) -> vec2f {
    let x = position.x - grid.offset.y;
    if (is_padded && x >= grid.shape.y) {
        return vec2f(0.0);
    }
    let value = phasor(opd[pixel_under(grid, position.y, x)], light);
    if (is_tilted) {
        return cmul(value, plane_wave(wave, position.y, x));
    }
    return value;
}

fn store(position: vec3u, value: vec2f) {
    target_rows[index_in_rows(grid, batch.target_field + position.z, position.y, position.x)] = stored(value);
}
