"""Generates WGSL of one FFT pass: load r values into registers, transform them, store them at the same positions.

A pass needs neither barriers nor workgroup memory, so that it runs on every driver. It accesses memory only through the
hooks `load(position: vec3u) -> vec2f` and `store(position: vec3u, value: vec2f)` with the position (x, y, field).
`line_fft` describes all hooks; `line_fft_workgroup` combines several passes in one shader.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from holoview.gpu.fft_butterfly import WgslEmitter, emit_dft
from holoview.gpu.rounding import ceil_div
from holoview.gpu.wgsl_struct import WgslStruct

Axis = Literal["x", "y"]
Direction = Literal["forward", "inverse"]

WORKGROUP_SIZE = 64
LINE_RANGE = WgslStruct("LineRange", [("first", "u32"), ("count", "u32")])
"""Lines to transform, at `@group(0) @binding(0)`: rows in a transform along x, columns in one along y."""
COMMON_DECLARATIONS = f"""//#include "lib/complex.wgsl"

{LINE_RANGE.wgsl}
@group(0) @binding(0) var<uniform> lines: LineRange;
"""
"""The beginning of every generated transform shader."""


@dataclass(frozen=True)
class PassShape:
    """Geometry of a pass along `axis` of `length` points: DFTs of `radix` values within blocks of `block` points.

    The first forward pass, which is the last inverse one, has block = length. The block of each further forward pass is
    the preceding block divided by the preceding radix. The last forward pass has block = radix.
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
        """Invocations (DFTs) for each line."""
        return self.length // self.radix


def pass_shapes(axis: Axis, length: int, factors: tuple[int, ...]) -> list[PassShape]:
    """The forward passes along an axis, in order; the inverse transform takes them in reverse order.

    A single point has one pass of radix 1, which only calls the hooks.
    """
    shapes, block = [], length
    for radix in factors or (1,):
        shapes.append(PassShape(axis, length, block, radix))
        block //= radix
    return shapes


def merge_passes(shapes: list[PassShape], steps: Sequence[Direction]) -> list[tuple[PassShape, tuple[Direction, ...]]]:
    """The passes of all steps in order. The last pass of a step and the first of the next are merged into one."""
    merged: list[tuple[PassShape, tuple[Direction, ...]]] = []
    for step in steps:
        for number, shape in enumerate(shapes if step == "forward" else shapes[::-1]):
            if number == 0 and merged:
                merged[-1] = (shape, (*merged[-1][1], step))
            else:
                merged.append((shape, (step,)))
    return merged


def generate_pass_shader(
    shape: PassShape, steps: Sequence[Direction], *, load: str = "load", store: str = "store", begin: bool = True
) -> str:
    """The WGSL of a pass with the entry point `main`, to be linked after the hooks that it calls.

    steps: one or two directions. Between two, values stay in registers and go through the hook `middle`.
    load, store: names of the WGSL functions to call. begin: whether to call the hook `begin`.
    Dispatch `workgroup_grid(pass_workgroups(shape, lines), device)` workgroups along x and y, and fields along z.
    """
    code = WgslEmitter()
    positions = [_position(shape, k) for k in range(shape.radix)]
    if begin:
        code.lines.append("begin(across, field);")
    values = [code.let(f"{load}({position})") for position in positions]
    values = emit_steps(code, shape, values, steps, positions)
    code.lines += [f"{store}({position}, {value});" for position, value in zip(positions, values, strict=True)]
    return _prologue(shape, steps) + "".join(f"    {line}\n" for line in code.lines) + "}\n"


def emit_steps(
    code: WgslEmitter, shape: PassShape, values: list[str], steps: Sequence[Direction], positions: Sequence[str]
) -> list[str]:
    """Emit the DFTs and twiddle factors of a pass and return the names of the results.

    values, positions: names and WGSL positions of the inputs. The WGSL variable `offset` has to be in scope: the index
    of the first value in its block, modulo block/radix.
    """
    twiddles: list[str] = []
    if shape.block != shape.radix:  # else offset is always 0
        code.lines.append(f"// twiddle factors: multiples of offset / {shape.block} turns")
        twiddles = code.twiddles("offset", shape.radix, shape.block)
    for number, step in enumerate(steps):
        if number:
            pairs = zip(positions, values, strict=True)
            values = [code.let(f"middle({position}, {value})") for position, value in pairs]
        code.lines.append(f"// {step} transform of {shape.radix} values")
        values = _emit_step(code, values, twiddles, step)
    return values


def pass_workgroups(shape: PassShape, lines: int) -> int:
    """Number of workgroups for `lines` lines."""
    return ceil_div(shape.invocations_per_line * lines, WORKGROUP_SIZE)


def _prologue(shape: PassShape, steps: Sequence[Direction]) -> str:
    """The beginning of the shader up to the position of an invocation; neighbouring invocations are neighbours in x."""
    stride = shape.block // shape.radix
    if shape.axis == "x":
        split = (
            f"let item = flat % {shape.invocations_per_line}u;\n    let line = flat / {shape.invocations_per_line}u;"
        )
    else:
        split = "let item = flat / lines.count;\n    let line = flat % lines.count;"
    return f"""{COMMON_DECLARATIONS}
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


def _position(shape: PassShape, k: int) -> str:
    """WGSL position of value k of an invocation."""
    along = f"start + {k * shape.block // shape.radix}u"
    return f"vec3u({along}, across, field)" if shape.axis == "x" else f"vec3u(across, {along}, field)"


def _emit_step(code: WgslEmitter, values: list[str], twiddles: list[str], step: Direction) -> list[str]:
    """Forward: DFT, then twiddle factors. Inverse: conjugate twiddle factors, then inverse DFT."""
    if step == "inverse":
        return emit_dft(code, code.times_twiddles(values, twiddles, conjugate=True) if twiddles else values, 1)
    values = emit_dft(code, values, -1)
    return code.times_twiddles(values, twiddles, conjugate=False) if twiddles else values
