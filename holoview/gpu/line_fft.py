"""A transform along one axis whose input, middle and output are functions of the caller: hooks in WGSL.

    begin(line: u32, field: u32)                       once an invocation: what all points of the line have in common
    load(position: vec3u) -> vec2f                     what is transformed, at (x, y, field)
    middle(position: vec3u, value: vec2f) -> vec2f     between two steps
    store(position: vec3u, value: vec2f)               what becomes of the result

Where neighbouring points along x need the same complex number, the hooks may tell it in a function of its own,

    joint(position: vec3u) -> vec2f                    the same for `neighbours` points, from a multiple of it on

and take it as a last argument of `load_with` or `middle_with`, instead of `load` or `middle`: a subgroup evaluates it
once for all of them.

Neither step is normalised. Positions of a spectrum are in the strategy's own order: `frequency_x(position: u32) -> i32`
and `frequency_y`, which hooks may call, tell the signed frequency index.

There are three strategies for how the values of a line meet:

    passes      in a buffer, in several shaders of one pass each; every size; compiles fast, needs nothing special
    workgroup   in workgroup memory, in one shader with barriers; lines that fit there
    subgroup    in registers, in one shader that exchanges them between the lanes of a subgroup; see `lanes_of`

`strategies` tells which of them a device has for a size, and `FftChoice` in tune.py which of these is the fastest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from holoview.gpu.device import INT64, SUBGROUP, Buffer, Constants, Device, Pipeline
from holoview.gpu.fft_codegen import (
    LINE_RANGE,
    Axis,
    Direction,
    generate_pass_shader,
    merge_passes,
    pass_shapes,
    pass_workgroups,
)
from holoview.gpu.fft_radices import frequency_order, frequency_wgsl, radices
from holoview.gpu.line_fft_subgroup import MOST_REGISTERS, generate_subgroup_shader, lanes_per_line, subgroup_workgroups
from holoview.gpu.line_fft_workgroup import fit_tile, generate_workgroup_shader
from holoview.gpu.recorder import CommandRecorder, Dispatch, workgroup_grid
from holoview.gpu.shader import GeneratedWgsl, ShaderSource, link
from holoview.numerics.fft_grid import frequency_indices
from holoview.util.errors import UserError

__all__ = [
    "STRATEGIES",
    "Axis",
    "Hooks",
    "LineFft",
    "Strategy",
    "spectrum_frequencies",
    "storage_shader",
    "supported_strategies",
    "supports_subgroup_strategy",
]

Part = str | GeneratedWgsl
Strategy = Literal["passes", "workgroup", "subgroup"]
STRATEGIES: tuple[Strategy, ...] = ("passes", "workgroup", "subgroup")
ROW_PADDING = 8
"""Complex numbers after each row: without them, columns of 2^k rows compete for the same few cache lines."""
_COMPLEX_BYTES, _WORD = 8, 4
_WORKGROUP_MEMORY = "max-compute-workgroup-storage-size"

_UNSHARED = {
    "load": GeneratedWgsl("load", "fn load(at: vec3u) -> vec2f { return load_with(at, joint(at)); }\n"),
    "middle": GeneratedWgsl(
        "middle", "fn middle(at: vec3u, value: vec2f) -> vec2f { return middle_with(at, value, joint(at)); }\n"
    ),
}
"""Where each point is alone in an invocation, it evaluates for itself what it has in common with its neighbours."""

_LANES: WeakKeyDictionary[Device, int] = WeakKeyDictionary()
_COUNT_LANES = """
@group(1) @binding(0) var<storage, read_write> lanes: u32;
@compute @workgroup_size(64)
fn main(@builtin(subgroup_size) size: u32) { lanes = size; }
"""


@dataclass(frozen=True)
class Hooks:
    """WGSL that defines the four functions, its override constants, and a name for messages.

    own_work: the WGSL also defines `load_work` and `store_work`, like `load` and `store`, for what lies between the
    shaders of a transform; else it lies in a work buffer. Hooks that transform a buffer in place need no other.
    shares: which of `load` and `middle` takes what `neighbours` points have in common, if one does.
    """

    name: str
    parts: tuple[Part, ...]
    constants: tuple[tuple[str, int | float | bool], ...] = ()
    has_work_hooks: bool = False
    shared_hook: Literal["load", "middle"] | None = None
    shared_points: int = 1


@dataclass(frozen=True)
class TransformShader:
    """One shader of a transform; `workgroups` are those that so many lines need."""

    source: ShaderSource
    constants: Constants
    workgroups: Callable[[int], int]
    uses_hooks: bool = True
    uses_work: bool = False


class LineFft:
    """Transforms along `axis` of fields of `shape` (ny, nx), by `steps` such as ("forward", "inverse").

    `work_bytes` is what a field needs between the shaders of a transform. `stages` are these shaders. Raises UserError
    for a size that can't be transformed, at all or by the strategy on this device.
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
        self._device, self.axis, self.shape, self._hooks, self._steps = device, axis, shape, hooks, tuple(steps)
        self._length = shape[1] if axis == "x" else shape[0]
        self._strategy = strategy
        check_strategy(device, axis, self._length, strategy)
        build = {"passes": self._passes, "workgroup": self._workgroup, "subgroup": self._subgroup}
        self.shaders = build[strategy]()
        self.work_bytes = 0
        if any(stage.uses_work for stage in self.shaders):
            self.work_bytes = shape[0] * (shape[1] + ROW_PADDING) * _COMPLEX_BYTES

    def bind(
        self, resources: Sequence[Buffer | None], lines: int, fields: int, work: Buffer | None = None, *, first: int = 0
    ) -> list[Dispatch]:
        """Lines first … first + lines − 1 of so many fields, with `resources` in `@group(1)` of the hooks."""
        chosen = self._device.uniform(LINE_RANGE.pack(first=first, count=lines), "lines")
        bound = []
        for stage in self.shaders:
            groups = [[chosen], resources if stage.uses_hooks else [], [work] if stage.uses_work else []]
            across, down = workgroup_grid(stage.workgroups(lines), self._device)
            bound.append(Dispatch.bind(self._device, self._pipeline(stage), groups, (across, down, fields)))
        return bound

    def compile(self) -> None:
        """Compiles now rather than when it is first bound."""
        for stage in self.shaders:
            self._pipeline(stage)

    def _pipeline(self, stage: TransformShader) -> Pipeline:
        return self._device.pipeline(stage.source, stage.constants)

    def _subgroup(self) -> list[TransformShader]:
        lanes = lanes_per_line(self._length, subgroup_size(self._device))
        assert lanes is not None
        text = generate_subgroup_shader(
            self.axis, self._length, lanes, self._steps, self._hooks.shared_hook, self._hooks.shared_points
        )
        return [TransformShader(self._linked(text), dict(self._hooks.constants), partial(subgroup_workgroups, lanes))]

    def _workgroup(self) -> list[TransformShader]:
        tile = fit_tile(self.axis, self._length, self._device.limits[_WORKGROUP_MEMORY])
        assert tile is not None
        text = generate_workgroup_shader(tile, self._steps)
        return [TransformShader(self._linked(text), dict(self._hooks.constants), tile.workgroups)]

    def _passes(self) -> list[TransformShader]:
        passes = merge_passes(pass_shapes(self.axis, self._length, radices(self._length)), self._steps)
        stages, last, own = [], len(passes) - 1, self._hooks.has_work_hooks
        row = self.shape[1] + ROW_PADDING
        for number, (shape, directions) in enumerate(passes):
            uses_hooks = own or number in (0, last) or len(directions) > 1
            uses_work = not own and last > 0
            load, store = "load" if number == 0 else "load_work", "store" if number == last else "store_work"
            text = generate_pass_shader(shape, directions, load=load, store=store, begin=uses_hooks)
            parts: list[Part] = ["fft/work.wgsl"] if uses_work else []
            constants: dict[str, int | float | bool] = {}
            if uses_work:
                constants |= {"work_row_stride": row, "work_field_stride": row * self.shape[0]}
            if uses_hooks:
                constants |= dict(self._hooks.constants)
            source = self._linked(text, f", block {shape.block}", parts, uses_hooks)
            stages.append(TransformShader(source, constants, partial(pass_workgroups, shape), uses_hooks, uses_work))
        return stages

    def _linked(self, text: str, which: str = "", parts: Sequence[Part] = (), uses_hooks: bool = True) -> ShaderSource:
        """The hooks, if they are used, and a generated shader after them."""
        name = f"{self._hooks.name}: {'-'.join(self._steps)} along {self.axis}{which}, {self._strategy}"
        before: Sequence[Part] = (GeneratedWgsl("frequencies", self._frequencies()), *self._hooks.parts)
        if self._hooks.shared_hook is not None and self._strategy != "subgroup":
            before = (*before, _UNSHARED[self._hooks.shared_hook])
        return link(*parts, *(before if uses_hooks else ()), GeneratedWgsl(name, text))

    def _frequencies(self) -> str:
        ny, nx = self.shape
        function = _natural_wgsl if self._strategy == "subgroup" else frequency_wgsl
        return function("frequency_y", ny) + function("frequency_x", nx)


