// Index of a sample in a buffer of rows, row by row. A single expression: early returns double the time that a driver
// takes to compile the loads and stores of a pass.
//#include "frame/rows.wgsl"

// Index of sample x of row y of a field.
fn index_of_sample(shape: RowLayout, field: u32, y: u32, x: u32) -> u32 {
    return (field * ((shape.rows + TILE_Y - 1u) / TILE_Y * TILE_Y) + y) * shape.stride + x;
}
