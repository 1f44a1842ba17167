"""An element of a chain is out of its place, or a mask isn't as deep as it should be."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from holoview.light.model.effects.effect import Effect, Parameter, Values
from holoview.light.model.elements import Element, Space
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.units import format_rounded

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.light.model.effects.hook_contexts import ModulatorContext, Pose


class Misplaced(Effect):
    """A point of an element that should be at r from its centre is at R(rotation)·r + shift, and shift_z farther on.

    The spaces before and behind it become longer and shorter by shift_z; the other elements and the planes stay.
    Between samples its transmission is linear, so that a shifted edge of a pixel is a mean over a sample's area.
    """

    id = "misplaced"
    cause = "An element is out of its place: shifted, too near or too far along the light, or turned."
    finding = (
        "It is shifted by {shift_y} (y) and {shift_x} (x), by {shift_z} along the light, and turned by {rotation}."
    )
    element_finding = (
        "{element} is shifted by {shift_y} (y) and {shift_x} (x), by {shift_z} along the light, and turned by "
        "{rotation}."
    )
    parameters = (
        Parameter("shift_y", "Shift in y (rows).", "um", low=-10e-3, high=10e-3, prior=4e-6),
        Parameter("shift_x", "Shift in x (columns).", "um", low=-10e-3, high=10e-3, prior=4e-6),
        Parameter(
            "shift_z",
            "Shift along the light.",
            "mm",
            low=-20e-3,
            high=20e-3,
            prior=0.2e-3,
            scan=(-0.6e-3, 0.6e-3, 0.2e-3),
        ),
        Parameter(
            "rotation", "Turn from +x to +y.", "mrad", low=-0.5, high=0.5, prior=5e-3, scan=(-28e-3, 28e-3, 7e-3)
        ),
    )
    acts_on = ()
    element_kinds = ("phase", "amplitude", "complex", "mask")
    varies_over_field = True

    def actual_element(self, system: System, element: str, v: Values) -> System:
        return moved_along(system, element, v["shift_z"]) if v["shift_z"] else system

    def element_pose(self, pose: Pose, v: Values) -> Pose:
        shift_m = (pose.shift_m[0] + v["shift_y"], pose.shift_m[1] + v["shift_x"])
        return dataclasses.replace(pose, shift_m=shift_m, rotation_rad=pose.rotation_rad + v["rotation"])


def moved_along(system: System, name: str, shift_m: float) -> System:
    """The system with an element moved along the light. Raises UserError where others or the planes are in the way."""
    index = system.part(name)
    names, arm_of = system.element_names, [getattr(e, "beside", "") for e in system.elements]
    if arms := {arm_of[index]} - {""} or {n for n, of in zip(names, arm_of, strict=True) if of == name}:
        found = f"moves {name}, which stands beside {' and '.join(sorted(arms))}, along the light"
        raise UserError("shift_z", found, expected="0: the ways of both arms are equally long")
    named = [dataclasses.replace(e, name=n) for e, n in zip(system.elements, names, strict=True)]
    before, behind = named[:index], named[index + 1 :]
    planes_m, is_last = system.planes_m, all(isinstance(e, Space) for e in behind)
    if before:
        before = _longer(before, shift_m, -1, name)
    if not is_last:
        behind = _longer(behind, -shift_m, 0, name)
    if system.planes_from == name or (is_last and not system.planes_from):
        planes_m = planes_m - shift_m
        if planes_m.min() < 0:
            found = f"brings {name} {format_rounded(-float(planes_m.min()), 'mm')} behind the nearest plane"
            raise UserError("shift_z", found, expected="planes behind it", remedy="lower it")
    return system.edit({"elements": (*before, named[index], *behind), "planes": planes_m})


def _longer(elements: list[Element], by_m: float, end: int, name: str) -> list[Element]:
    """Elements with a longer space at one end (0 or -1), which is added where there is none."""
    space = elements[end]
    if not isinstance(space, Space) or space.distance_m is None:
        space = Space(name=f"beside {name}", distance_m=0.0)
        elements = [space, *elements] if end == 0 else [*elements, space]
    length_m = (space.distance_m or 0.0) + by_m
    if length_m < -1e-15:
        neighbour = "before" if end else "behind"
        found = f"brings {name} {format_rounded(-length_m, 'mm')} past the element {neighbour} it"
        raise UserError("shift_z", found, expected="elements in their order", remedy="lower it")
    changed = list(elements)
    changed[end] = Space.over(max(length_m, 0.0), space.relay, space.name)
    return changed


class MaskDepth(Effect):
    """optical path of a mask → path·(1 + error), at all wavelengths."""

    id = "mask_depth"
    cause = "A mask is deeper or shallower than it was made for: its optical path is wrong."
    finding = "Its optical path is {percent} of what it should be."
    element_finding = "The optical path of {element} is {percent} of what it should be."
    parameters = (
        Parameter("error", "Relative error of the path.", low=-1.0, high=2.0, prior=0.1, scan=(-0.4, 0.4, 0.1)),
    )
    acts_on = ()
    element_kinds = ("mask",)

    def optical_path(self, path_m: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        return path_m * (1 + v["error"])

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        return {"percent": f"{100 * (1 + v['error']):.3g} %"}
