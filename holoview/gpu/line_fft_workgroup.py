"""WGSL of a transform along whole lines in the memory of a workgroup.

The passes are those of `fft_codegen`, with the same radices and so the same digit-reversed spectra, but one shader does
them all: between two passes the values of a line wait in workgroup memory, not in a buffer. As each pass puts its
values back where it found them, one barrier after each is enough. Several columns share a workgroup, so that
neighbouring invocations read neighbouring addresses; several short rows share one to fill it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from holoview.gpu.fft_butterfly import WgslEmitter
from holoview.gpu.fft_codegen import LINE_RANGE, Axis, Direction, PassShape, emit_steps, merge_passes, pass_shapes
from holoview.gpu.fft_radices import radices

LEAST_INVOCATIONS, MOST_INVOCATIONS = 64, 256
COLUMNS = 4
"""Columns that share a workgroup where its memory allows: 32 bytes, the least that GPUs read at a time."""
_COMPLEX_BYTES = 8
_BANKS = 16
"""A value is left free after so many: blocks of 2^k values would compete for one bank of memory."""


@dataclass(frozen=True)
class WorkgroupTile:
    """A workgroup: `lines` lines of `length` points along `axis`, with `threads` invocations each."""

    axis: Axis
    length: int
    threads: int
    lines: int

    @property
    def pitch(self) -> int:
        """Values of a line in memory, those left free included."""
        return _pitch(self.length)

    def workgroups(self, lines: int) -> int:
        """Workgroups that so many lines need."""
        return -(-lines // self.lines)


def fit_tile(axis: Axis, n: int, memory_bytes: int) -> WorkgroupTile | None:
    """The workgroup for lines of n points, or None where not even one line fits `memory_bytes`.

    Raises UserError for a length that can't be transformed.
    """
    items = [shape.invocations_per_line for shape in pass_shapes("x", n, radices(n))]
    threads = min(max(items, default=1), MOST_INVOCATIONS)
    wanted = COLUMNS if axis == "y" else 1
    while wanted * threads < LEAST_INVOCATIONS:
        wanted *= 2
    fitting = memory_bytes // (_pitch(n) * _COMPLEX_BYTES)
    if not fitting:
        return None
    while wanted > fitting or wanted * threads > MOST_INVOCATIONS:
        wanted //= 2
    return WorkgroupTile(axis, n, threads, wanted)


def generate_workgroup_shader(tile: WorkgroupTile, steps: Sequence[Direction]) -> str:
    """The WGSL of the transforms of a tile, to be linked after its hooks; its entry is `main`."""
    passes = merge_passes(pass_shapes("x", tile.length, radices(tile.length)), steps)
    body: list[str] = []
    for number, (shape, directions) in enumerate(passes):
        body += _pass(tile, shape, directions, is_first=number == 0, is_last=number == len(passes) - 1)
    text = "".join(f"    {line}\n" for line in body)
    return f"{_prologue(tile, steps)}{text}}}\n"


def _pass(
    tile: WorkgroupTile, shape: PassShape, steps: tuple[Direction, ...], *, is_first: bool, is_last: bool
) -> list[str]:
    """Statements of one pass, in a loop where invocations have several items or some have none."""
    code = WgslEmitter()
    stride = shape.block // shape.radix
    code.lines += [f"let offset = item % {stride}u;", f"let start = (item / {stride}u) * {shape.block}u + offset;"]
    places = [f"start + {k * stride}u" for k in range(shape.radix)]
    values = [code.let(f"load({_at(tile, p)})" if is_first else f"tile[slot({p}, across)]") for p in places]
    values = emit_steps(code, shape, values, steps, [_at(tile, p) for p in places])
    pairs = list(zip(places, values, strict=True))
    if is_last:
        code.lines += ["if (is_real) {", *(f"    store({_at(tile, p)}, {value});" for p, value in pairs), "}"]
    else:
        code.lines += [f"tile[slot({p}, across)] = {value};" for p, value in pairs]
    whole = shape.invocations_per_line == tile.threads
    head = ["{", "    let item = thread;"]
    if not whole:
        head = [f"for (var item = thread; item < {shape.invocations_per_line}u; item += {tile.threads}u) {{"]
    barrier = [] if is_last else ["workgroupBarrier();"]
    return [*head, *(f"    {line}" for line in code.lines), "}", *barrier]


def _at(tile: WorkgroupTile, along: str) -> str:
    return f"vec3u({along}, line, field)" if tile.axis == "x" else f"vec3u(line, {along}, field)"


def _pitch(n: int) -> int:
    return n + -(-n // _BANKS)


def _prologue(tile: WorkgroupTile, steps: Sequence[Direction]) -> str:
    """Declarations, and which line is this invocation's. One beyond the last line helps it: barriers need them all."""
    size = tile.threads * tile.lines
    if tile.axis == "x":
        split = f"let thread = local % {tile.threads}u;\n    let across = local / {tile.threads}u;"
        slot = f"across * {tile.pitch}u + along + along / {_BANKS}u"
    else:
        split = f"let thread = local / {tile.lines}u;\n    let across = local % {tile.lines}u;"
        slot = f"(along + along / {_BANKS}u) * {tile.lines}u + across"
    return f"""//#include "lib/complex.wgsl"

{LINE_RANGE.wgsl}
@group(0) @binding(0) var<uniform> lines: Lines;

var<workgroup> tile: array<vec2f, {tile.pitch * tile.lines}>;

// Where a value of a line waits in workgroup memory.
fn slot(along: u32, across: u32) -> u32 {{
    return {slot};
}}

// {" and ".join(steps)} transforms of {tile.lines} lines along {tile.axis} of {tile.length} points
@compute @workgroup_size({size})
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) workgroups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {{
    {split}
    let number = (workgroup.y * workgroups.x + workgroup.x) * {tile.lines}u + across;
    let is_real = number < lines.count;
    let line = lines.first + min(number, lines.count - 1u);
    let field = workgroup.z;
    begin(line, field);
"""
