// Where a thread stands on the padded grid. `Grid` comes from holoview/engine/layouts.py:
//   padded, shape, offset: vec2u (y, x) of samples; stride: complex numbers from row to row; upsample: samples a pixel.

fn is_inside(grid: Grid, y: u32, x: u32) -> bool {
    return y >= grid.offset.x && y < grid.offset.x + grid.shape.x && x >= grid.offset.y && x < grid.offset.y + grid.shape.y;
}

fn index_padded(grid: Grid, y: u32, x: u32) -> u32 {
    return y * grid.stride + x;
}

// Fields that a kernel leaves for the next one lie in tiles of 4 × 16 samples, of 32 bytes a row. Four columns of 768
// samples, which a workgroup takes, then fill half of a processor's first cache, and touch a sixteenth of the memory
// pages that they would in rows; lines along x still read whole sectors of 32 bytes.
const TILE_X = 4u;
const TILE_Y = 16u;

// Index of sample x of row y of a field, in a buffer that holds the field's rows alone; stride: of TILE_Y rows.
fn index_in_tiles(grid: Grid, field: u32, y: u32, x: u32) -> u32 {
    let bands = (grid.shape.x + TILE_Y - 1u) / TILE_Y;
    let tile = ((field * bands + y / TILE_Y) * grid.stride) / TILE_X + x / TILE_X;
    return (tile * TILE_Y + y % TILE_Y) * TILE_X + x % TILE_X;
}
