// A phase modulator: square pixels of constant optical path, given in strokes of the modulator.
// `Grid` and `Light` come from holoview/engine/shader_structs.py. Twin: holoview/optics/slm.py.
//#include "lib/complex.wgsl"

// Number of the modulator pixel under sample (y, x) of the field.
fn pixel_under(grid: Grid, y: u32, x: u32) -> u32 {
    return (y / grid.upsample) * (grid.shape.y / grid.upsample) + x / grid.upsample;
}

// exp(2πi·opd/λ)
fn phasor(strokes: f32, light: Light) -> vec2f {
    return cis(strokes * light.waves);
}
