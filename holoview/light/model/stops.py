"""The square stop of a relay: its half side as a numerical aperture, or at the edge of the modulators' first order."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from holoview.light.model.fields import Number
from holoview.util import units
from holoview.util.errors import UserError

_FIRST_ORDER = "first order"
_TEXT = re.compile(rf"(?:(?P<scale>\S+) )?{_FIRST_ORDER}(?: of (?P<of>.+?))?(?: at (?P<wavelength>.+))?")
_SCALE = Number(low=0.01, high=100.0)
_REFERENCE_M = 550e-9
_WAVELENGTH = Number("nm", low=100e-9, high=10e-6)
_EXPECTED = f'a numerical aperture, "{_FIRST_ORDER}", "{_FIRST_ORDER} at 550 nm" or "1.2 {_FIRST_ORDER}"'

APERTURE = Number(low=1e-5, high=1.0)
"""Field type of the numerical aperture of a stop."""


@dataclass(frozen=True)
class SquareStop:
    """A square stop in the Fourier plane of a relay, with sides along y and x, which pass nothing themselves.

    half_side_na: direction sine at the middle of a side, the same at every wavelength, as of a real aperture; or None
    for a stop at the modulators' first order, |u_y|, |u_x| < 1/(2·pitch).
    wavelength_m: where `half_side_na` is None, the wavelength at which a real aperture is as wide as the first order;
    None for an ideal stop, which is as wide as the first order at every wavelength.
    scale: factor on the width of the first order; 1 with `half_side_na`.
    of: the name of the element whose first order it is; "" where all pitches are equal, or with `half_side_na`.

    `Relay.square` holds one, and takes a number or text in its place.

    >>> import holoview as hv
    >>> hv.Relay(square="first order at 650 nm").square == hv.SquareStop(wavelength_m=650e-9)
    True
    >>> hv.Relay(square=0.03).square
    SquareStop(half_side_na=0.03, wavelength_m=None, scale=1.0, of='')
    """

    half_side_na: float | None = None
    wavelength_m: float | None = None
    scale: float = 1.0
    of: str = ""

    def half_side_sine(self, wavelength_m: float, pitch_m: float) -> float:
        """The direction sine at the middle of a side.

        wavelength_m: of the light. pitch_m: of the modulators' pixels.

        >>> import holoview as hv
        >>> real, ideal = hv.SquareStop(wavelength_m=650e-9), hv.SquareStop()
        >>> real.half_side_sine(450e-9, pitch_m=8e-6), ideal.half_side_sine(450e-9, pitch_m=8e-6)
        (0.040625, 0.028125)
        """
        if self.half_side_na is not None:
            return self.half_side_na
        return self.scale * (wavelength_m if self.wavelength_m is None else self.wavelength_m) / (2 * pitch_m)

    def half_side_bins(self, wavelength_m: float, padded: int, upsample: int, pitch_m: float) -> float:
        """Half the side in steps of the grid's frequencies: exactly padded/(2·upsample) at the first order.

        wavelength_m: of the light. padded: samples of the grid along an axis. upsample: samples along each side of a
        pixel. pitch_m: of the modulators' pixels.

        >>> import holoview as hv
        >>> hv.SquareStop().half_side_bins(532e-9, padded=2048, upsample=2, pitch_m=8e-6)
        512.0
        """
        if self.half_side_na is not None:
            return self.half_side_na * padded * (pitch_m / upsample) / wavelength_m
        ratio = 1.0 if self.wavelength_m is None else self.wavelength_m / wavelength_m
        return padded / (2 * upsample) * (self.scale * ratio)

    def nominal_na(self, pitch_m: float) -> float:
        """One aperture for all wavelengths: of the real aperture, or of an ideal stop at 550 nm.

        pitch_m: of the modulators' pixels.

        >>> import holoview as hv
        >>> hv.SquareStop(half_side_na=0.03).nominal_na(8e-6), hv.SquareStop().nominal_na(8e-6)
        (0.03, 0.034375)
        """
        return self.half_side_sine(_REFERENCE_M, pitch_m)

    def scaled(self, factor: float) -> SquareStop:
        """The stop with its sides multiplied by a factor; a half side is at most 1.

        factor: above 0.

        >>> import holoview as hv
        >>> hv.SquareStop(wavelength_m=650e-9).scaled(0.9).text
        '0.9 first order at 650 nm'
        """
        if self.half_side_na is not None:
            return SquareStop(half_side_na=min(self.half_side_na * factor, 1.0))
        return SquareStop(wavelength_m=self.wavelength_m, scale=self.scale * factor, of=self.of)

    def __str__(self) -> str:
        if self.half_side_na is not None:
            return f"NA {self.half_side_na:g}"
        return self.text

    @property
    def text(self) -> str:
        """A stop at the first order as in a preset, for example "1.2 first order at 550 nm".

        >>> import holoview as hv
        >>> hv.SquareStop(scale=1.2).text
        '1.2 first order'
        """
        scale = "" if self.scale == 1.0 else f"{self.scale!r} "
        at = "" if self.wavelength_m is None else f" at {units.format_exact(self.wavelength_m, 'nm')}"
        of = f" of {self.of}" if self.of else ""
        return f"{scale}{_FIRST_ORDER}{of}{at}"


@dataclass(frozen=True)
class SquareField:
    """Field type of an optional `SquareStop`: a number is a numerical aperture, text the first order or "none"."""

    def parse(self, value: Any, where: str) -> SquareStop | None:
        if value is None:
            return None
        if isinstance(value, SquareStop):
            return _checked(value, where)
        if value == "none":  # so that a preset can take away the stop of its base
            return None
        if not isinstance(value, str):
            try:
                return SquareStop(half_side_na=APERTURE.parse(value, where))
            except UserError as error:
                raise UserError(where, error.found, expected=f"{_EXPECTED}; {error.expected}") from error
        match = _TEXT.fullmatch(value)
        if match is None:
            raise UserError(where, f'"{value}"', expected=_EXPECTED)
        try:
            scale = 1.0 if match["scale"] is None else _SCALE.parse(float(match["scale"]), where)
        except ValueError as error:
            raise UserError(where, f'"{value}"', expected=_EXPECTED) from error
        at = None if match["wavelength"] is None else _WAVELENGTH.parse(match["wavelength"], where)
        return SquareStop(wavelength_m=at, scale=scale or 1.0, of=match["of"] or "")

    def to_toml(self, value: SquareStop | None) -> float | str | None:
        if value is None or value.half_side_na is None:
            return None if value is None else value.text
        return value.half_side_na


def _checked(square: SquareStop, where: str) -> SquareStop:
    """The stop. Raises UserError for sizes that are impossible or that contradict each other."""
    if square.half_side_na is None:
        _SCALE.parse(square.scale, f"{where}.scale")
        if square.wavelength_m is not None:
            _WAVELENGTH.parse(square.wavelength_m, f"{where}.wavelength")
    elif square != SquareStop(half_side_na=square.half_side_na):
        raise UserError(where, f"{square!r}", expected="half_side_na alone, or none with wavelength_m and scale")
    else:
        APERTURE.parse(square.half_side_na, f"{where}.half_side_na")
    return square


@dataclass(frozen=True)
class CentreField:
    """Field type of the direction sine (y, x) of the centre of a relay's stops."""

    def parse(self, value: Any, where: str) -> tuple[float, float]:
        if isinstance(value, str) or not isinstance(value, Iterable) or len(pair := list(value)) != 2:
            raise UserError(where, f"{value!r}", expected="[y, x], two direction sines such as [0.0, 0.002]")
        sine = Number(low=-1.0, high=1.0)
        y, x = (sine.parse(entry, f"{where}[{i}]") for i, entry in enumerate(pair))
        assert y is not None
        assert x is not None
        return y, x

    def to_toml(self, value: tuple[float, float]) -> list[float]:
        return list(value)
