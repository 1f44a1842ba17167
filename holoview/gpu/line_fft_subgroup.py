"""WGSL of a transform along a whole line, held in the registers of neighbouring lanes of a subgroup.

A line of n = S·A points belongs to S lanes with A complex registers each: lane l holds the points l, l + S, l + 2S, …
A forward transform is, after Cooley and Tukey (Math. Comp. 19, 297 (1965)),

    DFT of A over a lane's registers → twiddles w_n^(l·k) → S × S transposes between lanes and registers → DFTs of S

and leaves frequency l + S·g + A·j in register j of group g of lane l: natural order, read and written by neighbouring
lanes. A transpose exchanges register and lane bits one by one, `subgroupShuffleXor` and `select`. There is neither
workgroup memory nor a barrier, and between a forward and an inverse transform nothing leaves the registers.

Where S doesn't divide A, registers of zeros fill the last group, and the lanes l + S·g ≥ A in it compute nothing real:
they load what another lane loads, and store nothing.

Statements are emitted a group at a time, from its transpose to its store or its way back, so that few values are alive
at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from holoview.gpu.fft_butterfly import WgslEmitter, emit_dft, wgsl_float
from holoview.gpu.fft_codegen import LINE_RANGE, Direction

MOST_LINES, MOST_INVOCATIONS = 4, 128
"""Of a workgroup: four columns are 32 bytes wide, the least that GPUs read at a time."""
MOST_REGISTERS = 256
"""Complex registers of a lane: more would spill on any adapter."""


def lanes_per_line(n: int, largest: int) -> int | None:
    """The most lanes, a power of two up to `largest`, that can share a line of n points; None when there are none.

    They have to divide n, and to leave each lane at least as many registers as there are lanes and at most 256.
    """
    lanes = 1 << (largest.bit_length() - 1)
    while lanes > 1:
        if n % lanes == 0 and lanes <= n // lanes <= MOST_REGISTERS:
            return lanes
        lanes //= 2
    return None


def generate_subgroup_shader(
    axis: str, n: int, lanes: int, steps: Sequence[Direction], shared_hook: str | None = None, shared_points: int = 1
) -> str:
    """The WGSL of a transform of lines of n points along `axis`, to be linked after its hooks; its entry is `main`.

    shares: the hook, "load" or "middle", that takes what `neighbours` points have in common.
    """
    code = _Line(axis, n, lanes, shared_hook, shared_points)
    points: list[str] | None = None
    spectrum: Iterable[list[str]] | None = None
    for step in steps:
        if step == "forward":
            spectrum = code.spectrum(code.loaded_points() if points is None else code.between_points(points))
            points = None
        else:
            points = code.points(code.loaded_spectrum() if spectrum is None else code.between_spectrum(spectrum))
            spectrum = None
    if spectrum is None:
        code.store_points(points or [])
    else:
        code.store_spectrum(spectrum)
    body = "".join(f"    {line}\n" for line in code.lines)
    return f"{_prologue(axis, n, lanes, steps)}{body}}}\n"


def subgroup_workgroups(lanes: int, lines: int) -> int:
    """Workgroups that so many lines need."""
    return -(-lines // _lines_a_workgroup(lanes))


def _lines_a_workgroup(lanes: int) -> int:
    return max(min(MOST_LINES, MOST_INVOCATIONS // lanes), 1)


class _Line(WgslEmitter):
    """Statements on the registers of a line: its points, or the groups of its spectrum, one after the other."""

    def __init__(self, axis: str, n: int, lanes: int, shares: str | None, neighbours: int) -> None:
        super().__init__()
        self._shares, self._neighbours = shares, neighbours
        self.axis, self.n, self.lanes, self.registers = axis, n, lanes, n // lanes
        self.groups = -(-self.registers // lanes)
        for bit in self._bits():
            self.lines.append(f"let is_odd{bit} = (lane & {bit}u) != 0u;")
        self.lines.append("let of_others = invocation - lane;")
        self.lines.append("begin(line, field);")
        self._twiddles = self._emit_twiddles()

    def spectrum(self, points: list[str]) -> Iterator[list[str]]:
        """Points to frequencies, a group at a time."""
        columns = self._twiddled(emit_dft(self, points, -1), "cmul")
        columns += ["vec2f(0.0)"] * (self.groups * self.lanes - self.registers)
        for first in range(0, len(columns), self.lanes):
            yield emit_dft(self, self._transposed(columns[first : first + self.lanes]), -1)

    def points(self, spectrum: Iterable[list[str]]) -> list[str]:
        """Frequencies to points: the steps of `spectrum`, backwards and conjugated."""
        columns: list[str] = []
        for group in spectrum:
            columns += self._transposed(emit_dft(self, group, 1))
        return emit_dft(self, self._twiddled(columns[: self.registers], "cmul_conj"), 1)

    def loaded_points(self) -> list[str]:
        """What the hook loads."""
        if self._shares != "load":
            return [self.let(f"load({self._point(k)})") for k in range(self.registers)]
        return [self.let(f"load_with({self._point(k)}, {joint})") for k, joint in enumerate(self._joint())]

    def loaded_spectrum(self) -> Iterator[list[str]]:
        """What the hook loads, a group at a time."""
        for group in range(self.groups):
            yield [self.let(f"load({place})") for place in self._frequencies(group)]

    def between_points(self, points: list[str]) -> list[str]:
        """What the hook between two steps makes of points."""
        if self._shares != "middle":
            return [self.let(f"middle({self._point(k)}, {value})") for k, value in enumerate(points)]
        pairs = zip(points, self._joint(), strict=True)
        return [
            self.let(f"middle_with({self._point(k)}, {value}, {common})") for k, (value, common) in enumerate(pairs)
        ]

    def between_spectrum(self, spectrum: Iterable[list[str]]) -> Iterator[list[str]]:
        """What the hook between two steps makes of frequencies, a group at a time."""
        for group, values in enumerate(spectrum):
            places = self._frequencies(group)
            yield [self.let(f"middle({place}, {value})") for place, value in zip(places, values, strict=True)]

    def _joint(self) -> Iterator[str]:
        """What each register's point has in common with its neighbours, evaluated by one lane for all of them.

        The points of u registers are S·u in a row, which share S values, one for each lane to evaluate.
        """
        u, s = self._neighbours, self.lanes
        if u == 1 or s % u or self.registers % u:
            for k in range(self.registers):
                yield self.let(f"joint({self._point(k)})")
            return
        for first in range(0, self.registers, u):
            mine = self.let(f"joint({self._place(f'lane * {u}u + {s * first}u')})")
            for part in range(u):
                yield self.let(f"subgroupShuffle({mine}, of_others + lane / {u}u + {part * s // u}u)")

    def store_points(self, points: list[str]) -> None:
        """Hand the points of a line that there is to the hook."""
        self._store("is_real", [self._point(k) for k in range(self.registers)], points)

    def store_spectrum(self, spectrum: Iterable[list[str]]) -> None:
        """Hand the frequencies of a line that there is to the hook."""
        for group, values in enumerate(spectrum):
            is_whole = (group + 1) * self.lanes <= self.registers
            condition = "is_real" if is_whole else f"is_real && lane + {group * self.lanes}u < {self.registers}u"
            self._store(condition, self._frequencies(group), values)

    def _store(self, condition: str, places: list[str], values: list[str]) -> None:
        stores = [f"    store({place}, {value});" for place, value in zip(places, values, strict=True)]
        self.lines += [f"if ({condition}) {{", *stores, "}"]

    def _point(self, k: int) -> str:
        return self._place(f"lane + {self.lanes * k}u")

    def _frequencies(self, group: int) -> list[str]:
        """Places of the registers of a group."""
        lowest = f"lane + {group * self.lanes}u"
        if (group + 1) * self.lanes > self.registers:
            lowest = self.let(f"min({lowest}, {self.registers - 1}u)")
            return [self._place(f"{lowest} + {self.registers * j}u") for j in range(self.lanes)]
        return [self._place(f"lane + {group * self.lanes + self.registers * j}u") for j in range(self.lanes)]

    def _place(self, along: str) -> str:
        return f"vec3u({along}, line, field)" if self.axis == "x" else f"vec3u(line, {along}, field)"

    def _bits(self) -> list[int]:
        """lanes/2, …, 2, 1"""
        return [1 << bit for bit in reversed(range(self.lanes.bit_length() - 1))]

    def _transposed(self, values: list[str]) -> list[str]:
        """Register i of lane j for register j of lane i."""
        out = list(values)
        for bit in self._bits():
            for low in (i for i in range(self.lanes) if not i & bit):
                a, b = out[low], out[low + bit]
                out[low] = self.let(f"select({a}, subgroupShuffleXor({b}, {bit}u), is_odd{bit})")
                out[low + bit] = self.let(f"select(subgroupShuffleXor({a}, {bit}u), {b}, is_odd{bit})")
        return out

    def _emit_twiddles(self) -> list[str]:
        """Names of w⁰ … w^(A−1), w = exp(−2πi·lane/n): w, w², w⁴, … directly, the others as products of these."""
        powers = [""]
        for k in range(1, self.registers):
            highest = 1 << (k.bit_length() - 1)
            if k == highest:
                powers.append(self.let(f"cis(f32(lane * {k}u) * {wgsl_float(-1 / self.n)})"))
            else:
                powers.append(self.let(f"cmul({powers[highest]}, {powers[k - highest]})"))
        return powers

    def _twiddled(self, values: list[str], product: str) -> list[str]:
        pairs = zip(values[1:], self._twiddles[1:], strict=True)
        return [values[0], *(self.let(f"{product}({value}, {twiddle})") for value, twiddle in pairs)]


def _prologue(axis: str, n: int, lanes: int, steps: Sequence[Direction]) -> str:
    """Declarations, and which line is this lane's. Lanes beyond the last line help it: shuffles need them all."""
    lines = _lines_a_workgroup(lanes)
    return f"""//#include "lib/complex.wgsl"

{LINE_RANGE.wgsl}
@group(0) @binding(0) var<uniform> lines: Lines;

// {" and ".join(steps)} transform along {axis}: {n} points in {n // lanes} registers of {lanes} lanes
@compute @workgroup_size({lines * lanes})
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) workgroups: vec3u,
    @builtin(local_invocation_index) local: u32,
    @builtin(subgroup_invocation_id) invocation: u32,
) {{
    let lane = invocation % {lanes}u;
    let number = (workgroup.y * workgroups.x + workgroup.x) * {lines}u + local / {lanes}u;
    let is_real = number < lines.count;
    let line = lines.first + min(number, lines.count - 1u);
    let field = workgroup.z;
"""
