// Reads a complex number of the buffer of a plain FFT, as a texel.
//#include "lib/texels.wgsl"

@group(1) @binding(1) var value_texels: texture_storage_2d<rg32float, read>;

fn read_value(index: u32) -> vec2f {
    return textureLoad(value_texels, texel_place(index)).xy;
}
