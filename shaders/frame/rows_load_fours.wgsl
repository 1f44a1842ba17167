// Input of a transform along x: four neighbouring samples of a stored row, from texels.

fn load_four(position: vec3u) -> mat4x2f {
    let at = texel_place(index_of_sample(source_layout, position.z, position.y, position.x));
    return mat4x2f(
        textureLoad(source_texels, at).xy,
        textureLoad(source_texels, at + vec2u(1u, 0u)).xy,
        textureLoad(source_texels, at + vec2u(2u, 0u)).xy,
        textureLoad(source_texels, at + vec2u(3u, 0u)).xy,
    );
}
