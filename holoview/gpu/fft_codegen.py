"""WGSL of one FFT pass: load r values into registers, transform them there, store them where they came from.

A pass needs no barrier and no workgroup memory, so that one shader suits every driver. It has neither input nor output
of its own: it calls a `load(position: vec3u) -> vec2f` and a `store(position: vec3u, value: vec2f)`, with the position
(x, y, field). `lines.py` says which hooks there are; `lines_workgroup.py` makes one shader of several passes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from holoview.gpu.fft_butterfly import WgslEmitter, emit_dft, wgsl_float
from holoview.gpu.wgsl_struct import WgslStruct

Axis = Literal["x", "y"]
Direction = Literal["forward", "inverse"]

WORKGROUP_SIZE = 64
LINE_RANGE = WgslStruct("Lines", [("first", "u32"), ("count", "u32")])
"""The lines that a pass transforms: rows for a pass along x, columns for one along y. At `@group(0) @binding(0)`."""


@dataclass(frozen=True)
class PassShape:
    """Where a pass works: along `axis` of `length` points, in blocks of `block` points, with `radix` values at a time.

    The first forward pass along an axis, which is the last inverse one, has block = length; each further one has
    the block of the one before divided by that one's radix. The last forward pass has block = radix.
    """

    axis: Axis
    length: int
    block: int
    radix: int

    def __post_init__(self) -> None:
        if self.length % self.block or self.block % self.radix:
            raise ValueError(f"{self}: expected a radix that divides the block, and a block that divides the length")

    @property
    def invocations_per_line(self) -> int:
        """Invocations a line."""
        return self.length // self.radix


def pass_shapes(axis: Axis, length: int, factors: tuple[int, ...]) -> list[PassShape]:
    """The forward passes along an axis in their order; the inverse takes them from the last to the first.

    A single point has a pass too, which only calls the hooks.
    """
    shapes, block = [], length
    for radix in factors or (1,):
        shapes.append(PassShape(axis, length, block, radix))
        block //= radix
    return shapes


def merge_passes(shapes: list[PassShape], steps: Sequence[Direction]) -> list[tuple[PassShape, tuple[Direction, ...]]]:
    """The passes of all steps; where one step ends on the block on which the next begins, one pass does both."""
    out: list[tuple[PassShape, tuple[Direction, ...]]] = []
    for step in steps:
        for number, shape in enumerate(shapes if step == "forward" else shapes[::-1]):
            if number == 0 and out:
                out[-1] = (shape, (*out[-1][1], step))
            else:
                out.append((shape, (step,)))
    return out


def generate_pass_shader(
    shape: PassShape, steps: Sequence[Direction], *, load: str = "load", store: str = "store", begin: bool = True
) -> str:
    """The WGSL of a pass, to be linked after the hooks that it calls; its entry point is `main`.

    With two steps, as ("forward", "inverse"), one pass does both without touching memory in between; each value then
    goes through `middle`. `load` and `store` are names of functions; without `begin`, no such hook is called.
    Bind a `LINES` uniform at group 0, binding 0, and dispatch `spread(workgroups_of(shape, lines), device)` workgroups
    along x and y, with the fields along z.
    """
    code = WgslEmitter()
    places = [_place(shape, k) for k in range(shape.radix)]
    if begin:
        code.lines.append("begin(across, field);")
    values = [code.let(f"{load}({place})") for place in places]
    values = emit_steps(code, shape, values, steps, places)
    code.lines += [f"{store}({place}, {value});" for place, value in zip(places, values, strict=True)]
    return _prologue(shape, steps) + "".join(f"    {line}\n" for line in code.lines) + "}\n"


def emit_steps(
    code: WgslEmitter, shape: PassShape, values: list[str], steps: Sequence[Direction], places: Sequence[str]
) -> list[str]:
    """Emit what a pass does with its values, whose positions are `places`, where `offset` is in scope."""
    twiddles = _emit_twiddles(code, shape)
    for number, step in enumerate(steps):
        if number:
            values = [code.let(f"middle({place}, {value})") for place, value in zip(places, values, strict=True)]
        code.lines.append(f"// {step} transform of {shape.radix} values")
        values = _emit_step(code, values, twiddles, step)
    return values


def pass_workgroups(shape: PassShape, lines: int) -> int:
    """Workgroups that `lines` lines need."""
    return -(-shape.invocations_per_line * lines // WORKGROUP_SIZE)


def _prologue(shape: PassShape, steps: Sequence[Direction]) -> str:
    """Declarations, and which values are this invocation's: neighbours in a workgroup are neighbours along x."""
    stride = shape.block // shape.radix
    if shape.axis == "x":
        split = (
            f"let item = flat % {shape.invocations_per_line}u;\n    let line = flat / {shape.invocations_per_line}u;"
        )
    else:
        split = "let item = flat / lines.count;\n    let line = flat % lines.count;"
    return f"""//#include "lib/complex.wgsl"

{LINE_RANGE.wgsl}
@group(0) @binding(0) var<uniform> lines: Lines;

// {" and ".join(steps)} pass along {shape.axis}: {shape.length} points, blocks of {shape.block}, radix {shape.radix}
@compute @workgroup_size({WORKGROUP_SIZE})
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) workgroups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {{
    let flat = (workgroup.y * workgroups.x + workgroup.x) * {WORKGROUP_SIZE}u + local;
    if (flat >= {shape.invocations_per_line}u * lines.count) {{
        return;
    }}
    {split}
    let field = workgroup.z;
    let across = lines.first + line;
    let offset = item % {stride}u;
    let start = (item / {stride}u) * {shape.block}u + offset;
"""


def _place(shape: PassShape, k: int) -> str:
    along = f"start + {k * shape.block // shape.radix}u"
    return f"vec3u({along}, across, field)" if shape.axis == "x" else f"vec3u(across, {along}, field)"


def _emit_twiddles(code: WgslEmitter, shape: PassShape) -> list[str]:
    """Names of w⁰ … w^(r−1), w = exp(−2πi·offset/block); none where the offset is always 0.

    w, w², w⁴, … are evaluated directly, and the others are products of these: a chain of powers from w alone would
    lose a decimal digit.
    """
    if shape.block == shape.radix:
        return []
    code.lines.append(f"// twiddle factors: multiples of offset / {shape.block} turns")
    powers = [""]
    for k in range(1, shape.radix):
        highest = 1 << (k.bit_length() - 1)
        if k == highest:
            # offset·k is below 2^13 and exact, so that the angle is rounded once
            powers.append(code.let(f"cis(f32(offset * {k}u) * {wgsl_float(-1 / shape.block)})"))
        else:
            powers.append(code.let(f"cmul({powers[highest]}, {powers[k - highest]})"))
    return powers


def _emit_step(code: WgslEmitter, values: list[str], twiddles: list[str], step: Direction) -> list[str]:
    """Forward: transform, then twiddle. Inverse: the same backwards, with conjugates."""
    if step == "inverse":
        return emit_dft(code, _twiddled(code, values, twiddles, "cmul_conj"), 1)
    return _twiddled(code, emit_dft(code, values, -1), twiddles, "cmul")


def _twiddled(code: WgslEmitter, values: list[str], twiddles: list[str], product: str) -> list[str]:
    if not twiddles:
        return values
    pairs = zip(values[1:], twiddles[1:], strict=True)
    return [values[0], *(code.let(f"{product}({value}, {twiddle})") for value, twiddle in pairs)]
