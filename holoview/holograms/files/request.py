"""Requests to a reader: what the user knows of a hologram's file, and which part of it is wanted.

`ReadRequest` declares each statement once: flags of commands, notes beside files and the manual's tables follow.
"""

from __future__ import annotations

import math
from dataclasses import Field, dataclass, replace
from typing import Any, ClassVar, Literal, get_args

from holoview.light.model.fields import (
    Choice,
    Integer,
    Maybe,
    Nested,
    Number,
    Several,
    Truth,
    Word,
    described_field,
    spaced_key,
    validate,
    with_field_docs,
)
from holoview.light.numerics.sampling import Region
from holoview.util import units
from holoview.util.errors import UserError

Quantity = Literal["complex", "amplitude", "phase", "intensity", "bilevel"]
"""The quantity of a file's numbers. Bilevel: a pattern of two values, of whose spectrum one half is the field."""

Part = Literal["real", "imaginary", "amplitude", "phase", "r", "g", "b", "frame"]
"""The part that one of several files has in the field that they make together."""

RecordingKind = Literal["off-axis", "in-line", "phase-shifting", "none"]
"""How a camera recorded a hologram; "none" states that a real picture isn't a recording."""

AxisPlace = Literal["first", "last"]

Propagation = Literal["auto", "asm", "fresnel", "fourier"]
"""How the field's light goes to its distance: see `holoview.holograms.fields.propagation`."""

Steps = tuple[float, ...] | Literal["equal", "unknown"]
"""Phases of the reference in the pictures of a phase-shifting set, rad; "equal": 2π/N apart; "unknown": to be found."""


MOST_UNASKED = 1 << 24
"""Samples a colour: of a field with more, commands and the viewer read the middle unless a part is asked for."""


@dataclass(frozen=True)
class Order:
    """A first order in the spectrum of an off-axis recording.

    carrier: its centre (y, x), cycles a sample. radius: of the light that is kept around it, cycles a sample. origin:
    of the centre: the order's peak, which is light that the object didn't scatter, so that its tilt is removed exactly;
    its centre of gravity; or the user's choice.
    """

    carrier: tuple[float, float]
    radius: float
    origin: Literal["peak", "gravity", "given"] = "given"

    def conjugate(self) -> Order:
        """The order on the other side, which holds the conjugate field."""
        return replace(self, carrier=(-self.carrier[0], -self.carrier[1]))

    def describe(self) -> str:
        """The order in words."""
        origin = {"peak": "tilt from its peak", "gravity": "centred on its light", "given": "as given"}[self.origin]
        y, x = self.carrier
        return f"order at {x:.4f}, {y:.4f} cycles a pixel (x, y), radius {self.radius:.4f}, {origin}"


@dataclass(frozen=True)
class Viewpoint:
    """A square part of a hologram through which it is seen, the rest being dark: a synthetic aperture.

    place: of its centre (x, y): −1 touches the left or upper edge, 0 is the middle, 1 touches the right or lower edge.
    size: of a side in samples, or in degrees as seen from the middle of the image if `in_degrees`.

    Raises UserError for places and sizes that can't be.
    """

    place: tuple[float, float]
    size: float
    in_degrees: bool = False

    def __post_init__(self) -> None:
        if not (max(map(abs, self.place)) <= 1 and (0 < self.size < 180 if self.in_degrees else self.size >= 1)):
            found = f"{self.place[0]:g}, {self.place[1]:g}, {self.size:g}{'deg' * self.in_degrees}"
            raise UserError("viewpoint", found, expected="x and y from -1 to 1, and a size such as 512 or 2deg")


class Notation:
    """The type of a value with a notation of its own, in which text is; anything else is an SI value.

    made: types of its SI values. metavar: the notation, for the help of a flag. words: what is expected, for errors and
    the manual. is_appended: whether its flag is repeated for several of them.
    """

    made: ClassVar[Any] = (tuple, list)
    metavar: ClassVar[str] = ""
    words: str = ""
    is_appended: ClassVar[bool] = False

    def parse(self, value: Any, where: str) -> Any:
        found = self.read(value, where) if isinstance(value, str) else value if isinstance(value, self.made) else None
        if found is None:
            raise UserError(where, f'"{value}"' if isinstance(value, str) else repr(value), expected=self.words)
        return self.checked(found, where)

    def read(self, text: str, where: str) -> Any:
        """The value of a text; None where it isn't in this notation."""
        raise NotImplementedError

    def checked(self, value: Any, where: str) -> Any:
        """An SI value. Raises UserError for one that can't be."""
        return value

    def format_range(self) -> str:
        """What is expected, for the manual."""
        return self.words


