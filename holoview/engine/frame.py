"""The graph of stages, written once for both executors.

    illuminate ─▶ modulate 1 ─▶ spectrum ─▶ transmit the gap ─▶ field ─▶ modulate 2 ─▶ spectrum
        spectrum ─┬▶ transmit to z₁ ─▶ field ─▶ |·|²
                  └▶ transmit to z₂ ─▶ …

Frames and sources add in intensity. Everything up to the last spectrum is shared by all planes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from holoview.model.plan import Plan
from holoview.util.errors import UserError

Field = TypeVar("Field")
ProgressCallback = Callable[[int, int], None]


class Executor(Protocol[Field]):
    """The stages of a frame. A `Field` is complex: on the modulator's area in space, on the padded grid as a spectrum.

    A stage may reuse the storage of its input, except `transmit`, whose input stays valid for the next plane.
    `run` does all stages of a wavelength, in the order of `run_stages`, and may fuse them.
    """

    plan: Plan

    def run(self, wavelength: int) -> None:
        """Leaves each plane's intensity at one wavelength in the executor, averaged over frames and sources."""

    def illuminate(self, wavelength: int, source: int) -> Field:
        """The plane wave that falls on the first modulator."""

    def modulate(self, field: Field, frame: int, modulator: int, wavelength: int) -> Field:
        """field × exp(2πi·opd/λ), zero outside the modulator."""

    def spectrum(self, field: Field) -> Field:
        """Forward FFT of the zero-padded field."""

    def transmit(self, spectrum: Field, relay: int, wavelength: int, distance_m: float) -> Field:
        """spectrum × H × pupil."""

    def field(self, spectrum: Field) -> Field:
        """Inverse FFT, valid on the modulator's area."""

    def clear(self, plane: int) -> None:
        """Sets the intensity of a plane to zero."""

    def accumulate(self, field: Field, plane: int, weight: float) -> None:
        """Adds weight·|field|² to the intensity of a plane."""

    def intensity(self, plane: int) -> NDArray[np.floating]:
        """The accumulated intensity of a plane, (y, x)."""

    def clear_xyz(self) -> None:
        """Sets what the observer sees to black."""

    def composite(self, wavelength: int) -> None:
        """Adds each plane's intensity, at this wavelength, to what the observer sees."""

    def xyz(self) -> NDArray[np.floating]:
        """What the observer sees, XYZ (plane, y, x, 3)."""


def spectrum_behind_modulators(executor: Executor[Field], wavelength: int, frame: int, source: int) -> Field:
    """The spectrum behind the last modulator: what every focal plane is computed from."""
    system = executor.plan.system
    field = executor.modulate(executor.illuminate(wavelength, source), frame, 0, wavelength)
    if system.gap_m is not None:
        spectrum = executor.transmit(executor.spectrum(field), 0, wavelength, system.gap_m)
        field = executor.modulate(executor.field(spectrum), frame, 1, wavelength)
    return executor.spectrum(field)


def run_stages(executor: Executor[Field], wavelength: int) -> None:
    """What `run` of an executor does, one stage after the other."""
    plan = executor.plan
    planes = range(len(plan.planes_m))
    for plane in planes:
        executor.clear(plane)
    for frame in plan.lit(wavelength):
        for source in range(len(plan.slopes)):
            spectrum = spectrum_behind_modulators(executor, wavelength, frame, source)
            for plane in planes:
                seen = executor.field(executor.transmit(spectrum, 1, wavelength, float(plan.planes_m[plane])))
                executor.accumulate(seen, plane, float(plan.weights[frame, wavelength]))


def compute_focal_stack(
    executor: Executor[Field], progress: ProgressCallback | None = None
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Intensity (plane, wavelength, y, x) of a whole frame, and XYZ (plane, y, x, 3) that the observer sees.

    `progress(done, total)` is called after each wavelength. Raises UserError when the result isn't finite.
    """
    count = len(executor.plan.system.wavelengths_m)
    executor.clear_xyz()
    stacks: list[NDArray[np.floating]] = []
    for wavelength in range(count):
        executor.run(wavelength)
        executor.composite(wavelength)
        stacks.append(np.stack([executor.intensity(plane) for plane in range(len(executor.plan.planes_m))]))
        if progress is not None:
            progress(wavelength + 1, count)
    intensity, xyz = np.stack(stacks, axis=1), executor.xyz()
    if not (np.isfinite(intensity).all() and np.isfinite(xyz).all()):
        raise UserError("simulation", "the intensity isn't finite", remedy="check the amplitudes for extreme values")
    return intensity, xyz
