"""Generates the fused kernels, which are FFTs along one axis with hooks, and lists the variants that a plan needs.

Numbers that depend on the shape of a frame only are constants in the shader. Each optional part makes a variant: a
kernel, its switches (boolean override constants), and whether it reads one buffer and writes another. `shaders/frame/`
holds the hooks.

`FrameLayout` states the rows and columns that the kernels store between them, and their order. Along x and along y only
the frequencies of the relays' bands are stored. The field behind the first modulator follows from one sample for each
pixel, and its spectrum, which repeats itself, from as many numbers as there are pixels.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from holoview.light.engine.compositor import padded_pixels
from holoview.light.engine.shader_structs import DISPATCH_PARAMS, GRID, MODULATOR, PLANE_WAVE, PROPAGATION
from holoview.light.gpu.device import Device
from holoview.light.gpu.line_fft import (
    ROW_PADDING,
    Axis,
    Hooks,
    LineFft,
    LineTransform,
    Strategy,
    TransformShader,
    can_access_fours,
    can_transform_repeats,
    lanes_per_line,
    precompile,
    spectrum_order,
    storage_shader,
    subgroup_size,
    supported_strategies,
)
from holoview.light.gpu.shader import GeneratedWgsl, WgslStruct
from holoview.light.gpu.spectrum_order import Range, SpectrumOrder
from holoview.light.gpu.texels import fits_texels, reads_texels
from holoview.light.model.plan import Grid, Plan
from holoview.light.numerics.sampling import round_up

TILE_X, TILE_Y = 4, 16
"""Samples of a tile of stored rows: see `shaders/frame/rows_tiled.wgsl`."""
_MAX_KEPT = 16  # shapes of frames whose kernels a device keeps, of some hundred kB each
_PARTS = 8  # bands end at multiples of this share of the grid, so that small edits of a stop need no new kernels

Bands = tuple[tuple[Range, Range], ...]
"""The ranges of k_y and k_x that are computed, for each relay."""


@dataclass(frozen=True)
class FrameShape:
    """The properties of a plan on which the code of the kernels depends.

    bands: contain what the relays pass. places: at which elements stand, with a relay behind each; a relay before these
    isn't used. has_plain_pixels: whether the field behind the first place follows from one sample for each pixel.
    """

    grid: Grid
    bands: Bands
    places: int
    has_plain_pixels: bool = True

    @property
    def first_relay(self) -> int:
        """The relay behind the first place."""
        return len(self.bands) - self.places

    @property
    def last_relay(self) -> int:
        """The relay to the planes."""
        return len(self.bands) - 1

    def contains(self, other: FrameShape) -> bool:
        """Whether kernels of this shape compute frames of the other shape, whose bands lie inside."""
        pairs = zip(sum(self.bands, ()), sum(other.bands, ()), strict=True)
        is_inside = all(mine[0] <= theirs[0] and theirs[1] <= mine[1] for mine, theirs in pairs)
        rest = (self.grid, self.places, self.has_plain_pixels)
        return is_inside and rest == (other.grid, other.places, other.has_plain_pixels)


def frame_shape(plan: Plan, *, has_plain_pixels: bool = True) -> FrameShape:
    """The shape of a plan's frames.

    has_plain_pixels: whether the transmission of the first modulator is constant over each of its pixels.
    """
    grid = plan.grid
    bands = tuple(
        (
            _outwards((band.lowest[0], band.highest[0]), grid.padded[0]),
            _outwards((band.lowest[1], band.highest[1]), grid.padded[1]),
        )
        for band in map(plan.band, range(len(plan.relays)))
    )
    is_divisible = all(n % grid.upsample == 0 for n in grid.padded) and grid.upsample > 1
    return FrameShape(grid, bands, len(plan.way.places), has_plain_pixels and is_divisible)


def _outwards(band: Range, n: int) -> Range:
    """A band that ends at multiples of n/8 and contains a given band, which may be empty."""
    if band[0] > band[1]:
        return 0, 0
    lowest = band[0] * _PARTS // n * n // _PARTS
    highest = -(-(band[1] + 1) * _PARTS // n) * n // _PARTS - 1
    return max(lowest, -(n // 2)), min(max(highest, band[1]), (n - 1) // 2)


@dataclass(frozen=True)
class StoredRows:
    """Rows of complex numbers in device memory."""

    rows: int
    columns: int

    @property
    def stride(self) -> int:
        """Complex numbers from one row to the next (without tiles): whole tiles and padding."""
        return round_up(self.columns, TILE_X) + ROW_PADDING

    @property
    def samples(self) -> int:
        """Complex numbers of all rows, with padding."""
        return round_up(self.rows, TILE_Y) * self.stride


@dataclass(frozen=True)
class FrameLayout:
    """The rows between the kernels of a frame with a strategy of the FFTs.

    Kernels along x work on whole fields, and all others on the frequencies along x that a relay passes.
    """

    device: Device
    shape: FrameShape
    strategy: Strategy

    @cached_property
    def pixel_grid(self) -> Grid:
        """The grid of the samples behind the first modulator that are computed: one for each pixel, or all."""
        grid = self.shape.grid
        if not self.has_plain_pixels:
            return grid
        u = grid.upsample
        padded, shape, offset = ((y // u, x // u) for y, x in (grid.padded, grid.shape, grid.offset))
        return Grid(shape, padded, offset, grid.pitch_m * u, 1)

    @cached_property
    def has_plain_pixels(self) -> bool:
        """Whether the field behind the first modulator is computed at one sample for each pixel."""
        grid, u = self.shape.grid, self.shape.grid.upsample
        if not self.shape.has_plain_pixels:
            return False
        pixels = (grid.padded[0] // u, grid.padded[1] // u)
        return self.strategy in supported_strategies(self.device, pixels) and can_transform_repeats(
            self.device, grid.padded[0], u, self.strategy
        )

    def band(self, relay: int, axis: int) -> Range:
        """The frequencies of a relay that are computed, along y (0) or x (1)."""
        return self.shape.bands[relay][axis]

    def columns(self, relay: int) -> SpectrumOrder:
        """The frequencies along x that are stored of the light in a relay."""
        return self._order(self.shape.grid.padded[1], self.band(relay, 1))

    @cached_property
    def first_columns(self) -> SpectrumOrder:
        """The frequencies along x that are stored of the field behind the first place."""
        return self._order(self.pixel_grid.padded[1], self.band(self.shape.first_relay, 1))

    def spectrum_rows(self) -> SpectrumOrder:
        """The frequencies along y that are stored of the light in the last relay."""
        return self._order(self.shape.grid.padded[0], self.band(self.shape.last_relay, 0))

    @cached_property
    def leaving(self) -> tuple[StoredRows, ...]:
        """By relays, the light behind each, transformed along x."""
        rows = self.shape.grid.shape[0]
        return tuple(StoredRows(rows, self.columns(relay).count) for relay in range(len(self.shape.bands)))

    @cached_property
    def entering(self) -> tuple[StoredRows, ...]:
        """By relays, the light before each, transformed along x."""
        first = StoredRows(self.pixel_grid.shape[0], self.first_columns.count)
        return tuple(first if relay == self.shape.first_relay else rows for relay, rows in enumerate(self.leaving))

    @cached_property
    def spectrum(self) -> StoredRows:
        """The light before the last relay, transformed along x and y."""
        return StoredRows(self.spectrum_rows().count, self.columns(self.shape.last_relay).count)

    @cached_property
    def reads_texels(self) -> bool:
        """Whether kernels read stored fields as texels."""
        largest = max((*self.entering, *self.leaving, self.kept), key=lambda rows: rows.samples)
        return reads_texels(self.device) and fits_texels(self.device, largest.samples)

    @property
    def is_tiled(self) -> bool:
        """Whether rows are stored in tiles (`shaders/frame/rows_tiled.wgsl`)."""
        return self.strategy == "subgroup"

    @property
    def keeps_spectrum(self) -> bool:
        """Whether `spectrum` is kept for other planes instead of the rows before it: where it is smaller, and where it
        is as large and transforms are by passes, which store it anyway."""
        rows = self.entering[-1].samples
        is_stored = self.strategy == "passes" and self.spectrum.samples == rows
        return self.shape.places > 1 and (self.spectrum.samples < rows or is_stored)

    @property
    def kept(self) -> StoredRows:
        """What is kept for all planes: the rows before the last relay, or the spectrum."""
        return self.spectrum if self.keeps_spectrum else self.entering[-1]

    def _order(self, n: int, band: Range) -> SpectrumOrder:
        return spectrum_order(self.device, n, self.strategy, band)


# --- kernels ----------------------------------------------------------------------------------------------------------


Switches = tuple[tuple[str, bool], ...]

KERNELS: dict[str, tuple[Axis, tuple[WgslStruct, ...]]] = {
    "light": ("x", (PLANE_WAVE, MODULATOR)),
    "propagate": ("y", (PROPAGATION,)),
    "modulate": ("x", (MODULATOR,)),
    "spectrum": ("y", ()),
    "image": ("y", (PROPAGATION,)),
    "observe": ("x", ()),
}
"""Axis of the transform of each kernel, and the structs that its hooks use."""
_ACCESS: dict[bool, dict[str, tuple[str, ...]]] = {
    False: {
        "light": ("rows_store",),
        "modulate": ("rows_load", "rows_store"),
        "observe": ("rows_load", "observe_singles"),
    },
    True: {"light": ("rows_store_fours",), "modulate": ("rows_store_fours",), "observe": ("observe_fours",)},
}
"""Files with the hooks that load and store lines along x, by whether they access four values at a time."""
_FIRST_TABLE = 3
TABLES: dict[str, tuple[tuple[str, str] | None, ...]] = {
    "light": (None, None, ("opd", "f32"), ("dense", "vec2f")),
    "modulate": (None, ("opd", "f32"), ("dense", "vec2f")),
    "propagate": (None, None, ("pupil", "vec2f"), ("pixel_spectra", "vec2f")),
    "image": (None, None, ("pupil", "vec2f")),
}
"""Tables that kernels bind from `@binding(3)` on: name and type of number of those with a number for each sample, pixel
or frequency; None for others, which the shaders declare."""
_SHARED_HOOK: dict[str, Literal["load", "middle"]] = {"light": "load", "modulate": "middle"}
"""The hook that takes the transmission of a modulator pixel, which all its samples share."""


@dataclass(frozen=True)
class KernelVariant:
    """A kernel with its options.

    shape: of the frame. relay: that the light enters behind the kernel, or in it. separate_buffers: whether it reads
    one buffer and writes another instead of working in place.
    """

    shape: FrameShape
    kernel: str
    relay: int
    switches: Switches = ()
    separate_buffers: bool = False


class FusedKernels:
    """The kernels for frames of one shape, each generated once. half: fields are stored as f16."""

    def __init__(self, device: Device, shape: FrameShape, *, half: bool = False) -> None:
        self.device, self.shape, self.half = device, shape, half
        self._transforms: dict[tuple[KernelVariant, Strategy], LineFft] = {}
        self._layouts: dict[Strategy, FrameLayout] = {}

    @classmethod
    def kept(cls, device: Device, shape: FrameShape, *, half: bool = False) -> FusedKernels:
        """The kernels that were made last for this shape, with all that they have generated, or new kernels."""
        key, generated = (cls, shape, half, device.transforms), device.generated
        kernels: FusedKernels = generated.pop(key, None) or cls(device, shape, half=half)
        generated[key] = kernels
        if len(generated) > _MAX_KEPT:
            generated.popitem(last=False)
        return kernels

    def layout(self, strategy: Strategy) -> FrameLayout:
        """The layout between the kernels with a strategy. Raises UserError for a size that it can't transform."""
        if strategy not in self._layouts:
            self._layouts[strategy] = FrameLayout(self.device, self.shape, strategy)
        return self._layouts[strategy]

    def transform(self, variant: KernelVariant, strategy: Strategy) -> LineFft:
        """The transform of a variant by a strategy. Raises UserError for a size that it can't transform."""
        key = (variant, strategy)
        if key not in self._transforms:
            self._transforms[key] = make_transform(self.layout(strategy), variant, half=self.half)
        return self._transforms[key]

    def shaders(self, strategy: Strategy, variants: Iterable[KernelVariant]) -> list[TransformShader]:
        """All shaders of some variants."""
        ordered = sorted(variants, key=lambda variant: (variant.kernel, repr(variant)))
        return [shader for variant in ordered for shader in self.transform(variant, strategy).shaders]

    def precompile(self, strategy: Strategy, plan: Plan) -> None:
        """Start compiling the kernels that a plan needs as far as `plain_variants` tells."""
        precompile(self.device, self.shaders(strategy, self.plain_variants(strategy, plan)))

    def plain_variants(self, strategy: Strategy, plan: Plan) -> frozenset[KernelVariant]:
        """The kernels that a plan needs if it has no pupils, and of a short form no dense transmissions."""
        relays, are_dense = len(self.shape.bands), [plan.way.is_chain] * self.shape.places
        return required_variants(self.layout(strategy), plan, [{False}] * relays, are_dense)