def _numbers(text: str, least: int, most: int) -> list[float]:
    """The finite numbers of a text with commas, also with the unit deg; none for any other text."""
    try:
        numbers = [float(part.removesuffix("deg")) for part in text.replace(" ", "").split(",")]
    except ValueError:
        return []
    return numbers if least <= len(numbers) <= most and all(map(math.isfinite, numbers)) else []


class StepsType(Notation):
    """Steps of the reference, degrees in its notation."""

    metavar = "DEGREES"
    words = "degrees, one a picture, such as 0,90,180,270; or unknown"

    def read(self, text: str, where: str) -> Any:
        return text if text in ("equal", "unknown") else tuple(map(math.radians, _numbers(text, 3, 64))) or None

    def to_toml(self, value: Steps) -> Any:
        return value if isinstance(value, str) else [round(math.degrees(step), 9) for step in value]


class OrderType(Notation):
    """An order; without a radius it has half of its distance from the middle."""

    made = Order
    metavar = "FX,FY[,RADIUS]"
    words = "f_x,f_y or f_x,f_y,radius in cycles a pixel: 0.25,0.2"

    def read(self, text: str, where: str) -> Any:
        if not (numbers := _numbers(text, 2, 3)):
            return None
        x, y, *radius = numbers
        return Order((y, x), radius[0] if radius else math.hypot(x, y) / 2)

    def checked(self, value: Order, where: str) -> Order:
        (y, x), radius = value.carrier, value.radius
        if not (max(abs(x), abs(y)) <= 0.5 and 0 < radius <= 0.5):
            found = f"at {x:g}, {y:g} with the radius {radius:g}"
            raise UserError(where, found, expected="cycles a pixel: from -0.5 to 0.5, a radius above 0 to 0.5")
        return value

    def to_toml(self, value: Order) -> list[float]:
        return [value.carrier[1], value.carrier[0], value.radius]


class ViewpointType(Notation):
    """A viewpoint."""

    made = Viewpoint
    metavar = "X,Y,SIZE"
    words = "x,y,size: places from -1 to 1, and a side of samples or degrees, such as -1,0,2deg"
    is_appended = True

    def read(self, text: str, where: str) -> Any:
        numbers = _numbers(text, 3, 3)
        return Viewpoint((numbers[0], numbers[1]), numbers[2], text.strip().endswith("deg")) if numbers else None


@dataclass(frozen=True)
class LengthPair(Notation):
    """Two lengths (y, x), in its notation x,y. item: type of each. takes_one: whether one stands for both."""

    item: Number
    takes_one: bool = False
    words: str = "x,y with a unit, such as 12,-3um"
    metavar = "X,Y"

    def read(self, text: str, where: str) -> Any:
        return tuple(units.parse_several(text, where)[::-1])

    def checked(self, value: Any, where: str) -> Any:
        if not 2 - self.takes_one <= len(value) <= 2:
            raise UserError(where, f"{len(value)} lengths", expected=self.words)
        return tuple(self.item.parse(value[i], where) for i in (0, -1))

    def to_toml(self, value: tuple[float, float]) -> list[str]:
        return [self.item.to_toml(length) for length in value[::-1]]


class RegionType(Notation):
    """A part in samples from the upper left."""

    metavar = "PART"
    words = "x,y,width,height in whole samples, or degrees such as 2deg or 2deg,1,0"

    def read(self, text: str, where: str) -> Any:
        try:
            return tuple(map(int, text.split(",")))
        except ValueError:
            return None

    def checked(self, value: Any, where: str) -> Any:
        if len(value) != 4 or min(value) < 0 or 0 in value[2:]:
            raise UserError(where, ",".join(map(str, value)), expected=self.words)
        return tuple(value)


class DegreesType(RegionType):
    """A square in degrees, the size first, as seen from the image."""

    def read(self, text: str, where: str) -> Any:
        numbers = _numbers(text, 1, 3)
        return (numbers[0], *(numbers[1:] or (0.0, 0.0))) if len(numbers) in (1, 3) else None

    def checked(self, value: Any, where: str) -> Any:
        if len(value) != 3:
            raise UserError(where, ",".join(map(str, value)), expected=self.words)
        return tuple(value)


def _name(field: Field[Any]) -> str:
    """The name of a field in errors: its flag in words, if it has one."""
    return str(field.metadata["flag"]).replace("-", " ") or spaced_key(field)


