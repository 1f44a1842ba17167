"""Base class of an effect: an imperfection of a real display that the plain model doesn't have.

An effect states its cause and its parameters, and overrides the hooks of the quantities that it changes. Hooks are
called only when a parameter differs from its identity, so that an effect that is off changes no bit of a result. In the
order in which light meets them:

    actual_system       System → System: distances, angles, wavelengths, irises, laser powers
    actual_element      System → System, where the effect acts on one element that is stated
    laser_power         relative laser power that was set → that is emitted
    exposure_samples    what an exposure averages over: (weight, factor of the optical paths)
    stroke_response     fraction of the stroke (0…1) that was sent → that a modulator shows
    settled_share       the same, where it depends on the pattern before
    optical_path        optical path (m) of a modulator at a wavelength
    transmission        complex transmission of a modulator at a wavelength; also the light onto the first one
    slm2_pose           position of the second modulator: shift, rotation, magnification
    element_pose        position of the element that is stated
    pupil               complex pupil of a relay at a wavelength
    camera_distance     distance of the camera from the last modulator
    camera_pose         position of the camera
    camera_pose_at      position of the camera at a distance
    camera_motion       line along which the camera moves during an exposure
    image               what the camera collects (≥ 0, linear in light or not), before its black level
    ambient_light       counts per second that light beside the lasers' adds
    black_level_offset  counts beyond the camera's nominal black level

Hooks on light take and return torch tensors, by tensor methods and the tools of their context (`hook_contexts`).

`Parameter` has the unit, bounds, prior width and scan range of a parameter, and the value at which the effect is off.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from holoview.light.model.fields import Integer, Number
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.tables import check_keys

if TYPE_CHECKING:
    from torch import Tensor

    from holoview.light.model.effects.hook_contexts import CameraContext, ModulatorContext, Pose, RelayContext
    from holoview.light.model.system import System


_SI = {"pm": "m", "nm": "m", "um": "m", "mm": "m", "cm": "m", "urad": "rad", "mrad": "rad", "": "1"}


@dataclass(frozen=True)
class Parameter:
    """A number that describes by how much something is wrong. Values, bounds, prior and scan are in SI units.

    name: the key in presets and results.
    doc: a sentence that explains it.
    display_unit: the unit in which it is written and read: "mm", "nm", "mrad", "" for a plain number, or a name such as
    "counts" or "px", which isn't converted.
    low, high: inclusive bounds.
    prior: its usual size, one standard deviation.
    identity: the value at which the effect changes no bit.
    scan: (first, last, step) of a search along this parameter; None if a local fit finds it.
    even_symmetric: images depend on its square only, so that a fit varies the square: the derivative of images with
    respect to the square isn't zero at zero.
    non_smooth: images are discontinuous in it (hard edges), so that derivatives don't exist.
    passes_edges: as the parameter varies, light moves across the edge of a stop. On a grid whole samples of the
    spectrum pass the edge one after the other, so that images jump a little, many times within a step of a derivative.
    secondary: the parameter is calibrated, but no cause is named for it alone; a diagnosis holds it at its identity at
    first.
    acts_on: the one part of a bench, of `PLACES`, without which it would change nothing; "" for those of its effect.
    laser: the number of the one laser on which it acts, 1 for the shortest wavelength; 0 for all.
    modifies: parameters of the same effect, all of which at their identity leave nothing that this one could change.
    """

    name: str
    doc: str
    display_unit: str = ""
    low: float = -np.inf
    high: float = np.inf
    prior: float = 1.0
    identity: float = 0.0
    scan: tuple[float, float, float] | None = None
    even_symmetric: bool = False
    non_smooth: bool = False
    passes_edges: bool = False
    secondary: bool = False
    acts_on: str = ""
    laser: int = 0
    modifies: tuple[str, ...] = ()

    @property
    def unit(self) -> str:
        """The unit of its values: "m", "rad", "1", or `display_unit` where that isn't converted."""
        return _SI.get(self.display_unit, self.display_unit)

    @property
    def is_quantity(self) -> bool:
        """Whether it is a length or an angle, which are written with a unit."""
        return self.display_unit in _SI and self.display_unit != ""

    def parse(self, value: Any, where: str) -> Any:
        """The SI value of text or a number. Raises UserError, with the place `where`, if wrong or out of bounds."""
        if isinstance(value, str) and not self.is_quantity:
            value = self._parse_plain(value, where)
        number = Number(self.display_unit if self.is_quantity else "", self.low, self.high).parse(value, where)
        assert number is not None
        if not np.isfinite(number):
            raise UserError(where, f"{number:g}", expected="a finite number")
        return number

    def to_toml(self, value: Any) -> str | float:
        """The value in TOML, without losing a digit: text with a unit for lengths and angles, else a number."""
        return units.format_exact(value, self.display_unit) if self.is_quantity else float(value)

    def format(self, value: Any, digits: int = 3) -> str:
        """The value as rounded text with its unit, such as "0.108 mm" or "12 counts"."""
        if self.is_quantity:
            return units.format_rounded(value, self.display_unit, digits)
        return f"{value:.{digits}g} {self.display_unit}".rstrip()

    @property
    def has_sound_bounds(self) -> bool:
        """Whether the identity lies within the bounds and the prior is positive."""
        return bool(self.low <= self.identity <= self.high and self.prior > 0)

    def nudged(self, priors: float) -> Any:
        """The value so many priors from the identity, within the bounds."""
        return min(max(self.identity + priors * self.prior, self.low), self.high)

    def added(self, known: Any, found: Any) -> Any:
        """The whole deviation of a bench: a `known` part and the part `found` in addition, within the bounds."""
        return min(max(known + found - self.identity, self.low), self.high)

    def free_entries(self, value: Any) -> tuple[Parameter, ...]:
        """The parameters that a fit varies where this one has this value: itself, or the entries of a list; none where
        the bounds leave one value only."""
        return (self,) if self.low < self.high else ()

    def read(self, values: Mapping[str, Any]) -> Any:
        """Its value among those of its effect, the identity where none is given."""
        return values.get(self.name, self.identity)

    def written(self, values: Mapping[str, Any], value: Any) -> dict[str, Any]:
        """The values of its effect with this one changed."""
        return {**values, self.name: value}

    def scan_values(self) -> Iterator[float]:
        """The values of `scan` without the identity."""
        if self.scan is not None:
            first, last, step = self.scan
            steps = round((last - first) / step)
            yield from (v for k in range(steps + 1) if abs((v := first + k * step) - self.identity) > step / 1e6)

    def to_fit(self, value: float) -> float:
        """The number that a fit varies: the value, or its square if `even_symmetric`."""
        return value * value if self.even_symmetric else value

    def from_fit(self, number: float) -> float:
        """The value for the number that a fit varies, clipped to the bounds."""
        value = max(number, 0.0) ** 0.5 if self.even_symmetric else number
        return min(max(value, self.low), self.high)

    def _parse_plain(self, text: str, where: str) -> float:
        try:
            return float(text.removesuffix(self.display_unit).strip() if self.display_unit else text)
        except ValueError as error:
            raise UserError(
                where, f'"{text}"', expected=f"a number{' of ' + self.display_unit if self.display_unit else ''}"
            ) from error


