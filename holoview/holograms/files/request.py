"""Requests to a reader: what the user knows of a hologram's file, and which part of it is wanted."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, get_args

from holoview.light.numerics.sampling import Region
from holoview.util import units
from holoview.util.errors import UserError, suggest_matches

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


@dataclass(frozen=True)
class WindowRequest:
    """The window in which the image of a field is seen, at its distance.

    centre_m: (y, x) of its centre beside the axis, m. side_m: height and width, m; the field's own if None. pitch_m:
    between its samples, m; the field's own if None.

    Raises UserError for lengths that can't be.
    """

    centre_m: tuple[float, float] = (0.0, 0.0)
    side_m: tuple[float, float] | None = None
    pitch_m: float | None = None

    def __post_init__(self) -> None:
        lengths = [*(self.side_m or ()), *(() if self.pitch_m is None else (self.pitch_m,))]
        if not all(math.isfinite(length) and length > 0 for length in lengths):
            raise UserError("window", f"{min(lengths):g} m", expected="a size and a pitch above 0")
        if not all(abs(place) <= 10 for place in self.centre_m):
            raise UserError("window", f"{max(self.centre_m, key=abs):g} m beside the axis", expected="at most 10 m")


@dataclass(frozen=True)
class BinaryLayout:
    """The layout of a binary dump: a file of numbers without a description.

    dtype: numpy's name of the type of its numbers, such as "<f4" or "complex64"; shape: the sizes of its axes, slowest
    first, without the axis of the parts. offset: bytes before the numbers, if None as many as the file has too many.
    order: "C" if the last axis is the fastest, "F" if the first is, as in MATLAB and Fortran.
    parts: what the numbers are, in the order in which they stand: ("complex",), ("real", "imaginary"), … .
    interleaved: whether the parts alternate from sample to sample; otherwise they follow each other as whole arrays.
    """

    dtype: str
    shape: tuple[int, ...]
    offset: int | None = None
    order: Literal["C", "F"] = "C"
    parts: tuple[str, ...] = ()
    interleaved: bool = True


@dataclass(frozen=True)
class ReadRequest:
    """Knowledge of a file and wishes of a user; None, or an empty tuple, where there is none.

    pitch_m: distances (y, x) between samples, m. wavelengths_m: in vacuum, m, in the order of the file's colours.
    distance_m: from the plane of the field to its image, m; negative where the image lies before the plane.
    reference_radius_m: radius of the spherical wave with which the field is lit, m, as of Fourier holograms.
    quantity: what the numbers are. variable: name of the array, where a file holds several.
    parts: what each of several files, or of several variables named in `variable` with commas, is of one field.
    recording: how a camera recorded the picture, or "none" for a real picture that isn't a recording.
    steps: of a phase-shifting set; equal ones if None. orders: of an off-axis recording, one for each wavelength or one
    for all; found in its spectrum if there is none.
    dark_field: whether the beam of an in-line recording is taken away; if None, where it hides what the objects change.
    refractive_index: of the medium behind the field; wavelengths are divided by it.
    conjugated: whether phases were written with the other sign, so that the field is exp(−iφ).
    checkerboard: whether the phase alternates by π from sample to sample, which is then removed. A transform with its
    zero frequency at the corner leaves this, and the image lies in four pieces at the corners.
    phase_levels: the number in the file that stands for 2π: 255, 256, 1, or 2π for radians.
    colour_axis: whether the colours are the file's first or last axis. transposed: whether y and x are exchanged.
    region: (x, y, width, height) in samples from the upper left; the rest isn't read where the format allows it.
    aperture_deg: (size, x, y) of a square region in degrees as seen from the image, its centre at x, y from the middle.
    viewpoint: through which part of the field it is seen. colour_shifts_m: by how much the field of each colour is
    moved along (y, x), m, where a camera took them one beside the other; light that leaves the field is lost.
    most_samples: of a field with more samples a colour only the middle is read, unless a part or `decimate` is stated.
    decimate: the mean of so many samples in both directions becomes one, which keeps the middle of the spectrum.
    binary: the layout of a file without a description.
    propagation: how the light goes from the field to its distance. window: in which it is seen there.
    accept_guesses: take guesses where nothing tells a necessary property; otherwise these are errors.

    Raises UserError for impossible lengths and numbers.
    """

    pitch_m: tuple[float, float] | None = None
    wavelengths_m: tuple[float, ...] = ()
    distance_m: float | None = None
    reference_radius_m: float | None = None
    quantity: Quantity | None = None
    variable: str | None = None
    parts: tuple[Part, ...] = ()
    recording: RecordingKind | None = None
    steps: Steps | None = None
    orders: tuple[Order, ...] = ()
    dark_field: bool | None = None
    refractive_index: float | None = None
    conjugated: bool | None = None
    checkerboard: bool | None = None
    phase_levels: float | None = None
    colour_axis: AxisPlace | None = None
    transposed: bool | None = None
    region: Region | None = None
    aperture_deg: tuple[float, float, float] | None = None
    viewpoint: Viewpoint | None = None
    colour_shifts_m: tuple[tuple[float, float], ...] = ()
    most_samples: int | None = None
    decimate: int = 1
    binary: BinaryLayout | None = None
    accept_guesses: bool = False
    propagation: Propagation = "auto"
    window: WindowRequest | None = None

    def __post_init__(self) -> None:
        for key, lengths, unit, low, high in (
            ("pitch", self.pitch_m or (), "um", 1e-9, 1e-2),
            ("wavelength", self.wavelengths_m, "nm", 1e-11, 1e-4),
        ):
            for length in lengths:
                if not low <= length <= high:
                    found, *limits = (units.format_rounded(x, unit) for x in (length, low, high))
                    raise UserError(key, found, expected=f"a length from {limits[0]} to {limits[1]}")
        for key, number in (("distance", self.distance_m), ("radius of the reference", self.reference_radius_m)):
            if number is not None and not abs(number) <= 1e6:
                raise UserError(key, f"{number:g} m", expected="a length of at most 1000 km")
        if self.phase_levels is not None and not 0 < self.phase_levels <= 2**32:
            raise UserError("phase levels", f"{self.phase_levels:g}", expected="a number above 0, at most 2^32")
        if self.refractive_index is not None and not 0.1 <= self.refractive_index <= 10:
            raise UserError("refractive index", f"{self.refractive_index:g}", expected="a number from 0.1 to 10")
        if any(not abs(length) <= 1.0 for shift in self.colour_shifts_m for length in shift):
            raise UserError("colour shift", "beyond 1 m", expected="lengths of at most 1 m")
        for order in self.orders:
            if not (max(map(abs, order.carrier)) <= 0.5 and 0 < order.radius <= 0.5):
                y, x = order.carrier
                found = f"at {x:g}, {y:g} with the radius {order.radius:g}"
                raise UserError("order", found, expected="cycles a pixel: from -0.5 to 0.5, a radius above 0 to 0.5")
        if self.decimate < 1:
            raise UserError("decimate", f"{self.decimate}", expected="a whole number from 1")
        if self.region is not None and (min(self.region) < 0 or 0 in self.region[2:]):
            raise UserError("region", f"{self.region}", expected="x, y from 0 and a width and height from 1")
        for key, word, known in (
            ("quantity", self.quantity, get_args(Quantity)),
            ("recording", self.recording, get_args(RecordingKind)),
            ("colour axis", self.colour_axis, get_args(AxisPlace)),
            ("propagation", self.propagation, get_args(Propagation)),
            *(("parts", part, get_args(Part)) for part in self.parts),
        ):
            if word is not None and word not in known:
                raise UserError(key, f'"{word}"', remedy=suggest_matches(word, known))
