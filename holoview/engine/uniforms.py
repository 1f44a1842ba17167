"""Converts the numbers of a plan to the values of the shader structs, and the support of a relay to columns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from holoview.engine.shader_inputs import ShaderInputs
from holoview.model.passband import column_support
from holoview.model.plan import Grid, Plan
from holoview.model.transfer import Transfer, turns_to_fixed_point
from holoview.numerics.pixel_spectrum import pixel_spectrum

UniformValues = dict[str, object]
"""Values of a struct by the names of its fields, for `WgslStruct.pack`."""


def plane_wave_uniform(plan: Plan, wavelength: int, source: int) -> UniformValues:
    """Values of `PlaneWave`: the illumination by a source, with phase 0 at the centre of the field."""
    slopes = plan.slopes[source, wavelength]
    offset_turns = -float(np.dot(slopes, [(n - 1) / 2 for n in plan.grid.shape]))
    return {
        "slope_y": turns_to_fixed_point(slopes[0]),
        "slope_x": turns_to_fixed_point(slopes[1]),
        "phase_offset": turns_to_fixed_point(offset_turns)[0],
    }


def modulator_uniform(plan: Plan, modulator: int, wavelength: int) -> UniformValues:
    """Values of `Modulator`: stroke/λ."""
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


def dense_transmission(inputs: ShaderInputs, frame: int, modulator: int, wavelength: int) -> NDArray[np.complex64]:
    """Transmission (y, x) of a modulator that is given sample by sample."""
    samples = inputs.transmission(frame, modulator, wavelength)
    assert samples is not None
    return np.ascontiguousarray(samples.cpu().numpy().astype(np.complex64))
