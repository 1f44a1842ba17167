"""Fields that a bench can show: far images brought near, samples of one pitch along y and x.

A bench propagates by the angular spectrum in the field's own window. A field whose light leaves this window before its
image is brought there, in a window that holds it: by the exact angular spectrum, beside the axis and wider as need be,
or farther away by one Fresnel or Fourier transform. Planes count from there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.fields.field_bench import lit_field
from holoview.holograms.fields.propagation import MethodChoice, choose_method, own_window, propagate_field
from holoview.holograms.fields.wavefield import Wavefield
from holoview.holograms.files.request import Propagation, WindowRequest
from holoview.light.model.field_band import EQUAL_AMPLITUDES, line_spectrum
from holoview.light.model.validity import LEAST_IN_PICTURE
from holoview.light.optics.free_space import Pair, SampleWindow
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.memory_limit import require_memory

_AT_EDGES = -0.25  # balance between the middle (1) and the edges (−1) of an axis; ±0.02 of light spread at random
_NEAR_EDGE, _LEAST_AT_EDGE = 0.4, 0.05  # of an axis from its middle; share of the light beyond it on either side
_FAR_MEANS = 64  # along a side of a far field
_FILLED = (0.04, 0.9)
_LEAST_EDGES = 0.03
_MOST_SAMPLES = 16384  # along a side of the window of a far image
_STEEPEST = 0.99  # direction sine of light whose way is bounded
_TAIL = 0.002  # of the light on either side of a window along an axis, which it doesn't hold
_MOST_WINDOW = 4.5  # samples of an exact window in those of the field: twice its side along both axes, and a little


def split_axes(field: Wavefield, imaged: ImagedField) -> tuple[bool, bool]:
    """Along which axes (y, x) the image is split in two, as of light that alternates from sample to sample.

    imaged: of `image_field`; where its window isn't one first order, the field's spectrum is looked at. Light that goes
    around the edges of that window, or of the samples' band, has Σ I·cos(2πk/N)/ΣI near −1, k counted from the middle;
    light around the middle has it near 1, and light that is spread evenly 0. Split light stands at both edges: light
    near one of them alone has a known direction. Along both axes it is an image in four pieces at the corners.
    """
    power = _power(imaged.field.values) if imaged.is_far else np.fft.fftshift(_power(np.fft.fft2(field.values)))
    total = float(power.sum()) or 1.0
    split = []
    for axis, n in enumerate(power.shape):
        along, place = power.sum(axis=1 - axis) / total, (np.arange(n) - n // 2) / n
        at_edges = min(float(along[place > _NEAR_EDGE].sum()), float(along[place < -_NEAR_EDGE].sum()))
        split.append(float(along @ np.cos(2 * np.pi * place)) <= _AT_EDGES and at_edges >= _LEAST_AT_EDGE)
    return split[0], split[1]


def has_phases_alone(field: Wavefield) -> bool:
    """Whether all samples of the field have the same amplitude, as the pattern of a phase modulator has."""
    amplitude = np.abs(field.values)
    return bool(amplitude.max() - amplitude.min() <= EQUAL_AMPLITUDES * amplitude.max())


def has_far_image(field: Wavefield) -> bool:
    """Whether the far field of a pattern of phases, without its middle, looks like a picture.

    Means over a 64th of a side, or eight samples, which average the speckles out, fill between a twenty-fifth and nine
    tenths of the far field, (Σm)²/(N·Σm²); a near image of a rough object fills it evenly, that of a smooth object its
    middle alone. Neighbours among them differ as in pictures with edges: by at least 3 % of the variance.
    """
    power = np.fft.fftshift(_power(np.fft.fft2(field.values)))
    middle = tuple(slice(max(n // 2 - 2, 0), n // 2 + 3) for n in power.shape)
    power[middle] = np.median(power)
    blocks = [min(max(8, n // _FAR_MEANS), n) for n in power.shape]
    rows, columns = (n // block for n, block in zip(power.shape, blocks, strict=True))
    cut = power[: rows * blocks[0], : columns * blocks[1]]
    means = cut.reshape(rows, blocks[0], columns, blocks[1]).mean(axis=(1, 3), dtype=np.float64)
    if not means.sum() > 0:
        return False
    means /= means.mean()
    speckles = math.prod(blocks)
    square = float(np.square(means).mean()) / (1 + 1 / speckles)
    steps = sum(float(np.square(np.diff(means, axis=axis)).mean()) for axis in (0, 1)) / 4 - square / speckles
    return _FILLED[0] <= 1 / square <= _FILLED[1] and steps >= _LEAST_EDGES * (square - 1)


def in_lens(field: Wavefield) -> Wavefield:
    """The field at the distance of a lens in whose focal plane the shortest wavelength's far field has its own size."""
    shortest_m = float(field.wavelengths_m.min())
    return replace(
        field, distance_m=max(n * p**2 for n, p in zip(field.shape, field.pitch_m, strict=True)) / shortest_m
    )


