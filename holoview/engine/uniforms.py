"""What the shaders are told of a plan: the values of their structs, and the stops of each column of frequencies."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from holoview.model.plan import Grid, Plan, Transfer, turns_to_fixed_point

if TYPE_CHECKING:
    from holoview.optics.frame_inputs import AnyFrameInputs

UniformValues = dict[str, object]


def plane_wave_uniform(plan: Plan, wavelength: int, source: int) -> UniformValues:
    """`Wave`: the illumination by a source."""
    slopes = plan.slopes[source, wavelength]
    start = -float(np.dot(slopes, [(n - 1) / 2 for n in plan.grid.shape]))
    return {
        "slope_y": turns_to_fixed_point(slopes[0]),
        "slope_x": turns_to_fixed_point(slopes[1]),
        "start": turns_to_fixed_point(start)[0],
    }


def modulator_uniform(plan: Plan, modulator: int, wavelength: int) -> UniformValues:
    """`Light`: a modulator's stroke in wavelengths."""
    return {"waves": plan.system.modulators[modulator].stroke_m / float(plan.system.wavelengths_m[wavelength])}


def propagation_uniform(step: Transfer) -> UniformValues:
    """`Path`: free-space propagation."""
    words = step.paraxial_words()
    sine_step2 = [sine * sine for sine in step.sine_step]
    return {"paraxial_y": words[0], "paraxial_x": words[1], "sine_step2": sine_step2, "waves": step.waves}


def column_support(step: Transfer, grid: Grid) -> NDArray[np.int32]:
    """Smallest and largest |k_y| that passes for each |k_x| = 0 … P_x/2, (P_x/2 + 1, 2); the largest is −1 for none.

    The same frequencies as the plan's rows of (smallest, largest) |k_x|, neither of which rises with |k_y|: irises and
    blocks are round, the band limit is a rectangle.
    """
    py, px = grid.padded
    smallest, largest = step.support[: py // 2 + 1].T
    kx = np.arange(px // 2 + 1)
    first = len(smallest) - np.searchsorted(smallest[::-1], kx, side="right")
    end = len(largest) - np.searchsorted(largest[::-1], kx, side="left")
    return np.stack([first, end - 1], axis=1).astype(np.int32)


def dense_transmission(inputs: AnyFrameInputs, frame: int, modulator: int, wavelength: int) -> NDArray[np.complex64]:
    """Transmission of a modulator's samples (y, x), where effects give it one."""
    samples = inputs.transmission(frame, modulator, wavelength)
    assert samples is not None
    return np.ascontiguousarray(samples.cpu().numpy().astype(np.complex64))
