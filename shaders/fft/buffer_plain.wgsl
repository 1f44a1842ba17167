// Reads a complex number of the buffer of a plain FFT.

fn read_value(index: u32) -> vec2f {
    return decode_complex(values[index]);
}
