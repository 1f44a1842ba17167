"""Targets of a session: which picture a hologram should show, where and how bright; built on a worker thread."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.files.request import ReadRequest
from holoview.holograms.load_field import is_field_file, open_hologram
from holoview.holograms.metrics.likeness import OtherPlanes
from holoview.holograms.targets.focal_stack import Target
from holoview.holograms.targets.framing import Framing
from holoview.holograms.targets.light_field import LightField, is_light_field, read_light_field
from holoview.holograms.targets.moving_pupil import StacksAt
from holoview.holograms.targets.picture import Picture, UnreadPicture, resize_to_cover
from holoview.holograms.targets.target import Placement, scene_depth
from holoview.holograms.targets.target_source import ComputedScene, TargetContent, TargetLight
from holoview.light.colour import SRGB_TO_XYZ
from holoview.light.model.focus import plane_label
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.files import data_dir
from holoview.util.mailbox import LatestTask
from holoview.viewer.document.jobs import CallOnOwner

if TYPE_CHECKING:
    from holoview.holograms.fields.field_target import FieldTarget
    from holoview.holograms.optimise.field_loss import ComplexTarget

THUMBNAIL_PX = 320


@dataclass(frozen=True, eq=False)
class TargetSpec(TargetLight):
    """The target of a hologram, independent of the system that shows it.

    source: a picture in linear light, or the path of a rendered focal stack, a folder of views, or a complex field,
    which lies in the plane of the last modulator unless its placement has a distance.
    is_example: whether it is `example_target()`, which nobody chose: a hologram that is opened removes it.
    """

    source: Picture | Path
    title: str
    placement: Placement = field(default_factory=Placement)
    is_example: bool = False

    @cached_property
    def is_field(self) -> bool:
        """Whether it is a complex field."""
        return isinstance(self.source, Path) and is_field_file(self.source)

    def with_framing(self, framing: Framing) -> TargetSpec:
        """A copy whose picture is placed on the modulators in another way."""
        return replace(self, placement=replace(self.placement, framing=framing))

    def framing_text(self, system: System) -> str:
        """What a system cuts off the picture, or leaves black beside it; "" where nothing, and for other targets."""
        if isinstance(self.source, Path):
            return ""
        return self.placement.framing.describe(self.source.rgb.shape[:2], system.way.shape)

    def framed_part(self, system: System, framing: Framing) -> tuple[float, float, float, float]:
        """The part of the picture that a framing shows on a system: left, top, right, bottom, as fractions of it."""
        assert isinstance(self.source, Picture)
        rows, columns = self.source.rgb.shape[:2]
        left, top, width, height = framing.window((rows, columns), system.way.shape)
        return left / columns, top / rows, (left + width) / columns, (top + height) / rows

    @property
    def is_stack(self) -> bool:
        """Whether it is a rendered stack, which has pictures for the system's own planes only."""
        return isinstance(self.source, Path) and not (is_light_field(self.source) or self.is_field)

    def fields_for(self, system: System) -> ComplexTarget:
        """The fields of the lasers in the planes of a system. Raises UserError as `ComplexTarget.of` does."""
        from holoview.holograms.optimise.field_loss import ComplexTarget  # slow start: it imports torch

        target = ComplexTarget.of(self._field_scene(), system)
        return replace(target, stack=target.stack * np.float32(self.brightness))

    def _field_scene(self) -> FieldTarget:
        """The light of the field at its place."""
        assert isinstance(self.source, Path)
        opened = open_hologram([self.source], ReadRequest(propagation="asm", accept_guesses=True))
        return opened.hologram.scene(self.placement.at_m or 0.0)

    def _content(self, system: System) -> TargetContent:
        source: Picture | LightField | Path | ComputedScene = self.source
        if self.is_field:
            source = self._field_scene()
        elif isinstance(source, Path) and not self.is_stack:
            source = read_light_field(system, source, saturation=self.saturation, space=self.space)
        return TargetContent(source, self.placement, **self.light)

    def build(self, system: System, planes_m: NDArray[np.float64] | None = None) -> Target:
        """The target at the planes of a system; at `planes_m` (n,) in metres instead, unless it is a rendered stack.

        Raises UserError as `TargetContent.build` does, and for views that can't be read.
        """
        return self._content(system).build(system, planes_m)

    def stack_for(self, system: System) -> NDArray[np.float32]:
        """The focal stack (plane, y, x, 3) at the planes of a system, or on which its eye is focused."""
        return self.build(system).stack

    def moving(self, radius_m: float, system: System) -> StacksAt:
        """The focal stacks from any places of the pupil within a radius; not of a rendered stack."""
        return self._content(system).moving(radius_m, system)

    def depth_at(self, system: System, row: int, column: int) -> float:
        """Distance (m) behind the last modulator of the scene that the target shows at a sample of the simulation grid.

        Raises UserError for a focal stack, views and a field, whose pictures don't tell, and as `target_for` does.
        """
        if isinstance(self.source, Path):
            raise UserError(
                "target", "pictures without depth", expected="a picture with a depth map, which tells what is where"
            )
        depth_m = scene_depth(system, self.placement, self.source, make_plan(system).grid.shape)
        return float(np.broadcast_to(depth_m, make_plan(system).grid.shape)[row, column])


