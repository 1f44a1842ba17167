"""FFTs along one axis whose input, intermediate values and output go through caller-defined WGSL functions (hooks).

    begin(line: u32, field: u32)                       called first by each invocation, to read what a line needs
    load(position: vec3u) -> vec2f                     the complex input at position (x, y, field)
    middle(position: vec3u, value: vec2f) -> vec2f     applied between two steps
    store(position: vec3u, value: vec2f)               takes the result

If neighbouring points along x need the same complex number, the hooks can evaluate it in a separate function,

    shared_value(position: vec3u) -> vec2f             equal for `shared_points` points, from a multiple of that number

and take it as the last argument of `load_shared` or `middle_shared`, which then replace `load` or `middle`. A subgroup
evaluates it once for all these points.

The steps are forward, X[f] = Σ x[p]·exp(−2πi·f·p/n), or inverse, with the other sign; neither is normalised. The order
of a spectrum depends on the strategy: hooks of a transform along x can call `frequency_x(position: u32) -> i32`, which
returns the signed frequency index, or along y `frequency_y`. A step may name a band of frequencies. Then `load` and
`store` see the stored frequencies of `SpectrumOrder` only, at positions from 0 to its `count` − 1, and values outside
them count as 0. In the same way a step may name the points that it needs; others are neither loaded nor stored,
except a few next to them.

A strategy says where the values of a line are exchanged:

    passes      in a buffer, between several shaders of one pass each; any size; compiles fast, runs on every device
    workgroup   in workgroup memory, in one shader with barriers; lines that fit there
    subgroup    in registers, in one shader with subgroup shuffles; sizes for which `lanes_per_line` isn't None

`supported_strategies` tells which of them a device supports for a size, and `FftTuner` in `tune` which is the fastest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal
from weakref import WeakKeyDictionary

import numpy as np

from holoview.gpu.device import INT64, SUBGROUP, Buffer, Constants, Device
from holoview.gpu.fft_codegen import (
    LINE_RANGE,
    Axis,
    generate_pass_shader,
    merge_passes,
    pass_workgroups,
    radices,
)
from holoview.gpu.line_fft_codegen import (
    MAX_REGISTERS,
    can_repeat,
    fit_tile,
    generate_subgroup_shader,
    generate_workgroup_shader,
    lanes_per_line,
    subgroup_workgroups,
)
from holoview.gpu.recorder import CommandRecorder, Dispatch, workgroup_grid
from holoview.gpu.shader import GeneratedWgsl, ShaderSource, link
from holoview.gpu.spectrum_order import Direction, Range, SpectrumOrder, Step
from holoview.util.errors import UserError

__all__ = [
    "STRATEGIES",
    "Axis",
    "Direction",
    "Hooks",
    "LineFft",
    "Step",
    "Strategy",
    "can_transform_repeats",
    "spectrum_order",
    "storage_shader",
    "supported_strategies",
]

Part = str | GeneratedWgsl
Strategy = Literal["passes", "workgroup", "subgroup"]
STRATEGIES: tuple[Strategy, ...] = ("passes", "workgroup", "subgroup")
ROW_PADDING = 8
"""Unused complex numbers after each row: strides of 2^k would map a column to a few sets of the cache."""
_COMPLEX_BYTES, _WORD = 8, 4
_WORKGROUP_MEMORY = "max-compute-workgroup-storage-size"

_UNSHARED_HOOKS = {
    "load": GeneratedWgsl("load", "fn load(at: vec3u) -> vec2f { return load_shared(at, shared_value(at)); }\n"),
    "middle": GeneratedWgsl(
        "middle", "fn middle(at: vec3u, value: vec2f) -> vec2f { return middle_shared(at, value, shared_value(at)); }\n"
    ),
}
"""Without subgroups, each invocation evaluates the shared value of its own point."""

_SUBGROUP_SIZES: WeakKeyDictionary[Device, int] = WeakKeyDictionary()
_READ_SUBGROUP_SIZE = """
@group(1) @binding(0) var<storage, read_write> lanes: u32;
@compute @workgroup_size(64)
fn main(@builtin(subgroup_size) size: u32) { lanes = size; }
"""


@dataclass(frozen=True)
class Hooks:
    """WGSL that defines the hooks.

    name: for error messages. parts: shader files and generated text. constants: values of override constants.
    has_work_hooks: the WGSL also defines `load_work` and `store_work`, with the signatures of `load` and `store`, for
    intermediate values between the shaders of a transform; otherwise these are in a work buffer.
    shared_hook: "load" or "middle" if that hook takes the value that each `shared_points` points share.
    """

    name: str
    parts: tuple[Part, ...]
    constants: tuple[tuple[str, int | float | bool], ...] = ()
    has_work_hooks: bool = False
    shared_hook: Literal["load", "middle"] | None = None
    shared_points: int = 1


@dataclass(frozen=True)
class TransformShader:
    """One shader of a transform.

    constants: values of override constants. workgroups: the number of workgroups for a number of lines.
    uses_hooks: binds the caller's resources in group 1. uses_work: binds a work buffer in group 2.
    """

    source: ShaderSource
    constants: Constants
    workgroups: Callable[[int], int]
    uses_hooks: bool = True
    uses_work: bool = False


class LineFft:
    """Transforms along `axis` with `steps` such as (Step("forward"), Step("inverse")).

    shape: (ny, nx), the length of the transform along `axis`, and the number of lines along the other axis.
    `shaders` run in this order. `work_bytes` is the size of the work buffer for one field, 0 if none is needed.
    Raises UserError for a size that can't be transformed, at all or by the strategy on this device.
    """

    def __init__(
        self,
        device: Device,
        axis: Axis,
        shape: tuple[int, int],
        steps: Sequence[Step],
        hooks: Hooks,
        strategy: Strategy = "passes",
    ) -> None:
        self._device, self.axis, self.shape, self._hooks, self._steps = device, axis, shape, hooks, tuple(steps)
        self._length = shape[1] if axis == "x" else shape[0]
        self._strategy = strategy
        check_strategy(device, axis, self._length, strategy)
        repeats = math.lcm(*(step.repeats for step in self._steps))
        self._radices = radices(self._length, repeats, device.largest_radix)
        generators = {
            "passes": self._pass_shaders,
            "workgroup": self._workgroup_shader,
            "subgroup": self._subgroup_shader,
        }
        self.shaders = generators[strategy]()
        self.work_bytes = 0
        if any(shader.uses_work for shader in self.shaders):
            self.work_bytes = shape[0] * (shape[1] + ROW_PADDING) * _COMPLEX_BYTES

    def bind(
        self, resources: Sequence[Buffer | None], lines: int, fields: int, work: Buffer | None = None, *, first: int = 0
    ) -> list[Dispatch]:
        """The dispatches that transform lines first … first + lines − 1 of each of `fields` fields.

        resources: bound to `@group(1)`, which belongs to the hooks. work: `work_bytes` for each field.
        """
        line_range = self._device.uniform(LINE_RANGE.pack(first=first, count=lines), "lines")
        dispatches = []
        for shader in self.shaders:
            groups = [[line_range], resources if shader.uses_hooks else [], [work] if shader.uses_work else []]
            workgroups = (*workgroup_grid(shader.workgroups(lines), self._device), fields)
            pipeline = self._device.pipeline(shader.source, shader.constants)
            dispatches.append(Dispatch.bind(self._device, pipeline, groups, workgroups))
        return dispatches

    def _subgroup_shader(self) -> list[TransformShader]:
        lanes = lanes_per_line(self._length, subgroup_size(self._device))
        assert lanes is not None
        text = generate_subgroup_shader(
            self.axis, self._length, lanes, self._steps, self._hooks.shared_hook, self._hooks.shared_points
        )
        return [TransformShader(self._linked(text), dict(self._hooks.constants), partial(subgroup_workgroups, lanes))]

    def _workgroup_shader(self) -> list[TransformShader]:
        tile = fit_tile(self.axis, self._length, self._radices, self._device.limits[_WORKGROUP_MEMORY])
        assert tile is not None
        text = generate_workgroup_shader(tile, self._radices, self._steps)
        return [TransformShader(self._linked(text), dict(self._hooks.constants), tile.workgroups)]

    def _pass_shaders(self) -> list[TransformShader]:
        passes = merge_passes(self._length, self._radices, self._steps)
        shaders, last, has_work_hooks = [], len(passes) - 1, self._hooks.has_work_hooks
        row = self.shape[1] + ROW_PADDING
        for number, steps in enumerate(passes):
            uses_hooks = has_work_hooks or number in (0, last) or len(steps) > 1
            uses_work = not has_work_hooks and last > 0
            text = generate_pass_shader(
                self.axis, steps, is_first=number == 0, is_last=number == last, begin=uses_hooks
            )
            parts: list[Part] = ["fft/work.wgsl"] if uses_work else []
            constants: dict[str, int | float | bool] = {}
            if uses_work:
                constants |= {"work_row_stride": row, "work_field_stride": row * self.shape[0]}
            if uses_hooks:
                constants |= dict(self._hooks.constants)
            source = self._linked(text, f", block {steps[0][0].block}", parts, uses_hooks)
            shaders.append(TransformShader(source, constants, partial(pass_workgroups, steps), uses_hooks, uses_work))
        return shaders

    def _linked(self, text: str, suffix: str = "", parts: Sequence[Part] = (), uses_hooks: bool = True) -> ShaderSource:
        """`parts`, the hooks if they are used, and a generated shader; `suffix` is a part of its name in messages."""
        directions = "-".join(step.direction for step in self._steps)
        name = f"{self._hooks.name}: {directions} along {self.axis}{suffix}, {self._strategy}"
        hooks: Sequence[Part] = (GeneratedWgsl("frequencies", self._frequencies()), *self._hooks.parts)
        if self._hooks.shared_hook is not None and self._strategy != "subgroup":
            hooks = (*hooks, _UNSHARED_HOOKS[self._hooks.shared_hook])
        return link(*parts, *(hooks if uses_hooks else ()), GeneratedWgsl(name, text))

    def _frequencies(self) -> str:
        """WGSL of the frequency at each position of the spectrum of the last step."""
        band = self._steps[-1].band
        if self._strategy == "subgroup":
            order = spectrum_order(self._device, self._length, self._strategy, band)
        else:
            order = SpectrumOrder.reversed_order(self._radices, band)
        return order.frequency_wgsl(f"frequency_{self.axis}")


def supported_strategies(device: Device, shape: tuple[int, int]) -> tuple[Strategy, ...]:
    """The strategies that a device supports for fields of `shape` (ny, nx) along both axes.

    Raises UserError for a size that can't be transformed by any strategy.
    """
    ny, nx = shape
    return tuple(s for s in STRATEGIES if _is_supported(device, "y", ny, s) and _is_supported(device, "x", nx, s))


def spectrum_order(device: Device, n: int, strategy: Strategy, band: Range | None = None) -> SpectrumOrder:
    """The stored frequencies of n points, or of a band of them, which contains all that is stored otherwise.

    Raises UserError for a size that can't be transformed.
    """
    lanes = lanes_per_line(n, subgroup_size(device)) if strategy == "subgroup" else None
    if lanes is not None:
        return SpectrumOrder.natural(n, lanes, band)
    return SpectrumOrder.reversed_order(radices(n, largest=device.largest_radix), band)


def can_transform_repeats(device: Device, n: int, repeats: int, strategy: Strategy) -> bool:
    """Whether the strategy can transform lines of n points with `Step.repeats`."""
    if n % repeats or repeats > device.largest_radix:
        return False
    lanes = lanes_per_line(n, subgroup_size(device)) if strategy == "subgroup" else None
    return lanes is None or can_repeat(n, lanes, repeats)


def storage_shader(device: Device, *, half: bool = False) -> str:
    """The shader file that defines how complex numbers are stored in a buffer.

    It defines the type `StoredComplex` and the functions `encode_complex(vec2f)` and `decode_complex(StoredComplex)`.
    half: two f16 (4 bytes) instead of two f32 (8 bytes). On CPU adapters f32 pairs are accessed as one u64, which is
    faster there; the bytes are the same.
    """
    if half:
        return "fft/complex_f16.wgsl"
    is_wide = device.info.is_cpu and INT64 in device.features
    return "fft/complex_u64.wgsl" if is_wide else "fft/complex_f32.wgsl"


def subgroup_size(device: Device) -> int:
    """Lanes of a subgroup of the device, as a shader reports it; 1 if the device has no subgroup operations."""
    if SUBGROUP not in device.features:
        return 1
    if device not in _SUBGROUP_SIZES:
        out = device.buffer(_WORD, "subgroup size")
        pipeline = device.pipeline(link(GeneratedWgsl("subgroup size", _READ_SUBGROUP_SIZE)))
        recorder = CommandRecorder(device)
        recorder.add(Dispatch.bind(device, pipeline, [[], [out]], (1, 1, 1)))
        recorder.submit()
        _SUBGROUP_SIZES[device] = int(device.download(out, np.uint32, (1,))[0])
    return _SUBGROUP_SIZES[device]


def _is_supported(device: Device, axis: Axis, n: int, strategy: Strategy) -> bool:
    factors = radices(n, largest=device.largest_radix)  # raises UserError for sizes that no strategy can transform
    if strategy == "workgroup":
        return fit_tile(axis, n, factors, device.limits[_WORKGROUP_MEMORY]) is not None
    if strategy == "subgroup":
        return lanes_per_line(n, subgroup_size(device)) is not None
    return True


def check_strategy(device: Device, axis: Axis, n: int, strategy: Strategy) -> None:
    """Raise UserError unless the device can transform n points along `axis` by the strategy."""
    if _is_supported(device, axis, n, strategy):
        return
    lanes, memory = subgroup_size(device), device.limits[_WORKGROUP_MEMORY]
    expected = {
        "workgroup": f"a line that fits {memory} bytes of workgroup memory",
        "subgroup": f"{lanes} lanes or fewer, a power of two, that divide the length and hold at most {MAX_REGISTERS} "
        "values each"
        if lanes > 1
        else "an adapter whose lanes can exchange values",
    }[strategy]
    found = f"{n} points along {axis} on {device.info.name}"
    raise UserError(f"FFT strategy '{strategy}'", found, expected=expected, remedy="use 'passes'")


# Compiles shaders before they are needed: all are dispatched once, in one submission, on otherwise unused buffers.
#
# Drivers that execute shaders on the CPU compile a shader when it first runs, in a thread of their own. Such a driver
# compiles the submitted shaders while the program continues.


_BUFFER_BYTES = 1 << 16


def precompile(device: Device, shaders: Iterable[TransformShader]) -> None:
    """Create the pipelines of shaders and dispatch each once; doesn't wait until the driver has finished.

    Raises ShaderError and DeviceLost as `Device.pipeline` does.
    """
    recorder = CommandRecorder(device, "shaders")
    for shader in shaders:
        declared = shader.source.buffer_bindings() or {}
        groups = [_dummy_buffers(device, declared.get(number, {})) for number in range(max(declared, default=-1) + 1)]
        recorder.add(Dispatch.bind(device, device.pipeline(shader.source, shader.constants), groups, (1, 1, 1)))
    recorder.submit()


def _dummy_buffers(device: Device, bindings: Mapping[int, str]) -> list[Buffer | None]:
    """A zero buffer for each binding of a group, and None for each unused binding number."""
    buffers: list[Buffer | None] = [None] * (max(bindings, default=-1) + 1)
    for binding, kind in bindings.items():
        is_uniform = kind == "uniform"
        buffers[binding] = (
            device.uniform(bytes(_BUFFER_BYTES), "precompile")
            if is_uniform
            else device.buffer(_BUFFER_BYTES, "precompile")
        )
    return buffers