def works_in_place(layout: FrameLayout) -> bool:
    """Whether fields are propagated from place to place in place, which is faster, except by passes with more to
    compile."""
    first, last = layout.shape.first_relay, layout.shape.last_relay
    are_equal = len({*layout.entering[first:], *layout.leaving[first:last]}) == 1
    is_possible = are_equal and not (layout.has_plain_pixels or layout.keeps_spectrum)
    return is_possible and layout.strategy != "passes"


def required_variants(
    layout: FrameLayout, plan: Plan, has_pupil: Sequence[Iterable[bool]], is_dense: Sequence[bool]
) -> frozenset[KernelVariant]:
    """The kernels that a plan needs.

    has_pupil: for each relay, whether it has a pupil, with both values if that depends on the wavelength.
    is_dense: for each place, whether the transmission there is given sample by sample.
    """
    shape, first_relay, last_relay = layout.shape, layout.shape.first_relay, layout.shape.last_relay
    variants = {
        KernelVariant(shape, "light", first_relay, (("is_tilted", bool(slope.any())), ("is_dense", is_dense[0])))
        for slope in plan.slopes.reshape(-1, 2)
    }
    pupils = [[(("has_pupil", has),) for has in options] for options in has_pupil]
    in_place = {False, True} if works_in_place(layout) else {True}
    for relay, dense in enumerate(is_dense[1:], first_relay):
        variants |= {
            KernelVariant(shape, "propagate", relay, pupil, two) for pupil in pupils[relay] for two in in_place
        }
        separate = layout.leaving[relay] != layout.entering[relay + 1]
        variants.add(KernelVariant(shape, "modulate", relay + 1, (("is_dense", dense),), separate))
    if layout.keeps_spectrum:
        variants.add(KernelVariant(shape, "spectrum", last_relay, (), True))
    last = "image" if layout.keeps_spectrum else "propagate"
    variants |= {KernelVariant(shape, last, last_relay, pupil, True) for pupil in pupils[last_relay]}
    sums = range(min(len(plan.slopes), 2))
    variants |= {KernelVariant(shape, "observe", last_relay, (("accumulates", source > 0),)) for source in sums}
    return frozenset(variants)


