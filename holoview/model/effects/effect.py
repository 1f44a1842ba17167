"""Base class of an effect: an imperfection of a real display that the plain model doesn't have.

An effect states its cause and its parameters, and overrides the hooks of the quantities that it changes. Hooks are
called only when a parameter differs from its identity, so that an effect that is off changes no bit of a result. In the
order in which light meets them:

    actual_system       System → System: distances, angles, wavelengths, irises, laser powers
    laser_power         relative laser power that was set → that is emitted
    exposure_samples    what an exposure averages over: (weight, factor of the optical paths)
    stroke_response     fraction of the stroke (0…1) that was sent → that a modulator shows
    settled_share       the same, where it depends on the pattern before
    optical_path        optical path (m) of a modulator at a wavelength
    transmission        complex transmission of a modulator at a wavelength; also the light onto the first one
    slm2_pose           position of the second modulator: shift, rotation, magnification
    pupil               complex pupil of a relay at a wavelength
    camera_distance     distance of the camera from the last modulator
    camera_pose         position of the camera
    camera_pose_at      position of the camera at a distance
    image               what the camera collects (≥ 0, linear in light or not), before its black level
    ambient_light       counts per second that light beside the lasers' adds
    black_level_offset  counts beyond the camera's nominal black level

Hooks on light take and return torch tensors, by tensor methods and the tools of their context (`hook_contexts`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any, ClassVar

from holoview.model.effects.parameter import Parameter, Values

if TYPE_CHECKING:  # torch takes seconds to import; a System holds the values of its effects
    from torch import Tensor

    from holoview.model.effects.hook_contexts import CameraContext, ModulatorContext, Pose, RelayContext
    from holoview.model.system import System

ExposureSample = tuple[float, float]
"""(weight, factor of the optical paths) of a sample of an exposure."""

BENCH_HOOKS = ("actual_system", "laser_power", "exposure_samples")
MODULATOR_HOOKS = ("stroke_response", "settled_share", "optical_path", "transmission", "slm2_pose")
CAMERA_HOOKS = ("camera_distance", "camera_pose", "camera_pose_at", "image", "ambient_light", "black_level_offset")


class StartKind(StrEnum):
    """Kinds of starting values that a diagnosis reads off the pictures, with the parameters that an effect needs.

    DISPLACEMENT: by how much the picture has moved; any parameters that move it. GHOST: a faint copy; `strength`,
    `shift_y` and `shift_x` in camera pixels. SMEAR: a line along which the picture is smeared; `length_y` and
    `length_x` in camera pixels. CAMERA_FRINGES, MODULATOR_FRINGES: plane fringes over the picture, or over the
    modulator that the effect acts on; `path_y`, `path_x`, and `cos1`, `sin1`, `cos2` … for each laser. STUCK_PIXELS:
    lists of stuck columns, rows and pixels of the modulator that it acts on, as `slm1_stuck` has. PLANES: lists
    `distances` and `errors` of planes.
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
    """

    wavelengths: int
    planes: int
    powers: int
    modulators: int
    irises: tuple[bool, bool]
    is_fourier: bool


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
    parameters: what may vary, and by how much.
    acts_on: the parts that it changes, of "source", "modulator 1", "relay 1", "modulator 2", "relay 2", "camera".
    degenerate_with: ids of effects that no data can tell from this one.
    degenerate_limit: ids of effects with fewer parameters whose images this effect's images approach where it is large;
    a diagnosis that names this effect tries those in its place.
    needs: what captures must contain for it to be seen.
    order: effects with smaller numbers are applied first where several have the same hook.
    varies_over_field: whether it shows more towards the edges of the pictures than in their middle.
    start_kinds: which starting values, beside `starting_points`, a diagnosis reads off the pictures for it.
    has_rival_parameters: whether two parameters change images nearly alike, so that a fit from the identity may divide
    the value of one between both; a diagnosis then searches the range of each.
    listed: whether it is offered as a cause and in the viewer; otherwise it is known by its id only.

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

    # --- hooks ------------------------------------------------------------------------------------------------------

    def actual_system(self, system: System, v: Values) -> System:
        """The system as it really is. May raise UserError when such a system can't be."""
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

    def sample_phase(self, system: System, v: Values) -> float:
        """Phase (rad) between neighbouring samples of a continuum that the effect replaces by samples; 0 without one.

        At the edge of the first order, over the gap and the farthest plane, relative to light on the axis.
        """
        return 0.0

    # --- searching and reporting ------------------------------------------------------------------------------------

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        """Points {parameter: value} at which a search starts: by default each parameter's scan, others at identity."""
        return [{p.name: value} for p in self.parameters for value in p.scan_values()]

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

    def overrides(self, hook: str) -> bool:
        """Whether this effect overrides a hook."""
        return getattr(type(self), hook) is not getattr(Effect, hook)
