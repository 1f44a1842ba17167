"""The structs that the stage shaders take, each defined once for both sides; lengths in samples, phases in turns."""

from __future__ import annotations

from holoview.gpu.wgsl_struct import WgslStruct

GRID = WgslStruct(
    "Grid",
    [
        ("padded", "vec2<u32>"),  # (y, x) of the grid that is transformed
        ("shape", "vec2<u32>"),  # (y, x) of the field inside it
        ("offset", "vec2<u32>"),  # where the field begins
        ("stride", "u32"),  # complex numbers from row to row, before rows are cut into tiles
        ("upsample", "u32"),  # samples a modulator pixel and axis
    ],
)
PLANE_WAVE = WgslStruct(
    "Wave",
    [
        ("slope_y", "vec2<u32>"),  # turns a sample: 32 bits and 16 guard bits
        ("slope_x", "vec2<u32>"),
        ("start", "u32"),  # phase of the first sample, 2³² to the turn
    ],
)
MODULATOR = WgslStruct("Light", [("waves", "f32")])  # a modulator's stroke in wavelengths
PROPAGATION = WgslStruct(
    "Path",
    [
        ("paraxial_y", "vec2<u32>"),  # frac(z·λ/2·df²): 32 bits and 16 guard bits
        ("paraxial_x", "vec2<u32>"),
        ("sine_step2", "vec2<f32>"),  # (λ·df)², (y, x)
        ("waves", "f32"),  # z/λ
    ],
)
DISPATCH_PARAMS = WgslStruct(
    "Batch",
    [
        ("wave", "u32"),  # number of the first field's illumination
        ("wavelength", "u32"),  # number of the first field's wavelength; the fields that follow have those that follow
        ("source_field", "u32"),  # where the first field is read
        ("target_field", "u32"),  # where it is written
        ("work_field", "u32"),  # where it lies between the shaders of one transform
        ("weight", "f32"),  # of the intensity
    ],
)
WEIGHT = WgslStruct("Weight", [("weight", "f32")])
BLEND = WgslStruct(
    "Blend",
    [
        ("quads", "u32"),  # fours of pixels in an intensity
        ("count", "u32"),  # intensities that are blended
    ],
)
BLEND_TERM = WgslStruct(
    "Share", [("xyz", "vec3<f32>"), ("slice", "u32")]
)  # of one intensity: its weight and where it is
SRGB_ENCODING = WgslStruct(
    "Screen",
    [
        ("from_x", "vec4<f32>"),  # linear sRGB of X, of Y and of Z, exposure included
        ("from_y", "vec4<f32>"),
        ("from_z", "vec4<f32>"),
        ("width", "u32"),  # pixels
        ("pitch", "u32"),  # pixels from row to row of the picture
    ],
)
VIEWPORT = WgslStruct(
    "Viewport",
    [
        ("first", "vec4<f32>"),  # of XYZ: exposed channel = dot(xyz) + w, black 0 to white 1
        ("second", "vec4<f32>"),
        ("third", "vec4<f32>"),
        ("background", "vec4<f32>"),  # 8-bit sRGB / 255
        ("origin", "vec2<f32>"),  # (x, y) of the corner, in shares of the image
        ("step", "vec2<f32>"),  # from pixel to pixel, in shares of the image
        ("size_a", "vec2<u32>"),  # (x, y) samples of an image
        ("size_b", "vec2<u32>"),
        ("size", "vec2<u32>"),  # (x, y) pixels that are shown
        ("gain_a", "f32"),  # of the light of an image
        ("gain_b", "f32"),
        ("split", "f32"),  # pixels left of the wipe
        ("gamma", "f32"),
    ],
)