def make_transform(layout: FrameLayout, variant: KernelVariant, *, half: bool = False) -> LineFft:
    """A fused kernel: the transform along an axis with the hooks of `shaders/frame/<kernel>.wgsl`.

    half: fields are stored as f16. If possible, the intermediate values of a transform with several shaders are stored
    in the rows that it writes.
    """
    kernel, relay = variant.kernel, variant.relay
    axis, structs = KERNELS[kernel]
    grid = layout.pixel_grid if kernel == "light" else layout.shape.grid
    lines = lines_of(layout, kernel, relay)
    texels = not half and layout.reads_texels
    fours = texels and _accesses_fours(layout, kernel, grid)
    has_work_hooks = layout.strategy == "passes" and _holds_whole_lines(layout, kernel, relay)
    has_work_hooks = has_work_hooks and not half  # rounding to f16 after each pass would cost 12 dB of PSNR
    buffers = "two_buffers" if variant.separate_buffers else "in_place"
    parts = (
        GeneratedWgsl("structs", GRID.wgsl + DISPATCH_PARAMS.wgsl + "".join(struct.wgsl for struct in structs)),
        GeneratedWgsl("constants", _constants_wgsl(layout, kernel, relay, grid)),
        *(("lib/texels.wgsl",) if texels else ()),
        GeneratedWgsl("tables", _tables_wgsl(kernel, texels)),
        storage_shader(layout.device, half=half),
        f"frame/rows_{'tiled' if layout.is_tiled else 'plain'}.wgsl",
        f"frame/rows_{'fours' if fours else 'singles'}.wgsl",
        *(("frame/rows_texels.wgsl",) if texels else (f"frame/rows_{buffers}.wgsl", "frame/rows_read.wgsl")),
        *(("frame/rows_load_fours.wgsl",) if fours else ()),
        *((f"frame/work{'_texels' if texels else ''}.wgsl",) if has_work_hooks else ()),
        f"frame/{kernel}.wgsl",
        *(f"frame/{name}.wgsl" for name in _ACCESS[fours].get(kernel, ())),
    )
    shared = _SHARED_HOOK.get(kernel)
    hooks = Hooks(kernel, parts, variant.switches, has_work_hooks, shared, grid.upsample, fours, texels)
    shape = (lines, grid.padded[1]) if axis == "x" else (grid.padded[0], lines)
    return LineFft(layout.device, axis, shape, _steps(layout, kernel, relay), hooks, layout.strategy)


