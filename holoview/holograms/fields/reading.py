"""Reads anyone's hologram: fields and recordings of other programs and cameras, with the origin of each property.

The file's reader finds arrays (`readers`); their meaning is given, remembered beside the file, stated in the file or
guessed with a reason (`interpret`).
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.fields.interpret.arrangement import Arrangement, arrange_files
from holoview.holograms.fields.interpret.candidates import Candidate, name_wavelength
from holoview.holograms.fields.interpret.known_files import find_alike, find_known_file
from holoview.holograms.fields.interpret.named_lengths import find_named_lengths
from holoview.holograms.fields.interpret.properties import (
    FileFindings,
    Known,
    Question,
    find_distance,
    find_pitch,
    find_radius,
    find_wavelengths,
)
from holoview.holograms.fields.interpret.remembered import over, read_notes, remember, request_of_notes
from holoview.holograms.fields.interpret.strips import assemble, check_region, half_spectrum
from holoview.holograms.fields.wavefield import (
    Provenance,
    Wavefield,
    samples_of_degrees,
    shifted_colours,
    without_checkerboard,
)
from holoview.holograms.files.readers.contents import Contents, Facts
from holoview.holograms.files.readers.registry import open_file
from holoview.holograms.files.readers.tile_set import open_tiles
from holoview.holograms.files.request import BinaryLayout, Order, ReadRequest, RecordingKind, Steps
from holoview.light.numerics.sampling import Region
from holoview.util.errors import UserError
from holoview.util.progress import StepCallback

__all__ = [
    "BinaryLayout",
    "Question",
    "ReadRequest",
    "Reading",
    "Recording",
    "over",
    "read_wavefield",
    "remember",
    "request_of_notes",
]


@dataclass(frozen=True, eq=False)
class Recording:
    """Pictures of an interference that a camera took.

    pictures: (picture, wavelength, y, x) float32, intensities in the file's units, read-only; negative where a
    background was taken off. pitch_m, wavelengths_m, distance_m: as in `Wavefield`, of the camera's pixels. kind: as
    given, None if unknown. conjugated: whether the conjugate of its field is wanted; None if unknown. steps, orders
    and dark_field: as of `ReadRequest`. reference_radius_m: as in `Wavefield`; of a point source its distance.
    """

    pictures: NDArray[np.float32]
    pitch_m: tuple[float, float]
    wavelengths_m: NDArray[np.float64]
    distance_m: float
    kind: RecordingKind | None
    name: str
    conjugated: bool | None = None
    steps: Steps = "equal"
    orders: tuple[Order, ...] = ()
    reference_radius_m: float | None = None
    dark_field: bool | None = None


@dataclass(frozen=True, eq=False)
class Reading:
    """The result of reading: a field or a recording; the other is None.

    request: what was asked for and what is remembered. provenance: the origin of each property. candidates: the arrays
    of the first file that could be a field, the likeliest first. questions: properties that nothing states, with the
    guesses that were taken. notes: remarks for the user, such as contradictions.
    """

    wavefield: Wavefield | None
    recording: Recording | None
    request: ReadRequest
    provenance: tuple[Provenance, ...]
    candidates: tuple[Candidate, ...]
    questions: tuple[Question, ...]
    notes: tuple[str, ...]

    @property
    def kind(self) -> Literal["field", "recording"]:
        """Whether it is a field or a recording."""
        return "field" if self.wavefield is not None else "recording"


def read_wavefield(
    paths: Sequence[str | os.PathLike[str]] | str | os.PathLike[str],
    request: ReadRequest | None = None,
    progress: StepCallback | None = None,
) -> Reading:
    """Reads a field or a recording from a file, or from several files that are its parts.

    request: what the user knows and wants. It comes before the notes beside the first file, these before the file's own
    statements, and guesses come last. progress: as of `assemble`.

    Raises UserError for files that are wrong, when memory doesn't suffice, and when nothing states the pitch or the
    wavelengths, unless `request.accept_guesses`: the error names the options and the guesses.
    """
    files = [Path(paths)] if isinstance(paths, str | os.PathLike) else [Path(path) for path in paths]
    if not files:
        raise UserError("", "no file", expected="a hologram's file, or several that are its parts")
    for path in files:
        if path.is_dir():
            raise UserError(str(path), "is a folder", expected="a hologram's file")
    given = request or ReadRequest()
    merged = _with_kind(over(given, read_notes(files[0])))
    findings = FileFindings()
    with ExitStack() as stack:
        table = find_known_file(files[0].name)
        opens = open_tiles if table is not None and table.is_tiled and len(files) == 1 else open_file
        opened = [(path, *stack.enter_context(opens(path, merged))) for path in files]
        findings.add("format", opened[0][1].name, "file", "its first bytes")
        findings.notes += [note for _, _, content in opened for note in content.notes]
        contents = [(path, content) for path, _, content in opened]
        known = _known(files[0], contents, merged, given, findings)
        arrangement = arrange_files(contents, known, findings)
        _describe_request(known, arrangement, findings)
        return _read(known, arrangement, findings, progress)


def _with_kind(request: ReadRequest) -> ReadRequest:
    """The request with the kind of recording that has orders. Raises UserError for steps or orders of another kind."""
    kind = request.recording
    if request.steps is not None and kind != "phase-shifting":
        raise UserError("--steps", f"with {kind or 'no'} recording", expected="--recording phase-shifting")
    if request.orders and kind not in (None, "off-axis"):
        raise UserError("--order", f"with the recording {kind}", expected="--recording off-axis")
    request = replace(request, recording="off-axis") if request.orders else request
    if request.dark_field is not None and request.recording not in (None, "in-line"):
        raise UserError("--dark-field", f"with the recording {request.recording}", expected="--recording in-line")
    return request


def _known(
    path: Path,
    contents: Sequence[tuple[Path, Contents]],
    request: ReadRequest,
    given: ReadRequest,
    findings: FileFindings,
) -> Known:
    """All sources of a field's properties."""
    numbers: dict[str, tuple[float, ...]] = {}
    texts: dict[str, str] = {}
    for _, content in reversed(contents):
        numbers |= content.numbers
        texts |= content.texts
    lengths = find_named_lengths(numbers, texts)
    findings.notes += lengths.notes
    table = find_known_file(path.name)
    facts, reason = (table.facts, table.reason) if table else (Facts(), "")
    if table:
        findings.notes.append(table.note)
    named = {float(nm) * 1e-9 for file, _ in contents if (nm := name_wavelength(file.stem))}
    named_wavelengths = tuple(sorted(named, reverse=True))
    return Known(request, given, contents[0][1].facts, lengths, facts, reason, path.name, named_wavelengths)


