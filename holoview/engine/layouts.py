"""The structs that the stage shaders take, each defined once for both sides; lengths in samples, phases in turns."""

from __future__ import annotations

from holoview.gpu.layout import Struct

GRID = Struct(
    "Grid",
    [
        ("padded", "vec2<u32>"),  # (y, x) of the grid that is transformed
        ("shape", "vec2<u32>"),  # (y, x) of the field inside it
        ("offset", "vec2<u32>"),  # where the field begins
        ("stride", "u32"),  # complex numbers from row to row
        ("upsample", "u32"),  # samples a modulator pixel and axis
    ],
)
WAVE = Struct(
    "Wave",
    [
        ("slope_y", "vec2<u32>"),  # turns a sample: 32 bits and 16 guard bits
        ("slope_x", "vec2<u32>"),
        ("start", "u32"),  # phase of the first sample, 2³² to the turn
    ],
)
LIGHT = Struct("Light", [("waves", "f32")])  # a modulator's stroke in wavelengths
PATH = Struct(
    "Path",
    [
        ("paraxial_y", "vec2<u32>"),  # frac(z·λ/2·df²): 32 bits and 16 guard bits
        ("paraxial_x", "vec2<u32>"),
        ("sine_step2", "vec2<f32>"),  # (λ·df)², (y, x)
        ("waves", "f32"),  # z/λ
    ],
)
SHARE = Struct("Share", [("weight", "f32")])
RESPONSE = Struct("Response", [("xyz", "vec4<f32>")])
