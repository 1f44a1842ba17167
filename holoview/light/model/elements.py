"""The elements that light passes on a bench, each a frozen, checked class with a `kind`; lengths in SI units.

    [[elements]]
    kind = "phase"
    pitch = "8 um"
    shape = [384, 512]
    stroke = "825 nm"

A `System` has them in the order of the light (`holoview.light.model.chain` says which orders are possible, and what
numbers follow). Modulators and masks have square pixels on the simulation's samples, and stop all light beside them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from holoview.light.model.bench_parts import Modulator, Relay
from holoview.light.model.fields import (
    Choice,
    Description,
    Integer,
    Maybe,
    Number,
    Several,
    Shape,
    Truth,
    described_field,
    from_mapping,
    same_field,
    to_mapping,
    validate,
    with_changes,
)
from holoview.light.model.stops import SquareStop
from holoview.util.errors import UserError, suggest_matches

_FRAUNHOFER_M = (486.13e-9, 587.56e-9, 656.27e-9)  # F, d, C, which define the Abbe number
_FOCAL_LENGTH = Number("mm", low=1e-5, high=1e3)
_AMPLITUDES = Several(Number(low=0.0, high=1.0), 2, "two amplitudes from 0 to 1, the lower one first")
_PLACE = Several(Number("um", low=-0.1, high=0.1), 2, 'two lengths (y, x) such as ["0 um", "8 um"]')
_LONGEST_NAME = 40
_NAME = re.compile(r"[^\W\d_][\w -]*(?<! )")  # fit for a file's name


@dataclass(frozen=True)
class NameField:
    """Field type of an element's name, by which drives and edits know it; "" for one that is made from its kind."""

    def parse(self, value: Any, where: str) -> str:
        if value == "":
            return ""
        if not isinstance(value, str) or len(value) > _LONGEST_NAME or not _NAME.fullmatch(value):
            expected = f"up to {_LONGEST_NAME} letters, digits, spaces, - and _, a letter first"
            raise UserError(where, f"{value!r}"[:_LONGEST_NAME], expected=expected)
        return value

    def to_toml(self, value: str) -> str:
        return value


@dataclass(frozen=True, eq=False, kw_only=True)
class Element(Description):
    """An element of a bench. name: by which drives and edits know it.

    >>> import holoview as hv
    >>> [element.kind for element in hv.load("holochrome-8").elements]
    ['phase', 'space', 'phase', 'space']
    """

    kind: ClassVar[str] = ""
    name: str = described_field(NameField(), "By which drives and edits know it.", default="")

    def __post_init__(self) -> None:
        validate(self)


