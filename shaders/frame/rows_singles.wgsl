// Access to stored rows sample by sample.

alias RowElement = StoredComplex;

fn write_sample(field: u32, y: u32, x: u32, value: vec2f) {
    target_rows[index_of_sample(target_layout, params.target_field + field, y, x)] = encode_complex(value);
}
