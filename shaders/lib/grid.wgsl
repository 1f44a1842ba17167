// Where a thread stands on the padded grid. `Grid` comes from holoview/engine/layouts.py:
//   padded, shape, offset: vec2u (y, x) of samples; stride: complex numbers from row to row; upsample: samples a pixel.

fn is_inside(grid: Grid, y: u32, x: u32) -> bool {
    return y >= grid.offset.x && y < grid.offset.x + grid.shape.x && x >= grid.offset.y && x < grid.offset.y + grid.shape.y;
}

fn index_padded(grid: Grid, y: u32, x: u32) -> u32 {
    return y * grid.stride + x;
}

// Index of sample x of a row of the field, in a buffer that holds the field's rows alone.
fn index_in_rows(grid: Grid, field: u32, y: u32, x: u32) -> u32 {
    return field * (grid.shape.x * grid.stride) + y * grid.stride + x;
}
