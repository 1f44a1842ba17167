"""The fused kernels as transforms between hooks, and which variants of them a plan needs.

What only depends on the grid is a constant in the shader, and whatever else can be left out makes a variant: a kernel,
its switches, and whether it reads one buffer and writes another. `shaders/frame/` holds the hooks.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Literal

from holoview.engine.compositor import padded_pixels
from holoview.engine.shader_structs import DISPATCH_PARAMS, GRID, MODULATOR, PLANE_WAVE, PROPAGATION
from holoview.gpu.device import Device
from holoview.gpu.fft_codegen import Direction
from holoview.gpu.line_fft import ROW_PADDING, Axis, Hooks, LineFft, Strategy, TransformShader, storage_shader
from holoview.gpu.precompile import precompile
from holoview.gpu.shader import GeneratedWgsl
from holoview.gpu.wgsl_struct import WgslStruct
from holoview.model.plan import Grid, Plan

Switches = tuple[tuple[str, bool], ...]
KernelVariant = tuple[str, Switches, bool]
"""A kernel, its switches, and whether it reads one buffer and writes another, or works in place."""
TILE_X, TILE_Y = 4, 16
"""Samples of the tiles that fields lie in: see `shaders/frame/rows.wgsl`."""

KERNELS: dict[str, tuple[Axis, tuple[Direction, ...], tuple[WgslStruct, ...]]] = {
    "light": ("x", ("forward",), (PLANE_WAVE, MODULATOR)),
    "propagate": ("y", ("forward", "inverse"), (PROPAGATION,)),
    "modulate": ("x", ("inverse", "forward"), (MODULATOR,)),
    "observe": ("x", ("inverse",), ()),
}
"""Axis and directions of the transform, and the structs that its hooks take."""
_SHARED_HOOK: dict[str, Literal["load", "middle"]] = {"light": "load", "modulate": "middle"}
"""Hooks that take what the samples of a modulator's pixel have in common."""
FIELD_TO_FIELD = ("propagate", "modulate")
"""Kernels that read fields and write fields: in place, or from one buffer to another."""


class FusedKernels:
    """The kernels for one grid; `half` stores fields as f16. Each is generated once."""

    def __init__(self, device: Device, grid: Grid, *, half: bool = False) -> None:
        self.device, self.grid, self.half = device, grid, half
        self._transforms: dict[tuple[KernelVariant, Strategy], LineFft] = {}

    def transform(self, variant: KernelVariant, strategy: Strategy) -> LineFft:
        """A kernel by a strategy. Raises UserError for a size that it can't transform."""
        key = (variant, strategy)
        if key not in self._transforms:
            kernel, constants, two = variant
            options = {"half": self.half, "separate_buffers": two}
            self._transforms[key] = make_transform(self.device, self.grid, kernel, constants, strategy, **options)
        return self._transforms[key]

    def shaders(self, strategy: Strategy, variants: Iterable[KernelVariant]) -> list[TransformShader]:
        """All their shaders, such as to compile them somewhere else."""
        return [stage for variant in sorted(variants) for stage in self.transform(variant, strategy).shaders]

    def precompile(self, strategy: Strategy, plan: Plan) -> None:
        """Has the device compile what a plan without pupils needs, and doesn't wait for it where drivers allow that."""
        needed = required_variants(plan, [{False}, {False}], [False, False])
        if not works_in_place(strategy):
            needed -= {("propagate", constants, False) for _, constants, _ in needed}
        precompile(self.device, self.shaders(strategy, needed))


def works_in_place(strategy: Strategy) -> bool:
    """Whether fields are propagated in place: faster, except by passes, which have less to compile if they aren't."""
    return strategy != "passes"


def required_variants(
    plan: Plan, has_pupil: Sequence[Iterable[bool]], dense: Sequence[bool]
) -> frozenset[KernelVariant]:
    """The kernels that a plan needs. glass: for each relay, whether it has a pupil, at whichever wavelengths; dense:
    for each modulator, whether effects give its samples a transmission."""
    found: set[KernelVariant] = {
        ("light", (("is_tilted", bool(slope.any())), ("is_dense", dense[0])), False)
        for slope in plan.slopes.reshape(-1, 2)
    }
    found |= {("propagate", (("has_pupil", has),), True) for has in has_pupil[1]}
    found |= {("observe", (("adds", source > 0),), False) for source in range(min(len(plan.slopes), 2))}
    if plan.system.gap_m is not None:
        found |= {("propagate", (("has_pupil", has),), two) for has in has_pupil[0] for two in (False, True)}
        found.add(("modulate", (("is_dense", dense[1]),), False))
    return frozenset(found)


def make_transform(
    device: Device,
    grid: Grid,
    kernel: str,
    constants: Switches,
    strategy: Strategy,
    *,
    half: bool = False,
    separate_buffers: bool = False,
) -> LineFft:
    """A fused kernel: the transform of an axis between the hooks of `shaders/frame/<kernel>.wgsl`.

    half: fields are stored as f16. two: they are read from one buffer and written to another, else in place.
    Where the transform has several shaders, it uses the rows that it writes for what lies between them, if it can.
    """
    axis, steps, layouts = KERNELS[kernel]
    has_room = axis == "x" or grid.padded[0] == grid.shape[0]  # for whole lines, between the rows that are stored
    own_work = has_room and not half  # passes that round to f16 one after the other would cost 12 dB
    work = ("frame/work.wgsl",) if own_work else ()
    parts = (
        GeneratedWgsl("structs", GRID.wgsl + DISPATCH_PARAMS.wgsl + "".join(layout.wgsl for layout in layouts)),
        GeneratedWgsl("grid", _grid_wgsl(grid, strategy)),
        storage_shader(device, half=half),
        f"frame/rows_{'two' if separate_buffers else 'one'}.wgsl",
        *work,
        f"frame/{kernel}.wgsl",
    )
    hooks = Hooks(kernel, parts, constants, own_work, _SHARED_HOOK.get(kernel), grid.upsample)
    return LineFft(device, axis, grid.padded, steps, hooks, strategy)


def row_stride(grid: Grid) -> int:
    """Complex numbers from row to row, were they not in tiles: whole tiles, and two more."""
    return _rounded(grid.padded[1], TILE_X) + ROW_PADDING


def field_samples(grid: Grid) -> int:
    """Complex numbers that the rows of a field take."""
    return _rounded(grid.shape[0], TILE_Y) * row_stride(grid)


def _rounded(samples: int, tile: int) -> int:
    return -(-samples // tile) * tile


def _grid_wgsl(grid: Grid, strategy: Strategy) -> str:
    """WGSL constants of a grid and of how fields lie in memory, so that the compiler evaluates what depends on them."""
    pairs = [f"vec2u({y}u, {x}u)" for y, x in (grid.padded, grid.shape, grid.offset)]
    return (
        f"const grid = Grid({', '.join(pairs)}, {row_stride(grid)}u, {grid.upsample}u);\n"
        f"const is_tiled = {str(strategy == 'subgroup').lower()};\n"
        f"const is_padded = {str(grid.padded != grid.shape).lower()};\n"
        f"const inverse_scale = {1 / math.prod(grid.padded):.12g};  // of an inverse transform along both axes\n"
        f"const slice_pixels = {padded_pixels(grid.shape)}u;  // from one intensity to the next\n"
    )
