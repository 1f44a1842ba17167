"""Opens complex fields as holograms: an array of the caller's, or files of holoview and of other programs."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.fields.field_file import FIELD_FORMAT
from holoview.holograms.fields.interpret.properties import Question
from holoview.holograms.fields.interpret.remembered import notes_path
from holoview.holograms.fields.reading import Reading, ReadRequest, Recording, read_wavefield
from holoview.holograms.fields.wavefield import Provenance, Wavefield, without_checkerboard
from holoview.holograms.files.image_reader import file_format
from holoview.holograms.files.readers.registry import is_readable
from holoview.holograms.files.request import Order, Propagation, WindowRequest
from holoview.holograms.hologram import FORMAT, Hologram, load_hologram
from holoview.light.model.field_band import edge_power
from holoview.light.model.validity import LEAST_IN_PICTURE, band_note
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.progress import StepCallback
from holoview.util.safetensors_file import format_of

if TYPE_CHECKING:
    from holoview.holograms.fields.imaging import ImagedField

Length = float | str
_CORNERS = (
    "its light lay in four pieces at the corners, as of a transform whose zero frequency stands there: "
    "the alternating phase is taken away (--file-note checkerboard=false keeps it)"
)
_HALF_TURN = (
    "its light alternates from {0} to {0}, half a turn a sample, where +1/2 and -1/2 look alike and the image is split "
    "in two: the alternation is taken away, so that it is seen along its own direction (--file-note checkerboard=false "
    "keeps it)"
)
_HALF_TURN_OF_PHASES = (
    "most of its light alternates from {0} to {0}, half a turn a sample, where +1/2 and -1/2 look alike: its image is "
    "split in two, unless the pattern is made so on purpose"
)
_CORNERS_OF_PHASES = (
    "most of its light goes to the corners of the spectrum: a double-phase pattern sends the light there that its "
    "image doesn't use; if the image itself lies there in four pieces, --file-note checkerboard=true puts it together"
)


@dataclass(frozen=True)
class OpenedHologram:
    """A hologram from files.

    provenance: where each property of a field of another program is known from; empty for files of holoview.
    notes: remarks for the user, each a sentence. moved_m: how far the field was brought towards its image, from where
    planes count; 0 for a field in its own plane. other_side: the hologram of the conjugate field, seen in the same way,
    where its image is clearly sharper: the file's phase or distance may have the other sign. recorded: the camera's
    recording that the field was made of. light: the share of the field's light that is in the window there, 0…1.
    """

    hologram: Hologram
    provenance: tuple[Provenance, ...] = ()
    notes: tuple[str, ...] = ()
    moved_m: float = 0.0
    other_side: Hologram | None = None
    recorded: Recorded | None = None
    light: float = 1.0

    @property
    def guesses(self) -> tuple[Provenance, ...]:
        """The properties that were guessed."""
        return tuple(known for known in self.provenance if known.origin == "guessed")

    @property
    def guess_notes(self) -> tuple[str, ...]:
        """The guesses that `notes` don't tell, each as a sentence."""
        notes = (f"{known.key} {known.value} was guessed: {known.reason}" for known in self.guesses)
        told = [note.split(" was guessed")[0] for note in self.notes]
        return tuple(note for note in notes if note.split(" was guessed")[0] not in told)


@dataclass(frozen=True, eq=False)
class Recorded:
    """A camera's recording that a field was made of, to choose its kind, orders or steps anew.

    recording: with its kind, side, steps, and an order for each wavelength of an off-axis one. is_moved: whether the
    field is brought to its image, from where planes count.

    Raises UserError for a recording of unknown kind, and for one without its orders.
    """

    recording: Recording
    is_moved: bool = False

    def __post_init__(self) -> None:
        recording = self.recording
        wanted = len(recording.wavelengths_m) if recording.kind == "off-axis" else 0
        if recording.kind in (None, "none") or len(recording.orders) != wanted:
            found = f"of kind {recording.kind} with {len(recording.orders)} orders"
            raise UserError("recording", found, expected="off-axis with orders, in-line or phase-shifting")

    def with_order(self, wavelength: int, order: Order) -> Recorded:
        """With another order for the wavelength of an index."""
        orders = tuple(order if i == wavelength else kept for i, kept in enumerate(self.recording.orders))
        return replace(self, recording=replace(self.recording, orders=orders))

    def conjugate(self) -> Recorded:
        """The conjugate field: of an off-axis recording, from the orders on the other side."""
        orders = tuple(order.conjugate() for order in self.recording.orders)
        side = not orders and not self.recording.conjugated
        return replace(self, recording=replace(self.recording, orders=orders, conjugated=side))

    def found(self, **changes: Any) -> Recorded:
        """With the orders that stand out of the spectra, of an off-axis recording.

        changes: other fields of the recording, such as its kind. Raises UserError where nothing is found.
        """
        from holoview.holograms.fields.demodulation import field_of_recording  # slow start: it imports scipy

        return replace(
            self,
            recording=field_of_recording(replace(self.recording, orders=(), conjugated=False, **changes)).recording,
        )

    def hologram(self) -> Hologram:
        """The field, as `open_hologram` shows it. Raises UserError for orders beyond the samples, and other kinds."""
        from holoview.holograms.fields.demodulation import field_of_recording  # slow start: it imports scipy
        from holoview.holograms.fields.imaging import image_field  # slow start: it imports torch

        field = field_of_recording(self.recording).field
        return Hologram.of_field(image_field(field, "auto" if self.is_moved else "asm").field)


