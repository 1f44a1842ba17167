"""Numbers that follow from a chain of elements, as text: each element, how far light moves sideways, its étendue."""

from __future__ import annotations

import math

import numpy as np

from holoview.light.model.chain import pixel_shape
from holoview.light.model.elements import (
    AmplitudeModulator,
    ComplexModulator,
    Element,
    Fourier,
    Lens,
    Mask,
    PhaseModulator,
    Pixels,
    Space,
)
from holoview.light.model.masks import mask_values
from holoview.light.model.system import System
from holoview.util import units


def element_lines(system: System) -> list[tuple[str, str]]:
    """The name of each element of a system, and what it is, in the order of the light."""
    lines, pitch_m = list[tuple[str, str]](), math.inf
    for index, (name, element) in enumerate(zip(system.element_names, system.elements, strict=True)):
        if isinstance(element, Pixels):
            pitch_m = min(pitch_m, element.pitch_m)
        is_last = index == len(system.elements) - 1
        lines.append((f"{index + 1}. {name}", _describe(element, system, pitch_m, is_last)))
    return lines


def reach_m(system: System, distance_m: float, pitch_m: float) -> float:
    """How far light of the first order of a pitch moves sideways over a distance, at the longest wavelength, m."""
    sine = min(0.999, float(system.wavelengths_m.max()) / (2 * pitch_m))
    return distance_m * sine / math.sqrt(1 - sine * sine)


def etendue_mm2sr(system: System) -> tuple[float, float]:
    """Pixels × λ² of the finest element that is illuminated, mm² sr, at the shortest and the longest wavelength."""
    pixels = max(math.prod(pixel_shape(e)) for e in system.elements if isinstance(e, Pixels))
    shortest, longest = float(system.wavelengths_m.min()), float(system.wavelengths_m.max())
    return pixels * shortest**2 * 1e6, pixels * longest**2 * 1e6


def flattered_by(system: System) -> tuple[str, ...]:
    """Sentences on what makes a chain look better than it would be built: too few samples, light that leaves it."""
    finest_m = min(e.pitch_m for e in system.elements if isinstance(e, Pixels))
    sentences = list[str]()
    if finest_m < 1.5 * system.way.sample_m:
        sentences.append(
            "one sample a pixel: light that the pixels' edges send into higher orders isn't seen, so that stops take "
            "none and modulators do better than built ones; sampling.upsample = 2 or more shows it"
        )
    side_m, far_m = min(system.way.shape) * system.way.sample_m, _way_m(system)
    both_m = 2 * reach_m(system, far_m, finest_m)
    if side_m < both_m:
        width, needed = units.format_rounded(side_m, "mm"), units.format_rounded(both_m, "mm")
        sentences.append(
            f"the field is {width} wide, and light of a pixel spreads over {needed} on the way to the farthest plane: "
            "much of it leaves the picture; a larger shape or a shorter way keeps it"
        )
    return tuple(sentences)


def _way_m(system: System) -> float:
    """How far the light goes through free space, from the last Fourier plane on where there is one."""
    solid = [i for i, e in enumerate(system.elements) if isinstance(e, Fourier)]
    behind = system.elements[solid[-1] + 1 if solid else 0 :]
    between_m = math.fsum(e.distance_m or 0.0 for e in behind if isinstance(e, Space))
    return between_m + float(np.abs(system.planes_m - system.way.behind_m).max())


def _describe(element: Element, system: System, pitch_m: float, is_last: bool) -> str:
    """An element in words. pitch_m: of the finest pixels up to it."""
    if isinstance(element, Space):
        return _describe_space(element, system, pitch_m, is_last)
    if isinstance(element, Lens):
        if element.abbe is None:
            return f"lens, f = {units.format_rounded(element.focal_length_m, 'mm')}"
        shortest, longest = (
            element.focal_length_at(float(λ)) for λ in (np.min(system.wavelengths_m), np.max(system.wavelengths_m))
        )
        return f"lens, f = {units.format_rounded(shortest, 'mm')} to {units.format_rounded(longest, 'mm')}"
    if isinstance(element, Fourier):
        widths = [
            λ * element.focal_length_m / pitch_m for λ in (system.wavelengths_m.min(), system.wavelengths_m.max())
        ]
        first, last = (units.format_rounded(float(width), "mm") for width in widths)
        return f"Fourier plane, f = {units.format_rounded(element.focal_length_m, 'mm')}, first order {first} to {last}"
    assert isinstance(element, Pixels)
    rows, columns = pixel_shape(element)
    text = f"{element.kind}, {columns} x {rows} pixels of {units.format_rounded(element.pitch_m, 'um')}"
    if any(element.offset_m):
        y, x = (units.format_rounded(off, "um") for off in element.offset_m)
        text += f", at y {y}, x {x}"
    if element.beside:
        text += f", beside {element.beside}, to whose light its own adds"
    if isinstance(element, Mask):
        return f"{text}, {_describe_mask(element)}"
    if isinstance(element, PhaseModulator | ComplexModulator) and element.stroke_m is not None:
        text += f", {units.format_rounded(element.stroke_m, 'nm')} of path"
    if isinstance(element, AmplitudeModulator) and element.range != (0.0, 1.0):
        text += ", amplitude {:g} to {:g}".format(*element.range)
    if isinstance(element, PhaseModulator | AmplitudeModulator):
        text += ", continuous" if element.levels is None else f", {len(element.levels)} levels"
    text += ", one pattern of all frames" if getattr(element, "shared", False) else ""
    return text + (", held by the optimiser" if getattr(element, "held", False) else "")


def _describe_space(space: Space, system: System, pitch_m: float, is_last: bool) -> str:
    far_m = float(system.planes_m.max()) - system.way.behind_m if is_last else space.distance_m or 0.0
    side_m = reach_m(system, far_m, pitch_m)
    where = f"to the planes, at most {units.format_rounded(far_m, 'mm')}" if is_last else "space"
    if not is_last:
        where = f"space, {units.format_rounded(far_m, 'mm')}"
    stops = "" if space.relay.is_clear else ", with stops or aberrations"
    pixels = side_m / pitch_m
    return (
        f"{where}: light moves up to {units.format_rounded(side_m, 'um')} sideways, {pixels:.3g} of these pixels{stops}"
    )


def _describe_mask(mask: Mask) -> str:
    values, parts = mask_values(mask), [mask.pattern or mask.file]
    if values.path_m is not None:
        low, high = (units.format_rounded(float(v), "nm") for v in (values.path_m.min(), values.path_m.max()))
        parts.append(f"path {low} to {high}")
    if values.amplitude is not None:
        parts.append(f"amplitude {values.amplitude.min():.3g} to {values.amplitude.max():.3g}")
    return ", ".join(parts)
