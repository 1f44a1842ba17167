"""How the arrays of one or several files make a field or a recording: by frame, colour and quantity.

The quantity of real numbers is amplitude, phase, intensity, a bilevel pattern, or a camera's picture of fringes. Names
state it, or else the values show it: phases are spread evenly over their range, because whole periods are removed, or
alternate from sample to sample (double-phase patterns), while pictures of a camera have a peak and are smooth over the
distance of two pixels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.fields.interpret.axes import arrange
from holoview.holograms.fields.interpret.candidates import (
    PAIRS,
    Candidate,
    Component,
    choose,
    list_candidates,
    name_colour,
    name_role,
    name_wavelength,
    partner_of,
)
from holoview.holograms.fields.interpret.number_scale import TURN, full_scale, phase_levels, tell_bits
from holoview.holograms.fields.interpret.properties import FileFindings, Known, known_wavelengths
from holoview.holograms.fields.interpret.strips import PlacedArray, check_finite
from holoview.holograms.fields.wavefield import Origin
from holoview.holograms.files.readers.contents import Contents
from holoview.holograms.files.request import ReadRequest
from holoview.util.errors import UserError

_MOST_NUMBERS = 1 << 22  # of the middle of a stack by which its values are judged
_COLOUR_PARTS = ("r", "g", "b")
_SHORTEST_NM = (590.0, 490.0, 0.0)  # of the light that a camera's red, green and blue pixels see best
Files = Sequence[tuple[Path, Contents]]


@dataclass(frozen=True)
class Arrangement:
    """The arrangement of the files' arrays.

    groups: by frame and colour of separate files, the arrays that are parts of one field.
    candidates: of the first file. quantity: of single real arrays, "" for others.
    """

    groups: list[list[list[PlacedArray]]]
    candidates: list[Candidate]
    is_recording: bool
    quantity: str

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """Frames, colours, rows and columns of all."""
        frames, colours, rows, columns = self.groups[0][0][0].sizes
        return len(self.groups) * frames, len(self.groups[0]) * colours, rows, columns


def arrange_files(files: Files, known: Known, findings: FileFindings) -> Arrangement:
    """The parts of a field or a recording in one or several files; how they were recognised goes to `findings`.

    Raises UserError for files that don't belong together.
    """
    request, wavelengths = known.request, len(known_wavelengths(known))
    grid, candidates = _components(files, request, findings)
    placed = [[[_place(c, files, request, wavelengths) for c in parts] for parts in row] for row in grid]
    _check_sizes(placed, files)
    chosen = _only_colour([part for row in placed for parts in row for part in parts], known, findings)
    placed = [[[replace(part, only_colour=chosen) for part in parts] for parts in row] for row in placed]
    first = placed[0][0][0]
    if first.axes.reason and chosen is None:
        findings.add("axes", _axes_words(first), "guessed", first.axes.reason)
    is_recording, quantity = _recognise(placed, files, request, findings)
    flat = [part for row in placed for parts in row for part in parts]
    if is_recording:
        tell_bits([_sample(part) for part in flat], findings)
    samples: dict[str, list[np.ndarray]] = {}
    for part in flat:
        if (role := _role(part, quantity)) == "phase" or (role and part.component.array.dtype.kind in "iu"):
            samples.setdefault(role, []).append(_sample(part))
    scaled = [[[_scaled(p, quantity, samples, known, findings) for p in parts] for parts in row] for row in placed]
    return Arrangement(scaled, candidates, is_recording, quantity)


def _components(
    files: Files, request: ReadRequest, findings: FileFindings
) -> tuple[list[list[tuple[Component, ...]]], list[Candidate]]:
    """By frame and colour of separate files, the arrays that make a field."""
    path, contents = files[0]
    if len(files) == 1:
        candidate, candidates = choose(path, contents, request)
        partner = partner_of(path)
        if partner is not None:
            findings.notes.append(f'"{partner.name}" beside it is another part by its name: name both files')
        if len(candidates) > 1 or candidate.name:
            others = [c.name for c in candidates if c is not candidate]
            reason = "as given" if request.variable else "by kind and size"
            more = f"; others: {', '.join(others[:6])}" if others else ""
            findings.add("variable", candidate.name, "given" if request.variable else "guessed", reason + more)
        equals = [c.name for c in candidates if c is not candidate and _looks_like(c, candidate)]
        if equals and not request.variable:
            names = ", ".join(equals[:6]) + " …" * (len(equals) > 6)
            findings.notes.append(f'"{candidate.name}" is read; --variable takes another one like it: {names}')
        return [[candidate.components]], candidates
    parts = _name_parts(files, request)
    if not request.parts:
        findings.add("parts", ", ".join(map(str, parts)), "guessed", "the names of the files")
    return _grid(parts, path), list_candidates(contents)


def _looks_like(one: Candidate, other: Candidate) -> bool:
    """Whether two candidates have parts of the same shapes, types and quantities, so that only names differ."""
    kinds = [[(c.array.shape, c.array.dtype, c.role) for c in candidate.components] for candidate in (one, other)]
    return kinds[0] == kinds[1]


@dataclass(frozen=True)
class _NamedPart:
    """One of several files. Its quantity, "" if unknown; its colour, "" if it isn't one of several colours."""

    quantity: str
    colour: str
    component: Component

    def __str__(self) -> str:
        return " ".join(word for word in (self.quantity, self.colour) if word) or "frame"