class Pitches(Several):
    """Two lengths (y, x), of which one stands for both."""

    def parse(self, value: Any, where: str) -> tuple[Any, ...]:
        pitches = super().parse([value] if isinstance(value, int | float) else value, where)
        if not 1 <= len(pitches) <= 2:
            raise UserError(where, f"{len(pitches)} lengths", expected="one, or two: along y and along x")
        return pitches[0], pitches[-1]


_MOST = 1 << 62
_COUNT = Integer(1, _MOST, "a whole number from 1")
_LEAST = math.nextafter(0.0, 1.0)
_FAR = Number("mm", low=-1e6, high=1e6, words="a length of at most 1000 km")
_POSITIVE = Number("mm", low=_LEAST, words="a length above 0")


@with_field_docs
@dataclass(frozen=True)
class WindowRequest:
    """The window in which the image of a field is seen, at its distance; pairs are (y, x), in text x,y.

    Raises UserError for lengths that can't be.

    Fields:
    """

    centre_m: tuple[float, float] = described_field(
        LengthPair(Number("mm", low=-10.0, high=10.0)),
        "See the image in a window around this place beside the axis.",
        flag="window-centre",
        default=(0.0, 0.0),
    )
    side_m: tuple[float, float] | None = described_field(
        Maybe(LengthPair(_POSITIVE, True, "a width and a height such as 4,3mm, or one length for both")),
        "Width and height of this window, or one length for both; the field's if absent.",
        flag="window-size",
        default=None,
    )
    pitch_m: float | None = described_field(
        Maybe(_POSITIVE), "Between its samples; the field's pitch if absent.", flag="window-pitch", default=None
    )

    def __post_init__(self) -> None:
        validate(self, _name)


@with_field_docs
@dataclass(frozen=True)
class BinaryLayout:
    """The layout of a binary dump: a file of numbers without a description.

    Fields:
    """

    dtype: str = described_field(Choice(), 'numpy\'s name of the type of its numbers, such as "<f4" or "complex64".')
    shape: tuple[int, ...] = described_field(
        Several(_COUNT), "Sizes of its axes, slowest first, without the axis of the parts."
    )
    offset: int | None = described_field(
        Maybe(Integer(0, _MOST, words="bytes before the numbers, from 0")),
        "Bytes before the numbers; if absent, as many as the file has too many.",
        default=None,
    )
    order: Literal["C", "F"] = described_field(
        Word(("C", "F")),
        '"C" if the last axis is the fastest, "F" if the first is, as in MATLAB and Fortran.',
        default="C",
    )
    parts: tuple[str, ...] = described_field(
        Several(Choice()),
        "What the numbers are, in the order in which they stand: `complex`; `real`, `imaginary`; …",
        default=(),
    )
    interleaved: bool = described_field(
        Truth(),
        "The parts alternate from sample to sample; otherwise they follow each other as whole arrays.",
        default=True,
    )

    def __post_init__(self) -> None:
        validate(self)


