// Fields that a kernel reads, writes, or replaces in place, where it finds them.
//#include "frame/rows.wgsl"

@group(1) @binding(0) var<uniform> batch: Batch;
@group(1) @binding(1) var<storage, read_write> target_rows: array<Stored>;

// Sample x of row y of a field.
fn fetched(field: u32, y: u32, x: u32) -> vec2f {
    return restored(target_rows[index_of_sample(batch.source_field + field, y, x)]);
}

fn put(field: u32, y: u32, x: u32, value: vec2f) {
    target_rows[index_of_sample(batch.target_field + field, y, x)] = stored(value);
}
