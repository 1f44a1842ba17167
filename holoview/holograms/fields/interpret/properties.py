"""Pitch, wavelengths and distance of a field: given, remembered, of the file, or guessed, in this order."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field

from holoview.holograms.fields.interpret.known_files import AlikeFiles
from holoview.holograms.fields.interpret.named_lengths import LengthKey, NamedLengths
from holoview.holograms.fields.wavefield import Origin, Provenance
from holoview.holograms.files.readers.contents import Facts
from holoview.holograms.files.request import ReadRequest
from holoview.util import units
from holoview.util.errors import UserError

_AGREE = 0.02  # of two distances; people round them, and count z towards either side
_NUMBER = r"([-+]?\d+(?:[.p]\d+)?)"
_LIGHT_M = (3.5e-7, 1.2e-6)
_IN_NAME: dict[LengthKey, re.Pattern[str]] = {
    "distance_m": re.compile(rf"(?:^|[^a-z0-9]){_NUMBER}[ _]?(m|cm|mm)(?![a-z])", re.IGNORECASE),
    "pitch_m": re.compile(r"(?:^|[^a-z0-9])(\d+(?:[.p]\d+)?)[ _]?(um|µm|μm)(?![a-z])", re.IGNORECASE),
}


@dataclass(frozen=True)
class Question:
    """A property that nothing states. option: of the command line. guess: in people's units. reason: of the guess."""

    key: str
    option: str
    guess: str
    reason: str


@dataclass(frozen=True)
class Guess:
    """A value with its reason and its origin. is_doubtful: whether it may be another value, as the reason says."""

    value: tuple[float, ...]
    reason: str
    origin: Origin = "guessed"
    is_doubtful: bool = False


@dataclass
class FileFindings:
    """The findings about a file, in their order."""

    provenance: list[Provenance] = field(default_factory=list)
    questions: list[Question] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def add(self, key: str, value: str, origin: Origin, reason: str) -> None:
        """States the origin of a property."""
        self.provenance.append(Provenance(key, value, origin, reason))

    def add_guess(self, key: str, value: str, guess: Guess) -> None:
        """States where a property is from, and that it is doubtful."""
        self.add(key, value, guess.origin, guess.reason)
        if guess.is_doubtful:
            self.notes.append(f"{key} {value} was guessed: {guess.reason}")

    def ask(self, key: str, option: str, guess: str, reason: str) -> None:
        """A question, whose guess is used until it is answered."""
        self.questions.append(Question(key, option, guess, reason))
        self.provenance.append(Provenance(key, guess, "guessed", reason))


@dataclass(frozen=True)
class Known:
    """All sources of a field's properties.

    request: given and remembered properties together. given: the given ones alone. facts: of the file. named: by the
    names of its variables. table: published properties of a file of this name. name: of the first file.
    named_wavelengths_m: stated by the files' names, by falling length. alike: published holograms with such an array,
    for better guesses.
    """

    request: ReadRequest
    given: ReadRequest
    facts: Facts
    named: NamedLengths
    table: Facts
    table_reason: str
    name: str
    named_wavelengths_m: tuple[float, ...] = ()
    alike: AlikeFiles = field(default_factory=AlikeFiles)

    def origin(self, key: str) -> Origin:
        """Whether a property of the request was given now or is remembered."""
        return "given" if getattr(self.given, key) not in (None, ()) else "remembered"


def stated(known: Known, key: LengthKey) -> Iterable[Guess]:
    """All statements of a length, by decreasing rank. key: of `ReadRequest`."""
    value = getattr(known.request, key)
    if value not in (None, ()):
        origin = known.origin(key)
        reason = "as given" if origin == "given" else "as the notes beside the file say"
        yield Guess(value if isinstance(value, tuple) else (value,), reason, origin)
    value = getattr(known.facts, key, None)
    if value not in (None, ()):
        yield Guess(value if isinstance(value, tuple) else (value,), "as the file says", "file")
    for length in known.named.lengths.get(key, ()):
        yield Guess(length.metres, length.reason, "file" if length.is_sure else "guessed", not length.is_sure)
    value = getattr(known.table, key, None)
    if value not in (None, ()):
        yield Guess(value if isinstance(value, tuple) else (value,), known.table_reason)
    if key == "wavelengths_m" and known.named_wavelengths_m:
        yield Guess(known.named_wavelengths_m, "the file's name says it")
    if key in _IN_NAME and (metres := _in_name(known.name, key)) is not None:
        yield Guess((metres,), "the file's name says it")


