"""A transform along one axis whose input, middle and output are functions of the caller: hooks in WGSL.

    begin(line: u32, field: u32)                       once an invocation: what all points of the line have in common
    load(position: vec3u) -> vec2f                     what is transformed, at (x, y, field)
    middle(position: vec3u, value: vec2f) -> vec2f     between two steps
    store(position: vec3u, value: vec2f)               what becomes of the result

Neither step is normalised. Positions of a spectrum are in the strategy's own order: `frequency_x(position: u32) -> i32`
and `frequency_y`, which hooks may call, tell the signed frequency index.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal
from weakref import WeakKeyDictionary

import numpy as np

from holoview.gpu.device import SUBGROUP, Buffer, Constants, Device, Pipeline
from holoview.gpu.fft_codegen import LINES, Direction, PassShape, generate_pass, pass_shapes, workgroups_of
from holoview.gpu.fft_radices import frequency_wgsl, radices
from holoview.gpu.lines_subgroup import generate_line, lanes_of, workgroups_for
from holoview.gpu.recorder import Pass, Recorder, spread
from holoview.gpu.shader import Generated, ShaderSource, link

Axis = Literal["x", "y"]
Part = str | Generated
Strategy = Literal["passes", "subgroup"]
_ROW_PADDING, _COMPLEX_BYTES = 8, 8


_LANES: WeakKeyDictionary[Device, int] = WeakKeyDictionary()
_WORD = 4
_COUNT_LANES = """
@group(1) @binding(0) var<storage, read_write> lanes: u32;
@compute @workgroup_size(64)
fn main(@builtin(subgroup_size) size: u32) { lanes = size; }
"""


@dataclass(frozen=True)
class Hooks:
    """WGSL that defines the four functions, its override constants, and a name for messages."""

    name: str
    parts: tuple[Part, ...]
    constants: tuple[tuple[str, bool], ...] = ()


@dataclass(frozen=True)
class _Stage:
    """One shader of a transform."""

    source: ShaderSource
    constants: Constants
    workgroups: Callable[[int], int]
    uses_hooks: bool
    uses_work: bool


class LineTransform:
    """Transforms along `axis` of fields of `shape` (ny, nx), by `steps` such as ("forward", "inverse").

    `work_bytes` is what a field needs between the shaders of a transform. Raises UserError for a size that can't be
    transformed.
    """

    def __init__(
        self,
        device: Device,
        axis: Axis,
        shape: tuple[int, int],
        steps: Sequence[Direction],
        hooks: Hooks,
        strategy: Strategy = "passes",
    ) -> None:
        self._device, self.axis, self.shape, self._hooks = device, axis, shape, hooks
        self._stages = self._subgroup(steps) if strategy == "subgroup" else self._passes(steps)
        row = shape[1] + _ROW_PADDING
        self.work_bytes = shape[0] * row * _COMPLEX_BYTES if len(self._stages) > 1 else 0

    def bind(self, resources: Sequence[Buffer | None], lines: int, fields: int, work: Buffer | None) -> list[Pass]:
        """The transform of lines 0 … lines − 1 of so many fields, with `resources` in `@group(1)` of the hooks."""
        first = self._device.uniform(LINES.pack(first=0, count=lines), "lines")
        bound = []
        for stage in self._stages:
            groups = [[first], resources if stage.uses_hooks else [], [work] if stage.uses_work else []]
            across, down = spread(stage.workgroups(lines), self._device)
            bound.append(Pass.bind(self._device, self._pipeline(stage), groups, (across, down, fields)))
        return bound

    def compile(self) -> None:
        """Compiles now rather than when it is first bound."""
        for stage in self._stages:
            self._pipeline(stage)

    def _pipeline(self, stage: _Stage) -> Pipeline:
        return self._device.pipeline(stage.source, stage.constants)

    def _subgroup(self, steps: Sequence[Direction]) -> list[_Stage]:
        n = self.shape[1] if self.axis == "x" else self.shape[0]
        lanes = lanes_of(n, subgroup_lanes(self._device))
        assert lanes is not None, "ask `has_subgroups` first"
        order = _natural_wgsl("frequency_y", self.shape[0]) + _natural_wgsl("frequency_x", self.shape[1])
        name = f"{self._hooks.name}: {'-'.join(steps)} along {self.axis}"
        text = Generated(name, generate_line(self.axis, n, lanes, steps))
        source = link(Generated("frequencies", order), *self._hooks.parts, text)
        return [_Stage(source, dict(self._hooks.constants), partial(workgroups_for, lanes), True, False)]

    def _passes(self, steps: Sequence[Direction]) -> list[_Stage]:
        ny, nx = self.shape
        length = nx if self.axis == "x" else ny
        row = nx + _ROW_PADDING
        order = frequency_wgsl("frequency_y", ny) + frequency_wgsl("frequency_x", nx)
        merged = _merged(pass_shapes(self.axis, length, radices(length)), steps)
        stages, last = [], len(merged) - 1
        for number, (shape, directions) in enumerate(merged):
            uses_hooks = number in (0, last) or len(directions) > 1
            load, store = "load" if number == 0 else "load_work", "store" if number == last else "store_work"
            text = generate_pass(shape, *directions, load=load, store=store, begin=uses_hooks)
            parts: list[Part] = ["fft/work.wgsl"] if last else []
            constants = {"work_row_stride": row, "work_field_stride": row * ny} if last else {}
            if uses_hooks:
                parts += [Generated("frequencies", order), *self._hooks.parts]
                constants |= dict(self._hooks.constants)
            name = f"{self._hooks.name}: {'-'.join(directions)} along {self.axis}, block {shape.block}"
            source = link(*parts, Generated(name, text))
            stages.append(_Stage(source, constants, partial(workgroups_of, shape), uses_hooks, last > 0))
        return stages


def has_subgroups(device: Device, shape: tuple[int, int]) -> bool:
    """Whether the device can transform such fields by the subgroup strategy."""
    lanes = subgroup_lanes(device)
    return lanes > 1 and all(lanes_of(n, lanes) is not None for n in shape)


def subgroup_lanes(device: Device) -> int:
    """How many lanes a subgroup of the device has, asked of a shader; 1 where it can't shuffle."""
    if SUBGROUP not in device.features:
        return 1
    if device not in _LANES:
        out = device.buffer(_WORD, "lanes")
        step = Pass.bind(device, device.pipeline(link(Generated("lanes", _COUNT_LANES))), [[], [out]], (1, 1, 1))
        recorder = Recorder(device)
        recorder.add(step)
        recorder.submit()
        _LANES[device] = int(device.download(out, np.uint32, (1,))[0])
    return _LANES[device]


def _merged(shapes: list[PassShape], steps: Sequence[Direction]) -> list[tuple[PassShape, tuple[Direction, ...]]]:
    """The passes of all steps; where one step ends on the block on which the next begins, one pass does both."""
    out: list[tuple[PassShape, tuple[Direction, ...]]] = []
    for step in steps:
        for number, shape in enumerate(shapes if step == "forward" else shapes[::-1]):
            if number == 0 and out:
                out[-1] = (shape, (*out[-1][1], step))
            else:
                out.append((shape, (step,)))
    return out


def _natural_wgsl(name: str, n: int) -> str:
    """A WGSL function of the signed frequency index at a position of a spectrum in natural order."""
    half = math.ceil(n / 2)
    return f"fn {name}(position: u32) -> i32 {{ return i32(position) - select(0, {n}, position >= {half}u); }}\n"
