// Reads stored rows of a buffer sample by sample. Link it after `rows_in_place.wgsl` or `rows_two_buffers.wgsl`.

// Sample x of row y of field number `field` of the dispatch.
fn read_sample(field: u32, y: u32, x: u32) -> vec2f {
    return decode_complex(source_element(index_of_sample(source_layout, params.source_field + field, y, x)));
}
