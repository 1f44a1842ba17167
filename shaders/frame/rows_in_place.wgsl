// The fields of a kernel that reads and writes one buffer. Link it after `rows_singles.wgsl` or `rows_fours.wgsl`.

@group(1) @binding(0) var<uniform> params: DispatchParams;
@group(1) @binding(1) var<storage, read_write> target_rows: array<RowElement>;

fn source_element(index: u32) -> RowElement {
    return target_rows[index];
}