def lines_of(layout: FrameLayout, kernel: str, relay: int) -> int:
    """How many lines a kernel transforms."""
    if KERNELS[kernel][0] == "y":
        return layout.columns(relay).count
    return (layout.pixel_grid if kernel == "light" else layout.shape.grid).shape[0]


def rows_of(layout: FrameLayout, kernel: str, relay: int) -> tuple[StoredRows, StoredRows]:
    """The rows that a kernel reads and the rows that it writes; equal if it only reads or only writes rows."""
    before, behind = layout.entering[relay], layout.leaving[relay]
    return {
        "light": (before, before),
        "propagate": (before, behind),
        "modulate": (layout.leaving[relay - 1], before),
        "spectrum": (before, layout.spectrum),
        "image": (layout.spectrum, behind),
        "observe": (behind, behind),
    }[kernel]


def _steps(layout: FrameLayout, kernel: str, relay: int) -> tuple[LineTransform, ...]:
    grid, pixels = layout.shape.grid, layout.pixel_grid
    rows, columns, band = _window(grid, 0), _window(grid, 1), layout.band(relay, 0)
    inverse = LineTransform("inverse", rows, band)
    if kernel == "light":
        return (LineTransform("forward", _window(pixels, 1), layout.band(relay, 1)),)
    if kernel == "propagate" and _reads_pixels(layout, relay):
        return LineTransform("forward", _window(pixels, 0), band, grid.upsample), inverse
    if kernel == "modulate":
        return (
            LineTransform("inverse", columns, layout.band(relay - 1, 1)),
            LineTransform("forward", columns, layout.band(relay, 1)),
        )
    return {
        "propagate": (LineTransform("forward", rows, band), inverse),
        "spectrum": (LineTransform("forward", rows, band),),
        "image": (inverse,),
        "observe": (LineTransform("inverse", columns, layout.band(relay, 1)),),
    }[kernel]


