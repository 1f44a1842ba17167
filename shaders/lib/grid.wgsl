// Where a thread stands on the padded grid. `Grid` comes from holoview/engine/shader_structs.py:
//   padded, shape, offset: vec2u (y, x) of samples; stride: complex numbers from row to row; upsample: samples a pixel.

fn is_inside(grid: Grid, y: u32, x: u32) -> bool {
    return y >= grid.offset.x && y < grid.offset.x + grid.shape.x && x >= grid.offset.y && x < grid.offset.y + grid.shape.y;
}

fn index_padded(grid: Grid, y: u32, x: u32) -> u32 {
    return y * grid.stride + x;
}
