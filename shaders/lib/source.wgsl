// Illumination by plane waves. `PlaneWave` is defined in holoview/light/engine/shader_structs.py.
// Twin: holoview/light/optics/bench.py.
//#include "lib/complex.wgsl"
//#include "lib/fixed.wgsl"

// exp(2πi·(s_y·y + s_x·x)) at sample (y, x) of the field, with slopes s in turns per sample and phase 0 at the centre.
fn plane_wave(wave: PlaneWave, y: u32, x: u32) -> vec2f {
    return cis_fixed(wave.phase_offset + multiply_turns(y, wave.slope_y) + multiply_turns(x, wave.slope_x));
}
