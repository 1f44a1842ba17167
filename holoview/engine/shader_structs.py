"""The structs that Python and WGSL share, each defined once. Lengths are in samples and phases in turns."""

from __future__ import annotations

from holoview.gpu.wgsl_struct import WgslStruct

GRID = WgslStruct(
    "Grid",
    [
        ("padded", "vec2<u32>"),  # (y, x) samples of the padded grid
        ("shape", "vec2<u32>"),  # (y, x) samples of the field inside it
        ("offset", "vec2<u32>"),  # (y, x) of the first sample of the field
        ("stride", "u32"),  # complex numbers from one row to the next (without tiles)
        ("upsample", "u32"),  # samples for each modulator pixel, along either axis
    ],
)
PLANE_WAVE = WgslStruct(
    "PlaneWave",
    [
        ("slope_y", "vec2<u32>"),  # turns per sample: 32 bits and 16 guard bits
        ("slope_x", "vec2<u32>"),
        ("phase_offset", "u32"),  # phase of the first sample, in 2⁻³² turns
    ],
)
MODULATOR = WgslStruct("Modulator", [("stroke_waves", "f32")])  # stroke/λ
PROPAGATION = WgslStruct(
    "Propagation",
    [
        ("paraxial_y", "vec2<u32>"),  # frac(z·λ/2·df²) in turns: 32 bits and 16 guard bits
        ("paraxial_x", "vec2<u32>"),
        ("sine_step2", "vec2<f32>"),  # (λ·df)², (y, x): squared direction sine of the first frequency bin
        ("shift", "vec2<u32>"),  # phase of a displaced picture between frequencies (y, x), in 2⁻³² turns
        ("distance_waves", "f32"),  # z/λ
    ],
)
DISPATCH_PARAMS = WgslStruct(
    "DispatchParams",
    [
        ("first_wave", "u32"),  # index of the first field's plane wave
        ("first_wavelength", "u32"),  # index of the first field's wavelength; the further fields have the next ones
        ("source_field", "u32"),  # index of the first field in the buffer that is read
        ("target_field", "u32"),  # index of the first field in the buffer that is written
        ("work_field", "u32"),  # index of the first field in the buffer of intermediate values
        ("weight", "f32"),  # factor of the intensity
    ],
)
WEIGHT = WgslStruct("Weight", [("weight", "f32")])  # factor of the intensity
BLEND = WgslStruct(
    "Blend",
    [
        ("quads", "u32"),  # groups of four pixels in an intensity
        ("count", "u32"),  # number of blend terms
    ],
)
BLEND_TERM = WgslStruct(
    "BlendTerm",
    [
        ("xyz", "vec3<f32>"),  # XYZ of unit intensity
        ("intensity_index", "u32"),  # of the intensity in its buffer
    ],
)
SRGB_ENCODING = WgslStruct(
    "SrgbEncoding",
    [
        ("x_to_rgb", "vec4<f32>"),  # linear sRGB of X = 1, of Y = 1 and of Z = 1, exposure included
        ("y_to_rgb", "vec4<f32>"),
        ("z_to_rgb", "vec4<f32>"),
        ("width", "u32"),  # pixels of a row
        ("pitch", "u32"),  # pixels from one row to the next in the sRGB image
    ],
)
VIEWPORT = WgslStruct(
    "Viewport",
    [
        ("channel_r", "vec4<f32>"),  # exposed channel = dot(channel.xyz, XYZ) + channel.w, from 0 (black) to 1 (white)
        ("channel_g", "vec4<f32>"),
        ("channel_b", "vec4<f32>"),
        ("background", "vec4<f32>"),  # sRGB code / 255
        ("origin", "vec2<f32>"),  # (x, y) of the viewport's corner, as fractions of the image's size
        ("step", "vec2<f32>"),  # from one pixel to the next, as fractions of the image's size
        ("size_a", "vec2<u32>"),  # (x, y) samples of image a
        ("size_b", "vec2<u32>"),
        ("size", "vec2<u32>"),  # (x, y) pixels of the viewport
        ("gain_a", "f32"),  # factor of the XYZ of image a
        ("gain_b", "f32"),
        ("split", "f32"),  # pixels left of the boundary in the comparison "wipe"
        ("gamma", "f32"),
    ],
)
"""Used by the viewer (holoview/app/viewport.py)."""