def load_field(
    source: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | NDArray[Any],
    *,
    pitch: Length | tuple[Length, Length] | None = None,
    wavelengths: Sequence[Length] | Length = (),
    distance: Length | None = None,
    **known: Any,
) -> Hologram:
    """A complex field as a hologram, which `simulate` and `export_html` take as any other.

    source: an array (y, x), (wavelength, y, x) or (frame, wavelength, y, x) of complex numbers, also a tensor on the
    CPU; or the path of a file, or of several that are the parts of one field.
    pitch: distance between samples, or a pair (y, x); metres or text such as "8 um".
    wavelengths: of each laser, metres or text such as "532 nm", in vacuum.
    distance: from the plane of the field to where its image is expected; negative where it lies before the plane.
    known: further known properties of a file: other fields of `ReadRequest`, such as quantity="phase". An array takes
    propagation and window, a `holoview.holograms.files.request.WindowRequest`, which bring it to its image, from where
    planes then count; without them it stays in its plane.

    Returns a `Hologram` whose system has the plane of the field in place of modulators. Raises UserError for an array
    of another shape or of real numbers, for impossible lengths and lengths that nothing tells, and for a file that
    can't be read.

    >>> import holoview as hv, numpy as np
    >>> y, x = np.mgrid[-32:32, -32:32] * 8e-6
    >>> lens = np.exp(-1j * np.pi * (x**2 + y**2) / (532e-9 * 0.05))  # converges to a point 5 cm behind it
    >>> field = hv.load_field(lens, pitch="8 um", wavelengths="532 nm", distance="5 cm")
    >>> view = hv.simulate(field, backend="torch")
    >>> divmod(int(view.intensity[0, 0].argmax()), 64)
    (32, 32)
    """
    pair = pitch if isinstance(pitch, tuple) else (pitch, pitch)
    lasers = [wavelengths] if isinstance(wavelengths, str | float) else list(wavelengths)
    pitch_m = None if pitch is None else (units.parse(pair[0], "pitch"), units.parse(pair[1], "pitch"))  # type: ignore[arg-type]
    wavelengths_m = tuple(units.parse(λ, f"wavelengths[{i}]") for i, λ in enumerate(lasers))
    distance_m = None if distance is None else units.parse(distance, "distance")
    if isinstance(source, str | os.PathLike | list | tuple):
        paths = [source] if isinstance(source, str | os.PathLike) else source
        request = ReadRequest(pitch_m, wavelengths_m, distance_m, **known)
        return open_hologram(paths, request, finds_distance=False).hologram
    values = np.asarray(source)
    if others := [key for key in known if key not in ("propagation", "window")]:
        raise UserError(others[0], "with an array", expected="it of a file: an array holds the field itself")
    if values.dtype.kind != "c":
        remedy = "a phase is np.exp(1j * phase), an intensity np.sqrt(intensity) + 0j"
        raise UserError("field", f"values of type {values.dtype}", expected="complex numbers", remedy=remedy)
    if pitch_m is None or not wavelengths_m:
        missing = "pitch" if pitch_m is None else "wavelengths"
        raise UserError(missing, "is missing", expected="pitch and wavelengths: an array doesn't tell them")
    field = Wavefield.of_array(values, pitch_m, wavelengths_m, distance_m or 0.0)
    if known:
        from holoview.holograms.fields.imaging import image_field  # slow start: it imports torch

        asked = ReadRequest(**known)
        field = image_field(field, asked.propagation, asked.window).field
    return Hologram.of_field(field)