class FileParameter(Parameter):
    """A parameter whose value is the path of a file. In a preset it is relative to the preset's folder."""

    def parse(self, value: Any, where: str) -> str:
        """The path, as text. Raises UserError unless it is text."""
        if not isinstance(value, str) or not value.strip():
            raise UserError(where, f"{value!r}", expected="the path of a file")
        return value

    def to_toml(self, value: Any) -> str:
        """The path unchanged."""
        return str(value)

    def format(self, value: Any, digits: int = 3) -> str:
        """The path unchanged."""
        return str(value)


class Values(Mapping[str, float]):
    """The values of all parameters of an effect, {name: SI value}; identities where no value was given.

    Raises UserError for a name that isn't a parameter.
    """

    def __init__(self, parameters: tuple[Parameter, ...], given: Mapping[str, Any] | None = None) -> None:
        given = given or {}
        check_keys(given, {p.name for p in parameters}, noun="parameter")
        self._values = {p.name: given.get(p.name, p.identity) for p in parameters}
        self._is_off = {p.name: _is_identity(self._values[p.name], p.identity) for p in parameters}
        self._is_identity = all(self._is_off.values())

    def __getitem__(self, name: str) -> Any:
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    @property
    def is_identity(self) -> bool:
        """Whether all values are identities, so that the effect is off."""
        return self._is_identity

    def is_off(self, name: str) -> bool:
        """Whether the value of a parameter is its identity."""
        return self._is_off[name]

    @property
    def cache_key(self) -> tuple[Any, ...]:
        """A hashable key, equal for equal values."""
        return tuple(self._values.values())


