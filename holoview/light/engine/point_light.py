"""The light through one point of the image: sections along the axis, its directions, and its origins.

`section_steps`     the light in the planes x–z and y–z through the point
`point_steps`       the angles that reach the point; the lasers, diffraction orders and areas of modulators that lit it

The field of a laser at a sample p is linear in the field v behind each modulator, u(p) = Σ_q w(q)·v(q). The weights w
are a row of the matrix of propagation, and follow from the transposed propagation of a 1 at p, backwards along the way:

    w₂ = Fᵀ·(H₂·F⁻ᵀ·δ_p),   w₁ = F₁ᵀ·(H₁·F₁⁻ᵀ·(t₂·w₂)),   …

with the transmission t₂ of the second modulator and the transfer functions H of gap and plane. The contributions w·v of
each modulator add up to the field at p, and so do those of the diffraction orders, which are parts of the spectrum
behind the last element. An eye, effects and several frames and directions of the source are taken into account.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.light.engine.frame import light_along, spectrum_behind_modulators
from holoview.light.engine.torch_executor import TorchExecutor, TorchField
from holoview.light.model.chain import Travel
from holoview.light.model.elements import Pixels
from holoview.light.model.plan import Beam, make_plan
from holoview.light.model.system import System
from holoview.light.optics.chain import ChainTransmissions
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.util.memory_limit import require_memory

_PADDED_ARRAYS = 6  # of the padded grid that are in memory at a time, at most

Place = tuple[int, int]
"""Row and column of a sample of the image."""


# --- sections ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Sections:
    """The light in the planes x–z and y–z through a sample, as far as it is computed.

    planes_m: (plane,) nominal distances, rising. xz: (plane, x, 3) and yz: (plane, y, 3), XYZ of the intensity. A plane
    that isn't computed yet shows the nearest computed plane. share: of the planes that are computed; 0: nothing yet.
    """

    planes_m: NDArray[np.float64]
    xz: NDArray[np.float32]
    yz: NDArray[np.float32]
    share: float


def section_steps(
    system: System, drive: Any, planes_m: NDArray[np.float64], place: Place, lasers: Sequence[int]
) -> Iterator[Sections]:
    """The sections through a sample, better after each plane: first every 2ⁿ-th plane, then the planes between.

    planes_m: (plane,) nominal, rising. lasers: indices of those that are on. Each plane takes two lines of a transform.
    Raises UserError as `make_plan` and `FrameInputs` do, and when memory doesn't suffice for the spectra.
    """
    plan = make_plan(system, planes_m)
    executor, beams = TorchExecutor(plan, FrameInputs(plan, drive)), plan.beams(lasers)
    needed = (
        len(beams) * math.prod(plan.band(plan.way.last).shape) * 8 + _PADDED_ARRAYS * math.prod(plan.grid.padded) * 8
    )
    require_memory("sections", needed, remedy="show fewer lasers or frames")
    rows, columns = plan.grid.shape
    xz, yz = np.zeros((len(planes_m), columns, 3), np.float32), np.zeros((len(planes_m), rows, 3), np.float32)
    done, spectra = np.zeros(len(planes_m), bool), []
    for beam in beams:
        behind = spectrum_behind_modulators(executor, beam.wavelength, beam.frame, beam.source)
        spectra.append((beam, behind.values))
        yield Sections(planes_m, xz, yz, 0.0)
    for index in _coarse_to_fine(len(planes_m)):
        for wavelength in sorted({beam.wavelength for beam in beams}):
            transfer = executor.derived_transfer(plan.way.last, wavelength, index)
            for beam, spectrum in spectra:
                if beam.wavelength == wavelength:
                    lines = executor.transforms[plan.way.last].inverse_lines(spectrum * transfer, *place)
                    for picture, line in zip((xz, yz), lines, strict=True):
                        intensity = beam.weight * line.abs().square().numpy()
                        picture[index] += intensity[:, None] * plan.colour_weights[wavelength]
        done[index] = True
        nearest = np.abs(np.arange(len(planes_m))[:, None] - np.flatnonzero(done)).argmin(axis=1)
        shown = np.flatnonzero(done)[nearest]
        yield Sections(planes_m, xz[shown], yz[shown], float(done.mean()))


def _coarse_to_fine(count: int) -> list[int]:
    """All indices below a count: every 2ⁿ-th index, then the middles between, and so on."""
    stride = 1 << max(count - 1, 1).bit_length()
    order: list[int] = []
    while stride:
        order += [index for index in range(0, count, stride) if index not in order]
        stride //= 2
    return order


# --- one point --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PointLight:
    """The light of a sample of the image, as far as it is computed; intensities are means over frames and directions.

    wavelengths_m, intensities: (laser,) of the nominal system, and their light there; xyz: (3,) its colour.
    orders: {(y, x): share of the field there} of each diffraction order of the last element's pixels. Shares add up
    to 1; a share below 0 cancels others. They are means over beams, weighted by their intensity.
    areas: for each modulator XYZ (y, x, 3) of |w·v|², the power of the contributions of its samples.
    directions: XYZ (v, v, 3) of the power spectrum of the field around the sample in a Hann window `window` samples
    wide, by spatial frequency; 0 is in the middle, one step is `frequency_step`, 1/m.
    pitch_m: of the samples. share: of the lasers that are computed.
    """

    place: Place
    wavelengths_m: NDArray[np.float64]
    intensities: NDArray[np.float64]
    xyz: NDArray[np.float64]
    orders: dict[tuple[int, int], float]
    areas: tuple[NDArray[np.float32], ...]
    directions: NDArray[np.float32]
    window: int
    frequency_step: float
    pitch_m: float
    share: float


def point_steps(
    system: System, drive: Any, plane_m: float, place: Place, lasers: Sequence[int], window: int = 64
) -> Iterator[PointLight]:
    """The light of a sample of the image in a nominal focal plane, better after each beam.

    lasers: indices of those that are on. window: samples across the window of the local spectrum.
    Raises UserError as `make_plan` and `FrameInputs` do.
    """
    plan = make_plan(system, [*system.planes_m, plane_m])  # all planes: padding that follows from them stays the same
    require_memory("the light of a point", _PADDED_ARRAYS * math.prod(plan.grid.padded) * 16, remedy="lower padding")
    executor = TorchExecutor(plan, FrameInputs(plan, drive), double=True)
    beams, shape = plan.beams(lasers), plan.grid.shape
    intensities, xyz, total = np.zeros(len(system.wavelengths_m)), np.zeros(3), 0.0
    areas = [np.zeros((*shape, 3), np.float32) for _ in system.drive_shapes]
    directions, orders = np.zeros((window, window, 3), np.float32), dict[tuple[int, int], float]()
    for number, beam in enumerate(beams, start=1):
        found = beam_at_point(executor, beam, len(plan.planes) - 1, place)
        colour = plan.colour_weights[beam.wavelength]
        intensity = beam.weight * abs(found.field) ** 2
        intensities[plan.laser_of(beam.wavelength)] += intensity
        xyz += intensity * colour
        total += intensity
        for order, part in found.orders.items():
            share = beam.weight * (part * found.field.conjugate()).real
            orders[order] = orders.get(order, 0.0) + share
        for area, contribution in zip(areas, found.contributions, strict=True):
            area += (beam.weight * np.square(np.abs(contribution)))[..., None] * colour
        around = local_spectrum(found.around, place, window)
        directions += (beam.weight * np.square(np.abs(around)))[..., None] * colour
        yield PointLight(
            place=place,
            wavelengths_m=system.wavelengths_m,
            intensities=intensities.copy(),
            xyz=xyz.copy(),
            orders={order: value / total for order, value in sorted(orders.items())} if total else {},
            areas=tuple(area.copy() for area in areas),
            directions=directions.copy(),
            window=window,
            frequency_step=1 / (window * plan.grid.pitch_m),
            pitch_m=plan.grid.pitch_m,
            share=number / len(beams),
        )


@dataclass(frozen=True, eq=False)
class BeamAtPoint:
    """One beam at a sample: its field, complex; the parts of it by diffraction order; the contributions (y, x) of the
    samples of each modulator; the field (y, x) of the whole plane. Parts, and contributions of each, add up to it."""

    field: complex
    orders: dict[tuple[int, int], complex]
    contributions: tuple[NDArray[np.complex128], ...]
    around: NDArray[np.complex128]


def beam_at_point(executor: TorchExecutor, beam: Beam, plane: int, place: Place) -> BeamAtPoint:
    """The light of a beam at a sample (row, column) of a focal plane, with its parts and contributions."""
    way, wavelength = executor.plan.way, beam.wavelength
    transform, (*behind, (_, last)) = (
        executor.transforms[way.last],
        light_along(executor, wavelength, beam.frame, beam.source),
    )
    spectrum, transfer = last.values, executor.derived_transfer(way.last, wavelength, plane)
    around = transform.inverse(spectrum * transfer)
    at_place = transfer * transform.at_sample(*place)
    weights, contributions = transform.forward_transposed(at_place), list[NDArray[np.complex128]]()
    for step, (_, field) in zip(reversed(way.steps), reversed(behind), strict=True):
        if isinstance(step, Travel):
            relay, response = executor.transforms[step.relay], executor.derived_transfer(step.relay, wavelength)
            weights = relay.forward_transposed(response * relay.inverse_transposed(weights))
            continue
        if way.is_chain and way.transmissions[step.number].beside:
            number = way.steps.index(step)
            before = behind[number - 1][1] if number else None
            contributions[:0] = _of_arms(executor, beam, step.number, weights, before)
        elif not way.is_chain or getattr(way.transmissions[step.number].element, "is_driven", False):
            contributions.insert(0, weights.numpy() * executor.download_field(field))
        ones = TorchField(torch.ones_like(weights))
        weights = weights * executor.modulate(ones, beam.frame, step.number, wavelength).values
    parts = _by_order(executor, beam, (spectrum * at_place).numpy())
    return BeamAtPoint(complex(around[place]), parts, tuple(contributions), around.numpy())


def _of_arms(
    executor: TorchExecutor, beam: Beam, number: int, weights: torch.Tensor, before: TorchField | None
) -> list[NDArray[np.complex128]]:
    """The contributions (y, x) of each modulator of those that stand beside each other.

    weights (y, x): of the light behind them. before: the light that falls on them; that of the source when None.
    """
    transmissions, of = executor.inputs.sampled_transmissions, executor.plan.way.transmissions[number]
    assert isinstance(transmissions, ChainTransmissions)
    if before is None:
        wave = executor.illuminate(beam.wavelength, beam.source).values
        before = TorchField(transmissions.source_light(wave, beam.wavelength))
    arms = zip((of.element, *of.beside), transmissions.arms(beam.frame, number, beam.wavelength), strict=True)
    light = weights.numpy() * executor.download_field(before)
    return [light * arm.numpy() for element, arm in arms if getattr(element, "is_driven", False)]


def _by_order(executor: TorchExecutor, beam: Beam, parts: NDArray[np.complex128]) -> dict[tuple[int, int], complex]:
    """Sums of the parts (rows, columns) of a spectrum's frequencies by diffraction order (y, x) of the last pixels.

    Order n has the frequencies |u − s/λ − n/pitch| ≤ 1/(2·pitch), with the direction sine s of the illumination, which
    is 0 behind a Fourier plane.
    """
    plan, way = executor.plan, executor.plan.way
    slopes = np.zeros(2) if way.kernels else plan.slopes[beam.source, beam.wavelength]
    pixels = [of.element for of in way.transmissions if isinstance(of.element, Pixels)]
    size = round(pixels[-1].pitch_m / way.sample_m) if pixels else plan.grid.upsample
    numbers = [
        np.floor((k / padded - float(slope)) * size + 0.5).astype(int)
        for k, padded, slope in zip(executor.frequencies(way.last), plan.grid.padded, slopes, strict=True)
    ]
    sums = {}
    for row in np.unique(numbers[0]):
        for column in np.unique(numbers[1]):
            part = parts[np.ix_(numbers[0] == row, numbers[1] == column)]
            if np.any(part):
                sums[int(row), int(column)] = complex(part.sum())
    return sums


def local_spectrum(field: NDArray[np.complex128], place: Place, window: int) -> NDArray[np.complex128]:
    """The spectrum (window, window) of a field (y, x) in a Hann window around a sample, 0 in the middle.

    Its power adds up to that of the windowed field. Outside the field it is dark.
    """
    half = window // 2
    padded = np.pad(field, half)
    row, column = place
    cut = padded[row : row + window, column : column + window]  # whose sample `half` is the place
    hann = np.square(np.cos(np.pi * (np.arange(window) - half) / window))
    return np.asarray(np.fft.fftshift(np.fft.fft2(np.fft.ifftshift(cut * hann[:, None] * hann), norm="ortho")))
