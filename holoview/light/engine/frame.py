"""The sequence of propagation stages from the laser to the intensity, defined once for both executors.

Of two modulators; other chains have other steps of the same kinds, as `Plan.way` lists them:

    illuminate ─▶ modulate 1 ─▶ spectrum ─▶ transmit the gap ─▶ field ─▶ modulate 2 ─▶ spectrum
        spectrum ─┬▶ transmit to z₁ ─▶ field ─▶ |·|²
                  └▶ transmit to z₂ ─▶ …

Frames and sources add incoherently, as intensities. All planes share everything up to the last spectrum.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from holoview.light.model.chain import Modulate, Travel
from holoview.light.model.plan import Plan
from holoview.util.errors import UserError
from holoview.util.progress import StepCallback

Field = TypeVar("Field")
"""A complex field or spectrum in the representation of an executor."""

SPECTRUM = "spectrum"
"""The last of the places that the light of a beam passes (`Modulate.landmark`, `Travel.landmark`)."""


class Propagation(Protocol[Field]):
    """The stages that light passes: the elements of the bench.

    A `Field` covers the modulator's area in space. As a spectrum it has the frequencies of `Plan.band` of the relay
    that follows; no others pass that relay's stops. The field behind the first modulator may be kept as one sample for
    each pixel, from which the other samples follow.

    Arguments are indices of wavelengths, frames, sources, modulators, relays (0: the gap, 1: to a plane) and planes; of
    a chain those of its `Way`: its transmissions and its relays.
    A stage may reuse the memory of its input, except `transmit`, whose input stays valid for the next plane.
    """

    plan: Plan

    def illuminate(self, wavelength: int, source: int) -> Field:
        """The plane wave of unit amplitude that illuminates the first modulator."""

    def modulate(self, field: Field, frame: int, modulator: int, wavelength: int) -> Field:
        """field × exp(2πi·opd/λ), or × the sampled transmission if effects give one; zero outside the modulator."""

    def spectrum(self, field: Field, modulator: int) -> Field:
        """Forward FFT of the zero-padded field behind a modulator, at the frequencies of the next relay's band."""

    def transmit(self, spectrum: Field, relay: int, wavelength: int, plane: int = 0) -> Field:
        """spectrum × transfer function of free space × pupil of the relay, over the gap (0) or to a plane (1)."""

    def field(self, spectrum: Field, relay: int) -> Field:
        """Inverse FFT of the spectrum behind a relay, valid on the modulator's area."""


class Executor(Propagation[Field], Protocol[Field]):
    """All stages of a frame, with the sums of intensities and colours.

    `run` computes all stages of a wavelength with the result of `run_stages`, but may fuse them.

    power_behind: (wavelength,) power behind the last modulator or field and the stops of relay 2, of the wavelengths
    that were run; None where it isn't measured.
    """

    power_behind: NDArray[np.float64] | None

    def run(self, wavelength: int) -> None:
        """Compute each plane's intensity at one wavelength, averaged over frames and sources."""

    def clear(self, plane: int) -> None:
        """Set the intensity of a plane to zero."""

    def accumulate(self, field: Field, plane: int, weight: float) -> None:
        """Add weight·|field|² to the intensity of a plane."""

    def intensity(self, plane: int) -> NDArray[np.floating]:
        """The accumulated intensity of a plane, (y, x)."""

    def clear_xyz(self) -> None:
        """Set the XYZ of all planes to zero."""

    def composite(self, wavelength: int) -> None:
        """Add each plane's intensity at this wavelength, times the observer's response, to its XYZ."""

    def xyz(self) -> NDArray[np.floating]:
        """CIE XYZ (plane, y, x, 3) of the wavelengths composited so far."""


def relay_behind(plan: Plan, modulator: int) -> int:
    """The relay that light enters behind a modulator: 0 for the gap, 1 behind the last modulator."""
    steps = plan.way.steps
    index = next(i for i, step in enumerate(steps) if isinstance(step, Modulate) and step.number == modulator)
    return next((step.relay for step in steps[index + 1 :] if isinstance(step, Travel)), plan.way.last)


def light_along(
    stages: Propagation[Field], wavelength: int, frame: int, source: int, behind: tuple[int, Field] | None = None
) -> Iterator[tuple[str, Field]]:
    """The light at each landmark on its way to the spectrum behind the last element, `SPECTRUM`, which is the last.

    behind: the light behind a step of the way at which an element stands, from where it goes on: the index and the
    field; from the source when None. A field is valid until the next is asked for, where stages reuse memory.
    """
    steps, modulator = stages.plan.way.steps, 0
    if behind is None:
        field = stages.illuminate(wavelength, source)
    else:
        index, field = behind
        passed, steps = steps[index], steps[index + 1 :]
        assert isinstance(passed, Modulate)
        modulator = passed.number
    for step in steps:
        if isinstance(step, Modulate):
            modulator = step.number
            field = stages.modulate(field, frame, modulator, wavelength)
        else:
            spectrum = stages.spectrum(field, modulator)
            field = stages.field(stages.transmit(spectrum, step.relay, wavelength), step.relay)
        yield step.landmark, field
    yield SPECTRUM, stages.spectrum(field, modulator)


def spectrum_behind_modulators(stages: Propagation[Field], wavelength: int, frame: int, source: int) -> Field:
    """The spectrum behind the last modulator, from which every focal plane is computed."""
    *_, (_, spectrum) = light_along(stages, wavelength, frame, source)
    return spectrum


def run_stages(
    executor: Executor[Field], wavelength: int, behind: Callable[[Field, float], None] | None = None
) -> None:
    """Compute the intensities of all planes at one wavelength stage by stage, as `Executor.run` specifies.

    behind: called with the spectrum behind the last modulator of each frame and source, and the weight of its light.
    """
    plan = executor.plan
    for plane in range(len(plan.planes)):
        executor.clear(plane)
    for frame, source in itertools.product(plan.lit(wavelength), range(len(plan.slopes))):
        spectrum, weight = (
            spectrum_behind_modulators(executor, wavelength, frame, source),
            float(plan.weights[frame, wavelength]),
        )
        if behind is not None:
            behind(spectrum, weight)
        for plane in range(len(plan.planes)):
            seen = executor.transmit(spectrum, plan.way.last, wavelength, plane)
            executor.accumulate(executor.field(seen, plan.way.last), plane, weight)


def compute_focal_stack(
    executor: Executor[Field], progress: StepCallback | None = None
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Intensity (plane, wavelength, y, x) at all planes and wavelengths, and CIE XYZ (plane, y, x, 3).

    `progress(done, total)` is called after each wavelength. Raises UserError if the result isn't finite.
    """
    count = len(executor.plan.system.wavelengths_m)
    executor.clear_xyz()
    stacks: list[NDArray[np.floating]] = []
    for wavelength in range(count):
        executor.run(wavelength)
        executor.composite(wavelength)
        stacks.append(np.stack([executor.intensity(plane) for plane in range(len(executor.plan.planes))]))
        if progress is not None:
            progress(wavelength + 1, count)
    intensity, xyz = np.stack(stacks, axis=1), executor.xyz()
    if not (np.isfinite(intensity).all() and np.isfinite(xyz).all()):
        raise UserError("simulation", "the intensity isn't finite", remedy="check the amplitudes for extreme values")
    return intensity, xyz