def supported_strategies(device: Device, shape: tuple[int, int]) -> tuple[Strategy, ...]:
    """The strategies by which a device can transform fields of a shape (ny, nx) along both axes.

    Raises UserError for a size that can't be transformed at all.
    """
    ny, nx = shape
    return tuple(s for s in STRATEGIES if _has(device, "y", ny, s) and _has(device, "x", nx, s))


def supports_subgroup_strategy(device: Device, shape: tuple[int, int]) -> bool:
    """Whether the device can transform such fields by the subgroup strategy."""
    return "subgroup" in supported_strategies(device, shape)


def spectrum_frequencies(n: int, strategy: Strategy) -> NDArray[np.int32]:
    """Signed frequency index at each position of the spectrum of n points, shape (n,)."""
    return frequency_indices(n).astype(np.int32) if strategy == "subgroup" else frequency_order(n)


def storage_shader(device: Device, *, half: bool = False) -> str:
    """The shader file that says how complex numbers lie in a buffer: `Stored`, `stored(vec2f)`, `restored(Stored)`.

    half: as f16, 4 bytes each instead of 8. Else they are the same bytes on every device, but accessed in the way that
    suits the device.
    """
    if half:
        return "fft/stored_f16.wgsl"
    is_wide = device.info.is_cpu and INT64 in device.features
    return "fft/stored_u64.wgsl" if is_wide else "fft/stored_f32.wgsl"