def open_hologram(
    paths: Sequence[str | os.PathLike[str]],
    request: ReadRequest,
    progress: StepCallback | None = None,
    *,
    finds_distance: bool = True,
) -> OpenedHologram:
    """The hologram of a file of holoview or of another program, or of several files that are the parts of one.

    request: the user's statements on a file of another program; a file of holoview tells all but the distance.
    progress: called while a large file is read, with rows read and rows in all; its exceptions end the reading.
    finds_distance: of phases alone, whose distance nothing tells, it is guessed, which takes seconds; they may be
    brought to their far field.

    Raises UserError for files that can't be read, and for a recording in which no hologram is found.
    """
    if len(paths) == 1 and format_of(paths[0]) in (FORMAT, FIELD_FORMAT):
        return OpenedHologram(_at_distance(load_hologram(paths[0]), request))
    from holoview.holograms.fields.focus import is_sharper_on_other_side  # slow start: it imports torch
    from holoview.holograms.fields.imaging import image_field, with_square_pitch  # slow start: it imports torch

    reading, found = _read(paths, request, progress)
    propagation = request.propagation
    if finds_distance and found.recording is None and any(q.key == "distance" for q in found.questions):
        found, propagation = _at_guess(found, propagation)
    field, notes = found.field, found.notes
    is_dark = found.recording is not None and found.recording.dark_field
    if propagation == "auto" and is_dark and field.reference_radius_m is None:
        propagation = "asm"  # the objects stood before the frame, however far their light goes
    if request.viewpoint is not None:
        from holoview.holograms.fields.synthetic_aperture import seen_from  # slow start: it imports torch

        field = seen_from(field, request.viewpoint)
    may_alternate = reading.recording is None and reading.request.checkerboard is None
    field, imaged, said = _imaged(field, found.field, propagation, request.window, may_alternate)
    seen, resampled = with_square_pitch(imaged.field)
    notes = (*notes, *said, *([resampled] if resampled else []))
    hologram = Hologram.of_field(seen)
    if hologram.system.observer == "mono":
        notes = (
            *notes,
            "an eye doesn't see all of its wavelengths"
            + " in the medium" * (request.refractive_index is not None)
            + ": they are shown in grey, as a camera sees them",
        )
    notes = (*notes, *_scale_notes(field, seen))
    other = None
    if reading.recording is None and is_sharper_on_other_side(field):
        conjugate = image_field(replace(field, values=np.conj(field.values)), propagation, request.window)
        other = Hologram.of_field(conjugate.field)
        notes = (*notes, "the image is sharper with the other sign of the phase (--conjugate) or of the distance")
    recorded = None if found.recording is None else Recorded(found.recording, bool(imaged.note))
    moved_m = field.distance_m if imaged.note else 0.0
    return OpenedHologram(hologram, found.provenance, notes, moved_m, other, recorded, imaged.light)


def _imaged(
    field: Wavefield, whole: Wavefield, propagation: Propagation, window: WindowRequest | None, may_alternate: bool
) -> tuple[Wavefield, ImagedField, list[str]]:
    """The field without an alternation that splits its image, as a bench can show it, and notes on both.

    whole: the field without a viewpoint. may_alternate: whether such an alternation is looked for.
    """
    from holoview.holograms.fields.imaging import (  # slow start: it imports torch
        has_phases_alone,
        image_field,
        split_axes,
    )

    imaged, notes = image_field(field, propagation, window, whole), []
    split = split_axes(whole, imaged) if may_alternate else (False, False)
    if any(split):
        keeps_them = has_phases_alone(field)
        notes.append(_split_note(split, keeps_them))
        if not keeps_them:
            field, whole = (replace(f, values=without_checkerboard(f.values, split)) for f in (field, whole))
            imaged = image_field(field, propagation, window, whole)
    notes += [note for note in (imaged.note, imaged.note and band_note(edge_power(field.values))) if note]
    if imaged.light < LEAST_IN_PICTURE:
        notes.append(f"{100 * imaged.light:.2g}% of its light are in this window")
    return field, imaged, notes


def _split_note(split: tuple[bool, bool], keeps_them: bool) -> str:
    """What is said of a field whose image is split along some axes."""
    if all(split):
        return _CORNERS_OF_PHASES if keeps_them else _CORNERS
    return (_HALF_TURN_OF_PHASES if keeps_them else _HALF_TURN).format("row" if split[0] else "column")


def _scale_notes(field: Wavefield, seen: Wavefield) -> tuple[str, ...]:
    """What is said of the size of a picture whose samples aren't those of its field."""
    pitch_m = seen.pitch_m[1]
    if math.isclose(pitch_m, field.pitch_m[1], rel_tol=1e-6):
        return ()
    width, height = (units.format_rounded(n * pitch_m, "mm") for n in reversed(seen.shape))
    return (f"a sample of the picture is {units.format_rounded(pitch_m, 'um')} wide, the whole {width} × {height}",)


