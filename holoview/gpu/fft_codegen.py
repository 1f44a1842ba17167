"""Generates WGSL of one FFT pass: load r values into registers, transform them, store them at the same positions.

A pass needs neither barriers nor workgroup memory, so that it runs on every driver. It accesses memory only through the
hooks `load(position: vec3u) -> vec2f` and `store(position: vec3u, value: vec2f)` with the position (x, y, field).
`line_fft` describes all hooks; `line_fft_workgroup` combines several passes in one shader.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from holoview.gpu.fft_butterfly import WgslEmitter, emit_dft, scattered
from holoview.gpu.line_step import Direction, Step
from holoview.gpu.rounding import ceil_div
from holoview.gpu.spectrum_order import covered_digits
from holoview.gpu.wgsl_struct import WgslStruct

Axis = Literal["x", "y"]

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
    """Geometry of a pass over lines of `length` points: DFTs of `radix` values within blocks of `block` points.

    The first forward pass, which is the last inverse one, has block = length. The block of each further forward pass is
    the preceding block divided by the preceding radix. The last forward pass has block = radix.

    points, frequencies: the digits (see `spectrum_order`) of the values that are needed before and after the forward
    DFT. The inverse DFT takes the frequencies and gives the points.
    spread: factor of the positions of values between passes, so that each pass of a transform and of a longer one that
    follows it works in place.
    """

    length: int
    block: int
    radix: int
    points: tuple[int, ...]
    frequencies: tuple[int, ...]
    spread: int = 1

    def __post_init__(self) -> None:
        if self.length % self.block or self.block % self.radix:
            raise ValueError(f"{self}: expected a radix that divides the block, and a block that divides the length")

    @property
    def invocations_per_line(self) -> int:
        """Invocations (DFTs) for each line."""
        return self.length // self.radix

    @property
    def stride(self) -> int:
        """Points from one value of a DFT to the next."""
        return self.block // self.radix

    def point_positions(self) -> list[str]:
        """WGSL positions of the points along the line."""
        return [self._position(k) for k in self.points]

    def frequency_positions(self) -> list[str]:
        """WGSL positions along the line of the frequencies, or of the values between two passes."""
        if len(self.frequencies) == self.radix:
            return [self._position(k) for k in self.frequencies]
        return [f"item * {len(self.frequencies)}u + {k}u" for k in range(len(self.frequencies))]

    def between_passes(self, along: str) -> str:
        """WGSL position of a value between passes."""
        return along if self.spread == 1 else f"({along}) * {self.spread}u"

    def _position(self, k: int) -> str:
        start = f"item * {self.radix}u" if self.stride == 1 else f"(item / {self.stride}u) * {self.block}u + offset"
        return f"{start} + {k * self.stride}u"


PassSteps = tuple[tuple[PassShape, Direction], ...]
"""What one pass does: one step, or the end of a transform and the beginning of the next."""


def pass_shapes(length: int, factors: tuple[int, ...], step: Step) -> list[PassShape]:
    """The forward passes over lines of `length` points, in order; an inverse transform takes them in reverse order.

    A single point has one pass of radix 1, which only calls the hooks.
    """
    shapes, block = [], length
    for radix in factors or (1,):
        is_first, is_last = block == length, block == radix
        points = covered_digits(length, radix, step.points if is_first else None)
        frequencies = covered_digits(length, radix, step.band if is_last else None)
        shapes.append(PassShape(length, block, radix, points, frequencies, step.repeats))
        block //= radix
    return shapes


def merge_passes(length: int, factors: tuple[int, ...], steps: Sequence[Step]) -> list[PassSteps]:
    """The passes of all steps in order. The last pass of a step and the first of the next are merged into one.

    factors: the radices of `length`; the last one has to be a multiple of each step's `repeats`.
    """
    merged: list[PassSteps] = []
    for step in steps:
        own = (*factors[:-1], factors[-1] // step.repeats) if step.repeats > 1 else factors
        shapes = pass_shapes(length // step.repeats, own, step)
        for number, shape in enumerate(shapes if step.direction == "forward" else shapes[::-1]):
            if number == 0 and merged:
                merged[-1] = (*merged[-1], (shape, step.direction))
            else:
                merged.append(((shape, step.direction),))
    return merged


def generate_pass_shader(
    axis: Axis, steps: PassSteps, *, is_first: bool = True, is_last: bool = True, begin: bool = True
) -> str:
    """The WGSL of a pass along `axis` with the entry point `main`, to be linked after the hooks that it calls.

    steps: one or two. Between two, values stay in registers and go through the hook `middle`.
    is_first, is_last: of the passes of a transform; others call `load_work` and `store_work`. begin: whether to call
    the hook `begin`.
    Dispatch `workgroup_grid(pass_workgroups(steps, lines), device)` workgroups along x and y, and fields along z.
    """
    code = WgslEmitter()
    if begin:
        code.lines.append("begin(across, field);")

    def position(along: str) -> str:
        return f"vec3u({along}, across, field)" if axis == "x" else f"vec3u(across, {along}, field)"

    def load(along: str) -> str:
        return f"load({position(along)})" if is_first else f"load_work({position(steps[0][0].between_passes(along))})"

    for along, value in emit_pass(code, steps, load, position):
        work = position(steps[-1][0].between_passes(along))
        code.lines.append(f"store({position(along)}, {value});" if is_last else f"store_work({work}, {value});")
    return _prologue(axis, steps) + "".join(f"    {line}\n" for line in code.lines) + "}\n"


def emit_pass(
    code: WgslEmitter, steps: PassSteps, load: Callable[[str], str], position: Callable[[str], str]
) -> list[tuple[str, str]]:
    """Emit a pass and return pairs of the position along the line and the name of the value to be stored there.

    load: the WGSL that loads the value at a position along the line. position: that position as the hook `middle` takes
    it. The WGSL variables `item`, the number of the DFT in its line, and `offset`, of its first value in its block,
    have to be in scope.
    """
    shape, direction = steps[0]
    ends = shape.point_positions(), shape.frequency_positions()
    values = [code.let(load(along)) for along in ends[direction == "inverse"]]
    for number, (shape, direction) in enumerate(steps):
        if number:
            values = _between(code, steps, values, position)
        code.lines.append(f"// {direction} transform of {shape.radix} values")
        values = _emit_step(code, shape, direction, values)
    ends = shape.point_positions(), shape.frequency_positions()
    return list(zip(ends[direction == "forward"], values, strict=True))


def _between(code: WgslEmitter, steps: PassSteps, values: list[str], position: Callable[[str], str]) -> list[str]:
    """The values of the first step as the second takes them, after the hook `middle`."""
    (before, _), (after, direction) = steps
    kept = (before.points, before.frequencies)[direction == "inverse"]
    by_digit = dict(zip(kept, values, strict=True))
    wanted = (after.points, after.frequencies)[direction == "inverse"]
    along = (after.point_positions(), after.frequency_positions())[direction == "inverse"]
    pairs = [(by_digit[digit % before.radix], place) for digit, place in zip(wanted, along, strict=True)]
    return [code.let(f"middle({position(place)}, {value})") for value, place in pairs]


def pass_workgroups(steps: PassSteps, lines: int) -> int:
    """Number of workgroups for `lines` lines."""
    return ceil_div(steps[0][0].invocations_per_line * lines, WORKGROUP_SIZE)


def _prologue(axis: Axis, steps: PassSteps) -> str:
    """The beginning of the shader up to the number of a DFT; neighbouring invocations are neighbours in x."""
    shape = steps[0][0]
    if axis == "x":
        split = (
            f"let item = flat % {shape.invocations_per_line}u;\n    let line = flat / {shape.invocations_per_line}u;"
        )
    else:
        split = "let item = flat / lines.count;\n    let line = flat % lines.count;"
    directions = " and ".join(direction for _, direction in steps)
    return f"""{COMMON_DECLARATIONS}
// {directions} pass along {axis}: {shape.length} points, blocks of {shape.block}, radix {shape.radix}
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
    let offset = item % {shape.stride}u;
"""


def _emit_step(code: WgslEmitter, shape: PassShape, direction: Direction, values: list[str]) -> list[str]:
    """Forward: DFT, then twiddle factors. Inverse: conjugate twiddle factors, then inverse DFT."""
    twiddles = [""] * shape.radix
    if shape.block != shape.radix:  # else offset is always 0
        code.lines.append(f"// twiddle factors: multiples of offset / {shape.block} turns")
        twiddles = code.twiddles("offset", shape.radix, shape.block)
    if direction == "inverse":
        values = code.times_twiddles(values, [twiddles[k] for k in shape.frequencies], conjugate=True)
        found = emit_dft(code, scattered(values, shape.frequencies, shape.radix), 1)
        return [found[k] for k in shape.points]
    found = emit_dft(code, scattered(values, shape.points, shape.radix), -1)
    return code.times_twiddles(
        [found[k] for k in shape.frequencies], [twiddles[k] for k in shape.frequencies], conjugate=False
    )
