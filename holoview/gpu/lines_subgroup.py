"""WGSL of a transform along a whole line, held in the registers of neighbouring lanes of a subgroup.

A line of n = S·A points, of which S² is a divisor, belongs to S lanes with A complex registers each: lane l holds the
points l, l + S, l + 2S, … A forward transform is, after Cooley and Tukey (Math. Comp. 19, 297 (1965)),

    DFT of A over a lane's registers → twiddles w_n^(l·k) → S × S transposes between lanes and registers → DFTs of S

and leaves frequency l + S·g + A·j in one register of lane l: natural order, read and written by neighbouring lanes. A
transpose exchanges register and lane bits one by one, `subgroupShuffleXor` and `select`. There is neither workgroup
memory nor a barrier, and between a forward and an inverse transform nothing leaves the registers.
"""

from __future__ import annotations

from collections.abc import Sequence

from holoview.gpu.fft_butterfly import Emitter, emit_dft, literal
from holoview.gpu.fft_codegen import LINES, Direction

INVOCATIONS = 64
MOST_REGISTERS = 256
"""Complex registers of a lane: more would spill on any adapter."""


def lanes_of(n: int, largest: int) -> int | None:
    """The most lanes, a power of two up to `largest`, that can share a line of n points; None when there are none."""
    lanes = 1 << (largest.bit_length() - 1)
    while lanes > 1:
        if n % (lanes * lanes) == 0 and n // lanes <= MOST_REGISTERS:
            return lanes
        lanes //= 2
    return None


def generate_line(axis: str, n: int, lanes: int, steps: Sequence[Direction]) -> str:
    """The WGSL of a transform of lines of n points along `axis`, to be linked after its hooks; its entry is `main`."""
    code = _Line(n, lanes)
    is_spectrum = steps[0] == "inverse"
    values = [code.let(f"load({_place(axis, at)})") for at in code.places(is_spectrum)]
    for number, step in enumerate(steps):
        if number:
            places = [_place(axis, at) for at in code.places(is_spectrum)]
            values = [code.let(f"middle({place}, {value})") for place, value in zip(places, values, strict=True)]
        values = code.forward(values) if step == "forward" else code.inverse(values)
        is_spectrum = step == "forward"
    stores = [
        f"store({_place(axis, at)}, {value});" for at, value in zip(code.places(is_spectrum), values, strict=True)
    ]
    body = "".join(f"    {line}\n" for line in code.lines)
    return f"{_prologue(axis, n, lanes, steps)}{body}    if (is_real) {{\n{_indented(stores)}    }}\n}}\n"


def workgroups_for(lanes: int, lines: int) -> int:
    """Workgroups that so many lines need."""
    return -(-lines // _lines_a_workgroup(lanes))


def _lines_a_workgroup(lanes: int) -> int:
    return max(INVOCATIONS // lanes, 1)


class _Line(Emitter):
    """Statements on the registers of a line, which are in the order of `places`."""

    def __init__(self, n: int, lanes: int) -> None:
        super().__init__()
        self.n, self.lanes_count, self.registers = n, lanes, n // lanes
        self.groups = self.registers // lanes
        bit = lanes >> 1
        while bit:
            self.lines.append(f"let is_odd{bit} = (lane & {bit}u) != 0u;")
            bit >>= 1
        self.lines.append("begin(line, field);")
        self._twiddles = self._emit_twiddles()

    def places(self, is_spectrum: bool) -> list[int]:
        """Offset of each register's point or frequency from the lane."""
        s, a = self.lanes_count, self.registers
        if is_spectrum:
            return [s * g + a * j for g in range(self.groups) for j in range(s)]
        return [s * k for k in range(a)]

    def forward(self, values: list[str]) -> list[str]:
        """Points to frequencies."""
        columns = self._twiddled(emit_dft(self, values, -1), "cmul")
        out: list[str] = []
        for group in self._split(columns):
            out += emit_dft(self, self._transposed(group), -1)
        return out

    def inverse(self, values: list[str]) -> list[str]:
        """Frequencies to points: the steps of `forward`, backwards and conjugated."""
        columns: list[str] = []
        for group in self._split(values):
            columns += self._transposed(emit_dft(self, group, 1))
        return emit_dft(self, self._twiddled(columns, "cmul_conj"), 1)

    def _split(self, values: list[str]) -> list[list[str]]:
        s = self.lanes_count
        return [values[s * g : s * (g + 1)] for g in range(self.groups)]

    def _transposed(self, values: list[str]) -> list[str]:
        """Register i of lane j for register j of lane i."""
        out, bit = list(values), self.lanes_count >> 1
        while bit:
            for low in (i for i in range(self.lanes_count) if not i & bit):
                a, b = out[low], out[low + bit]
                out[low] = self.let(f"select({a}, subgroupShuffleXor({b}, {bit}u), is_odd{bit})")
                out[low + bit] = self.let(f"select(subgroupShuffleXor({a}, {bit}u), {b}, is_odd{bit})")
            bit >>= 1
        return out

    def _emit_twiddles(self) -> list[str]:
        """Names of w⁰ … w^(A−1), w = exp(−2πi·lane/n): w, w², w⁴, … directly, the others as products of these."""
        powers = [""]
        for k in range(1, self.registers):
            highest = 1 << (k.bit_length() - 1)
            if k == highest:
                powers.append(self.let(f"cis(f32(lane * {k}u) * {literal(-1 / self.n)})"))
            else:
                powers.append(self.let(f"cmul({powers[highest]}, {powers[k - highest]})"))
        return powers

    def _twiddled(self, values: list[str], product: str) -> list[str]:
        pairs = zip(values[1:], self._twiddles[1:], strict=True)
        return [values[0], *(self.let(f"{product}({value}, {twiddle})") for value, twiddle in pairs)]


def _place(axis: str, offset: int) -> str:
    along = f"lane + {offset}u"
    return f"vec3u({along}, line, field)" if axis == "x" else f"vec3u(line, {along}, field)"


def _indented(statements: Sequence[str]) -> str:
    return "".join(f"        {statement}\n" for statement in statements)


def _prologue(axis: str, n: int, lanes: int, steps: Sequence[Direction]) -> str:
    """Declarations, and which line is this lane's. Lanes beyond the last line help it: shuffles need them all."""
    lines = _lines_a_workgroup(lanes)
    return f"""//#include "lib/complex.wgsl"

{LINES.wgsl}
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