def _in_name(name: str, key: LengthKey) -> float | None:
    """The length that a file's name states; of several in µm the one that isn't a wavelength of light."""
    found = [_length(*match) for match in _IN_NAME[key].findall(name)]
    if key == "pitch_m" and len(found) > 1:
        found = [length for length in found if not _LIGHT_M[0] < length < _LIGHT_M[1]]
        return found[0] if len(found) == 1 else None
    return found[0] if found else None


def _length(number: str, unit: str) -> float:
    return units.parse(f"{number.replace('p', '.').replace('P', '.')} {unit.lower()}", "the file's name")


def known_wavelengths(known: Known) -> tuple[float, ...]:
    """The wavelengths that the user, the file, its table or its name states, m; none if nothing does."""
    return next((guess.value for guess in stated(known, "wavelengths_m")), ())


def find_wavelengths(known: Known, colours: int, is_recording: bool, findings: FileFindings) -> tuple[float, ...]:
    """A wavelength for each colour, in vacuum, m; the origin or the question goes to `findings`."""
    for guess in stated(known, "wavelengths_m"):
        if len(guess.value) == colours:
            findings.add_guess("wavelengths", _nm(guess.value), guess)
            return guess.value
        if guess.origin in ("given", "remembered"):
            found = f"{len(guess.value)} of them ({_nm(guess.value)})"
            raise UserError(f"{known.name}: wavelengths", found, expected=f"{colours}, one for each colour")
    value, reason = known.alike.facts.wavelengths_m, known.alike.reason
    if not value:
        value, reason = _usual_lasers(colours, is_recording)
    findings.ask("wavelengths", "--wavelength", _nm(value), reason)
    return value


def _usual_lasers(colours: int, is_recording: bool) -> tuple[tuple[float, ...], str]:
    """Wavelengths that are usual for so many colours, and why."""
    if colours == 3:
        return (638e-9, 520e-9, 450e-9), "usual laser diodes in red, green and blue"
    if colours == 1 and is_recording:
        return (632.8e-9,), "most recordings are made with a helium-neon laser"
    return (532e-9,) * colours, "the most usual laser of holograms"


def find_pitch(known: Known, is_recording: bool, findings: FileFindings) -> tuple[float, float]:
    """The pitch (y, x) in m; the origin or the question goes to `findings`."""
    for guess in stated(known, "pitch_m"):
        pitch = guess.value[0], guess.value[1] if len(guess.value) > 1 else guess.value[0]
        findings.add_guess("pitch", _um(pitch), guess)
        return pitch
    pair = known.alike.facts.pitch_m
    if pair is not None:
        findings.ask("pitch", "--pitch", _um(pair), known.alike.reason)
        return pair
    value, reason = 8e-6, "the most usual pitch of phase modulators"
    if is_recording:
        value, reason = 3.45e-6, "the most usual pitch of cameras for holograms"
    findings.ask("pitch", "--pitch", _um((value, value)), reason)
    return value, value


def find_distance(known: Known, findings: FileFindings) -> float:
    """The distance in m, 0 if nothing states it; contradictions go to the notes."""
    sources = list(stated(known, "distance_m"))
    if not sources:
        findings.ask("distance", "--distance", "0 mm", "nothing says where the image is: search the best focus")
        return 0.0
    first = sources[0]
    findings.add_guess("distance", units.format_rounded(first.value[0], "mm"), first)
    for other in sources[1:]:
        if all(not math.isclose(abs(value), abs(first.value[0]), rel_tol=_AGREE) for value in other.value):
            said = units.format_rounded(other.value[0], "mm")
            mine = units.format_rounded(first.value[0], "mm")
            findings.notes.append(f"distances contradict: {mine} ({first.reason}), {said} ({other.reason})")
    return first.value[0]


def find_radius(known: Known, findings: FileFindings) -> float | None:
    """The radius of the reference wave in m, None for a plane wave."""
    sources: tuple[tuple[float | None, Origin, str], ...] = (
        (known.request.reference_radius_m, known.origin("reference_radius_m"), "as given or remembered"),
        (known.facts.reference_radius_m, "file", "as the file says"),
        (known.table.reference_radius_m, "guessed", known.table_reason),
    )
    for value, origin, reason in sources:
        if value is not None:
            findings.add("radius of the reference", units.format_rounded(value, "mm"), origin, reason)
            return value
    return None


def _nm(lengths: Iterable[float]) -> str:
    return ", ".join(units.format_rounded(length, "nm") for length in lengths)


def _um(pitch: tuple[float, float]) -> str:
    return " × ".join(units.format_rounded(p, "um") for p in dict.fromkeys(pitch))