def subgroup_size(device: Device) -> int:
    """How many lanes a subgroup of the device has, asked of a shader; 1 where it can't shuffle."""
    if SUBGROUP not in device.features:
        return 1
    if device not in _LANES:
        out = device.buffer(_WORD, "lanes")
        step = Dispatch.bind(
            device, device.pipeline(link(GeneratedWgsl("lanes", _COUNT_LANES))), [[], [out]], (1, 1, 1)
        )
        recorder = CommandRecorder(device)
        recorder.add(step)
        recorder.submit()
        _LANES[device] = int(device.download(out, np.uint32, (1,))[0])
    return _LANES[device]


def _has(device: Device, axis: Axis, n: int, strategy: Strategy) -> bool:
    radices(n)  # the sizes that any strategy can transform
    if strategy == "workgroup":
        return fit_tile(axis, n, device.limits[_WORKGROUP_MEMORY]) is not None
    if strategy == "subgroup":
        return lanes_per_line(n, subgroup_size(device)) is not None
    return True


def check_strategy(device: Device, axis: Axis, n: int, strategy: Strategy) -> None:
    """Raise UserError unless the device can transform n points by the strategy."""
    if _has(device, axis, n, strategy):
        return
    lanes, memory = subgroup_size(device), device.limits[_WORKGROUP_MEMORY]
    expected = {
        "workgroup": f"a line that fits {memory} bytes of workgroup memory",
        "subgroup": f"{lanes} lanes or fewer, a power of two, that divide the length and hold at most {MOST_REGISTERS} "
        "values each"
        if lanes > 1
        else "an adapter whose lanes can exchange values",
    }[strategy]
    found = f"{n} points along {axis} on {device.info.name}"
    raise UserError(f"FFT strategy '{strategy}'", found, expected=expected, remedy="use 'passes'")


def _natural_wgsl(name: str, n: int) -> str:
    """A WGSL function of the signed frequency index at a position of a spectrum in natural order."""
    half = math.ceil(n / 2)
    return f"fn {name}(position: u32) -> i32 {{ return i32(position) - select(0, {n}, position >= {half}u); }}\n"