def _is_identity(value: Any, identity: Any) -> bool:
    return not isinstance(value, str) and bool(value == identity)


# --- lists of numbers -------------------------------------------------------------------------------------------------


MAX_FREE_ENTRIES = 32
"""Longer lists keep their values in a fit, since each entry costs a prediction of every capture."""

_MAX_PLACE = 1 << 16  # rows or columns of a modulator


@dataclass(frozen=True)
class ListParameter(Parameter):
    """A list of numbers, empty where the effect does nothing; bounds, prior and unit are those of an entry.

    Presets and JSON hold a list; text such as "3, 17" or "4, 6 mm" is read too. Its value is a tuple.

    places: entries are rows or columns, counted from 0. No fit varies them, as nothing depends on them smoothly.
    fixed: no fit varies the entries, which say what those of another list are of.
    """

    identity: Any = ()
    places: bool = False
    fixed: bool = False

    @property
    def has_sound_bounds(self) -> bool:
        return self.identity == () and self.low <= self.high and self.prior > 0

    def parse(self, value: Any, where: str) -> Any:
        """The entries of a list, of text with commas or blanks, or of a single number, as a tuple in SI units."""
        if isinstance(value, str):
            texts = value.replace(",", " ").split()
            value = _with_units(texts) if self.is_quantity else [_number(text, f"{where}: {value}") for text in texts]
        entries = list(value) if isinstance(value, Iterable) else [value]
        low, high = (max(self.low, 0), min(self.high, _MAX_PLACE)) if self.places else (self.low, self.high)
        unit = self.display_unit if self.is_quantity else ""
        kind = Integer(int(low), int(high)) if self.places else Number(unit, low, high)
        found = tuple(kind.parse(_whole(entry), f"{where}[{i}]") for i, entry in enumerate(entries))
        for i, entry in enumerate(found):
            if not math.isfinite(entry or 0):
                raise UserError(f"{where}[{i}]", f"{entry:g}", expected="a finite number")
        return found

    def to_toml(self, value: Any) -> Any:
        return [units.format_exact(entry, self.display_unit) for entry in value] if self.is_quantity else list(value)

    def format(self, value: Any, digits: int = 3) -> str:
        """The entries as rounded text, with the unit behind the last one."""
        texts = [Parameter.format(self, entry, digits).removesuffix(self.display_unit).rstrip() for entry in value]
        return f"{', '.join(texts)} {self.display_unit if texts else ''}".rstrip()

    def nudged(self, priors: float) -> Any:
        """A list of one entry, which is so many priors; places are counted from 0."""
        entry = min(max(abs(priors) * self.prior, self.low), self.high)
        return (int(entry) if self.places else entry,)

    def added(self, known: Any, found: Any) -> Any:
        """The entries of both."""
        return (*known, *found)

    def free_entries(self, value: Any) -> tuple[Parameter, ...]:
        """A parameter for each number of the list; none for places and other fixed ones, and none for a long list."""
        if self.places or self.fixed or len(value) > MAX_FREE_ENTRIES:
            return ()
        own = {f.name: getattr(self, f.name) for f in dataclasses.fields(Parameter)}
        return tuple(
            ListEntry(**{**own, "name": f"{self.name}[{i}]", "identity": math.nan}, list_name=self.name, index=i)
            for i in range(len(value))
        )


