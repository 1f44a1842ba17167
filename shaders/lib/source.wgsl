// The illumination: plane waves. `Wave` comes from holoview/engine/shader_structs.py. Twin: holoview/optics/source.py.
//#include "lib/complex.wgsl"
//#include "lib/fixed.wgsl"

// exp(2πi·(s_y·y + s_x·x)) at sample (y, x) of the field, zero phase at its centre.
fn plane_wave(wave: Wave, y: u32, x: u32) -> vec2f {
    return cis_fixed(wave.start + turns_times(y, wave.slope_y) + turns_times(x, wave.slope_x));
}
