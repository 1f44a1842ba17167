// Kernel 5 of a frame: row IFFT → weight·|field|², set or added to. Hooks of an inverse transform along x.
//#include "lib/grid.wgsl"

// Whether it is added to: a switch, as drivers that run shaders on the processor go through both sides of an `if`.
override adds: bool = false;

@group(1) @binding(3) var<storage, read_write> intensity: array<f32>;

fn begin(line: u32, field: u32) {
}

fn load(position: vec3u) -> vec2f {
    return fetched(position.z, position.y, position.x);
}

fn store(position: vec3u, value: vec2f) {
    let x = position.x - grid.offset.y;
    if (is_padded && x >= grid.shape.y) {
        return;
    }
    let at = (batch.target_field + position.z) * slice_pixels + position.y * grid.shape.y + x;
    var sum = batch.weight * dot(value, value);
    if (adds) {
        sum += intensity[at];
    }
    intensity[at] = sum;
}