@with_field_docs
@dataclass(frozen=True)
class ReadRequest:
    """Knowledge of a file and wishes of a user; None, or an empty tuple, where there is none.

    Raises UserError for impossible lengths, numbers and words.

    Fields:
    """

    pitch_m: tuple[float, float] | None = described_field(
        Maybe(Pitches(Number("um", low=1e-9, high=1e-2))),
        "Between samples, e.g. 8um; two of them: along y, then along x. A field of two pitches is resampled to the "
        "smaller one.",
        flag="pitch",
        default=None,
    )
    wavelengths_m: tuple[float, ...] = described_field(
        Several(Number("nm", low=1e-11, high=1e-4)),
        "Of each colour in the file's order, in vacuum.",
        flag="wavelength",
        default=(),
    )
    distance_m: float | None = described_field(
        Maybe(_FAR),
        "From the plane of the field to its image; negative where it lies before the plane. The first --plane if "
        "absent.",
        flag="distance",
        default=None,
    )
    reference_radius_m: float | None = described_field(
        Maybe(_FAR), "Of the spherical wave with which the field is lit, as of Fourier holograms.", default=None
    )
    quantity: Quantity | None = described_field(
        Maybe(Word(get_args(Quantity))), "What the numbers are.", flag="quantity", default=None
    )
    variable: str | None = described_field(
        Maybe(Choice()),
        "Which array, where a file holds several; or names with commas, one for each part.",
        flag="variable",
        default=None,
    )
    parts: tuple[Part, ...] = described_field(
        Several(Word(get_args(Part))),
        "What each of several files or arrays is of one field: real,imaginary; amplitude,phase; r,g,b; frame,…",
        flag="parts",
        default=(),
    )
    recording: RecordingKind | None = described_field(
        Maybe(Word(get_args(RecordingKind))),
        "How a camera recorded it, phase-shifting in three or more pictures of one object; none: it didn't.",
        flag="recording",
        default=None,
    )
    steps: Steps | None = described_field(
        Maybe(StepsType()),
        "Of a phase-shifting set: phases of the reference in its pictures; equal, 2π/N apart, if absent; unknown: "
        "found from the pictures.",
        flag="steps",
        default=None,
    )
    orders: tuple[Order, ...] = described_field(
        Several(OrderType()),
        "Of an off-axis recording, in cycles a pixel, one for each wavelength or one for all; found if absent.",
        flag="order",
        default=(),
    )
    dark_field: bool | None = described_field(
        Maybe(Truth()),
        "Of an in-line recording: without its beam, so that objects that change little of the light stand out; if "
        "absent, where the fringes of the beam's frame hide them.",
        flag="dark-field",
        default=None,
    )
    refractive_index: float | None = described_field(
        Maybe(Number(low=0.1, high=10, words="a number from 0.1 to 10")),
        "Of the medium behind the field; wavelengths are divided by it.",
        flag="index",
        default=None,
    )
    conjugated: bool | None = described_field(
        Maybe(Truth()), "Phases were written with the other sign: exp(−iφ).", flag="conjugate", default=None
    )
    checkerboard: bool | None = described_field(
        Maybe(Truth()),
        "The phase alternates by π from sample to sample, which is removed. A transform with its zero frequency at the "
        "corner leaves this, and the image lies in four pieces at the corners.",
        default=None,
    )
    phase_levels: float | None = described_field(
        Maybe(Number(low=_LEAST, high=2.0**32, words="a number above 0, at most 2^32")),
        "The number in the file that stands for 2π: 255, 256, 1, or 2π for radians.",
        default=None,
    )
    colour_axis: AxisPlace | None = described_field(
        Maybe(Word(get_args(AxisPlace))), "Which axis of the file the colours are.", default=None
    )
    transposed: bool | None = described_field(Maybe(Truth()), "y and x are exchanged.", default=None)
    region: Region | None = described_field(
        Maybe(RegionType()),
        "Read a part: X,Y,WIDTH,HEIGHT in samples from the upper left, where the format allows it without the rest.",
        flag="aperture",
        default=None,
    )
    aperture_deg: tuple[float, float, float] | None = described_field(
        Maybe(DegreesType()),
        "Or a square of degrees as seen from the image: 2deg in the middle, or 2deg,X,Y with its centre at X, Y.",
        flag="aperture",
        default=None,
    )
    viewpoint: Viewpoint | None = described_field(
        Maybe(ViewpointType()),
        "See it through a square part, the rest being dark: its place from -1 (left, upper edge) to 1, and its side in "
        "samples or degrees as seen from the image: -1,0,2deg. render and compare take it several times.",
        flag="viewpoint",
        default=None,
    )
    colour_shifts_m: tuple[tuple[float, float], ...] = described_field(
        Several(LengthPair(Number("um", low=-1.0, high=1.0))),
        "Move the field of each colour, one pair for each: 0,0um 12,-3um 5,5um. Light that leaves the field is lost.",
        flag="colour-shift",
        default=(),
    )
    most_samples: int | None = described_field(
        Maybe(_COUNT),
        "Of a field with more samples a colour only the middle is read, unless a part or `decimate` is stated.",
        default=None,
    )
    decimate: int = described_field(
        Integer(1),
        "The mean of N × N samples becomes one, which keeps the middle of the spectrum.",
        flag="decimate",
        default=1,
    )
    binary: BinaryLayout | None = described_field(
        Maybe(Nested(BinaryLayout)), "Of a file of bare numbers.", default=None
    )
    accept_guesses: bool = described_field(
        Truth(),
        "Take guesses for what nothing tells, and say them; otherwise these are errors.",
        flag="guess",
        default=False,
    )
    propagation: Propagation = described_field(
        Word(get_args(Propagation)),
        "To its distance: asm, the angular spectrum in the field's own window; one transform for far images.",
        flag="propagation",
        default="auto",
    )
    window: WindowRequest | None = described_field(
        Maybe(Nested(WindowRequest)), "In which the image is seen.", default=None
    )

    def __post_init__(self) -> None:
        validate(self, _name)
