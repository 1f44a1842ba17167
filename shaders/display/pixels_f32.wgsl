// Intensities of eight pixels, and XYZ of four, as f32.

@group(1) @binding(0) var<storage, read> intensity: array<vec4f>;
@group(1) @binding(1) var<storage, read_write> xyz: array<vec4f>;
@group(1) @binding(2) var<storage, read> base: array<vec4f>;

fn read_intensities(octet: u32) -> mat2x4f {
    return mat2x4f(intensity[2u * octet], intensity[2u * octet + 1u]);
}

fn read_xyz(four: u32) -> mat4x3f {
    let i = 4u * four;
    return mat4x3f(xyz[i].xyz, xyz[i + 1u].xyz, xyz[i + 2u].xyz, xyz[i + 3u].xyz);
}

fn read_base(four: u32) -> mat4x3f {
    let i = 4u * four;
    return mat4x3f(base[i].xyz, base[i + 1u].xyz, base[i + 2u].xyz, base[i + 3u].xyz);
}

fn write_xyz(four: u32, value: mat4x3f) {
    xyz[4u * four] = vec4f(value[0], 0.0);
    xyz[4u * four + 1u] = vec4f(value[1], 0.0);
    xyz[4u * four + 2u] = vec4f(value[2], 0.0);
    xyz[4u * four + 3u] = vec4f(value[3], 0.0);
}
