"""Generates the fused kernels, which are FFTs along one axis with hooks, and lists the variants that a plan needs.

Numbers that depend on the grid only are constants in the shader. Each optional part makes a variant: a kernel, its
switches (boolean override constants), and whether it reads one buffer and writes another. `shaders/frame/` holds the
hooks.
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
from holoview.gpu.rounding import round_up
from holoview.gpu.shader import GeneratedWgsl
from holoview.gpu.wgsl_struct import WgslStruct
from holoview.model.plan import Grid, Plan

Switches = tuple[tuple[str, bool], ...]
KernelVariant = tuple[str, Switches, bool]
"""Name of the kernel, its switches, and whether it reads one buffer and writes another instead of working in place."""
TILE_X, TILE_Y = 4, 16
"""Samples of a tile of a stored field: see `shaders/frame/rows.wgsl`."""

KERNELS: dict[str, tuple[Axis, tuple[Direction, ...], tuple[WgslStruct, ...]]] = {
    "light": ("x", ("forward",), (PLANE_WAVE, MODULATOR)),
    "propagate": ("y", ("forward", "inverse"), (PROPAGATION,)),
    "modulate": ("x", ("inverse", "forward"), (MODULATOR,)),
    "observe": ("x", ("inverse",), ()),
}
"""Axis and directions of the transform of each kernel, and the structs that its hooks use."""
_SHARED_HOOK: dict[str, Literal["load", "middle"]] = {"light": "load", "modulate": "middle"}
"""The hook that takes the transmission of a modulator pixel, which all its samples share."""
FIELD_TO_FIELD = ("propagate", "modulate")
"""Kernels that read and write fields: in place, or from one buffer to another."""


class FusedKernels:
    """The kernels for one grid, each generated once. half: fields are stored as f16."""

    def __init__(self, device: Device, grid: Grid, *, half: bool = False) -> None:
        self.device, self.grid, self.half = device, grid, half
        self._transforms: dict[tuple[KernelVariant, Strategy], LineFft] = {}

    def transform(self, variant: KernelVariant, strategy: Strategy) -> LineFft:
        """The transform of a variant by a strategy. Raises UserError for a size that it can't transform."""
        key = (variant, strategy)
        if key not in self._transforms:
            kernel, switches, separate_buffers = variant
            self._transforms[key] = make_transform(
                self.device, self.grid, kernel, switches, strategy, half=self.half, separate_buffers=separate_buffers
            )
        return self._transforms[key]

    def shaders(self, strategy: Strategy, variants: Iterable[KernelVariant]) -> list[TransformShader]:
        """All shaders of some variants."""
        return [shader for variant in sorted(variants) for shader in self.transform(variant, strategy).shaders]

    def precompile(self, strategy: Strategy, plan: Plan) -> None:
        """Start compiling the kernels that a plan needs if it has neither pupils nor dense transmissions."""
        variants = required_variants(plan, [{False}, {False}], [False, False])
        if not works_in_place(strategy):
            variants -= {("propagate", switches, False) for _, switches, _ in variants}
        precompile(self.device, self.shaders(strategy, variants))


def works_in_place(strategy: Strategy) -> bool:
    """Whether fields are propagated in place, which is faster, except by passes, which then have more to compile."""
    return strategy != "passes"


def required_variants(
    plan: Plan, has_pupil: Sequence[Iterable[bool]], is_dense: Sequence[bool]
) -> frozenset[KernelVariant]:
    """The kernels that a plan needs.

    has_pupil: for each relay, whether it has a pupil, with both values if that depends on the wavelength.
    is_dense: for each modulator, whether its transmission is given sample by sample.
    """
    variants: set[KernelVariant] = {
        ("light", (("is_tilted", bool(slope.any())), ("is_dense", is_dense[0])), False)
        for slope in plan.slopes.reshape(-1, 2)
    }
    variants |= {("propagate", (("has_pupil", has),), True) for has in has_pupil[1]}
    variants |= {("observe", (("accumulates", source > 0),), False) for source in range(min(len(plan.slopes), 2))}
    if plan.system.gap_m is not None:
        variants |= {("propagate", (("has_pupil", has),), two) for has in has_pupil[0] for two in (False, True)}
        variants.add(("modulate", (("is_dense", is_dense[1]),), False))
    return frozenset(variants)


def make_transform(
    device: Device,
    grid: Grid,
    kernel: str,
    switches: Switches,
    strategy: Strategy,
    *,
    half: bool = False,
    separate_buffers: bool = False,
) -> LineFft:
    """A fused kernel: the transform along an axis with the hooks of `shaders/frame/<kernel>.wgsl`.

    half: fields are stored as f16. separate_buffers: they are read from one buffer and written to another. If possible,
    the intermediate values of a transform with several shaders are stored in the rows that it writes.
    """
    axis, steps, structs = KERNELS[kernel]
    holds_whole_lines = axis == "x" or grid.padded[0] == grid.shape[0]
    has_work_hooks = holds_whole_lines and not half  # rounding to f16 after each pass would cost 12 dB of PSNR
    work = ("frame/work.wgsl",) if has_work_hooks else ()
    parts = (
        GeneratedWgsl("structs", GRID.wgsl + DISPATCH_PARAMS.wgsl + "".join(struct.wgsl for struct in structs)),
        GeneratedWgsl("grid", _grid_wgsl(grid, strategy)),
        storage_shader(device, half=half),
        f"frame/rows_{'two_buffers' if separate_buffers else 'in_place'}.wgsl",
        *work,
        f"frame/{kernel}.wgsl",
    )
    hooks = Hooks(kernel, parts, switches, has_work_hooks, _SHARED_HOOK.get(kernel), grid.upsample)
    return LineFft(device, axis, grid.padded, steps, hooks, strategy)


def row_stride(grid: Grid) -> int:
    """Complex numbers from one row of a stored field to the next (without tiles): whole tiles and padding."""
    return round_up(grid.padded[1], TILE_X) + ROW_PADDING


def field_samples(grid: Grid) -> int:
    """Complex numbers of a stored field, that is of its rows transformed along x."""
    return round_up(grid.shape[0], TILE_Y) * row_stride(grid)


def _grid_wgsl(grid: Grid, strategy: Strategy) -> str:
    """WGSL constants of the grid and of the memory layout, so that the compiler evaluates what depends on them."""
    pairs = [f"vec2u({y}u, {x}u)" for y, x in (grid.padded, grid.shape, grid.offset)]
    return (
        f"const grid = Grid({', '.join(pairs)}, {row_stride(grid)}u, {grid.upsample}u);\n"
        f"const is_tiled = {str(strategy == 'subgroup').lower()};\n"
        f"const is_padded = {str(grid.padded != grid.shape).lower()};\n"
        f"const inverse_scale = {1 / math.prod(grid.padded):.12g};  // of an inverse transform along both axes\n"
        f"const intensity_stride = {padded_pixels(grid.shape)}u;  // pixels from one intensity to the next\n"
    )
