// Access to the fields of a kernel that reads one buffer and writes another, so that its input stays valid.
//#include "frame/rows.wgsl"

@group(1) @binding(0) var<uniform> params: DispatchParams;
@group(1) @binding(1) var<storage, read_write> source_rows: array<StoredComplex>;
@group(1) @binding(2) var<storage, read_write> target_rows: array<StoredComplex>;

// Sample x of row y of field number `field` of the dispatch.
fn read_sample(field: u32, y: u32, x: u32) -> vec2f {
    return decode_complex(source_rows[index_of_sample(source_layout, params.source_field + field, y, x)]);
}

fn write_sample(field: u32, y: u32, x: u32, value: vec2f) {
    target_rows[index_of_sample(target_layout, params.target_field + field, y, x)] = encode_complex(value);
}