@dataclass(frozen=True, eq=False, kw_only=True)
class Pixels(Element):
    """An element of square pixels, beside which no light passes.

    pitch_m: distance between pixel centres. shape: (rows, columns). offset_m: place (y, x) of its centre from the axis.
    beside: the name of the element before it, if both stand in arms of an interferometer: a beam splitter divides the
    light among them and adds it behind, so that all together transmit the mean of what each transmits.
    """

    pitch_m: float = same_field(Modulator, "pitch_m")
    shape: tuple[int, int] = same_field(Modulator, "shape")
    offset_m: tuple[float, float] = described_field(_PLACE, "Place (y, x) of its centre.", default=(0.0, 0.0))

    beside: str = described_field(
        NameField(),
        "Name of the element before it beside which it stands: what both transmit adds, by halves.",
        default="",
    )

    is_driven: ClassVar[bool] = True
    """Whether it shows a pattern of each frame."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ShownPixels(Pixels):
    """An element that shows patterns, which an optimiser may move.

    shared: whether all frames show one pattern, as a static mask that is sought together with the patterns. held:
    whether the optimiser leaves its patterns as they are. step: the optimiser's first step, of its range; None: as the
    optimiser's settings say.
    """

    shared: bool = described_field(Truth(), "Whether all frames show one pattern.", default=False)
    held: bool = described_field(Truth(), "Whether the optimiser leaves its patterns as they are.", default=False)
    step: float | None = described_field(
        Number(low=1e-6, high=1.0, optional=True),
        "First step of the optimiser, of the range of its patterns; none: as its settings say.",
        default=None,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class PhaseModulator(ShownPixels):
    """A phase modulator: exp(2πi·drive·stroke/λ). levels: stroke fractions that it can show; None: continuous."""

    kind: ClassVar[str] = "phase"
    stroke_m: float = described_field(Number("nm", low=1e-9, high=20e-6), "Optical path that full drive adds.")
    levels: NDArray[np.float64] | None = same_field(Modulator, "levels")


@dataclass(frozen=True, eq=False, kw_only=True)
class AmplitudeModulator(ShownPixels):
    """An amplitude modulator: low + (high − low)·drive of the amplitude passes, with `range` from low to high.

    levels: drives that it can show; 2: binary. What a range doesn't know of its contrast is the effect `leakage`.
    """

    kind: ClassVar[str] = "amplitude"
    range: tuple[float, float] = described_field(
        _AMPLITUDES, "Amplitudes that pass at no drive and at full drive.", default=(0.0, 1.0)
    )
    levels: NDArray[np.float64] | None = same_field(Modulator, "levels")

    def __post_init__(self) -> None:
        super().__post_init__()
        low, high = self.range
        if low >= high:
            raise UserError("range", f"{low:g} to {high:g}", expected=_AMPLITUDES.words)

    def amplitude_of(self, drive: Any) -> Any:
        """The amplitude of a drive: a number, an array or a tensor."""
        low, high = self.range
        return low + (high - low) * drive


@dataclass(frozen=True, eq=False, kw_only=True)
class ComplexModulator(ShownPixels):
    """A modulator of amplitude and phase: its drive is complex, of modulus 0…1.

    stroke_m: optical path of a whole turn of the drive's phase, which then changes with the wavelength as that of a
    phase modulator; None: the same phase at every wavelength.
    """

    kind: ClassVar[str] = "complex"
    stroke_m: float | None = described_field(
        Number("nm", low=1e-9, high=20e-6, optional=True),
        "Optical path of a whole turn; none: the same phase at all wavelengths.",
        default=None,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class FieldPlane(Pixels):
    """The plane of a complex field that is known at points, alone on its bench (`Modulator.content`)."""

    kind: ClassVar[str] = "field"


@dataclass(frozen=True, eq=False, kw_only=True)
class Mask(Pixels):
    """A static mask: optical path, amplitude, or both, from a file or named; the path is the same at all wavelengths.

    shape: (rows, columns); None: those of the file.
    file: .npy, PNG or TIFF. With a stroke its values, 0…1, are fractions of the stroke. Without, a .npy of numbers up
    to 20 µm in size is an optical path in metres, and values 0…1 are amplitudes; a .npy (2, y, x) is both, the path in
    metres and the amplitude.
    pattern: "random" (path 0…stroke, from `seed`), "grating" (lines along y of half a `period`, of the stroke, or dark
    without one), "lens array" (lenses of `period`, `focal_length` at any wavelength) or "half plane" (dark below the
    axis).
    """

    kind: ClassVar[str] = "mask"
    is_driven: ClassVar[bool] = False
    shape: tuple[int, int] | None = described_field(  # type: ignore[assignment]
        Maybe(Shape()), "Rows and columns; those of its file when absent.", default=None
    )
    stroke_m: float | None = described_field(
        Number("nm", low=1e-9, high=100e-6, optional=True), "Optical path of the value 1.", default=None
    )
    file: str = described_field(Choice(), "Its values: .npy, PNG or TIFF.", default="")
    pattern: str = described_field(
        Choice(("", "random", "grating", "lens array", "half plane")), "A named mask in place of a file.", default=""
    )
    period_m: float | None = described_field(
        Number("um", low=1e-7, high=0.1, optional=True), "Period of a grating or of a lens array.", default=None
    )
    focal_length_m: float | None = described_field(
        Number("mm", low=1e-5, high=1e3, optional=True), "Of each lens of a lens array.", default=None
    )
    seed: int = described_field(Integer(0, 1 << 31), "Of a random mask.", default=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if bool(self.file) == bool(self.pattern):
            found = "with a pattern" if self.file else "is missing"
            raise UserError("file", found, expected="a file or a pattern, one of them")
        needs = {"random": ("stroke",), "grating": ("period",), "lens array": ("period", "focal_length")}
        needed = ("shape", *needs.get(self.pattern, ())) if self.pattern else ()
        for key in needed:
            if getattr(self, key if key == "shape" else f"{key}_m") is None:
                raise UserError(key, "is missing", expected=f'it, with pattern = "{self.pattern}"')


@dataclass(frozen=True, eq=False, kw_only=True)
class Lens(Element):
    """A thin lens on the axis: exp(−iπ·r²/(λ·f)), as wide as the simulated field; negative: a diverging one.

    abbe: Abbe number V of its glass, whose n − 1 follows Cauchy's formula of two terms; None: f at every wavelength.
    """

    kind: ClassVar[str] = "lens"
    focal_length_m: float = described_field(Number("mm", low=-1e3, high=1e3), "Focal length; negative: it diverges.")
    abbe: float | None = described_field(
        Number(low=10.0, high=200.0, optional=True),
        "Abbe number of its glass, whose focal length is the stated one at 587.6 nm; of no dispersion if absent.",
        default=None,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if abs(self.focal_length_m) < _FOCAL_LENGTH.low:
            raise UserError("focal_length", f"{self.focal_length_m:g} m", expected="at least 0.01 mm")

    def focal_length_at(self, wavelength_m: float) -> float:
        """f (m) at a wavelength: f_d/f = (n − 1)/(n_d − 1) = 1 + (λ⁻² − λ_d⁻²)/(V·(λ_F⁻² − λ_C⁻²))."""
        if self.abbe is None:
            return self.focal_length_m
        blue, yellow, red = (line_m**-2 for line_m in _FRAUNHOFER_M)
        return self.focal_length_m / (1 + (wavelength_m**-2 - yellow) / (self.abbe * (blue - red)))


@dataclass(frozen=True, eq=False, kw_only=True)
class Space(Element):
    """Free space to the next element, through a relay's stops and aberrations (the keys of `Relay`).

    distance_m: to the next element; None behind the last, where the planes tell how far the light goes.
    """

    kind: ClassVar[str] = "space"
    distance_m: float | None = described_field(
        Number("mm", low=0.0, high=1.0, optional=True),
        "To the next element; none on the way to the planes.",
        default=None,
    )
    iris_na: float | None = same_field(Relay, "iris_na")
    square: SquareStop | None = same_field(Relay, "square")
    centre_na: tuple[float, float] = same_field(Relay, "centre_na")
    dc_block_na: float | None = same_field(Relay, "dc_block_na")
    apodisation_na: float | None = same_field(Relay, "apodisation_na")
    aberration_m: tuple[tuple[int, float], ...] = same_field(Relay, "aberration_m")

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.relay  # which checks that its values suit each other

    @cached_property
    def relay(self) -> Relay:
        """Its stops and aberrations."""
        return Relay(**{field.name: getattr(self, field.name) for field in fields(Relay)})

    @staticmethod
    def over(distance_m: float | None, relay: Relay, name: str = "") -> Space:
        """The space of a distance with the stops of a relay."""
        stops = {field.name: getattr(relay, field.name) for field in fields(Relay)}
        return Space(name=name, distance_m=distance_m, **stops)


@dataclass(frozen=True, eq=False, kw_only=True)
class Fourier(Element):
    """A lens of focal length f, a focal length behind what stands before it: what follows stands in its Fourier plane.

    u(x) ▸ −i/(λf)·∫u(x')·exp(−2πi·x·x'/(λf))dx', sampled at the same pitch as before.
    """

    kind: ClassVar[str] = "fourier"
    focal_length_m: float = described_field(_FOCAL_LENGTH, "Focal length of the lens, half the way.")


KINDS: dict[str, type[Element]] = {
    each.kind: each
    for each in (PhaseModulator, AmplitudeModulator, ComplexModulator, Mask, Lens, Space, Fourier, FieldPlane)
}
"""The classes of elements by their kind."""


@dataclass(frozen=True)
class ElementsField:
    """Field type of a bench's elements: instances, or tables whose `kind` says which they are."""

    def parse(self, value: Any, where: str) -> tuple[Element, ...]:
        if isinstance(value, Mapping | str) or not isinstance(value, Iterable):
            raise UserError(where, f"{value!r}"[:60], expected=f"a list of tables, one [[{where}]] each")
        elements = list[Element]()
        for i, entry in enumerate(value):
            element = self._element(entry, f"{where}[{i}]")
            elements.append(replace(element) if any(element is other for other in elements) else element)
        return tuple(elements)

    def to_toml(self, value: tuple[Element, ...]) -> list[dict[str, Any]]:
        return [{"kind": element.kind, **to_mapping(element)} for element in value]

    def with_changes(self, value: tuple[Element, ...], changes: Mapping[str, Any], where: str) -> tuple[Element, ...]:
        """The elements with changes in some, {"0.pitch": …, "mask.pitch": …}: by their place or their name."""
        entries, names = list(value), element_names(value)
        for key, change in changes.items():
            known, _, rest = key.partition(".")
            index = names.index(known) if known in names else int(known) if known.isdecimal() else len(entries)
            if not rest or index >= len(entries):
                expected = f"an element, {', '.join(names)} or 0 to {len(entries) - 1}, and a key"
                raise UserError(f"{where}.{key}", "unknown key", expected=expected)
            try:
                entries[index] = with_changes(entries[index], {rest: change})
            except UserError as error:
                raise error.inside(f"{where}.{known}.") from error
        return tuple(entries)

    def _element(self, entry: Any, where: str) -> Element:
        if isinstance(entry, Element):
            return entry
        if not isinstance(entry, Mapping):
            raise UserError(where, f"{entry!r}"[:60], expected="a table with a kind and its keys")
        table = dict(entry)
        kind = table.pop("kind", None)
        if not isinstance(kind, str) or kind not in KINDS:
            found = "is missing" if kind is None else f"{kind!r}"[:60]
            remedy = suggest_matches(kind, KINDS) if isinstance(kind, str) else f"one of {', '.join(KINDS)}"
            raise UserError(f"{where}.kind", found, expected="the kind of an element", remedy=remedy)
        try:
            element: Element = from_mapping(KINDS[kind], table)
        except UserError as error:
            raise error.inside(f"{where}.") from error
        return element