def _power(values: NDArray[np.complexfloating]) -> NDArray[np.floating]:
    """The power (y, x) of values (frame, wavelength, y, x), summed over frames and wavelengths."""
    return (np.square(values.real) + np.square(values.imag)).sum(axis=(0, 1))


def with_square_pitch(field: Wavefield) -> tuple[Wavefield, str]:
    """The field at samples of its smaller pitch along y and x, and a sentence that says so; empty if nothing was done.

    It is the sum over the frequencies of its samples, evaluated at other places: exact for a field that the samples
    determine. Sharp edges of its window ring. Raises UserError for more samples than a bench may have.
    """
    pitch_m = min(field.pitch_m)
    if np.isclose(*field.pitch_m, rtol=1e-6):
        return field, ""
    shape = (round(field.shape[0] * field.pitch_m[0] / pitch_m), round(field.shape[1] * field.pitch_m[1] / pitch_m))
    own = " × ".join(units.format_rounded(pitch, "um") for pitch in field.pitch_m)
    if max(shape) > _MOST_SAMPLES:
        found = f"{own} (y, x), at one pitch {shape[1]} × {shape[0]} samples"
        raise UserError("pitch", found, expected=f"at most {_MOST_SAMPLES} along a side")
    require_memory("field", field.values.size // math.prod(field.shape) * math.prod(shape) * 32)
    lit = replace(field, values=lit_field(field), reference_radius_m=None)
    seen = propagate_field(lit, 0.0, "asm", SampleWindow(shape, (pitch_m, pitch_m)))
    values = seen.values.numpy().astype(np.complex64)
    note = f"its pitch of {own} (y, x) was resampled to {units.format_rounded(pitch_m, 'um')}, by its spectrum"
    return replace(lit, values=values, pitch_m=(pitch_m, pitch_m)), note


@dataclass(frozen=True, eq=False)
class ImagedField:
    """A field as a bench can show it. Made by `image_field`.

    note: a sentence that says what was done; empty if nothing was done. light: the share of the field's light that is
    in it, 0…1. is_far: whether it was brought to its image by one transform, whose window is one first order.
    """

    field: Wavefield
    note: str = ""
    light: float = 1.0
    is_far: bool = False


def image_field(
    field: Wavefield,
    propagation: Propagation = "auto",
    asked: WindowRequest | None = None,
    whole: Wavefield | None = None,
) -> ImagedField:
    """The field as a bench can show it: in its own plane, or brought to its image, from which planes then count.

    propagation: "auto" leaves the field in its plane where its own window holds nine tenths of the light at its
    distance. Where light leaves it, but not beyond the limits of `choose_method`, the field is brought to its image in
    the window that holds its light, by the exact angular spectrum, if this has up to four times the field's samples;
    else by one transform, as beyond the limits. "asm" leaves the field in its plane; the other methods bring it to its
    distance.
    asked: the window in which the image is seen, by the method that `choose_method` gives for it, or by `propagation`.
    whole: the field of which this one is a part, the rest being dark; it decides, so that the image stays in its place.

    Raises UserError as `choose_method` does, for a window at the distance 0, and for one of too many samples.
    """
    distance_m = field.distance_m
    if asked is not None:
        window = _asked_window(field, asked)
        return _moved(field, choose_method(field, distance_m, propagation, window))
    choice, exact = choose_method(whole or field, distance_m, propagation), None
    if propagation == "auto" and distance_m != 0 and field.reference_radius_m is None:
        choice, exact = _holding_choices(whole or field, choice)
    if choice.method == "asm" and (propagation == "asm" or choice.window == own_window(field)):
        return ImagedField(field)
    moved = None if exact is None else _moved(field, exact)
    if moved is not None and (exact is choice or moved.light >= LEAST_IN_PICTURE):
        return moved
    return _moved(field, choice)


def _moved(field: Wavefield, choice: MethodChoice) -> ImagedField:
    """The field at its distance, in the window of a choice, at one pitch."""
    window, pitch_m = choice.window, min(choice.window.pitch_m)
    rows, columns = (min(max(round(side / pitch_m), 2), _MOST_SAMPLES) for side in window.side_m)
    window = replace(window, shape=(rows, columns), pitch_m=(pitch_m, pitch_m))
    require_memory("field", field.values.size // math.prod(field.shape) * rows * columns * 32)
    seen = propagate_field(field, field.distance_m, choice.method, window)
    values = seen.values.numpy().astype(np.complex64)
    there = Wavefield(values, (pitch_m, pitch_m), field.wavelengths_m, name=field.name)
    power, whole = (float(_power(f.values).sum(dtype=np.float64)) * math.prod(f.pitch_m) for f in (there, field))
    how = {"fresnel": "one Fresnel transform", "fourier": "one Fourier transform"}.get(choice.method, "its spectrum")
    place = "" if choice.method != "asm" else f" in a window of {columns} × {rows} samples"
    if window.centre_m != (0.0, 0.0):
        y, x = (units.format_rounded(c, "mm") for c in window.centre_m)
        place += f" around x {x}, y {y} beside the axis"
    distance = units.format_rounded(field.distance_m, "mm")
    note = f"brought {distance} to its image by {how}{place} ({choice.reason}); planes count from there"
    return ImagedField(there, note, min(power / whole, 1.0) if whole > 0 else 1.0, choice.method != "asm")


def _asked_window(field: Wavefield, asked: WindowRequest) -> SampleWindow:
    """The window of a request; the field's own side and pitch, and the axis, where it says nothing."""
    if field.distance_m == 0:
        raise UserError("window", "of a field without a distance", expected="a distance to its image other than 0")
    own = own_window(field)
    pitch_m = (asked.pitch_m, asked.pitch_m) if asked.pitch_m else own.pitch_m
    sides = asked.side_m or own.side_m
    rows, columns = (round(side / pitch) for side, pitch in zip(sides, pitch_m, strict=True))
    if not all(2 <= n <= _MOST_SAMPLES for n in (rows, columns)):
        found = f"{columns} × {rows} samples"
        raise UserError("window", found, expected=f"2 to {_MOST_SAMPLES} along a side")
    return SampleWindow((rows, columns), pitch_m, asked.centre_m)


# --- the window that holds the light ----------------------------------------------------------------------------------


def _holding_choices(field: Wavefield, plain: MethodChoice) -> tuple[MethodChoice, MethodChoice | None]:
    """The choice that holds the light at the field's distance, and the exact one of the same light, if it is small.

    plain: of `choose_method`, which stays where its window holds nine tenths of the light, and far away unless
    Fresnel's integral would misplace the light. Rays tell whether light may leave: the frequencies that hold the light,
    times the distance. If so, the light is measured by the angular spectrum in all places that rays reach, or where
    these are many, in one first order by a Fresnel transform. One first order also holds light of finer fringes than
    the samples' band, which the angular spectrum takes for light of other directions.
    """
    own, ways = own_window(field), _ways_m(field)
    steepest = max(abs(way) / math.hypot(way, field.distance_m) for span in ways for way in span)
    sample_sine = min(float(field.wavelengths_m.min()) / side for side in own.side_m)
    if plain.method == "fresnel" and steepest**3 / 2 <= sample_sine:  # z·(tan θ − sin θ) within a sample of the picture
        return plain, None
    lost = sum(max(abs(low), abs(high)) / side for (low, high), side in zip(ways, own.side_m, strict=True))
    if plain.method == "asm" and lost <= 1 - LEAST_IN_PICTURE:  # of an evenly lit field
        return plain, None
    spans = [_span(low - side / 2, high + side / 2) for (low, high), side in zip(ways, own.side_m, strict=True)]
    reached = _window_of(field, spans)
    if plain.method == "asm" and reached.centre_m == (0.0, 0.0) and has_phases_alone(field):
        return plain, None  # of a modulator's pattern, the rest is light that it couldn't shape
    measured = MethodChoice("asm", plain.reason, reached)
    if math.prod(reached.shape) > _MOST_WINDOW * math.prod(field.shape):
        try:
            measured = choose_method(field, field.distance_m, "fresnel")
        except UserError:  # its chirp isn't sampled
            return plain, None
    power = _power(propagate_field(field, field.distance_m, measured.method, measured.window).values.numpy())
    at = [measured.window.positions_m(axis) for axis in (0, 1)]
    inside = [np.abs(place) <= side / 2 for place, side in zip(at, own.side_m, strict=True)]
    total = float(power.sum(dtype=np.float64))
    share = float(power[np.ix_(*inside)].sum(dtype=np.float64)) / total if total > 0 else 1.0
    if plain.method == "asm" and share >= LEAST_IN_PICTURE:
        return plain, None
    reason = f"its own window would hold {100 * share:.2g}% of its light"
    held = [_holding_span(place, power.sum(axis=1 - axis)) for axis, place in enumerate(at)]
    exact = MethodChoice("asm", reason, _window_of(field, held))
    if measured.method == "asm":
        return exact, exact
    pitch_m = max(2 * half / n for (_, half), n in zip(held, field.shape, strict=True))
    cut = MethodChoice(measured.method, reason, _window_of(replace(field, pitch_m=(pitch_m, pitch_m)), held))
    return cut, exact if math.prod(exact.window.shape) <= _MOST_WINDOW * math.prod(field.shape) else None


def _ways_m(field: Wavefield) -> list[Pair]:
    """How far the light moves sideways along y and x over the field's distance, from and to."""
    ways = []
    squares = [_power(field.values[:, i : i + 1]) for i in range(len(field.wavelengths_m))]
    for axis in (0, 1):
        ends = []
        for index, wavelength_m in enumerate(field.wavelengths_m.tolist()):
            frequencies, power = line_spectrum(field.values[:, index], axis, squares[index])
            middle, half = _holding_span(frequencies / field.pitch_m[axis], power)
            sines = [min(max(wavelength_m * f, -_STEEPEST), _STEEPEST) for f in (middle - half, middle + half)]
            ends += [field.distance_m * s / math.sqrt(1 - s * s) for s in sines]
        ways.append((min(ends), max(ends)))
    return ways


def _span(low: float, high: float) -> Pair:
    """Middle and half width."""
    return (low + high) / 2, (high - low) / 2


def _holding_span(places: NDArray[np.float64], power: NDArray[np.floating]) -> Pair:
    """Middle and half width of the part of an axis that holds the light but for a tail on either side."""
    summed = power.cumsum(dtype=np.float64)
    low, high = np.searchsorted(summed, [_TAIL * summed[-1], (1 - _TAIL) * summed[-1]])
    step = places[1] - places[0] if len(places) > 1 else 0.0
    return _span(float(places[low]) - step, float(places[min(int(high), len(places) - 1)]) + step)


def _window_of(field: Wavefield, spans: Sequence[Pair]) -> SampleWindow:
    """The window of samples on the field's own grid that holds a span along y and one along x.

    It is around the axis where the span's middle is nearer to the axis than to its ends.
    """
    counts, centres = [], []
    for (middle, half), n, pitch in zip(spans, field.shape, field.pitch_m, strict=True):
        if abs(middle) < half / 2:
            middle, half = 0.0, abs(middle) + half
        count = max(2, math.ceil(2 * half / pitch))
        counts.append(count + (count - n) % 2)
        centres.append(round(middle / pitch) * pitch)
    return SampleWindow((counts[0], counts[1]), field.pitch_m, (centres[0], centres[1]))
