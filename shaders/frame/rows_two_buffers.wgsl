// The fields of a kernel that reads one buffer and writes another, so that its input stays valid. Link it after
// `rows_singles.wgsl` or `rows_fours.wgsl`.

@group(1) @binding(0) var<uniform> params: DispatchParams;
@group(1) @binding(1) var<storage, read_write> source_rows: array<RowElement>;
@group(1) @binding(2) var<storage, read_write> target_rows: array<RowElement>;

fn source_element(index: u32) -> RowElement {
    return source_rows[index];
}
