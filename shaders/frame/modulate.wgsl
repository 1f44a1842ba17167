// Kernel 3 of a frame: row IFFT × modulator 2 → row FFT. Hooks of a transform along x, backwards and forwards.
//#include "lib/modulator.wgsl"
//#include "lib/grid.wgsl"

@group(1) @binding(0) var<uniform> batch: Batch;
@group(1) @binding(1) var<storage, read> lights: array<Light>;
@group(1) @binding(2) var<storage, read> opd: array<f32>;
@group(1) @binding(3) var<storage, read> source_rows: array<Stored>;
@group(1) @binding(4) var<storage, read_write> target_rows: array<Stored>;

var<private> light: Light;

fn begin(line: u32, field: u32) {
    light = lights[batch.wavelength + field];
}

fn load(position: vec3u) -> vec2f {
    return restored(source_rows[index_in_rows(grid, batch.source_field + position.z, position.y, position.x)]);
}

fn middle(position: vec3u, value: vec2f) -> vec2f {
    let x = position.x - grid.offset.y;
    if (is_padded && x >= grid.shape.y) {
        return vec2f(0.0);
    }
    return cmul(value, phasor(opd[pixel_under(grid, position.y, x)], light));
}

fn store(position: vec3u, value: vec2f) {
    target_rows[index_in_rows(grid, batch.target_field + position.z, position.y, position.x)] = stored(value);
}