def _reads_pixels(layout: FrameLayout, relay: int) -> bool:
    """Whether a relay's `propagate` reads one sample for each pixel of the first place."""
    return layout.has_plain_pixels and relay == layout.shape.first_relay


def _adds_lane(layout: FrameLayout, kernel: str, *grids: Grid) -> bool:
    """Whether each point of a lane, on the grid and among the stored rows, is the lane's number plus a multiple of the
    number of lanes, so that the addition carries nothing."""
    axis = 1 if KERNELS[kernel][0] == "x" else 0
    n = grids[0].padded[axis]
    lanes = lanes_per_line(n, subgroup_size(layout.device)) if layout.strategy == "subgroup" else None
    return lanes is not None and all(k % lanes == 0 for k in (n // lanes, *(grid.offset[axis] for grid in grids)))


def _accesses_fours(layout: FrameLayout, kernel: str, grid: Grid) -> bool:
    """Whether a kernel along x loads and stores four neighbouring values at a time, which is faster on a processor."""
    if KERNELS[kernel][0] != "x" or layout.strategy != "subgroup":
        return False
    lanes = lanes_per_line(grid.padded[1], subgroup_size(layout.device))
    divides = kernel != "observe" or (grid.shape[1] % 4 == 0 and grid.offset[1] % 4 == 0)
    return lanes is not None and divides and can_access_fours(grid.padded[1], lanes)


def _window(grid: Grid, axis: int) -> Range:
    """The samples of the field on the padded grid, along y (0) or x (1)."""
    return grid.offset[axis], grid.offset[axis] + grid.shape[axis] - 1


def _holds_whole_lines(layout: FrameLayout, kernel: str, relay: int) -> bool:
    """Whether the rows that a kernel writes have room for all points of its lines, at the same positions."""
    source, target = rows_of(layout, kernel, relay)
    if KERNELS[kernel][0] == "x":
        n = (layout.pixel_grid if kernel == "light" else layout.shape.grid).padded[1]
        return source.columns == target.columns == n
    n = layout.shape.grid.padded[0]
    is_whole = layout.band(relay, 0)[1] - layout.band(relay, 0)[0] + 1 >= n
    return kernel == "propagate" and is_whole and target.rows == n


def _tables_wgsl(kernel: str, texels: bool) -> str:
    """WGSL of the functions that read `TABLES`."""
    text = ""
    for binding, table in enumerate(TABLES.get(kernel, ()), start=_FIRST_TABLE):
        if table is None:
            continue
        name, number = table
        place = f"@group(1) @binding({binding}) var"
        declaration, read = f"{place}<storage, read> {name}: array<{number}>;", f"return {name}[index];"
        if texels:
            declaration = f"{place} {name}: texture_storage_2d<rg32float, read>;"
            read = f"return textureLoad({name}, texel_place(index)).xy;"
        if texels and number == "f32":
            read = f"let two = textureLoad({name}, texel_place(index / 2u)).xy;"
            read += " return select(two.x, two.y, index % 2u == 1u);"
        text += f"{declaration}\nfn read_{name}(index: u32) -> {number} {{ {read} }}\n"
    return text


def _constants_wgsl(layout: FrameLayout, kernel: str, relay: int, grid: Grid) -> str:
    """WGSL constants of the grid and of the memory layout, so that the compiler evaluates expressions of them."""
    pairs = [f"vec2u({y}u, {x}u)" for y, x in (grid.padded, grid.shape, grid.offset)]
    source, target = rows_of(layout, kernel, relay)
    whole, reads_pixels = layout.shape.grid, kernel == "propagate" and _reads_pixels(layout, relay)
    wave_step = whole.upsample if layout.has_plain_pixels else 1
    read = layout.pixel_grid if reads_pixels else whole
    text = (
        f"const grid = Grid({', '.join(pairs)}, 0u, {grid.upsample}u);\n"
        f"const source_layout = RowLayout({source.rows}u, {source.stride}u);\n"
        f"const target_layout = RowLayout({target.rows}u, {target.stride}u);\n"
        f"const work_layout = {'source' if kernel == 'observe' else 'target'}_layout;\n"
        f"const is_along_x = {str(KERNELS[kernel][0] == 'x').lower()};\n"
        f"const adds_lane = {str(_adds_lane(layout, kernel, grid, read)).lower()};\n"
        f"const is_padded = {str(whole.padded != whole.shape).lower()};\n"
        f"const inverse_scale = {1 / math.prod(whole.padded):.12g};  // of an inverse transform along both axes\n"
        f"const intensity_stride = {padded_pixels(whole.shape)}u;  // pixels from one intensity to the next\n"
        f"const wave_step = {wave_step}u;  // samples of the field from one computed sample of the light to the next\n"
        f"const source_offset = {read.offset[0]}u;  // first row of the field on the padded grid\n"
        f"const repeats_pixels = {str(reads_pixels).lower()};\n"
    )
    if KERNELS[kernel][0] == "y":
        text += layout.columns(relay).frequency_wgsl("frequency_x")
    return text + (layout.first_columns.position_wgsl("first_position") if kernel == "propagate" else "")
