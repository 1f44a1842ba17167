"""The bench as data: frozen, checked when it is built, in SI units.

    source ─▶ modulator 1 ─▶ gap (relay 1) ─▶ modulator 2 ─▶ relay 2 to plane z ─▶ |·|² ─▶ observer

A `System` describes this and nothing else; `holoview.model.plan` derives every number from it. `with_` and `edit`
return a changed copy and accept SI numbers or people's text ("3 mm").
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.model.dataclass_fields import Description, Nested, NestedList, described_field, validate, with_changes
from holoview.model.effects.effect_table import EffectPairs, EffectTable
from holoview.model.field_types import Array, Choice, Coefficients, Integer, LevelFractions, Number, Shape
from holoview.model.shorthand import expand_edit
from holoview.util import units
from holoview.util.errors import UserError

Floats = NDArray[np.float64]

_ANGLE = Number("mrad", low=-1.0, high=1.0)
_APERTURE = Number(low=1e-5, high=1.0, optional=True)
_EYE_RANGE_M = (390e-9, 830e-9)
_LONGEST_M = 1.0  # of any gap or plane: a bare "3" that meant millimetres is refused, not taken for metres

PLANE_DISTANCES = Array(Number("mm", low=0.0, high=_LONGEST_M))
"""Distances of focal planes, measured from the last modulator."""


@dataclass(frozen=True, eq=False)
class Source(Description):
    """Plane waves that illuminate the first modulator, mutually incoherent, equally strong."""

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
    """A phase modulator: square pixels of constant optical path."""

    pitch_m: float = described_field(Number("um", low=0.1e-6, high=1e-3), "Distance between pixel centres.")
    shape: tuple[int, int] = described_field(Shape(), "Rows and columns of pixels.")
    stroke_m: float = described_field(Number("nm", low=1e-9, high=20e-6), "Optical path that full drive adds.")
    levels: Floats | None = described_field(LevelFractions(), "Stroke fractions that can be shown.", default=None)

    def __post_init__(self) -> None:
        validate(self)


@dataclass(frozen=True, eq=False)
class Relay(Description):
    """Imaging optics between two planes: what its Fourier plane lets through, and with which path error."""

    iris_na: float | None = described_field(
        _APERTURE, "Numerical aperture of a round iris; none when absent.", default=None
    )
    dc_block_na: float | None = described_field(
        _APERTURE, "Radius of a round stop at the zero order, as an aperture.", default=None
    )
    apodisation_na: float | None = described_field(
        _APERTURE, "Aperture at which a Gaussian transmission falls to 1/e in amplitude.", default=None
    )
    aberration_m: tuple[tuple[int, float], ...] = described_field(
        Coefficients("Z", Number("nm", low=-1e-4, high=1e-4), highest=37),
        "Zernike terms (Noll index, r.m.s. optical path) over the iris.",
        default=(),
    )

    def __post_init__(self) -> None:
        validate(self)
        if self.dc_block_na and self.iris_na and self.dc_block_na >= self.iris_na:
            raise UserError(
                "dc_block_na",
                f"{self.dc_block_na:g}",
                expected=f"less than iris_na = {self.iris_na:g}",
                remedy="nothing would pass the relay otherwise",
            )
        if self.aberration_m and self.iris_na is None:
            raise UserError("aberration", "without an iris", remedy="give iris_na: Zernike terms are over the iris")

    @property
    def is_clear(self) -> bool:
        """Whether the relay neither blocks nor delays anything."""
        return self == Relay()


@dataclass(frozen=True, eq=False)
class Sampling(Description):
    """How finely and on how large a grid the light is computed."""

    upsample: int = described_field(Integer(1, 16), "Simulation samples a modulator pixel and axis.", default=2)
    propagation: str = described_field(
        Choice(("linear", "compact", "periodic")),
        "linear: padded to `padding` times the size; compact: padded by the largest walk-off; periodic: not padded.",
        default="linear",
    )
    padding: int = described_field(Integer(2, 8), "Sides of a linear grid in sides of the modulators.", default=2)

    def __post_init__(self) -> None:
        validate(self)


@dataclass(frozen=True, eq=False)
class System(Description):
    """A display bench. Arrays: wavelengths (wavelength,), amplitudes (frame, wavelength), planes (plane,).

    An amplitude multiplies the intensity of its laser in its frame; frames and sources are averaged. Raises UserError
    with the key, the value and the remedy when values are impossible or contradict each other.
    """

    wavelengths_m: Floats = described_field(
        Array(Number("nm", low=100e-9, high=10e-6)), "Vacuum wavelength of each laser."
    )
    amplitudes: Floats = described_field(
        Array(Number(low=0.0, high=1e6), axes=2), "Relative power of each laser in each frame."
    )
    modulators: tuple[Modulator, ...] = described_field(NestedList(Modulator), "One or two phase modulators.")
    gap_m: float | None = described_field(
        Number("mm", low=0.0, high=_LONGEST_M, optional=True), "From modulator 1 to 2.", default=None
    )
    planes_m: Floats = described_field(
        PLANE_DISTANCES, "Focal planes, measured from the last modulator.", default=(0.01,)
    )
    source: Source = described_field(Nested(Source), "Illumination.", default_factory=Source)
    relay1: Relay = described_field(Nested(Relay), "Between the modulators.", default_factory=Relay)
    relay2: Relay = described_field(
        Nested(Relay), "From the last modulator to the focal planes.", default_factory=Relay
    )
    observer: str = described_field(
        Choice(("eye", "cie1931", "mono")), "What looks: the eye's cones, CIE 1931, mono camera.", default="eye"
    )
    sampling: Sampling = described_field(Nested(Sampling), "Grid of the simulation.", default_factory=Sampling)
    effects: EffectPairs = described_field(
        EffectTable(), "What the bench does beyond the plain model: effects by their id.", default=()
    )
    name: str = described_field(Choice(), "Name of the preset.", default="")
    description: str = described_field(Choice(), "The bench in a sentence.", default="")

    def __post_init__(self) -> None:
        validate(self)
        for key, array in (("wavelengths", self.wavelengths_m), ("planes", self.planes_m)):
            if array.ndim != 1 or len(array) == 0:
                raise UserError(key, f"an array of shape {array.shape}", expected="a list of at least one length")
        self._check_amplitudes()
        self._check_modulators()
        self._check_source()
        if self.observer != "mono":
            self._check_visible()

    def _check_amplitudes(self) -> None:
        count = len(self.wavelengths_m)
        if self.amplitudes.ndim != 2 or self.amplitudes.shape[1] != count or len(self.amplitudes) == 0:
            raise UserError(
                "amplitudes",
                f"a table of shape {self.amplitudes.shape}",
                expected=f"(frames, {count}): a row a frame, a column a wavelength",
                remedy='give amplitudes together with wavelengths, or "white"',
            )
        if not np.any(self.amplitudes > 0):
            raise UserError("amplitudes", "all are zero", expected="at least one laser that is on")

    def _check_modulators(self) -> None:
        count = len(self.modulators)
        if count not in (1, 2):
            raise UserError("modulators", f"{count} of them", expected="one or two")
        if count == 1 and self.gap_m is not None:
            raise UserError(
                "gap",
                f"{units.format_rounded(self.gap_m, 'mm')} with one modulator",
                expected="no gap",
                remedy="add a second [[modulators]] table or remove the gap",
            )
        if count == 2 and self.gap_m is None:
            raise UserError(
                "gap", "is missing", expected="the distance between the two modulators", remedy='e.g. gap = "2 mm"'
            )
        if count == 1 and not self.relay1.is_clear:
            raise UserError(
                "relay1",
                "with one modulator",
                expected="no relay 1",
                remedy="it lies between two modulators: use relay2",
            )
        first, last = self.modulators[0], self.modulators[-1]
        if first.pitch_m != last.pitch_m or first.shape != last.shape:
            raise UserError(
                "modulators",
                " and ".join(f"{m.shape} at {units.format_rounded(m.pitch_m, 'um')}" for m in (first, last)),
                expected="two modulators of equal shape and pitch (as imaged onto each other by relay 1)",
            )

    def _check_source(self) -> None:
        tilts = self.source.tilts_rad
        if tilts is not None and len(tilts) != len(self.wavelengths_m):
            raise UserError(
                "source.tilts",
                f"{len(tilts)} rows",
                expected=f"a row for each of {len(self.wavelengths_m)} wavelengths",
            )

    def _check_visible(self) -> None:
        low, high = _EYE_RANGE_M
        for i, wavelength in enumerate(self.wavelengths_m):
            if not low <= wavelength <= high:
                raise UserError(
                    f"wavelengths[{i}]",
                    units.format_rounded(wavelength, "nm"),
                    expected="390 to 830 nm, where the observer's response is known",
                    remedy='choose another wavelength or observer = "mono"',
                )

    @property
    def frames(self) -> int:
        """Number of time-multiplexed frames that one image takes."""
        return len(self.amplitudes)

    @property
    def drive_shape(self) -> tuple[int, int, int, int]:
        """Shape of a drive array: (frame, modulator, y, x)."""
        return (self.frames, len(self.modulators), *self.modulators[0].shape)

    @property
    def effect_values(self) -> dict[str, dict[str, Any]]:
        """Effects that are switched on, {id: {parameter: SI value}}."""
        return {name: dict(pairs) for name, pairs in self.effects}

    def edit(self, changes: Mapping[str, Any]) -> System:
        """A copy with some keys changed, e.g. edit({"gap": 3e-3, "relay2.iris_na": 0.02}); SI numbers or people's text.

        `pitch`, `shape`, `stroke` and `levels` change every modulator; amplitudes="white" balances the lasers.
        Raises UserError for unknown keys and impossible values.
        """
        edited: System = with_changes(self, expand_edit(self, changes))
        return edited

    def with_(self, **changes: Any) -> System:
        """`edit` with keywords: system.with_(gap="3 mm", upsample=4)."""
        return self.edit(changes)