def _name_parts(files: Files, request: ReadRequest) -> list[_NamedPart]:
    """The part that each of several files is, as stated or by its name; colours only if there are several."""
    stated = request.parts or ("frame",) * len(files)
    if len(stated) != len(files):
        found = f"{len(stated)} parts for {len(files)} files"
        raise UserError("parts", found, expected="one part for each file, such as amplitude,phase")
    colours = [w if w in _COLOUR_PARTS else name_colour(path.stem) for w, (path, _) in zip(stated, files, strict=True)]
    if set(colours) != set(_COLOUR_PARTS):
        nm = [name_wavelength(path.stem) for path, _ in files]
        colours = nm if len(set(nm)) > 1 and all(nm) else [""] * len(files)
    parts = []
    for word, colour, (path, contents) in zip(stated, colours, files, strict=True):
        component = _single(path, contents, request)
        is_stated = word not in ("frame", *_COLOUR_PARTS)
        quantity = word if is_stated else component.role or name_role(path.stem)
        parts.append(_NamedPart(quantity, colour, replace(component, role=quantity, reason="one of several files")))
    return parts


def _single(path: Path, contents: Contents, request: ReadRequest) -> Component:
    candidate, _ = choose(path, contents, replace(request, parts=(), quantity=request.quantity or "intensity"))
    if len(candidate.components) != 1:
        raise UserError(str(path), "holds more than one part of a field", expected="one part in each file")
    return candidate.components[0]


def _grid(parts: Sequence[_NamedPart], path: Path) -> list[list[tuple[Component, ...]]]:
    """The components by frame and colour. Raises UserError unless each colour has the same parts."""
    colours = sorted({part.colour for part in parts}, key=_colour_order)
    by_colour = [[part for part in parts if part.colour == colour] for colour in colours]
    quantities = [sorted(part.quantity for part in group) for group in by_colour]
    if all(found == quantities[0] for found in quantities):
        if tuple(quantities[0]) in map(tuple, map(sorted, PAIRS)):
            return [[tuple(part.component for part in group) for group in by_colour]]
        if len(set(quantities[0])) == 1:
            frames = zip(*by_colour, strict=True)
            return [[(part.component,) for part in frame] for frame in frames]
    raise UserError(
        str(path),
        f"the parts {', '.join(map(str, parts))} don't make a field",
        expected="real,imaginary or amplitude,phase or r,g,b, or frames",
        remedy="state them with --parts",
    )


def _colour_order(colour: str) -> float:
    """Red, green and blue in this order; other colours by falling wavelength."""
    return float(_COLOUR_PARTS.index(colour)) if colour in _COLOUR_PARTS else -float(colour or 0)


def _place(component: Component, files: Files, request: ReadRequest, wavelengths: int) -> PlacedArray:
    where = component.array.name or str(files[0][0])
    return PlacedArray(component, arrange(component.array, request, wavelengths, where))


def _check_sizes(placed: Sequence[Sequence[Sequence[PlacedArray]]], files: Files) -> None:
    sizes = {part.sizes for row in placed for parts in row for part in parts}
    if len(sizes) > 1:
        words = " and ".join(f"{x} × {y} samples, {c} colours, {f} frames" for f, c, y, x in sorted(sizes))
        raise UserError(str(files[0][0]), f"its parts have different sizes: {words}", expected="parts of one size")


def _only_colour(parts: Sequence[PlacedArray], known: Known, findings: FileFindings) -> int | None:
    """The channel that is taken of pictures in three colours: of grey pictures, and where one wavelength is known."""
    if any(p.axes.colour is None or p.sizes[1] != 3 or p.component.array.dtype.kind not in "iu" for p in parts):
        return None
    samples = [_sample(part) for part in parts]
    if all((sample == sample[:, :1]).all() for sample in samples):
        findings.add("colours", "one", "file", "the channels are equal: grey that is stored as colours")
        return 0
    wavelengths = known_wavelengths(known)
    if len(wavelengths) != 1:
        return None
    channel = next(i for i, shortest in enumerate(_SHORTEST_NM) if wavelengths[0] * 1e9 >= shortest)
    name = ("red", "green", "blue")[channel]
    findings.add("colours", f"the {name} channel", "guessed", "one wavelength is known, which this channel sees")
    return channel


