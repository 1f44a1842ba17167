// Where a thread stands on the padded grid. `Grid` comes from holoview/engine/layouts.py:
//   padded, shape, offset: vec2u (y, x) of samples; stride: complex numbers from row to row; upsample: samples a pixel.

fn is_inside(grid: Grid, y: u32, x: u32) -> bool {
    return y >= grid.offset.x && y < grid.offset.x + grid.shape.x && x >= grid.offset.y && x < grid.offset.y + grid.shape.y;
}

fn index_padded(grid: Grid, y: u32, x: u32) -> u32 {
    return y * grid.stride + x;
}

// Fields that a kernel leaves for the next one lie in tiles of 8 × 8 samples, of 64 bytes a row: lines along y then
// touch an eighth of the memory pages that they would in rows, and lines along x still read whole cache lines.
const TILE = 8u;

// Index of sample x of row y of a field, in a buffer that holds the field's rows alone; stride: of 8 rows, an eighth.
fn index_in_tiles(grid: Grid, field: u32, y: u32, x: u32) -> u32 {
    let bands = (grid.shape.x + TILE - 1u) / TILE;
    return ((field * bands + y / TILE) * grid.stride + (x / TILE) * TILE + y % TILE) * TILE + x % TILE;
}
