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

`generate_workgroup_shader` and `generate_subgroup_shader` make the WGSL of the last two; `fft_codegen` that of a pass.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby, islice
from typing import Any, Literal
from weakref import WeakKeyDictionary

import numpy as np

from holoview.light.gpu.device import INT64, SUBGROUP, Buffer, Constants, Device
from holoview.light.gpu.fft_codegen import (
    COMMON_DECLARATIONS,
    LINE_RANGE,
    Axis,
    PassSteps,
    WgslEmitter,
    emit_dft,
    emit_pass,
    generate_pass_shader,
    merge_passes,
    pass_workgroups,
    radices,
    scattered,
)
from holoview.light.gpu.recorder import CommandRecorder, Dispatch, workgroup_grid
from holoview.light.gpu.shader import TEXELS, GeneratedWgsl, ShaderSource, link
from holoview.light.gpu.spectrum_order import Direction, LineTransform, Range, SpectrumOrder, covered_digits
from holoview.light.gpu.texels import TexelMemory, Texels
from holoview.light.numerics.sampling import ceil_div
from holoview.util.errors import UserError

# --- in workgroup memory ----------------------------------------------------------------------------------------------

# The passes are those of `fft_codegen`, with the same radices and therefore the same digit-reversed spectra, but one
# shader does all of them: between two passes the values of a line are in workgroup memory instead of a buffer. Each
# pass works in place, so that one barrier after it is sufficient. Several columns share a workgroup, so that
# neighbouring invocations read neighbouring addresses; several short rows share one to fill it.


MIN_TILE_INVOCATIONS, MAX_TILE_INVOCATIONS = 64, 256
"""Invocations of a workgroup."""
COLUMNS = 4
"""Columns that share a workgroup if its memory allows: 32 bytes, the smallest memory transaction of GPUs."""
_COMPLEX_BYTES = 8
_BANKS = 16
"""One unused value follows so many: strides of 2^k values would map to a single bank of workgroup memory."""


@dataclass(frozen=True)
class WorkgroupTile:
    """The lines of one workgroup: `lines` lines of `length` points along `axis`, `threads` invocations for each."""

    axis: Axis
    length: int
    threads: int
    lines: int

    @property
    def pitch(self) -> int:
        """Complex values from one line to the next in workgroup memory, including unused ones."""
        return _pitch(self.length)

    def workgroups(self, lines: int) -> int:
        """Number of workgroups for `lines` lines."""
        return ceil_div(lines, self.lines)


