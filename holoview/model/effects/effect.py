"""What an effect is: something a real bench does and the plain model doesn't.

An effect states its cause, its parameters, and overrides the hooks of the slots that it changes. Hooks run only when a
parameter is off its identity, so that an effect that is off changes no bit. In the order in which light meets them:

    bench         System → System: distances, angles, wavelengths, irises, laser powers
    power         relative laser power that was set → that was emitted
    moments       what one exposure averages over: (weight, factor of the optical paths)
    response      share of the stroke (0…1) that a modulator shows, for the share that was sent
    path          optical path (m) of a modulator at a wavelength
    transmission  complex transmission of a modulator at a wavelength; what falls onto the first one belongs here too
    seat          how the second modulator lies against the first: shift, rotation, magnification
    pupil         complex pupil of a relay at a wavelength
    aim           how the camera lies
    image         what the camera collects: ≥ 0, linear in light or not, before its black level
    offset        the camera's black level, counts beyond the nominal

Hooks take and return torch tensors; they use tensor methods and the tools of their context (`hook_contexts`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from holoview.model.effects.old_names import MEMBERS, adopt_old_members, old_attribute, old_method
from holoview.model.effects.parameter import Parameter, Values

if TYPE_CHECKING:
    from torch import Tensor

    from holoview.model.effects.hook_contexts import CameraContext, ModulatorContext, Pose, RelayContext
    from holoview.model.system import System

ExposureSample = tuple[float, float]

BENCH_HOOKS = ("bench", "laser_power", "exposure_samples")
MODULATOR_HOOKS = ("stroke_response", "optical_path", "transmission", "slm2_pose")
CAMERA_HOOKS = ("camera_pose", "image", "black_level_offset")


@dataclass(frozen=True)
class DataProperties:
    """What data tell about: how many different wavelengths, planes, laser powers and modulators; which geometry."""

    wavelengths: int
    planes: int
    powers: int
    modulators: int
    irises: tuple[bool, bool]
    is_fourier: bool


@dataclass(frozen=True)
class Needs:
    """The least that an effect needs of the data to be seen in them. irises: numbers (1, 2) of relays with an iris."""

    wavelengths: int = 1
    planes: int = 1
    powers: int = 1
    modulators: int = 1
    irises: tuple[int, ...] = ()
    near_field: bool = True
    fourier: bool = True

    def unmet_by(self, facts: DataProperties) -> str:
        """Why the effect can't be seen in such data, in words; empty when it can."""
        if not (self.fourier if facts.is_fourier else self.near_field):
            return "it doesn't act on a Fourier bench" if facts.is_fourier else "it acts on a Fourier bench only"
        for what in ("wavelengths", "planes", "powers", "modulators"):
            if getattr(facts, what) < getattr(self, what):
                return f"it needs {getattr(self, what)} {what}, there are {getattr(facts, what)}"
        lacking = [n for n in self.irises if not facts.irises[n - 1]]
        return f"relay {lacking[0]} has no iris" if lacking else ""


class Effect:
    """One physical cause. Subclasses give the class variables and override hooks.

    id: the name in presets, results and file names. cause: a sentence that says what would be wrong. finding: what is
    said once it is found, with {parameter} for values in people's units and what `words` adds. equals: ids of effects
    that no data of these benches can tell from this one. where: the places it changes, of "source", "modulator 1",
    "relay 1", "modulator 2", "relay 2", "camera". order: among hooks of the same kind, small numbers first.
    listed: whether it is offered as a cause or a slider; one that isn't is only known by its id.
    """

    id: ClassVar[str]
    cause: ClassVar[str]
    finding: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    acts_on: ClassVar[tuple[str, ...]]
    degenerate_with: ClassVar[tuple[str, ...]] = ()
    needs: ClassVar[Needs] = Needs()
    order: ClassVar[int] = 0
    listed: ClassVar[bool] = True

    def __init_subclass__(cls) -> None:
        adopt_old_members(cls)

    # --- what it changes --------------------------------------------------------------------------------------------

    def bench(self, system: System, v: Values) -> System:
        """The bench as it is; raises UserError where such a bench can't be."""
        return system

    def laser_power(self, power: Any, v: Values) -> Any:
        """Relative power emitted when `power` was set; a number or an array."""
        return power

    def exposure_samples(self, v: Values) -> Sequence[ExposureSample]:
        """(weight, factor of all optical paths) of the moments that an exposure averages over; weights sum to 1."""
        return ((1.0, 1.0),)

    def stroke_response(self, share: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        """Share of the stroke that pixels (rows, columns) show."""
        return share

    def optical_path(self, path_m: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        """Optical path, of pixels (rows, columns) or, from `at.sampled` on, of samples."""
        return path_m

    def transmission(self, transmission: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        """Complex transmission, of pixels or samples as for `path`."""
        return transmission

    def slm2_pose(self, pose: Pose, v: Values) -> Pose:
        """Where the second modulator is, against where it should be."""
        return pose

    def pupil(self, pupil: Tensor, context: RelayContext, v: Values) -> Tensor:
        """Complex pupil at the frequencies of `at` (rows, columns)."""
        return pupil

    def camera_pose(self, pose: Pose, v: Values) -> Pose:
        """Where the camera is, against where it should be."""
        return pose

    def image(self, image: Tensor, context: CameraContext, v: Values) -> Tensor:
        """What the camera collects, (y, x)."""
        return image

    def black_level_offset(self, v: Values) -> float:
        """Counts that the camera adds to its nominal black level."""
        return 0.0

    # --- what is said about it --------------------------------------------------------------------------------------

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        """Points from which to search, off the identity: each parameter's own scan, others at their identity."""
        return [{p.name: value} for p in self.parameters for value in p.scan_values()]

    def finding_fields(self, system: System, v: Values) -> Mapping[str, str]:
        """More words for `finding`, e.g. the nominal value that it is compared with."""
        return {}

    def degeneracies(self, facts: DataProperties) -> tuple[str, ...]:
        """Ids of effects that such data can't tell from this one."""
        return self.degenerate_with

    def format_finding(self, system: System, values: Mapping[str, float]) -> str:
        """The finding in words, for the nominal bench and the values (SI) that were found."""
        v = self.parameter_values(values)
        texts = {p.name: p.format(v[p.name]) for p in self.parameters}
        return self.finding.format(**texts, **self.finding_fields(system, v))

    def parameter_values(self, given: Mapping[str, Any] | None = None) -> Values:
        """Values with identities filled in; UserError for an unknown name."""
        return Values(self.parameters, given)

    def overrides(self, hook: str) -> bool:
        """Whether this effect overrides a hook."""
        return getattr(type(self), hook) is not getattr(Effect, hook)


for _old, _new in MEMBERS.items():  # for effect files that call what they inherit by its old name
    _method = getattr(Effect, _new, None)
    setattr(Effect, _old, old_method(_old, _new, _method) if callable(_method) else old_attribute(_old, _new))