def _read(known: Known, arrangement: Arrangement, findings: FileFindings, progress: StepCallback | None) -> Reading:
    request, name = known.request, known.name
    is_field = not arrangement.is_recording
    _, colours, rows, columns = arrangement.sizes
    variable = arrangement.groups[0][0][0].component.array.name
    known = replace(known, alike=find_alike(variable, colours, (rows, columns)))
    pitch = find_pitch(known, not is_field, findings)
    wavelengths = find_wavelengths(known, colours, not is_field, findings)
    distance, radius = find_distance(known, findings), find_radius(known, findings)
    _require_answers(known, findings)
    index = request.refractive_index or 1.0
    in_medium = np.array(wavelengths) / index
    region = _region(request, (rows, columns), pitch, distance, findings)
    values = assemble(arrangement.groups, region, request.decimate, name, is_field, progress)
    coarse = pitch[0] * request.decimate, pitch[1] * request.decimate
    values.flags.writeable = False
    field, recording = None, None
    if is_field:
        final = _finished(values, request, arrangement, coarse)
        field = Wavefield(final, coarse, in_medium, distance, radius, name)
    else:
        chosen = request.steps or "equal", request.orders
        recording = Recording(
            values,
            coarse,
            in_medium,
            distance,
            request.recording,
            name,
            request.conjugated,
            *chosen,
            radius,
            request.dark_field,
        )
    return Reading(
        field,
        recording,
        request,
        tuple(findings.provenance),
        tuple(arrangement.candidates),
        tuple(findings.questions),
        tuple(findings.notes),
    )


