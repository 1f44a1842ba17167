// Row IFFT → weight·|field|², stored as the intensity or added to it. Hooks of an inverse
// transform along x. Positions are (x on the padded grid, row of the field, field).
//#include "lib/grid.wgsl"

// Whether to add to the stored intensity. A constant, since drivers that execute shaders on the CPU run both sides of
// an `if`.
override accumulates: bool = false;

fn begin(line: u32, field: u32) {
}

// Index of sample (y, x) of the field in the buffer of intensities.
fn index_of_intensity(field: u32, y: u32, x: u32) -> u32 {
    let row = (params.target_field + field) * intensity_stride + y * grid.shape.y;
    return row + lane_point + (x - lane_point);
}
