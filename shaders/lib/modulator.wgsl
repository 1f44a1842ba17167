// A phase modulator: square pixels of constant optical path, given as a fraction of the modulator's stroke.
// `Grid` and `Modulator` are defined in holoview/light/engine/shader_structs.py. Twin: holoview/light/optics/slm.py.
//#include "lib/complex.wgsl"

// Index of the modulator pixel that covers sample (y, x) of the field.
fn pixel_index(grid: Grid, y: u32, x: u32) -> u32 {
    return (y / grid.upsample) * (grid.shape.y / grid.upsample) + x / grid.upsample;
}

// exp(2πi·opd/λ) of an optical path of `strokes` times the stroke.
fn phasor(strokes: f32, modulator: Modulator) -> vec2f {
    return cis(strokes * modulator.stroke_waves);
}
