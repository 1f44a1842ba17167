// Intensities of eight pixels, and XYZ of four, as f32 that are read as texels and written as 64-bit integers: the bytes of
// pixels_f32.wgsl. The texels begin with the first intensity that is needed. What is added to is `base` always.
//#include "fft/complex_u64.wgsl"
//#include "lib/texels.wgsl"

@group(1) @binding(0) var intensity: texture_storage_2d<rg32float, read>;
@group(1) @binding(1) var<storage, read_write> xyz: array<vec4<u64>>;
@group(1) @binding(2) var base: texture_storage_2d<rg32float, read>;

fn read_two(at: vec2u, number: u32) -> vec2f {
    return textureLoad(intensity, at + vec2u(number, 0u)).xy;
}

fn read_intensities(octet: u32) -> mat2x4f {
    let at = texel_place(4u * octet);
    return mat2x4f(vec4f(read_two(at, 0u), read_two(at, 1u)), vec4f(read_two(at, 2u), read_two(at, 3u)));
}

fn read_pixel(at: vec2u, number: u32) -> vec3f {
    let xy = textureLoad(base, at + vec2u(2u * number, 0u)).xy;
    return vec3f(xy, textureLoad(base, at + vec2u(2u * number + 1u, 0u)).x);
}

fn read_base(four: u32) -> mat4x3f {
    let at = texel_place(8u * four);
    return mat4x3f(read_pixel(at, 0u), read_pixel(at, 1u), read_pixel(at, 2u), read_pixel(at, 3u));
}

fn read_xyz(four: u32) -> mat4x3f {
    return read_base(four);
}

fn encode_xyz(a: vec3f, b: vec3f) -> vec4<u64> {
    return vec4<u64>(
        encode_complex(a.xy),
        encode_complex(vec2f(a.z, 0.0)),
        encode_complex(b.xy),
        encode_complex(vec2f(b.z, 0.0)),
    );
}

fn write_xyz(four: u32, value: mat4x3f) {
    xyz[2u * four] = encode_xyz(value[0], value[1]);
    xyz[2u * four + 1u] = encode_xyz(value[2], value[3]);
}
