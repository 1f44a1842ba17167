"""The structs that Python and WGSL share, each defined once. Lengths are in samples and phases in turns.

The inputs of a frame as shaders read them: a protocol that `holoview.light.optics.frame_inputs` fulfils.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from holoview.light.gpu.shader import WgslStruct
from holoview.light.model.passband import Transfer, column_support, turns_to_fixed_point
from holoview.light.model.plan import Grid, Plan
from holoview.light.numerics.sampling import pixel_spectrum


class DeviceArray(Protocol):
    """A complex array that can be copied to host memory, such as a torch.Tensor."""

    def cpu(self) -> Any:
        """A copy in host memory with a method `numpy()`."""


class ShaderInputs(Protocol):
    """Optical paths, transmissions and pupils of a frame."""

    @property
    def pupils(self) -> Sequence[Sequence[DeviceArray | None]]:
        """pupils[relay][wavelength]: complex (P_y, P_x), or None if the relay neither apodises nor aberrates."""

    @property
    def drives(self) -> Mapping[str, object]:
        """The patterns of a chain by the names of its elements."""

    @property
    def sampled_transmissions(self) -> object | None:
        """None if the transmission of each modulator is exp(2πi·opd/λ) of its pixels."""

    def stroke_fractions(self, frame: int, modulator: int, stroke_m: float) -> NDArray[np.float32]:
        """Optical path of a modulator's pixels divided by the stroke (m), (y, x)."""

    def is_sampled(self, modulator: int) -> bool:
        """Whether a modulator's transmission is given sample by sample."""

    def shown_first(self, frame: int, modulator: int) -> int:
        """The first frame in which a modulator has the same transmission."""

    def transmission(self, frame: int, modulator: int, wavelength: int) -> DeviceArray | None:
        """Complex transmission of a modulator's samples, (y, x); None if it isn't given sample by sample."""


# --- structs ----------------------------------------------------------------------------------------------------------


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
WEIGHT = WgslStruct(
    "Weight",
    [
        ("weight", "f32"),  # factor of the intensity
        ("first", "u32"),  # index of its first sample in a buffer of several
    ],
)
BLEND = WgslStruct(
    "Blend",
    [
        ("octets", "u32"),  # groups of eight pixels in an intensity
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
        ("gain_a", "vec4<f32>"),  # factors of X, Y and Z of image a
        ("gain_b", "vec4<f32>"),
        ("origin", "vec2<f32>"),  # (x, y) of the viewport's corner, as fractions of the image's size
        ("step", "vec2<f32>"),  # from one pixel to the next, as fractions of the image's size
        ("size_a", "vec2<u32>"),  # (x, y) samples of image a
        ("size_b", "vec2<u32>"),
        ("size", "vec2<u32>"),  # (x, y) pixels of the viewport
        ("split", "f32"),  # pixels left of the boundary in the comparison "wipe"
        ("gamma", "f32"),
    ],
)
"""Used by the viewer (holoview/viewer/app/viewport.py)."""


# --- values from a plan -----------------------------------------------------------------------------------------------


UniformValues = dict[str, object]
"""Values of a struct by the names of its fields, for `WgslStruct.pack`."""


def plane_wave_uniform(plan: Plan, wavelength: int, source: int) -> UniformValues:
    """Values of `PlaneWave`: the illumination by a source, with phase 0 at the centre of the field."""
    slopes = plan.slopes[source, wavelength]
    rows, columns = plan.grid.shape
    # Products are rounded before they are added, as in `bench.js`: a dot product may not round them.
    offset_turns = -float(slopes[0] * ((rows - 1) / 2) + slopes[1] * ((columns - 1) / 2))
    return {
        "slope_y": turns_to_fixed_point(slopes[0]),
        "slope_x": turns_to_fixed_point(slopes[1]),
        "phase_offset": turns_to_fixed_point(offset_turns)[0],
    }


def modulator_uniform(plan: Plan, modulator: int, wavelength: int) -> UniformValues:
    """Values of `Modulator`: stroke/λ; 1 of a chain, whose transmissions are given sample by sample."""
    if plan.way.is_chain:
        return {"stroke_waves": 1.0}
    stroke_m = plan.system.modulators[modulator].stroke_m
    return {"stroke_waves": stroke_m / float(plan.system.wavelengths_m[wavelength])}


def propagation_uniform(step: Transfer) -> UniformValues:
    """Values of `Propagation`: free space over the distance of a relay."""
    words = step.paraxial_words()
    return {
        "paraxial_y": words[0],
        "paraxial_x": words[1],
        "sine_step2": [sine * sine for sine in step.sine_step],
        "shift": [turns_to_fixed_point(turns)[0] for turns in step.shift_turns],
        "distance_waves": step.waves,
    }


def support_table(step: Transfer, grid: Grid) -> NDArray[np.int32]:
    """The support of a relay by columns, as the shaders' vec4i: (P_x, 4) int32 in `fftfreq` order.

    Smallest |k_y|, lowest k_y and highest k_y that pass in a column, and 0.
    """
    return np.pad(column_support(step.support, grid.padded[1]), ((0, 0), (0, 1)))


def pixel_spectra(plan: Plan, wavelength: int, source: int) -> NDArray[np.complex64]:
    """Spectra of one pixel in a plane wave along y, then along x, (P_y + P_x,) in the order of numpy.fft."""
    grid, slopes = plan.grid, plan.slopes[source, wavelength]
    spectra = [pixel_spectrum(n, grid.upsample, float(slope)) for n, slope in zip(grid.padded, slopes, strict=True)]
    return np.concatenate(spectra).astype(np.complex64)


def dense_transmission(
    inputs: ShaderInputs, frame: int, modulators: Sequence[int], wavelength: int
) -> NDArray[np.complex64]:
    """Transmission (y, x) of a modulator that is given sample by sample; of several the product of theirs."""
    product: Any = 1.0
    for modulator in modulators:
        samples = inputs.transmission(frame, modulator, wavelength)
        assert samples is not None
        product = product * samples.cpu().numpy()
    return np.ascontiguousarray(product.astype(np.complex64))


def complex64(samples: DeviceArray) -> NDArray[np.complex64]:
    """An array in host memory, in single precision."""
    host: NDArray[np.complex64] = samples.cpu().numpy().astype(np.complex64)
    return host
