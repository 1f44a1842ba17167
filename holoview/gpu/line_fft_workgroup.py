"""Generates WGSL of an FFT of whole lines in workgroup memory.

The passes are those of `fft_codegen`, with the same radices and therefore the same digit-reversed spectra, but one
shader does all of them: between two passes the values of a line are in workgroup memory instead of a buffer. Each pass
works in place, so that one barrier after it is sufficient. Several columns share a workgroup, so that neighbouring
invocations read neighbouring addresses; several short rows share one to fill it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from holoview.gpu.fft_butterfly import WgslEmitter
from holoview.gpu.fft_codegen import COMMON_DECLARATIONS, Axis, PassSteps, emit_pass, merge_passes
from holoview.gpu.line_step import Step
from holoview.gpu.rounding import ceil_div

MIN_INVOCATIONS, MAX_INVOCATIONS = 64, 256
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
    threads = min(n // min(factors, default=1), MAX_INVOCATIONS)
    lines = COLUMNS if axis == "y" else 1
    while lines * threads < MIN_INVOCATIONS:
        lines *= 2
    fitting = memory_bytes // (_pitch(n) * _COMPLEX_BYTES)
    if not fitting:
        return None
    while lines > fitting or lines * threads > MAX_INVOCATIONS:
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