def element_names(elements: Iterable[Element]) -> tuple[str, ...]:
    """The names of elements in order: their own, or their kind, with its number where there are several of a kind."""
    kinds, seen, names = [element.kind for element in elements], dict[str, int](), []
    for element in elements:
        seen[element.kind] = number = seen.get(element.kind, 0) + 1
        made = element.kind if kinds.count(element.kind) == 1 else f"{element.kind}{number}"
        names.append(element.name or made)
    return tuple(names)


def modulator_of(element: Element) -> Modulator | None:
    """The modulator of the short form that an element is; None for other elements, and away from the axis."""
    if isinstance(element, Pixels) and (any(element.offset_m) or element.beside):
        return None
    if isinstance(element, PhaseModulator) and not (element.shared or element.held or element.step):
        return Modulator(element.pitch_m, element.shape, element.stroke_m, element.levels)
    return Modulator(element.pitch_m, element.shape, content="field") if isinstance(element, FieldPlane) else None


def element_of(modulator: Modulator, name: str = "") -> Element:
    """A modulator of the short form as an element."""
    if modulator.is_field:
        return FieldPlane(name=name, pitch_m=modulator.pitch_m, shape=modulator.shape)
    return PhaseModulator(
        name=name,
        pitch_m=modulator.pitch_m,
        shape=modulator.shape,
        stroke_m=modulator.stroke_m,
        levels=modulator.levels,
    )