def _axes_words(part: PlacedArray) -> str:
    names = {part.axes.y: "y", part.axes.x: "x"}
    for name, axis in (("colour", part.axes.colour), ("frame", part.axes.frame)):
        if axis is not None:
            names[axis] = name
    return "(" + ", ".join(names.get(axis, "1") for axis in range(len(part.component.array.shape))) + ")"


def _recognise(
    placed: Sequence[Sequence[Sequence[PlacedArray]]], files: Files, request: ReadRequest, findings: FileFindings
) -> tuple[bool, str]:
    """Whether it is a recording, and the quantity of single parts."""
    parts = placed[0][0]
    roles = [part.component.role for part in parts]
    if request.recording not in (None, "none"):
        findings.add("recording", str(request.recording), "given", "as given or remembered")
        return True, "intensity"
    if roles == ["complex"] and request.quantity not in (None, "complex"):
        found = f"the numbers are complex, not of the quantity {request.quantity}"
        raise UserError(str(files[0][0]), found, expected="the quantity complex, or none stated")
    if roles == ["complex"] or len(parts) > 1:
        findings.add("quantity", " and ".join(roles), "file", parts[0].component.reason or "its numbers are complex")
        return False, ""
    if request.quantity is not None:
        findings.add("quantity", request.quantity, "given", "as given or remembered")
        return False, request.quantity
    for role, reason in (
        (roles[0], f'the variable is named "{parts[0].component.array.name}"'),
        (name_role(files[0][0].stem), "the file's name says it"),
    ):
        if role in ("amplitude", "phase", "intensity", "bilevel"):
            findings.add("quantity", role, "guessed", reason)
            return False, role
    judgement = judge(_sample(parts[0]))
    if judgement.quantity == "recording" and request.recording == "none":
        findings.add("quantity", "amplitude", "guessed", "it is no recording, as given, and not spread as phases are")
        return False, "amplitude"
    findings.add("quantity", judgement.quantity, "guessed", judgement.reason)
    return judgement.quantity == "recording", judgement.quantity


