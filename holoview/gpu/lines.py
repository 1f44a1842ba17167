"""A transform along one axis whose input, middle and output are functions of the caller (hooks)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from holoview.gpu.device import Buffer, Device
from holoview.gpu.fft_codegen import LINES, Direction, PassShape, generate_pass, pass_shapes, workgroups_of
from holoview.gpu.fft_radices import frequency_wgsl, radices
from holoview.gpu.recorder import Pass, spread
from holoview.gpu.shader import Generated, link

Axis = Literal["x", "y"]
Part = str | Generated


@dataclass(frozen=True)
class Hooks:
    name: str
    parts: tuple[Part, ...]
    constants: tuple[tuple[str, int | float | bool], ...] = ()


class LineTransform:
    def __init__(
        self, device: Device, axis: Literal["x", "y"], shape: tuple[int, int], steps: Sequence[Direction], hooks: Hooks
    ) -> None:
        self._device, self.axis, self.shape, self.hooks = device, axis, shape, hooks
        ny, nx = shape
        length = nx if axis == "x" else ny
        self.row_stride = nx + 8
        self._passes = _merged(pass_shapes(axis, length, radices(length)), list(steps))
        self.work_fields_bytes = ny * self.row_stride * 8 if len(self._passes) > 1 else 0

    def bind(self, groups: Sequence[Buffer | Any], lines: int, fields: int, work: Buffer | None) -> list[Pass]:
        out = []
        last = len(self._passes) - 1
        for number, (shape, directions) in enumerate(self._passes):
            uses_hooks = number in (0, last) or len(directions) > 1
            uses_work = number > 0 or number < last
            pipeline = self._pipeline(number)
            across, down = spread(workgroups_of(shape, lines), self._device)
            lines_buffer = self._device.uniform(LINES.pack(first=0, count=lines), "lines")
            bound = [[lines_buffer], list(groups) if uses_hooks else [], [work] if uses_work else []]
            out.append(Pass.bind(self._device, pipeline, bound, (across, down, fields)))
        return out

    def compile(self) -> None:
        """Compiles all passes now rather than when they are first bound."""
        for number in range(len(self._passes)):
            self._pipeline(number)

    def _pipeline(self, number: int) -> Any:
        shape, directions = self._passes[number]
        last = len(self._passes) - 1
        ny, nx = self.shape
        text = generate_pass(
            shape,
            *directions,
            load="load" if number == 0 else "load_work",
            store="store" if number == last else "store_work",
            begin=number in (0, last) or len(directions) > 1,
        )
        uses_hooks = number in (0, last) or len(directions) > 1
        uses_work = number > 0 or number < last
        parts: list[Part] = []
        constants: dict[str, Any] = {}
        if uses_work:
            parts.append("fft/work.wgsl")
            constants |= {"work_row_stride": self.row_stride, "work_field_stride": self.row_stride * ny}
        if uses_hooks:
            order = frequency_wgsl("frequency_y", ny) + frequency_wgsl("frequency_x", nx)
            parts += [Generated("frequencies", order), *self.hooks.parts]
            constants |= dict(self.hooks.constants)
        name = f"{self.hooks.name}: {'-'.join(directions)} along {shape.axis}, block {shape.block}"
        return self._device.pipeline(link(*parts, Generated(name, text)), constants)


def _merged(shapes: list[PassShape], steps: list[Direction]) -> list[tuple[PassShape, tuple[Direction, ...]]]:
    out: list[tuple[PassShape, tuple[Direction, ...]]] = []
    for step in steps:
        ordered = shapes if step == "forward" else shapes[::-1]
        for shape in ordered:
            if out and out[-1][0] == shape and len(out[-1][1]) == 1 and out[-1][1][0] != step:
                out[-1] = (shape, (*out[-1][1], step))
            else:
                out.append((shape, (step,)))
    return out
