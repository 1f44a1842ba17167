// Indices on the padded grid. `Grid` is defined in holoview/light/engine/shader_structs.py; its pairs are (y, x):
//   padded, shape: samples of the padded grid, and of the field inside it; offset: first sample of the field
//   stride: complex numbers from one row to the next; upsample: samples for each modulator pixel, along either axis

// Whether sample (y, x) of the padded grid belongs to the field.
fn is_inside(grid: Grid, y: u32, x: u32) -> bool {
    let end = grid.offset + grid.shape;
    return y >= grid.offset.x && y < end.x && x >= grid.offset.y && x < end.y;
}

// Index of sample (y, x) of the padded grid in a buffer.
fn index_padded(grid: Grid, y: u32, x: u32) -> u32 {
    return y * grid.stride + x;
}
