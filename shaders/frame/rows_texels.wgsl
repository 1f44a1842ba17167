// The fields of a kernel that reads texels and writes a buffer. The fields that are read are the texture's first ones.
// Link it after `rows_singles.wgsl` or `rows_fours.wgsl`.
//#include "lib/texels.wgsl"

@group(1) @binding(0) var<uniform> params: DispatchParams;
@group(1) @binding(1) var source_texels: texture_storage_2d<rg32float, read>;
@group(1) @binding(2) var<storage, read_write> target_rows: array<RowElement>;

// Sample x of row y of field number `field` of the dispatch.
fn read_sample(field: u32, y: u32, x: u32) -> vec2f {
    return textureLoad(source_texels, texel_place(index_of_sample(source_layout, field, y, x))).xy;
}
