// Row IFFT → weight·|field|², stored as the intensity or added to it. Hooks of an inverse
// transform along x. Positions are (x on the padded grid, row of the field, field).
//#include "lib/grid.wgsl"

// Whether to add to the stored intensity. A constant, since drivers that execute shaders on the CPU run both sides of
// an `if`.
override accumulates: bool = false;

@group(1) @binding(3) var<storage, read_write> intensity: array<f32>;

fn begin(line: u32, field: u32) {
}

fn load(position: vec3u) -> vec2f {
    return read_sample(position.z, position.y, position.x);
}

fn store(position: vec3u, value: vec2f) {
    let x = position.x - grid.offset.y;
    if (is_padded && x >= grid.shape.y) {
        return;
    }
    let at = (params.target_field + position.z) * intensity_stride + position.y * grid.shape.y + x;
    var sum = params.weight * dot(value, value);
    if (accumulates) {
        sum += intensity[at];
    }
    intensity[at] = sum;
}
