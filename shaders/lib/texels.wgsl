// Complex numbers of a buffer that were copied to a texture: see holoview/light/gpu/texels.py.

const TEXEL_COLUMNS = 8192u;

// Where number `index` stands in a texture.
fn texel_place(index: u32) -> vec2u {
    return vec2u(index % TEXEL_COLUMNS, index / TEXEL_COLUMNS);
}
