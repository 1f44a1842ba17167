"""WGSL of an FFT of whole lines: in workgroup memory, or in the registers of neighbouring lanes of a subgroup.

WorkgroupTile, fit_tile, generate_workgroup_shader    in workgroup memory
generate_subgroup_shader                              in registers, with subgroup shuffles
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

from holoview.gpu.fft_codegen import (
    COMMON_DECLARATIONS,
    Axis,
    PassSteps,
    WgslEmitter,
    emit_dft,
    emit_pass,
    merge_passes,
    scattered,
)
from holoview.gpu.spectrum_order import Step, covered_digits
from holoview.numerics.sampling import ceil_div

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


def generate_workgroup_shader(tile: WorkgroupTile, factors: tuple[int, ...], steps: Sequence[Step]) -> str:
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


def _prologue(tile: WorkgroupTile, steps: Sequence[Step]) -> str:
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
# If S doesn't divide A, zeros fill the last group of registers. There the lanes with l + S·g ≥ A compute unused values:
# they load the same as another lane and store nothing.
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
    axis: str, n: int, lanes: int, steps: Sequence[Step], shared_hook: str | None = None, shared_points: int = 1
) -> str:
    """The WGSL of a transform of lines of n points along `axis`, to be linked after its hooks; entry point `main`.

    shared_hook: "load" or "middle" if that hook takes a value that each `shared_points` neighbouring points share.
    """
    code = _Line(axis, n, lanes, shared_hook, shared_points)
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


def subgroup_workgroups(lanes: int, lines: int) -> int:
    """Number of workgroups for `lines` lines of `lanes` lanes each."""
    return ceil_div(lines, _lines_per_workgroup(lanes))


def _lines_per_workgroup(lanes: int) -> int:
    return max(min(MAX_LINES, MAX_INVOCATIONS // lanes), 1)


class _Line(WgslEmitter):
    """Emits statements on the registers of a line: its points, or the groups of its spectrum one after the other."""

    def __init__(self, axis: str, n: int, lanes: int, shared_hook: str | None, shared_points: int) -> None:
        super().__init__()
        self._shared_hook, self._shared_points = shared_hook, shared_points
        self.axis, self.n, self.lanes, self.registers = axis, n, lanes, n // lanes
        self.groups = ceil_div(self.registers, lanes)
        for bit in self._bits():
            self.lines.append(f"let is_odd{bit} = (lane & {bit}u) != 0u;")
        self.lines.append("let subgroup_start = invocation - lane;")
        self.lines.append("begin(line, field);")
        self._twiddles = self.twiddles("lane", self.registers, n)

    def spectrum(self, points: Names, step: Step) -> Spectrum:
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

    def loaded_points(self, step: Step) -> Names:
        """Points from the hook `load` or `load_shared`."""
        registers = self._needed_points(step)
        if self._shared_hook != "load":
            return {k: self.let(f"load({self._point(k)})") for k in registers}
        return {k: self.let(f"load_shared({self._point(k)}, {value})") for k, value in self._shared_values(registers)}

    def loaded_spectrum(self, step: Step) -> Spectrum:
        """Frequencies from the hook `load`, group by group."""
        for group in range(self.groups):
            positions = self._frequencies(group, step)
            yield group, {digit: self.let(f"load({position})") for digit, position in positions.items()}

    def between_points(self, points: Names, step: Step) -> Names:
        """Points after the hook `middle` or `middle_shared`."""
        registers = self._needed_points(step)
        if self._shared_hook != "middle":
            return {k: self.let(f"middle({self._point(k)}, {points[k]})") for k in registers}
        shared = self._shared_values(registers)
        return {k: self.let(f"middle_shared({self._point(k)}, {points[k]}, {value})") for k, value in shared}

    def between_spectrum(self, spectrum: Spectrum, step: Step) -> Spectrum:
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

    def store_points(self, points: Names, step: Step) -> None:
        """Pass the points of a valid line to the hook `store`."""
        self._store("is_valid_line", {self._point(k): points[k] for k in self._needed_points(step)})

    def store_spectrum(self, spectrum: Spectrum, step: Step) -> None:
        """Pass the frequencies of a valid line to the hook `store`."""
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

    def _needed_points(self, step: Step) -> tuple[int, ...]:
        """The registers with points that a step needs."""
        n, registers = self.n // step.repeats, self.registers // step.repeats
        return covered_digits(n, registers, step.points)

    def _point(self, k: int) -> str:
        """Position of the point in register k."""
        return self._position(f"lane + {self.lanes * k}u")

    def _frequencies(self, group: int, step: Step) -> dict[int, str]:
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
        """Exchange register i of lane j with register j of lane i."""
        out = list(values)
        for bit in self._bits():
            for low in (i for i in range(self.lanes) if not i & bit):
                a, b = out[low], out[low + bit]
                out[low] = self.let(f"select({a}, subgroupShuffleXor({b}, {bit}u), is_odd{bit})")
                out[low + bit] = self.let(f"select(subgroupShuffleXor({a}, {bit}u), {b}, is_odd{bit})")
        return out


def _lanes_prologue(axis: str, n: int, lanes: int, steps: Sequence[Step]) -> str:
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