_APERTURE = 1024  # samples of a side of the middle that is read of a field with too many of them


def _region(
    request: ReadRequest,
    shape: tuple[int, int],
    pitch_m: tuple[float, float],
    distance_m: float,
    findings: FileFindings,
) -> Region:
    """The part that is read; a note says where it lies, because pictures are centred on it."""
    rows, columns = shape
    wanted = request.region
    if request.aperture_deg is not None:
        size, x, y = request.aperture_deg
        (height, width), (beside_y, beside_x) = samples_of_degrees(distance_m, pitch_m, (size, size), (y, x))
        wanted = round((columns - width) / 2 + beside_x), round((rows - height) / 2 + beside_y), width, height
        if min(wanted) < 0:
            found = f"{width} × {height} samples at ({wanted[0]}, {wanted[1]})"
            raise UserError("aperture", found, expected=f"a part of the {columns} × {rows} samples")
    too_many = request.most_samples is not None and rows * columns > request.most_samples
    if wanted is None and request.decimate == 1 and too_many:
        height, width = min(rows, _APERTURE), min(columns, _APERTURE)
        wanted = (columns - width) // 2, (rows - height) // 2, width, height
        findings.notes.append(
            f"of its {columns} × {rows} samples the middle {width} × {height} are read: --aperture takes another part, "
            f"--decimate {math.ceil(max(shape) / _APERTURE)} the middle of the band of the whole"
        )
    region = check_region(wanted, rows, columns, request.decimate)
    if wanted is not None:
        findings.add("aperture", f"{region[2]} × {region[3]} samples at {region[0]}, {region[1]}", "given", "as asked")
    return region


def _finished(
    values: NDArray[Any], request: ReadRequest, arrangement: Arrangement, pitch_m: tuple[float, float]
) -> NDArray[Any]:
    """The field of a bilevel pattern, with the stated sign of the phase and shifts, without a stated checkerboard."""
    if request.checkerboard and request.decimate > 1:
        raise UserError("decimate", "with a checkerboard", expected="1", remedy="read a region of it")
    if arrangement.quantity == "bilevel":
        if request.decimate > 1:
            raise UserError("decimate", "a bilevel pattern", expected="1", remedy="read a region of it")
        values = half_spectrum(values)
    values = np.conj(values) if request.conjugated else values
    if request.colour_shifts_m:
        values = shifted_colours(values, request.colour_shifts_m, pitch_m)
    return without_checkerboard(values) if request.checkerboard else values


def _describe_request(known: Known, arrangement: Arrangement, findings: FileFindings) -> None:
    request = known.request
    if request.refractive_index is not None:
        reason = "wavelengths are divided by it"
        findings.add("refractive index", f"{request.refractive_index:g}", known.origin("refractive_index"), reason)
    if request.conjugated is not None:
        sign = "exp(−iφ)" if request.conjugated else "exp(+iφ)"
        findings.add("sign of the phase", sign, known.origin("conjugated"), "as given or remembered")
    elif not arrangement.is_recording:
        findings.add("sign of the phase", "exp(+iφ)", "guessed", "the usual sign; the other one mirrors the distance")


def _require_answers(known: Known, findings: FileFindings) -> None:
    """Raises UserError with all necessary questions, unless guesses are accepted."""
    asked = [q for q in findings.questions if q.key in ("pitch", "wavelengths")]
    if not asked or known.request.accept_guesses:
        return
    examples = " ".join(f"{q.option} {q.guess.replace(' ', '').replace(',', ' ')}" for q in asked)
    reasons = "; ".join(f"{q.guess}: {q.reason}" for q in asked)
    found = f"doesn't say its {' and '.join(q.key for q in asked)}"
    remedy = (
        f"e.g. {examples} ({reasons}); `holoview info` with these options and --remember notes them for all commands"
    )
    raise UserError(known.name, found, expected=" and ".join(q.option for q in asked), remedy=remedy)