def _sample(part: PlacedArray) -> np.ndarray:
    """The middle of the array, at most `MOST_SAMPLE` rows and columns, of stacks fewer, (frame, colour, y, x)."""
    frames, colours, rows, columns = part.sizes
    most = max(min(MOST_SAMPLE, math.isqrt(_MOST_NUMBERS // (frames * colours))), 1)
    height, width = min(rows, most), min(columns, most)
    region = ((columns - width) // 2, (rows - height) // 2, width, height)
    values = part.load(region)
    check_finite(part.component.array.name or "field", values, region)
    return values


def _role(part: PlacedArray, quantity: str) -> str:
    """The quantity of the numbers of one part. quantity: of single parts, "" for others."""
    role = part.component.role
    return quantity if role in ("", *_COLOUR_PARTS) or (quantity and role != "complex") else role


def _scaled(
    part: PlacedArray, quantity: str, samples: dict[str, list[np.ndarray]], known: Known, findings: FileFindings
) -> PlacedArray:
    """The part with its role and the scale of its numbers, which is one for all parts of a role.

    samples: of all parts by role, of phases and of integers.
    """
    role = _role(part, quantity)
    named = replace(part, component=replace(part.component, role=role))
    dtype = part.component.array.dtype
    if role == "phase":
        levels, reason = phase_levels(samples[role])
        origin: Origin = "guessed"
        if known.facts.phase_levels is not None:
            levels, reason, origin = known.facts.phase_levels, "as the file says", "file"
        if known.request.phase_levels is not None:
            levels, reason = known.request.phase_levels, "as given or remembered"
            origin = known.origin("phase_levels")
        if not any(p.key == "phase levels" for p in findings.provenance):
            findings.add("phase levels", f"{levels:.6g}", origin, reason)
        return replace(named, scale=2 * np.pi / levels)
    if role in ("amplitude", "intensity", "bilevel") and dtype.kind in "iu":
        return replace(named, scale=1 / full_scale(samples[role]))
    if role in ("real", "imaginary") and dtype.kind == "u":
        middle = full_scale(samples[role]) / 2
        findings.add(f"zero of the {role} part", f"{middle:g}", "guessed", "numbers without sign: the middle is 0")
        return replace(named, zero=middle, scale=1 / middle)
    return named


# --- the quantity of real numbers -------------------------------------------------------------------------------------


_BINS = 16
_EVEN = 0.15
"""Largest distance from an even distribution (half the sum of absolute differences) of values that are phases.

Speckle's amplitudes and intensities (Rayleigh's and exponential distributions over their range) have 0.48 and more, a
camera's sinusoidal fringes of full contrast 0.21."""

_ALTERNATING = 0.2
"""Least share of a chessboard's pattern in double-phase patterns, which take φ + acos(a) and φ − acos(a) in turn.

It is below 0.02 in eleven public recordings, off-axis ones with fringes of two pixels among them."""

_SOFT, _MOST_AT_ENDS, _LEAST_END = 0.02, 0.97, 0.005
"""Of a drawing with smooth edges, or in a JPEG: range at either end of the values, least shares of both and of each."""

_FINE, _SPARSE = 0.1, 0.1
"""Least share of differing neighbours, and least share of either value, of a bilevel hologram.

Fringes of p samples along y differ at 2/p of the neighbours along y: 0.2 and more for ten samples, the mean of both
axes 0.1; those of random objects fill half. Letters and slits of ten samples and more differ at less."""

MOST_SAMPLE = 1024
"""Rows and columns of the middle of an array by which its values are judged."""


@dataclass(frozen=True)
class Judgement:
    """quantity: as in `ReadRequest`, or "recording". reason: in words."""

    quantity: str
    reason: str


def judge(sample: NDArray[Any]) -> Judgement:
    """The quantity of real numbers (…, y, x), by their values."""
    values = sample.astype(np.float64)
    low, high = float(values.min()), float(values.max())
    if sample.dtype.kind == "b" or (high > low and bool(((values == low) | (values == high)).all())):
        return _judge_two_values(values > low, "it has two values only")
    ends = values < low + _SOFT * (high - low), values > high - _SOFT * (high - low)
    if (
        high > low
        and sum(end.mean() for end in ends) >= _MOST_AT_ENDS
        and min(end.mean() for end in ends) >= _LEAST_END
    ):
        soft = _judge_two_values(values > (low + high) / 2, "nearly all of its values are two")
        if soft.quantity == "amplitude":
            return soft
    if low < 0:
        if sample.dtype.kind == "f" and -math.pi - 1e-3 <= low < -3 and 3 < high <= math.pi + 1e-3:
            return Judgement("phase", "its values reach from −π to π")
        return Judgement("recording", "it is real and has negative values, as pictures without their background")
    if sample.dtype.kind == "f" and 6.2 < high <= TURN + 1e-3:
        return Judgement("phase", "its values reach from 0 to 2π")
    full = full_scale([sample]) if sample.dtype.kind in "iu" else 1.0 if high <= 1 else max(high, 1e-300)
    if unevenness(values, full) < _EVEN:
        return Judgement("phase", "its values are spread evenly over the whole range, as phases are")
    if alternation(values) > _ALTERNATING:
        return Judgement("phase", "its values alternate from sample to sample, as double-phase patterns do")
    return Judgement("recording", "its values have a peak, as a camera's picture")


def _judge_two_values(pattern: NDArray[np.bool_], found: str) -> Judgement:
    """Whether a pattern (…, y, x) of two values is a bilevel hologram or an aperture. found: its values, in words.

    A hologram's pattern is as fine as its fringes, whose carrier takes at least a tenth of the band, and fills about
    half; an aperture, a slit or a drawing has areas.
    """
    changes = [float(np.mean(pattern[..., 1:, :] != pattern[..., :-1, :])) if pattern.shape[-2] > 1 else 0.0]
    changes.append(float(np.mean(pattern[..., 1:] != pattern[..., :-1])) if pattern.shape[-1] > 1 else 0.0)
    share, filled = sum(changes) / 2, float(pattern.mean())
    if share < _FINE or not _SPARSE < filled < 1 - _SPARSE:
        what = f"{share:.1%} of its neighbouring samples differ and {filled:.1%} are bright"
        reason = f"{found}, in areas ({what}): an aperture; --quantity bilevel takes it for a hologram"
        return Judgement("amplitude", reason)
    reason = f"{found}, in a fine pattern ({share:.0%} of its neighbouring samples differ)"
    return Judgement("bilevel", f"{reason}; --quantity amplitude takes it for an aperture")


def unevenness(values: NDArray[np.float64], full: float) -> float:
    """How far the distribution of values from 0 to `full` is from an even one: 0 even, towards 1 in one place."""
    counts, _ = np.histogram(values, _BINS, (0, full))
    shares = counts / max(values.size, 1)
    return float(0.5 * np.abs(shares - 1 / _BINS).sum())


def alternation(values: NDArray[np.float64]) -> float:
    """The mean of (…, y, x) with the signs of a chessboard, in standard deviations: of N random values 1/√N or so."""
    deviation = float(values.std())
    signs = (-1.0) ** np.add.outer(np.arange(values.shape[-2]), np.arange(values.shape[-1]))
    return float(abs((values * signs).mean(axis=(-2, -1))).max()) / deviation if deviation > 0 else 0.0