def fit_tile(axis: Axis, n: int, factors: Sequence[int], memory_bytes: int) -> WorkgroupTile | None:
    """The tile for lines of n points and these radices, or None if a single line exceeds the workgroup memory."""
    threads = min(n // min(factors, default=1), MAX_TILE_INVOCATIONS)
    lines = COLUMNS if axis == "y" else 1
    while lines * threads < MIN_TILE_INVOCATIONS:
        lines *= 2
    fitting = memory_bytes // (_pitch(n) * _COMPLEX_BYTES)
    if not fitting:
        return None
    while lines > fitting or lines * threads > MAX_TILE_INVOCATIONS:
        lines //= 2
    return WorkgroupTile(axis, n, threads, lines)


def generate_workgroup_shader(tile: WorkgroupTile, factors: tuple[int, ...], steps: Sequence[LineTransform]) -> str:
    """The WGSL of the transforms of a tile, to be linked after its hooks; the entry point is `main`."""
    passes = merge_passes(tile.length, factors, steps)
    body: list[str] = []
    for number, merged in enumerate(passes):
        body += _pass(tile, merged, is_first=number == 0, is_last=number == len(passes) - 1)
    text = "".join(f"    {line}\n" for line in body)
    return f"{_prologue(tile, steps)}{text}}}\n"


def _pass(tile: WorkgroupTile, steps: PassSteps, *, is_first: bool, is_last: bool) -> list[str]:
    """Statements of one pass, in a loop if the DFTs of a line aren't exactly as many as its invocations."""
    code, shape = WgslEmitter(), steps[0][0]
    code.lines.append(f"let offset = item % {shape.stride}u;")

    def position(along: str) -> str:
        return f"vec3u({along}, line, field)" if tile.axis == "x" else f"vec3u(line, {along}, field)"

    def load(along: str) -> str:
        return (
            f"load({position(along)})" if is_first else f"line_memory[line_slot({shape.between_passes(along)}, across)]"
        )

    pairs = emit_pass(code, steps, load, position)
    if is_last:
        stores = [f"    store({position(along)}, {value});" for along, value in pairs]
        code.lines += ["if (is_valid_line) {", *stores, "}"]
    else:
        places = [steps[-1][0].between_passes(along) for along, _ in pairs]
        code.lines += [
            f"line_memory[line_slot({place}, across)] = {value};"
            for place, (_, value) in zip(places, pairs, strict=True)
        ]
    is_one_each = shape.invocations_per_line == tile.threads
    head = ["{", "    let item = thread;"]
    if not is_one_each:
        head = [f"for (var item = thread; item < {shape.invocations_per_line}u; item += {tile.threads}u) {{"]
    barrier = [] if is_last else ["workgroupBarrier();"]
    return [*head, *(f"    {line}" for line in code.lines), "}", *barrier]


def _pitch(n: int) -> int:
    return n + ceil_div(n, _BANKS)


def _prologue(tile: WorkgroupTile, steps: Sequence[LineTransform]) -> str:
    """The beginning of the shader up to the line of an invocation.

    Invocations beyond the last line repeat it without storing, since all have to reach each barrier.
    """
    size, directions = tile.threads * tile.lines, " and ".join(step.direction for step in steps)
    if tile.axis == "x":
        split = f"let thread = local % {tile.threads}u;\n    let across = local / {tile.threads}u;"
        slot = f"across * {tile.pitch}u + along + along / {_BANKS}u"
    else:
        split = f"let thread = local / {tile.lines}u;\n    let across = local % {tile.lines}u;"
        slot = f"(along + along / {_BANKS}u) * {tile.lines}u + across"
    return f"""{COMMON_DECLARATIONS}
var<workgroup> line_memory: array<vec2f, {tile.pitch * tile.lines}>;

// Index in workgroup memory of the value `along` of line `across` of the workgroup.
fn line_slot(along: u32, across: u32) -> u32 {{
    return {slot};
}}

// {directions} transforms of {tile.lines} lines along {tile.axis} of {tile.length} points
@compute @workgroup_size({size})
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) workgroups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {{
    {split}
    let number = (workgroup.y * workgroups.x + workgroup.x) * {tile.lines}u + across;
    let is_valid_line = number < lines.count;
    let line = lines.first + min(number, lines.count - 1u);
    let field = workgroup.z;
    begin(line, field);
"""


# --- in the registers of a subgroup -----------------------------------------------------------------------------------

# A line of n = S·A points is held by S lanes with A complex registers each: lane l holds the points l, l + S, l + 2S, …
# A forward transform consists, after Cooley and Tukey (Math. Comp. 19, 297 (1965)), of
#
# DFT of A over a lane's registers → twiddles w_n^(l·k) → S × S transposes between lanes and registers → DFTs of S
#
# after which register j of group g of lane l holds the frequency l + S·g + A·j: the spectrum is in natural order, and
# neighbouring lanes access neighbouring frequencies. A transpose exchanges the bits of register and lane numbers one by
# one with `subgroupShuffleXor` and `select`. There are neither workgroup memory nor barriers, and between a forward and
# an inverse transform all values stay in registers.
#
# If S doesn't divide A, zeros fill the last group of registers. There the lanes with l + S·g ≥ A compute values that
# nobody uses: such a lane loads the numbers of another lane and stores nothing.
#
# Statements are emitted group by group, from the transpose to the store or the inverse transform, so that few values
# are live at the same time.


Names = dict[int, str]
"""Names of values by the number of their register in a line, or by their digit in a group of a spectrum."""
Spectrum = Iterator[tuple[int, Names]]
"""The groups of a spectrum: their number and their values."""

MAX_LINES, MAX_INVOCATIONS = 4, 128
"""Most lines of a workgroup. Four columns are 32 bytes wide, the smallest memory transaction of GPUs."""
MAX_REGISTERS = 256
"""Complex registers of a lane: more would be spilled to memory on any adapter."""


def lanes_per_line(n: int, subgroup_size: int) -> int | None:
    """The most lanes, a power of two up to `subgroup_size`, that can share a line of n points; None if impossible.

    They have to divide n, and each lane has to have at least as many registers as there are lanes and at most 256.
    """
    lanes = 1 << (subgroup_size.bit_length() - 1)
    while lanes > 1:
        if n % lanes == 0 and lanes <= n // lanes <= MAX_REGISTERS:
            return lanes
        lanes //= 2
    return None


def generate_subgroup_shader(
    axis: str,
    n: int,
    lanes: int,
    steps: Sequence[LineTransform],
    shared_hook: str | None = None,
    shared_points: int = 1,
    *,
    fours: bool = False,
) -> str:
    """The WGSL of a transform of lines of n points along `axis`, to be linked after its hooks; entry point `main`.

    shared_hook: "load" or "middle" if that hook takes a value that each `shared_points` neighbouring points share.
    fours: see `Hooks`; only if `can_access_fours`.
    """
    code = _Line(axis, n, lanes, shared_hook, shared_points, fours=fours)
    points: Names | None = None
    spectrum: Spectrum | None = None
    for step in steps:
        if step.direction == "forward":
            given = code.loaded_points(step) if points is None else code.between_points(points, step)
            points, spectrum = None, code.spectrum(given, step)
            if step.repeats > 1:
                spectrum = code.repeated(spectrum, step.repeats)
        else:
            frequencies = code.loaded_spectrum(step) if spectrum is None else code.between_spectrum(spectrum, step)
            points, spectrum = code.points(frequencies), None
    if spectrum is None:
        code.store_points(points or {}, steps[-1])
    else:
        code.store_spectrum(spectrum, steps[-1])
    body = "".join(f"    {line}\n" for line in code.lines)
    return f"{_lanes_prologue(axis, n, lanes, steps)}{body}}}\n"


def can_repeat(n: int, lanes: int, repeats: int) -> bool:
    """Whether the spectrum of n/repeats points can be repeated in registers."""
    return n % (lanes * lanes * repeats) == 0


def can_access_fours(n: int, lanes: int) -> bool:
    """Whether lanes can load and store four neighbouring points at a time."""
    return lanes % 4 == 0 and n % (4 * lanes * lanes) == 0


def subgroup_workgroups(lanes: int, lines: int) -> int:
    """Number of workgroups for `lines` lines of `lanes` lanes each."""
    return ceil_div(lines, _lines_per_workgroup(lanes))


def _lines_per_workgroup(lanes: int) -> int:
    return max(min(MAX_LINES, MAX_INVOCATIONS // lanes), 1)


class _Line(WgslEmitter):
    """Emits statements on the registers of a line: its points, or the groups of its spectrum one after the other."""

    def __init__(
        self, axis: str, n: int, lanes: int, shared_hook: str | None, shared_points: int, *, fours: bool = False
    ) -> None:
        super().__init__()
        self._shared_hook, self._shared_points, self._fours = shared_hook, shared_points, fours
        self.axis, self.n, self.lanes, self.registers = axis, n, lanes, n // lanes
        self.groups = ceil_div(self.registers, lanes)
        for bit in self._bits():
            self.lines.append(f"let is_odd{bit} = (lane & {bit}u) != 0u;")
        self.lines.append("let subgroup_start = invocation - lane;")
        self.lines.append(f"lane_point = {f'lane % 4u * {lanes}u + lane / 4u * 4u' if fours else 'lane'};")
        self.lines.append("begin(line, field);")
        self._twiddles = self.twiddles("lane", self.registers, n)

    def spectrum(self, points: Names, step: LineTransform) -> Spectrum:
        """The forward transform of points: frequencies by digit, group by group."""
        registers = self.registers // step.repeats
        twiddles = self._twiddles[:: step.repeats]
        given = scattered(list(points.values()), list(points), registers)
        columns = self.times_twiddles(emit_dft(self, given, -1), twiddles, conjugate=False)
        columns += ["vec2f(0.0)"] * (-registers % self.lanes)
        for group, first in enumerate(range(0, len(columns), self.lanes)):
            yield group, dict(enumerate(emit_dft(self, self._transposed(columns[first : first + self.lanes]), -1)))

    def repeated(self, spectrum: Spectrum, repeats: int) -> Spectrum:
        """The spectrum repeated to n frequencies, of which register j of group g has the frequency lane + S·g + A·j."""
        groups = self.groups // repeats
        for group, values in spectrum:
            for part in range(repeats):
                digits = ((repeats * j + part) % self.lanes for j in range(self.lanes))
                yield group + groups * part, {j: values[digit] for j, digit in enumerate(digits)}

    def points(self, spectrum: Spectrum) -> Names:
        """The inverse transform of frequencies: the steps of `spectrum` in reverse order, conjugated."""
        columns = [""] * (self.groups * self.lanes)
        for group, values in spectrum:
            given = scattered(list(values.values()), list(values), self.lanes)
            first = group * self.lanes
            columns[first : first + self.lanes] = self._transposed(emit_dft(self, given, 1))
        turned = self.times_twiddles(columns[: self.registers], self._twiddles, conjugate=True)
        return dict(enumerate(emit_dft(self, turned, 1)))

    def loaded_points(self, step: LineTransform) -> Names:
        """Points from the hook `load` or `load_shared`."""
        registers = self._needed_points(step)
        if self._shared_hook != "load":
            return {k: self.let(f"load({self._point(k)})") for k in registers}
        return {k: self.let(f"load_shared({self._point(k)}, {value})") for k, value in self._shared_values(registers)}

    def loaded_spectrum(self, step: LineTransform) -> Spectrum:
        """Frequencies from the hook `load` or `load_four`, group by group."""
        for group in range(0, self.groups if self._fours else 0, 4):
            starts = self._frequencies(group, step)
            fours = {digit: self.let(f"load_four({self._of_four(start)})") for digit, start in starts.items()}
            split = {digit: self._transposed([f"{four}[{i}]" for i in range(4)]) for digit, four in fours.items()}
            yield from ((group + i, {digit: values[i] for digit, values in split.items()}) for i in range(4))
        for group in range(0 if self._fours else self.groups):
            positions = self._frequencies(group, step)
            yield group, {digit: self.let(f"load({position})") for digit, position in positions.items()}

    def between_points(self, points: Names, step: LineTransform) -> Names:
        """Points after the hook `middle` or `middle_shared`."""
        registers = self._needed_points(step)
        if self._shared_hook != "middle":
            return {k: self.let(f"middle({self._point(k)}, {points[k]})") for k in registers}
        shared = self._shared_values(registers)
        return {k: self.let(f"middle_shared({self._point(k)}, {points[k]}, {value})") for k, value in shared}

    def between_spectrum(self, spectrum: Spectrum, step: LineTransform) -> Spectrum:
        """Frequencies after the hook `middle`, group by group."""
        for group, values in spectrum:
            positions = self._frequencies(group, step)
            yield (
                group,
                {digit: self.let(f"middle({position}, {values[digit]})") for digit, position in positions.items()},
            )

    def _shared_values(self, registers: Sequence[int]) -> Iterator[tuple[int, str]]:
        """For each register, the value that its point shares with its neighbours, evaluated by one lane for all.

        The points of u registers are S·u successive ones. They share S values, of which each lane evaluates one.
        """
        u, s = self._shared_points, self.lanes
        if u == 1 or s % u or self.registers % u:
            for k in registers:
                yield k, self.let(f"shared_value({self._point(k)})")
            return
        for first, successive in groupby(registers, lambda k: k - k % u):
            own = self.let(f"shared_value({self._position(f'lane * {u}u + {s * first}u')})")
            for k in successive:
                yield k, self.let(f"subgroupShuffle({own}, subgroup_start + lane / {u}u + {k % u * s // u}u)")

    def store_points(self, points: Names, step: LineTransform) -> None:
        """Pass the points of a valid line to the hook `store` or `store_four`."""
        if self._fours:
            for first in sorted({k - k % 4 for k in self._needed_points(step)}):
                self._store_four(self._point(first), [points[first + i] for i in range(4)])
            return
        self._store("is_valid_line", {self._point(k): points[k] for k in self._needed_points(step)})

    def store_spectrum(self, spectrum: Spectrum, step: LineTransform) -> None:
        """Pass the frequencies of a valid line to the hook `store` or `store_four`."""
        if self._fours:
            for first in range(0, self.groups, 4):
                groups = [values for _, values in islice(spectrum, 4)]
                for digit, position in self._frequencies(first, step).items():
                    self._store_four(position, [values[digit] for values in groups])
            return
        for group, values in spectrum:
            is_whole = (group + 1) * self.lanes <= self.registers
            is_used = f"is_valid_line && lane + {group * self.lanes}u < {self.registers}u"
            positions = self._frequencies(group, step)
            self._store(
                "is_valid_line" if is_whole else is_used,
                {position: values[digit] for digit, position in positions.items()},
            )

    def _store(self, condition: str, values: dict[str, str]) -> None:
        stores = [f"    store({position}, {value});" for position, value in values.items()]
        self.lines += [f"if ({condition}) {{", *stores, "}"]

    def _store_four(self, start: str, values: list[str]) -> None:
        """Pass the values of four registers, the first of which is at `start`, to the hook `store_four`."""
        four = f"mat4x2f({', '.join(self._transposed(values))})"
        self.lines += ["if (is_valid_line) {", f"    store_four({self._of_four(start)}, {four});", "}"]

    def _of_four(self, position: str) -> str:
        """The position at which a lane accesses four registers, of which the first one is at `position`."""
        return position.replace("lane", "lane_point", 1)

    def _needed_points(self, step: LineTransform) -> tuple[int, ...]:
        """The registers with points that a step needs."""
        n, registers = self.n // step.repeats, self.registers // step.repeats
        return covered_digits(n, registers, step.points)

    def _point(self, k: int) -> str:
        """Position of the point in register k."""
        return self._position(f"lane + {self.lanes * k}u")

    def _frequencies(self, group: int, step: LineTransform) -> dict[int, str]:
        """Positions of the stored frequencies in the registers of a group, by digit."""
        lowest, offset = "lane", group * self.lanes
        if (group + 1) * self.lanes > self.registers:
            lowest, offset = self.let(f"min(lane + {offset}u, {self.registers - 1}u)"), 0
        digits = covered_digits(self.n, self.lanes, step.band)
        return {
            digit: self._position(f"{lowest} + {offset + self.registers * number}u")
            for number, digit in enumerate(digits)
        }

    def _position(self, along: str) -> str:
        return f"vec3u({along}, line, field)" if self.axis == "x" else f"vec3u(line, {along}, field)"

    def _bits(self) -> list[int]:
        """The bits of a lane number, highest first: lanes/2, …, 2, 1."""
        return [1 << bit for bit in reversed(range(self.lanes.bit_length() - 1))]

    def _transposed(self, values: list[str]) -> list[str]:
        """Exchange register i of lane j with register j of lane i; of four registers, with the last two bits of j."""
        out = list(values)
        for bit in (bit for bit in self._bits() if bit < len(values)):
            for low in (i for i in range(len(values)) if not i & bit):
                a, b = out[low], out[low + bit]
                out[low] = self.let(f"select({a}, subgroupShuffleXor({b}, {bit}u), is_odd{bit})")
                out[low + bit] = self.let(f"select(subgroupShuffleXor({a}, {bit}u), {b}, is_odd{bit})")
        return out


def _lanes_prologue(axis: str, n: int, lanes: int, steps: Sequence[LineTransform]) -> str:
    """The beginning of the shader up to the line of a lane.

    Lanes beyond the last line repeat it without storing, since shuffles need all lanes to be active.
    """
    lines, directions = _lines_per_workgroup(lanes), " and ".join(step.direction for step in steps)
    return f"""{COMMON_DECLARATIONS}
// {directions} transform along {axis}: {n} points in {n // lanes} registers of {lanes} lanes
@compute @workgroup_size({lines * lanes})
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) workgroups: vec3u,
    @builtin(local_invocation_index) local: u32,
    @builtin(subgroup_invocation_id) invocation: u32,
) {{
    let lane = invocation % {lanes}u;
    let number = (workgroup.y * workgroups.x + workgroup.x) * {lines}u + local / {lanes}u;
    let is_valid_line = number < lines.count;
    let line = lines.first + min(number, lines.count - 1u);
    let field = workgroup.z;
"""


# --- transforms -------------------------------------------------------------------------------------------------------


__all__ = [
    "STRATEGIES",
    "Axis",
    "Direction",
    "Hooks",
    "LineFft",
    "LineTransform",
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
_WORD = 4
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
    fours: of the strategy `subgroup`, whether the hooks `load_four(position: vec3u) -> mat4x2f`, of a spectrum, and
    `store_four(position: vec3u, values: mat4x2f)` access four neighbouring values, of which `position` is the first, in
    place of `load` and `store`.
    texels: whether the hooks read complex numbers as texels (`texels.py`). Then a work buffer is read so too.
    """

    name: str
    parts: tuple[Part, ...]
    constants: tuple[tuple[str, int | float | bool], ...] = ()
    has_work_hooks: bool = False
    shared_hook: Literal["load", "middle"] | None = None
    shared_points: int = 1
    fours: bool = False
    texels: bool = False


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
    """Transforms along `axis` with `steps` such as (LineTransform("forward"), LineTransform("inverse")).

    shape: (ny, nx), the length of the transform along `axis`, and the number of lines along the other axis.
    `shaders` run in this order. `work_bytes` is the size of the work buffer for one field, 0 if none is needed.
    Raises UserError for a size that can't be transformed, at all or by the strategy on this device.
    """

    def __init__(
        self,
        device: Device,
        axis: Axis,
        shape: tuple[int, int],
        steps: Sequence[LineTransform],
        hooks: Hooks,
        strategy: Strategy = "passes",
    ) -> None:
        self._device, self.axis, self.shape, self._hooks, self._steps = device, axis, shape, hooks, tuple(steps)
        self.has_work_hooks = hooks.has_work_hooks
        self._length = shape[1] if axis == "x" else shape[0]
        self._strategy = strategy
        check_strategy(device, axis, self._length, strategy)
        repeats = math.lcm(*(step.repeats for step in self._steps))
        self._radices = radices(self._length, repeats, device.transforms.largest_radix)
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
        self,
        resources: Sequence[Buffer | Texels | None],
        lines: int,
        fields: int,
        work: Buffer | None = None,
        *,
        first: int = 0,
        later: Sequence[Buffer | Texels | Any | None] | None = None,
        texels: TexelMemory | None = None,
    ) -> list[Dispatch]:
        """The dispatches that transform lines first … first + lines − 1 of each of `fields` fields.

        resources: bound to `@group(1)`, which belongs to the hooks. work: `work_bytes` for each field. later: what
        shaders behind the first bind in place of `resources`. texels: where those of the work buffer are, of hooks that
        read texels.
        """
        line_range = self._device.uniform(LINE_RANGE.pack(first=first, count=lines), "lines")
        work_read: list[Buffer | Texels | None] = [work]
        if work and texels and self._hooks.texels and self.work_bytes:
            work_read.append(Texels(texels, work, 0, fields * self.work_bytes // _COMPLEX_BYTES))
        dispatches = []
        for number, shader in enumerate(self.shaders):
            hooked = later if later and number else resources
            worked = work_read if number else [work]
            groups = [[line_range], hooked if shader.uses_hooks else [], worked if shader.uses_work else []]
            workgroups = (*workgroup_grid(shader.workgroups(lines), self._device), fields)
            pipeline = self._device.pipeline(shader.source, shader.constants)
            dispatches.append(Dispatch.bind(self._device, pipeline, groups, workgroups))
        return dispatches

    def _subgroup_shader(self) -> list[TransformShader]:
        lanes = lanes_per_line(self._length, subgroup_size(self._device))
        assert lanes is not None
        text = generate_subgroup_shader(
            self.axis,
            self._length,
            lanes,
            self._steps,
            self._hooks.shared_hook,
            self._hooks.shared_points,
            fours=self._hooks.fours,
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
                self.axis,
                steps,
                is_first=number == 0,
                is_last=number == last,
                begin=uses_hooks,
                invocations=self._device.transforms.pass_invocations,
                is_rough=self._device.transforms.is_rough,
            )
            reads_texels = self._hooks.texels and number > 0
            parts: list[Part] = [f"fft/work{'_texels' if reads_texels else ''}.wgsl"] if uses_work else []
            constants: dict[str, int | float | bool] = {}
            if uses_work:
                constants |= {"work_row_stride": row, "work_field_stride": row * self.shape[0]}
            if uses_hooks:
                constants |= dict(self._hooks.constants)
            source = self._linked(text, f", block {steps[0][0].block}", parts, uses_hooks)
            workgroups = partial(pass_workgroups, steps, self._device.transforms.pass_invocations)
            shaders.append(TransformShader(source, constants, workgroups, uses_hooks, uses_work))
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
    return SpectrumOrder.reversed_order(radices(n, largest=device.transforms.largest_radix), band)


def can_transform_repeats(device: Device, n: int, repeats: int, strategy: Strategy) -> bool:
    """Whether the strategy can transform lines of n points with `LineTransform.repeats`."""
    if n % repeats or repeats > device.transforms.largest_radix:
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
    is_read_as_u64 = device.info.is_cpu and INT64 in device.features
    return "fft/complex_u64.wgsl" if is_read_as_u64 else "fft/complex_f32.wgsl"


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
    factors = radices(n, largest=device.transforms.largest_radix)  # or UserError: no strategy can
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
    """Create the missing pipelines of shaders and dispatch each once; doesn't wait until the driver has finished.

    Raises ShaderError and DeviceLost as `Device.pipeline` does.
    """
    for shader in shaders:
        if device.has_pipeline(shader.source, shader.constants):
            continue
        recorder = CommandRecorder(device, "shaders")
        declared = shader.source.bindings() or {}
        groups = [_dummies(device, declared.get(number, {})) for number in range(max(declared, default=-1) + 1)]
        recorder.add(Dispatch.bind(device, device.pipeline(shader.source, shader.constants), groups, (1, 1, 1)))
        recorder.submit()


def _dummies(device: Device, bindings: Mapping[int, str]) -> list[Buffer | Any | None]:
    """A zero buffer or texture for each binding of a group, and None for each unused binding number."""
    dummies: list[Buffer | Any | None] = [None] * (max(bindings, default=-1) + 1)
    for binding, kind in bindings.items():
        if kind == TEXELS:
            dummies[binding] = TexelMemory(device, 1, "precompile").view
        elif kind == "uniform":
            dummies[binding] = device.uniform(bytes(_BUFFER_BYTES), "precompile")
        else:
            dummies[binding] = device.buffer(_BUFFER_BYTES, "precompile")
    return dummies
