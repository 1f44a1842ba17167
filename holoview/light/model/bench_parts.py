"""The parts of a bench: `Source`, `Modulator`, `Relay` and `Sampling`; each frozen, checked, and in SI units."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.light.model.fields import (
    Array,
    Choice,
    Coefficients,
    Description,
    Integer,
    LevelFractions,
    Number,
    Shape,
    described_field,
    validate,
)
from holoview.light.model.stops import CentreField, SquareField, SquareStop
from holoview.util.errors import UserError

Floats = NDArray[np.float64]

_ANGLE = Number("mrad", low=-1.0, high=1.0)
_APERTURE = Number(low=1e-5, high=1.0, optional=True)


@dataclass(frozen=True)
class StrokeField(Number):
    """Field type of a modulator's stroke; the plane of a field has none, which is 0 and isn't written."""

    def parse(self, value: Any, where: str) -> float | None:
        return 0.0 if value is None or value == 0.0 else super().parse(value, where)

    def to_toml(self, value: float | None) -> Any:
        return super().to_toml(value) if value else None


_STROKE = StrokeField("nm", low=1e-9, high=20e-6)


@dataclass(frozen=True, eq=False)
class Source(Description):
    """Illumination of the first modulator: mutually incoherent plane waves of equal intensity.

    directions_rad: (source, 2) angles of incidence (y, x); one wave on the axis by default. Each at most 1 rad.
    tilts_rad: (wavelength, 2) angles (y, x) that are added to every direction, for lasers that aren't co-aligned, or
    None.

    Angles are numbers in radians or text such as "5 mrad". Raises UserError for values out of range and for tables
    that don't consist of pairs. The number of rows of `tilts_rad` is checked by `System`.

    >>> import holoview as hv
    >>> source = hv.Source(directions_rad=[["-2 mrad", 0.0], ["2 mrad", 0.0]])
    >>> source.directions_rad.tolist()
    [[-0.002, 0.0], [0.002, 0.0]]
    """

    directions_rad: Floats = described_field(
        Array(_ANGLE, axes=2),
        "Direction (y, x) of each source: the angles of incidence.",
        default_factory=lambda: np.zeros((1, 2)),
    )
    tilts_rad: Floats | None = described_field(
        Array(_ANGLE, axes=2, optional=True),
        "Angle (y, x) that each wavelength adds to every direction: lasers that aren't co-aligned.",
        default=None,
    )

    def __post_init__(self) -> None:
        validate(self)
        for key, table in (("directions", self.directions_rad), ("tilts", self.tilts_rad)):
            if table is not None and (table.ndim != 2 or table.shape[0] < 1 or table.shape[1] != 2):
                raise UserError(key, f"a table of shape {table.shape}", expected="rows of two angles [y, x]")


@dataclass(frozen=True, eq=False)
class Modulator(Description):
    """A phase modulator with square pixels of constant optical path and a fill factor of 1, or the plane of a field.

    pitch_m: distance between pixel centres, 0.1 µm to 1 mm.
    shape: (rows, columns) of pixels, each from 2 to 16384.
    stroke_m: optical path that full drive adds, 1 nm to 20 µm. Drive is given as a fraction 0…1 of it. 0 for a field.
    levels: stroke fractions that can be shown, rising from 0 to 1, or a number of equal levels; None: continuous.
    content: "phase", or "field": a plane in which a complex field is known at points, one for each "pixel", as another
    program or a recording has it. Such a plane has neither stroke nor levels, and its drive is the field itself.

    Lengths are metres or text such as "8 um". Raises UserError for values out of range, and for a phase modulator
    without a stroke.

    >>> import holoview as hv
    >>> modulator = hv.Modulator(pitch_m="8 um", shape=(768, 1024), stroke_m="800 nm", levels=3)
    >>> modulator.pitch_m, modulator.levels.tolist()
    (8e-06, [0.0, 0.5, 1.0])
    """

    pitch_m: float = described_field(Number("um", low=0.01e-6, high=1e-3), "Distance between pixel centres.")
    shape: tuple[int, int] = described_field(Shape(), "Rows and columns of pixels.")
    stroke_m: float = described_field(_STROKE, "Optical path that full drive adds.", default=None)
    levels: Floats | None = described_field(LevelFractions(), "Stroke fractions that can be shown.", default=None)
    content: str = described_field(
        Choice(("phase", "field"), unwritten="phase"),
        "phase: a phase modulator; field: the plane of a complex field, without stroke and levels.",
        default="phase",
    )

    def __post_init__(self) -> None:
        validate(self)
        if self.is_field and (self.stroke_m or self.levels is not None):
            raise UserError(
                "stroke" if self.stroke_m else "levels", "with a field", expected="none: a field isn't shown by pixels"
            )
        if not self.is_field and not self.stroke_m:
            raise UserError("stroke", "is missing", expected="Optical path that full drive adds.")

    @property
    def is_field(self) -> bool:
        """Whether it is the plane of a complex field.

        >>> import holoview as hv
        >>> hv.Modulator("8 um", (48, 64), content="field").is_field
        True
        """
        return self.content == "field"


@dataclass(frozen=True, eq=False)
class Relay(Description):
    """Imaging optics between two planes: the stops in its Fourier plane, and its aberrations.

    iris_na: numerical aperture of a round iris, the sine of the steepest direction that passes; None: no iris.
    square: a square stop, a `SquareStop`: its half side as a numerical aperture; "first order", which passes
    |u_y|, |u_x| < 1/(2·pitch) at every wavelength; "first order at 650 nm", a real aperture that is as wide as that
    at one wavelength; None: no square stop. With `iris_na`, light has to pass both.
    centre_na: direction sine (y, x) of the centre of the iris and of the square stop.
    dc_block_na: numerical aperture of a round stop at the zero order, which doesn't cover all that the iris and the
    square stop pass; None: no stop.
    apodisation_na: aperture at which a Gaussian transmission falls to 1/e in amplitude; None: uniform.
    aberration_m: Zernike terms over the pupil, a table {"Z4": "50 nm"} or pairs (Noll index 1…37, r.m.s. optical path
    in metres), each at most 0.1 mm. They need an iris or a square stop: the pupil is the iris, or the circle through
    the corners of the square where that is smaller or alone.

    A relay without arguments images perfectly. Magnification isn't modelled: distances and pitches are those of the
    image space of the relay. Raises UserError for values out of range or that contradict each other.

    >>> import holoview as hv
    >>> relay = hv.Relay(iris_na=0.02, aberration_m={"Z4": "50 nm"})
    >>> relay.aberration_m, relay.is_clear, hv.Relay().is_clear
    (((4, 5e-08),), False, True)
    >>> round(hv.Relay(square="first order").steepest_sine(532e-9, pitch_m=8e-6), 6)  # to the corners: √2·λ/(2·pitch)
    0.047023
    """

    iris_na: float | None = described_field(
        _APERTURE, "Numerical aperture of a round iris; none when absent.", default=None
    )
    square: SquareStop | None = described_field(
        SquareField(),
        'A square stop: "first order", "first order at 550 nm", or half its side as an aperture.',
        default=None,
    )
    centre_na: tuple[float, float] = described_field(
        CentreField(), "Direction sine (y, x) of the centre of the iris and of the square stop.", default=(0.0, 0.0)
    )
    dc_block_na: float | None = described_field(
        _APERTURE, "Radius of a round stop at the zero order, as an aperture.", default=None
    )
    apodisation_na: float | None = described_field(
        _APERTURE, "Aperture at which a Gaussian transmission falls to 1/e in amplitude.", default=None
    )
    aberration_m: tuple[tuple[int, float], ...] = described_field(
        Coefficients("Z", Number("nm", low=-1e-4, high=1e-4), highest=37),
        "Zernike terms (Noll index, r.m.s. optical path) over the pupil.",
        default=(),
    )

    def __post_init__(self) -> None:
        validate(self)
        self._check_dc_block(self._farthest_sine(None if self.square is None else self.square.half_side_na))
        if not self.has_aperture and self.aberration_m:
            remedy = "give iris_na or square: Zernike terms are over the pupil"
            raise UserError("aberration", "without an iris or a square stop", remedy=remedy)
        if not self.has_aperture and any(self.centre_na):
            raise UserError("centre_na", "without an iris or a square stop", remedy="give iris_na or square")

    def check_passes_light(self, wavelength_m: float, pitch_m: float) -> None:
        """Raises UserError if the DC block covers all that the other stops pass.

        wavelength_m: of the light. pitch_m: of the modulators' pixels, on which a stop at the first order depends.

        >>> import holoview as hv
        >>> relay = hv.Relay(square="first order", dc_block_na=0.06)
        >>> relay.check_passes_light(700e-9, pitch_m=8e-6)
        >>> try:
        ...     relay.check_passes_light(450e-9, pitch_m=8e-6)
        ... except hv.UserError as error:
        ...     print(error.expected)
        less than the steepest direction that the other stops pass = 0.0397748
        """
        self._check_dc_block(self.steepest_sine(wavelength_m, pitch_m))

    def _check_dc_block(self, edge: float) -> None:
        if self.dc_block_na is not None and self.dc_block_na >= edge:
            what = "iris_na" if edge == self.iris_na else "the steepest direction that the other stops pass"
            raise UserError(
                "dc_block_na",
                f"{self.dc_block_na:g}",
                expected=f"less than {what} = {edge:.6g}",
                remedy="nothing would pass the relay otherwise",
            )

    @property
    def has_aperture(self) -> bool:
        """Whether there is an iris or a square stop.

        >>> import holoview as hv
        >>> hv.Relay(square=0.02).has_aperture, hv.Relay(dc_block_na=0.001).has_aperture
        (True, False)
        """
        return self.iris_na is not None or self.square is not None

    def steepest_sine(self, wavelength_m: float, pitch_m: float) -> float:
        """The largest direction sine along y or x that the iris and the square stop pass; 1 without either.

        wavelength_m: of the light.
        pitch_m: of the modulators' pixels, on which a stop at the first order depends.

        >>> import holoview as hv
        >>> hv.Relay(iris_na=0.02, centre_na=(0.0, 0.005)).steepest_sine(532e-9, pitch_m=8e-6)
        0.025
        """
        return self._farthest_sine(None if self.square is None else self.square.half_side_sine(wavelength_m, pitch_m))

    def first_order_sine(self, wavelength_m: float, pitch_m: float) -> float:
        """The same of the first order's light alone: at most λ/(2·pitch), the edge of the first order.

        wavelength_m: of the light. pitch_m: of the modulators' pixels.

        >>> import holoview as hv
        >>> hv.Relay().first_order_sine(532e-9, pitch_m=8e-6), hv.Relay(iris_na=0.02).first_order_sine(532e-9, 8e-6)
        (0.03325, 0.02)
        """
        return min(self.steepest_sine(wavelength_m, pitch_m), wavelength_m / (2 * pitch_m))

    def axis_sine(self, wavelength_m: float, pitch_m: float) -> float:
        """The largest direction sine along y or x alone that the iris and the square stop pass; 1 without either.

        wavelength_m: of the light. pitch_m: of the modulators' pixels, on which a stop at the first order depends.

        >>> import holoview as hv
        >>> hv.Relay(square="first order").axis_sine(532e-9, pitch_m=8e-6)
        0.03325
        """
        iris = 1.0 if self.iris_na is None else self.iris_na
        half = iris if self.square is None else min(iris, self.square.half_side_sine(wavelength_m, pitch_m))
        return min(1.0, half + max(map(abs, self.centre_na)))

    def _farthest_sine(self, half_side: float | None) -> float:
        """The largest direction sine in the iris and in a square of this half side; at most 1."""
        farthest = 1.0
        if self.iris_na is not None:
            farthest = min(farthest, self.iris_na + math.hypot(*self.centre_na))
        if half_side is not None:
            farthest = min(farthest, math.hypot(*(abs(c) + half_side for c in self.centre_na)))
        return farthest

    def pupil_radius_sine(self, wavelength_m: float, pitch_m: float) -> float:
        """Radius of the pupil as a direction sine: of the iris, or of the circle through the corners of the square.

        The smaller one where there are both, 1 where there is neither.

        wavelength_m: of the light. pitch_m: of the modulators' pixels, on which a stop at the first order depends.

        >>> import holoview as hv
        >>> hv.Relay(iris_na=0.02).pupil_radius_sine(532e-9, pitch_m=8e-6)
        0.02
        """
        iris = 1.0 if self.iris_na is None else self.iris_na
        if self.square is None:
            return iris
        return min(iris, math.sqrt(2) * self.square.half_side_sine(wavelength_m, pitch_m))

    @property
    def is_clear(self) -> bool:
        """Whether the relay has neither a stop, nor apodisation, nor aberrations.

        >>> import holoview as hv
        >>> hv.Relay().is_clear, hv.Relay(iris_na=0.02).is_clear
        (True, False)
        """
        return self == Relay()


@dataclass(frozen=True, eq=False)
class Sampling(Description):
    """The grid on which the light is computed.

    upsample: samples along each side of a modulator pixel, 1 to 16. 2 or more resolves the sinc envelope of the pixels.
    propagation: "linear": the grid is `padding` times as large as the modulators, so that light that leaves them at a
    side doesn't return at the other; "compact": padded by the largest walk-off only; "periodic": not padded, light
    wraps around.
    padding: sides of a linear grid in sides of the modulators, 2 to 8.

    Raises UserError for values out of range. docs/physics-evidence.md has the price of each in accuracy.

    >>> import holoview as hv
    >>> hv.Sampling(upsample=2, propagation="compact")
    Sampling(upsample=2, propagation='compact', padding=2)
    """

    upsample: int = described_field(Integer(1, 16), "Simulation samples a modulator pixel and axis.", default=2)
    propagation: str = described_field(
        Choice(("linear", "compact", "periodic")),
        "linear: padded to `padding` times the size; compact: padded by the largest walk-off; periodic: not padded.",
        default="linear",
    )
    padding: int = described_field(Integer(2, 8), "Sides of a linear grid in sides of the modulators.", default=2)

    def __post_init__(self) -> None:
        validate(self)