def thumbnail_xyz(target_spec: TargetSpec) -> NDArray[np.float32]:
    """The whole picture of a target, XYZ (y, x, 3), at most THUMBNAIL_PX along each side."""
    assert isinstance(target_spec.source, Picture)
    rgb = target_spec.source.rgb
    scale = min(THUMBNAIL_PX / max(rgb.shape[:2]), 1.0)
    rows, columns = (max(round(size * scale), 1) for size in rgb.shape[:2])
    return np.asarray(resize_to_cover(rgb, (rows, columns)) @ SRGB_TO_XYZ.T, dtype=np.float32)


def example_target() -> TargetSpec:
    """The shipped still life with its depth. Its files are read when they are needed."""
    folder = data_dir("assets")
    placement = Placement(depth=folder / "still-life-depth.png")
    return TargetSpec(UnreadPicture(folder / "still-life.png"), "still life", placement, is_example=True)


# --- Builds targets at a focal plane on a worker thread, and caches them ---


Image = NDArray[np.float32]
_MAX_CACHED_IMAGES = 24


class TargetBuilder:
    """Builds the target that was requested last; a request that still waits is dropped when another comes.

    deliver: has the session's owner make a call. on_ready: called by the owner when a target is available. on_error:
    called by the owner with the exception and "target" when it can't be built.
    """

    def __init__(
        self,
        deliver: CallOnOwner,
        on_ready: Callable[[], None],
        on_error: Callable[[BaseException, str], None],
    ) -> None:
        self._on_ready, self._on_error = on_ready, on_error
        self._cache: dict[Hashable, Image | None] = {}
        self._task: LatestTask[_Built] = LatestTask("targets", deliver, lambda error: None)

    def get(self, target_spec: TargetSpec, system: System, plane_m: float) -> Image | None:
        """The target (y, x, 3) of a specification at a plane, in linear sRGB; None until it is built."""
        request = _TargetRequest(target_spec, system, plane_m)
        if request.key in self._cache:
            return self._cache[request.key]
        self._task.submit(request.build, partial(self._on_built, request), request.key)
        return None

    def built_stack(self, target_spec: TargetSpec, system: System) -> Image | None:
        """The focal stack (plane, y, x, 3) of a system, as `TargetSpec.stack_for` builds it; None until it is built."""
        images = [self._cache.get(_TargetRequest(target_spec, system, float(z)).key) for z in system.planes_m]
        return (
            np.stack([image for image in images if image is not None]) if all(i is not None for i in images) else None
        )

    def others(self, target_spec: TargetSpec, system: System, plane_m: float) -> OtherPlanes:
        """The targets that are built for other planes of the system."""
        found = {float(z): self._cache.get(_TargetRequest(target_spec, system, float(z)).key) for z in system.planes_m}
        named = {f"at {plane_label(system, z)}": of for z, of in found.items() if of is not None and z != plane_m}
        return OtherPlanes(named, are_mistakable=target_spec.is_stack)

    @property
    def is_building(self) -> bool:
        """Whether a target is being built or waits to be."""
        return self._task.is_busy

    def close(self) -> None:
        """Ends the thread."""
        self._task.close()

    def _on_built(self, request: _TargetRequest, built: _Built) -> None:
        images, error = built
        self._cache |= {replace(request, plane_m=z).key: image for z, image in images.items()}
        self._cache.setdefault(request.key, None)
        while len(self._cache) > max(_MAX_CACHED_IMAGES, len(images) + 1):  # this request's own images stay
            self._cache.pop(next(iter(self._cache)))
        if error is not None:
            self._on_error(error, "target")
        self._on_ready()


_Built = tuple[dict[float, Image], Exception | None]
"""Images by their plane in metres, and errors."""


@dataclass(frozen=True, eq=False)
class _TargetRequest:
    """A target for a system at a plane in metres."""

    target_spec: TargetSpec
    system: System
    plane_m: float

    @property
    def key(self) -> tuple[Hashable, ...]:
        return self.target_spec, _geometry_key(self.system), self.plane_m

    def build(self) -> _Built:
        """Images of all planes of the system, if `plane_m` is one of them; else of that plane alone."""
        is_own_plane = bool(np.any(self.system.planes_m == self.plane_m))
        if not is_own_plane and self.target_spec.is_stack:
            return {}, None
        try:
            planes_m = self.system.planes_m if is_own_plane else np.array([self.plane_m])
            target = self.target_spec.build(self.system, planes_m)
        except Exception as error:  # reported to the user by the owner, once for each request
            return {}, error
        return dict(zip(target.planes_m, target.stack, strict=True)), None


def _geometry_key(system: System) -> Hashable:
    """Properties of a system that change a target: planes, sampling, and the cone of light that blurs it.

    With an eye, also its pupil, and the lasers, each of which it sees in another focus.
    """
    way, median_m = system.way, float(np.median(system.wavelengths_m))
    grid = (way.shape, way.sample_m, way.finest_m)
    seen = None if system.eye is None else (system.eye, system.observer, system.wavelengths_m.tobytes())
    return grid, median_m, way.relays[way.last], system.planes_m.tobytes(), seen