@dataclass(frozen=True, eq=False)
class FieldOfFiles:
    """A field in its own plane. recording: that it was made of. provenance: as of `OpenedHologram`.

    findings: what stands out, in words. questions: what nothing states, with the guesses that were taken.
    """

    field: Wavefield
    recording: Recording | None = None
    findings: tuple[str, ...] = ()
    questions: tuple[Question, ...] = ()
    provenance: tuple[Provenance, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """As of `OpenedHologram`."""
        return (*self.findings, *(f"{q.key} {q.guess} was guessed: {q.reason}" for q in self.questions))


def field_of_files(paths: Sequence[str | os.PathLike[str]], request: ReadRequest) -> FieldOfFiles:
    """The field of a file of holoview or of another program, or of several that are its parts, in its own plane.

    Raises UserError as `open_hologram` does, and for patterns of modulators.
    """
    if len(paths) == 1 and format_of(paths[0]) in (FORMAT, FIELD_FORMAT):
        return FieldOfFiles(_at_distance(load_hologram(paths[0]), request).field())
    return _read(paths, request, None)[1]


_MOST_SEARCHED = 1 << 22  # samples of a pattern whose distance is searched unasked
_CLEARLY = (2.0, 4.0)  # of a peak of the focus: without and with a picture in the far field
_FAR = "as it holds phases alone and its far field looks like a picture, it is taken for a far-field (Fourier) pattern"
_NEAR = "as both measures of `holoview focus` stand out there, of its phases"


def _at_guess(found: FieldOfFiles, propagation: Propagation) -> tuple[FieldOfFiles, Propagation]:
    """A field that nothing tells the distance of, at a guess if there is one, and how it goes there."""
    field, chosen, reason = _guess(found.field, propagation)
    if not reason:
        return found, propagation
    guess = units.format_rounded(field.distance_m, "mm")
    questions = [
        replace(asked, guess=guess, reason=f"{reason}; {asked.option} says it") if asked.key == "distance" else asked
        for asked in found.questions
    ]
    known = Provenance("distance", guess, "guessed", reason)
    provenance = tuple(known if told.key == "distance" else told for told in found.provenance)
    return replace(found, field=field, questions=tuple(questions), provenance=provenance), chosen


def _guess(field: Wavefield, propagation: Propagation) -> tuple[Wavefield, Propagation, str]:
    """A field at a guessed distance; how it goes there, and why, "" without a guess.

    Guessed are the distances of patterns of phases alone, of which an even plane is all that is seen in their own
    plane, and that of a lens where its focal plane is asked for.
    """
    from holoview.holograms.fields.focus import clear_distance_m, default_range_m, find_focus  # slow start: torch
    from holoview.holograms.fields.imaging import (  # slow start: it imports torch
        has_far_image,
        has_phases_alone,
        in_lens,
    )

    if field.reference_radius_m is not None:
        return field, propagation, ""
    if propagation == "fourier":
        return in_lens(field), "fourier", "a lens in whose focal plane the far field has the pattern's own size"
    if propagation != "auto" or math.prod(field.shape) > _MOST_SEARCHED or not has_phases_alone(field):
        return field, propagation, ""
    is_far = has_far_image(field)
    distance_m = clear_distance_m(find_focus(field, *default_range_m(field)), _CLEARLY[is_far])
    if distance_m is not None:
        return replace(field, distance_m=distance_m), propagation, _NEAR
    if is_far:
        return in_lens(field), "fourier", f"{_FAR}, and seen in the focus of a lens where it has the pattern's own size"
    return field, propagation, ""


def _read(
    paths: Sequence[str | os.PathLike[str]], request: ReadRequest, progress: StepCallback | None
) -> tuple[Reading, FieldOfFiles]:
    """What files of other programs hold, and the field that it is or was made of."""
    reading = read_wavefield(paths, request, progress)
    if reading.wavefield is not None:
        told = reading.notes, reading.questions, reading.provenance
        return reading, FieldOfFiles(reading.wavefield, None, *told)
    from holoview.holograms.fields.demodulation import field_of_recording  # slow start: it imports scipy

    assert reading.recording is not None
    found = field_of_recording(reading.recording)
    findings = (*reading.notes, *found.report)
    return reading, FieldOfFiles(found.field, found.recording, findings, reading.questions, reading.provenance)


def is_field_file(path: Path) -> bool:
    """Whether a file holds a field: holoview's own, one that another program's reader recognises, or a picture whose
    notes say so."""
    if not path.is_file():
        return False
    if notes_path(path).exists() or format_of(path) == FIELD_FORMAT:
        return True
    return not file_format(path) and format_of(path) != FORMAT and is_readable(path)


def _at_distance(hologram: Hologram, request: ReadRequest) -> Hologram:
    """A hologram of holoview with the distance of a request, if that states one. Raises UserError for anything else."""
    known = replace(request, distance_m=None, accept_guesses=False, most_samples=None)
    if known not in (ReadRequest(), ReadRequest(propagation="asm")):  # its own plane is what it is shown in
        raise UserError(
            "pitch, wavelength, quantity …",
            "of a file of holoview",
            expected="none of them: it tells all of this itself",
            remedy="change its bench with --set",
        )
    if request.distance_m is None:
        return hologram
    return Hologram(hologram.drive, hologram.system.with_(planes=[request.distance_m]))
