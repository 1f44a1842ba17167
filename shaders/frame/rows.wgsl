// Where a sample of a field lies that one kernel leaves for the next: in rows, or in tiles of 4 × 16 samples.
//#include "lib/grid.wgsl"

// Tiles suit a subgroup that takes a whole line. Four columns of 768 samples, which are a workgroup's, fill half of a
// processor's first cache and touch a sixteenth of the memory pages that they would in rows; lines along x still read
// whole sectors of 32 bytes. `is_tiled` comes from holoview/engine/kernels.py.
const TILE_X = 4u;
const TILE_Y = 16u;

// Index of sample x of row y of a field, in a buffer that holds the field's rows alone.
fn index_of_sample(field: u32, y: u32, x: u32) -> u32 {
    let bands = (grid.shape.x + TILE_Y - 1u) / TILE_Y;
    if (!is_tiled) {
        return (field * bands * TILE_Y + y) * grid.stride + x;
    }
    let tile = ((field * bands + y / TILE_Y) * grid.stride) / TILE_X + x / TILE_X;
    return (tile * TILE_Y + y % TILE_Y) * TILE_X + x % TILE_X;
}