@dataclass(frozen=True)
class ListEntry(Parameter):
    """One number of a list, which a fit varies. It has no identity (NaN): only the empty list does nothing."""

    list_name: str = ""
    index: int = 0

    def read(self, values: Mapping[str, Any]) -> Any:
        return values[self.list_name][self.index]

    def written(self, values: Mapping[str, Any], value: Any) -> dict[str, Any]:
        entries = list(values[self.list_name])
        entries[self.index] = value
        return {**values, self.list_name: tuple(entries)}


def _number(text: str, where: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise UserError(where, f'"{text}"', expected="numbers, with commas between them") from error


def _with_units(texts: list[str]) -> list[str]:
    """The numbers of a text that was split at blanks, each with its unit: its own, or that of the last one."""
    joined: list[str] = []
    for text in texts:
        if text.isalpha() and joined:
            joined[-1] += text
        else:
            joined.append(text)
    unit = joined[-1].lstrip("+-.0123456789eE") if joined else ""
    return [text if text[-1].isalpha() else text + unit for text in joined]


def _whole(entry: Any) -> Any:
    """A whole number as one, whatever its type; anything else unchanged."""
    return int(entry) if isinstance(entry, float) and entry.is_integer() else entry


# --- effects ----------------------------------------------------------------------------------------------------------


ExposureSample = tuple[float, float]
"""(weight, factor of the optical paths) of a sample of an exposure."""

PLACES = ("source", "modulator 1", "relay 1", "modulator 2", "relay 2", "camera")
"""The parts of a bench that an effect may act on, in the order in which light meets them."""

BENCH_HOOKS = ("actual_system", "actual_element", "laser_power", "exposure_samples")
MODULATOR_HOOKS = ("stroke_response", "settled_share", "optical_path", "transmission", "slm2_pose", "element_pose")
CAMERA_HOOKS = (
    "camera_distance",
    "camera_pose",
    "camera_pose_at",
    "camera_motion",
    "image",
    "ambient_light",
    "black_level_offset",
)
ELEMENT_HOOKS = ("actual_element", "element_pose")
"""The hooks that are called only where an element is stated."""
HOOKS = (*BENCH_HOOKS, *MODULATOR_HOOKS, "pupil", *CAMERA_HOOKS)
"""All hooks, in the order in which light meets them."""


class StartKind(StrEnum):
    """Kinds of starting values that a diagnosis reads off the pictures, with the parameters that an effect needs.

    DISPLACEMENT: by how much the picture has moved; any parameters that move it. GHOST: a faint copy; `strength`,
    `shift_y` and `shift_x` in camera pixels. SMEAR: a line along which the picture is smeared; `length_y` and
    `length_x` in camera pixels. CAMERA_FRINGES, MODULATOR_FRINGES: plane fringes over the picture, or over the
    modulator that the effect acts on; `path_y`, `path_x`, and `cos1`, `sin1`, `cos2` … for each laser. STUCK_PIXELS:
    lists of stuck columns, rows and pixels of the modulator that it acts on, as `slm1_stuck` has. PLANES: planes
    at the wrong distance, as the two lists `distances` (where they should be) and `errors` (by how much they miss).
    """

    DISPLACEMENT = "displacement"
    GHOST = "ghost"
    SMEAR = "smear"
    CAMERA_FRINGES = "camera fringes"
    MODULATOR_FRINGES = "modulator fringes"
    STUCK_PIXELS = "stuck pixels"
    PLANES = "planes"


@dataclass(frozen=True)
class DataProperties:
    """The content of captures that decides which effects can be seen in them.

    wavelengths, planes, powers, modulators: how many different ones.
    irises: whether relay 1 and relay 2 have an iris or a square stop.
    is_fourier: whether the camera is in the far field of the modulator, on a Fourier bench.
    is_field: whether the bench has the plane of a complex field in place of modulators.
    lasers: how many the bench has; None where it doesn't matter.
    elements: of a chain, the name and kind of each.
    """

    wavelengths: int
    planes: int
    powers: int
    modulators: int
    irises: tuple[bool, bool]
    is_fourier: bool
    is_field: bool = False
    lasers: int | None = None
    elements: tuple[tuple[str, str], ...] = ()

    @property
    def parts(self) -> frozenset[str]:
        """The parts of the bench, of `PLACES`; of a chain the source, its elements and the camera."""
        if self.elements:
            return frozenset(("source", *(name for name, _ in self.elements), "camera"))
        modulators = () if self.is_field else PLACES[1 : 2 * self.modulators : 2]
        return frozenset(("source", *modulators, *(("relay 1",) if self.modulators > 1 else ()), "relay 2", "camera"))


@dataclass(frozen=True)
class Needs:
    """The content that captures must have for an effect to be seen in them.

    wavelengths, planes, powers, modulators: at least so many different ones.
    irises: numbers (1, 2) of the relays that must have an iris or a square stop.
    near_field, fourier: whether the effect acts on a near-field bench and on a Fourier bench.
    """

    wavelengths: int = 1
    planes: int = 1
    powers: int = 1
    modulators: int = 1
    irises: tuple[int, ...] = ()
    near_field: bool = True
    fourier: bool = True

    def unmet_by(self, properties: DataProperties) -> str:
        """Why the effect can't be seen in data with these properties, in words; empty when it can."""
        if not (self.fourier if properties.is_fourier else self.near_field):
            return "it doesn't act on a Fourier bench" if properties.is_fourier else "it acts on a Fourier bench only"
        for what in ("wavelengths", "planes", "powers", "modulators"):
            if getattr(properties, what) < getattr(self, what):
                return f"it needs {getattr(self, what)} {what}, there are {getattr(properties, what)}"
        lacking = [n for n in self.irises if not properties.irises[n - 1]]
        return f"relay {lacking[0]} has neither an iris nor a square stop" if lacking else ""


class Effect:
    """One physical cause. Subclasses set the class variables and override hooks.

    id: its name in presets, results and file names.
    cause: a sentence that names the fault.
    finding: the sentence of a diagnosis that names it, with {parameter} for values with units and the fields of
    `finding_fields`.
    parameters: the numbers that may vary, each with its range.
    acts_on: the parts that it changes, of `PLACES`.
    degenerate_with: ids of effects that no data can tell from this one.
    degenerate_limit: ids of effects with fewer parameters whose images this effect's images approach where it is large;
    a diagnosis that names this effect tries those in its place.
    needs: the variety of captures in which it can be seen.
    order: effects with smaller numbers are applied first where several have the same hook.
    varies_over_field: whether it shows more towards the edges of the pictures than in their middle.
    start_kinds: which starting values, beside `starting_points`, a diagnosis reads off the pictures for it.
    has_rival_parameters: whether two parameters change images nearly alike. A fit that starts from the identity may
    then give each of the two a part of a value that belongs to one of them; a diagnosis searches the range of each.
    listed: whether it is offered as a cause and in the viewer; otherwise it is known by its id only.
    element_kinds: kinds of elements on one of which it acts where `element` is stated (`OnElement`).
    element_id: its id there, where each place of a short form has its own effect.
    on_chain: kinds of elements of which a chain needs one so that the effect acts on it as a whole, without `element`.
    on_all_elements: whether it acts on a chain's source, on each of its elements and on each space between them; hooks
    are told which by `ModulatorContext.element` and `RelayContext.names`.
    instead: what describes its cause on a chain, where it doesn't itself; in words.
    element_finding: as `finding`, where it acts on one element, whose name is {element}; made of the cause if empty.

    Hooks get the values of the parameters, in SI units, as `v`.
    """

    id: ClassVar[str]
    cause: ClassVar[str]
    finding: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    acts_on: ClassVar[tuple[str, ...]]
    degenerate_with: ClassVar[tuple[str, ...]] = ()
    degenerate_limit: ClassVar[tuple[str, ...]] = ()
    needs: ClassVar[Needs] = Needs()
    order: ClassVar[int] = 0
    varies_over_field: ClassVar[bool] = False
    start_kinds: ClassVar[tuple[StartKind, ...]] = (StartKind.DISPLACEMENT,)
    has_rival_parameters: ClassVar[bool] = False
    listed: ClassVar[bool] = True
    element_kinds: ClassVar[tuple[str, ...]] = ()
    element_id: ClassVar[str] = ""
    on_chain: ClassVar[tuple[str, ...]] = ()
    on_all_elements: ClassVar[bool] = False
    instead: ClassVar[str] = ""
    element_finding: ClassVar[str] = ""

    # --- hooks ------------------------------------------------------------------------------------------------------

    def actual_system(self, system: System, v: Values) -> System:
        """The system as it really is. May raise UserError when such a system can't be."""
        return system

    def actual_element(self, system: System, element: str, v: Values) -> System:
        """As `actual_system`, of an effect on the element of this name."""
        return system

    def laser_power(self, power: Any, v: Values) -> Any:
        """The relative power that is emitted when `power` was set; a number or an array."""
        return power

    def exposure_samples(self, v: Values) -> Sequence[ExposureSample]:
        """Samples (weight, factor of all optical paths) that an exposure averages in intensity; weights sum to 1."""
        return ((1.0, 1.0),)

    def stroke_response(self, share: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        """The fraction of the stroke that pixels (rows, columns) show when `share` was sent."""
        return share

    def settled_share(self, share: Tensor, before: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        """The fraction of the stroke that pixels (rows, columns) show if they would settle at `share`, from `before`.

        Called only where the pattern before is known: that of the frame before, of several that repeat, or of the
        capture before.
        """
        return share

    def optical_path(self, path_m: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        """The optical path (m) of pixels (rows, columns), or of samples once an effect has called `context.sampled`."""
        return path_m

    def transmission(self, transmission: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        """The complex transmission of pixels or samples, as for `optical_path`."""
        return transmission

    def slm2_pose(self, pose: Pose, v: Values) -> Pose:
        """The position of the second modulator relative to its nominal one."""
        return pose

    def element_pose(self, pose: Pose, v: Values) -> Pose:
        """The position of the element that the effect acts on, relative to its nominal one."""
        return pose

    def pupil(self, pupil: Tensor, context: RelayContext, v: Values) -> Tensor:
        """The complex pupil at the frequencies of the context (rows, columns)."""
        return pupil

    def camera_distance(self, distance_m: float, v: Values) -> float:
        """How far the camera is from the last modulator, m; on a Fourier bench from the focal plane."""
        return distance_m

    def camera_pose(self, pose: Pose, v: Values) -> Pose:
        """The position of the camera relative to its nominal one."""
        return pose

    def camera_pose_at(self, pose: Pose, distance_m: float, v: Values) -> Pose:
        """The same, where it depends on the distance of `camera_distance`."""
        return pose

    def camera_motion(self, length_px: tuple[float, float], v: Values) -> tuple[float, float]:
        """The line (y, x) along which the camera moves evenly during an exposure, in its pixels; centred."""
        return length_px

    def image(self, image: Tensor, context: CameraContext, v: Values) -> Tensor:
        """The image (y, x) that the camera collects, before its black level."""
        return image

    def ambient_light(self, counts_per_s: Tensor, context: CameraContext, v: Values) -> Tensor:
        """Counts per second of exposure (y, x) that light beside the lasers' adds to a picture."""
        return counts_per_s

    def black_level_offset(self, v: Values) -> float:
        """Counts that are added to the camera's nominal black level."""
        return 0.0

    # --- validity ---------------------------------------------------------------------------------------------------

    def contradiction(self, v: Values) -> str:
        """Why these values can't hold together, in words; empty when they can."""
        return ""

    def sample_phase(self, system: System, v: Values) -> float:
        """Phase (rad) between neighbouring samples of a continuum that the effect replaces by samples; 0 without one.

        Of directions and wavelengths at the edge of the first order, over the gap and the farthest plane, relative to
        light on the axis.
        """
        return 0.0

    # --- searching and reporting ------------------------------------------------------------------------------------

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        """Points {parameter: value} at which a search starts: by default each parameter's scan, others at identity."""
        return [{p.name: value} for p in self.parameters for value in p.scan_values()]

    def element_starts(self, parameters: tuple[Parameter, ...]) -> list[dict[str, float]]:
        """`starting_points` where it acts on one element, with its parameters there."""
        return [{p.name: value} for p in parameters for value in p.scan_values()]

    def finding_fields(self, system: System, v: Values) -> Mapping[str, str]:
        """Further fields of `finding`, such as the nominal value."""
        return {}

    def degeneracies(self, properties: DataProperties) -> tuple[str, ...]:
        """Ids of effects that data with these properties can't tell from this one."""
        return self.degenerate_with

    def format_finding(self, system: System, values: Mapping[str, float]) -> str:
        """The finding in words, for the nominal system and the values (SI) that were found."""
        v = self.parameter_values(values)
        texts = {p.name: p.format(v[p.name]) for p in self.parameters}
        return self.finding.format(**texts, **self.finding_fields(system, v))

    def parameter_values(self, given: Mapping[str, Any] | None = None) -> Values:
        """All values, identities where none is given. Raises UserError for an unknown parameter."""
        return Values(self.parameters, given)

    def cache_values(self, v: Values, laser: int) -> tuple[Any, ...]:
        """A hashable key of the values that its hooks on light depend on while a laser is on, 0 for the shortest
        wavelength; empty if they do nothing then. By default that is all of them."""
        return v.cache_key

    @property
    def hooks(self) -> tuple[str, ...]:
        """The hooks that it overrides."""
        return tuple(hook for hook in HOOKS if self.overrides(hook))

    def overrides(self, hook: str) -> bool:
        """Whether this effect overrides a hook."""
        return _is_overridden(type(self), hook)  # type: ignore[arg-type]  # mypy takes no class for hashable


@lru_cache(maxsize=4096)  # asked thousands of times for each picture that is predicted
def _is_overridden(kind: type[Effect], hook: str) -> bool:
    return getattr(kind, hook) is not getattr(Effect, hook)


# --- starting points that several effects share -----------------------------------------------------------------------


def square_grid(first: str, second: str, reach: float, step: float) -> list[dict[str, float]]:
    """Points {parameter: value} of a square grid, −reach … reach in each, without (0, 0), sorted by distance to it."""
    count = round(reach / step)
    steps = [(i, j) for i in range(-count, count + 1) for j in range(-count, count + 1) if (i, j) != (0, 0)]
    steps.sort(key=lambda pair: pair[0] ** 2 + pair[1] ** 2)
    return [{first: i * step, second: j * step} for i, j in steps]


def half_circle(first: str, second: str, radius: float, count: int) -> list[dict[str, float]]:
    """Points {parameter: value} on the half of a circle where `first` isn't negative, equally spaced from +`second`."""
    angles = [math.pi * k / count for k in range(count)]
    return [{first: radius * math.sin(a), second: radius * math.cos(a)} for a in angles]
