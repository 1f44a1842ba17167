// Input and output of a transform along x: four neighbouring samples of a stored row at a time, each a 64-bit integer.
// A driver that executes shaders on the CPU turns each access into a loop over the lanes of a vector.

alias RowElement = vec4<u64>;

fn load_four(position: vec3u) -> mat4x2f {
    let field = params.source_field + position.z;
    let four = source_element(index_of_sample(source_layout, field, position.y, position.x) / 4u);
    return mat4x2f(decode_complex(four.x), decode_complex(four.y), decode_complex(four.z), decode_complex(four.w));
}
