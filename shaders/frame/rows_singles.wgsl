// Access to stored rows sample by sample.

alias RowElement = StoredComplex;

// Sample x of row y of field number `field` of the dispatch.
fn read_sample(field: u32, y: u32, x: u32) -> vec2f {
    return decode_complex(source_element(index_of_sample(source_layout, params.source_field + field, y, x)));
}

fn write_sample(field: u32, y: u32, x: u32, value: vec2f) {
    target_rows[index_of_sample(target_layout, params.target_field + field, y, x)] = encode_complex(value);
}
