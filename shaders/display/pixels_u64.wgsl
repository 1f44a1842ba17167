// Intensities of eight pixels, and XYZ of four, as f32 that are read and written as 64-bit integers: the bytes of
// pixels_f32.wgsl. A driver that executes shaders on the CPU turns each access into a loop over the lanes of a vector.
//#include "fft/complex_u64.wgsl"

@group(1) @binding(0) var<storage, read> intensity: array<vec4<u64>>;
@group(1) @binding(1) var<storage, read_write> xyz: array<vec4<u64>>;
@group(1) @binding(2) var<storage, read> base: array<vec4<u64>>;

fn decode_four(low: u64, high: u64) -> vec4f {
    return vec4f(decode_complex(low), decode_complex(high));
}

fn decode_xyz(ab: vec4<u64>, cd: vec4<u64>) -> mat4x3f {
    return mat4x3f(
        decode_four(ab.x, ab.y).xyz,
        decode_four(ab.z, ab.w).xyz,
        decode_four(cd.x, cd.y).xyz,
        decode_four(cd.z, cd.w).xyz,
    );
}

fn encode_xyz(a: vec3f, b: vec3f) -> vec4<u64> {
    return vec4<u64>(
        encode_complex(a.xy),
        encode_complex(vec2f(a.z, 0.0)),
        encode_complex(b.xy),
        encode_complex(vec2f(b.z, 0.0)),
    );
}

fn read_intensities(octet: u32) -> mat2x4f {
    let eight = intensity[octet];
    return mat2x4f(decode_four(eight.x, eight.y), decode_four(eight.z, eight.w));
}

fn read_xyz(four: u32) -> mat4x3f {
    return decode_xyz(xyz[2u * four], xyz[2u * four + 1u]);
}

fn read_base(four: u32) -> mat4x3f {
    return decode_xyz(base[2u * four], base[2u * four + 1u]);
}

fn write_xyz(four: u32, value: mat4x3f) {
    xyz[2u * four] = encode_xyz(value[0], value[1]);
    xyz[2u * four + 1u] = encode_xyz(value[2], value[3]);
}
