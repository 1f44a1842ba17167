// Intermediate values between the passes of one transform, in a buffer of their own that is read as texels.
//#include "lib/texels.wgsl"

// Complex numbers from one row to the next (padding included), and from one field of the batch to the next.
override work_row_stride: u32;
override work_field_stride: u32;

@group(2) @binding(0) var<storage, read_write> work: array<vec2f>;
@group(2) @binding(1) var work_texels: texture_storage_2d<rg32float, read>;

fn load_work(position: vec3u) -> vec2f {
    let index = position.z * work_field_stride + position.y * work_row_stride + position.x;
    return textureLoad(work_texels, texel_place(index)).xy;
}

fn store_work(position: vec3u, value: vec2f) {
    work[position.z * work_field_stride + position.y * work_row_stride + position.x] = value;
}
