"""Every shader compiles in every permutation; shaders read structs and fixed-point phases as Python packs them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from itertools import product
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from holoview.light.engine import shader_structs
from holoview.light.engine.fused_kernels import (
    KERNELS,
    FrameLayout,
    FrameShape,
    FusedKernels,
    KernelVariant,
    make_transform,
)
from holoview.light.gpu.device import INT64, Buffer, Device
from holoview.light.gpu.line_fft import LineFft, Strategy, supported_strategies
from holoview.light.gpu.recorder import CommandRecorder, Dispatch
from holoview.light.gpu.shader import GeneratedWgsl, ShaderError, WgslStruct, link
from holoview.light.gpu.spectrum_order import Range
from holoview.light.gpu.texels import reads_texels
from holoview.light.model.passband import turns_to_fixed_point
from holoview.light.model.plan import Grid, make_plan
from holoview.light.optics.propagate import transfer_function
from holoview.util.files import data_dir
from tests.explored import one_of_each

pytestmark = pytest.mark.gpu

STRUCTS = {struct.name: struct for struct in vars(shader_structs).values() if isinstance(struct, WgslStruct)}
DECLARATIONS = GeneratedWgsl("structs", "".join(struct.wgsl for struct in STRUCTS.values()))
SWITCH = re.compile(r"^override (\w+): bool\b", re.MULTILINE)
STORAGES = {"display/composite.wgsl": [["display/pixels_f32.wgsl"], ["display/pixels_texels.wgsl"]]}
"""Files that a shader has to be linked after, one of each list."""
NUMBER = re.compile(r"^override (\w+): [ui]32;", re.MULTILINE)


def _shaders() -> list[str]:
    folder = data_dir("shaders")
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*.wgsl"))


def _permutations() -> Iterator[tuple[str, dict[str, int]]]:
    """Each shader that stands for itself, with each choice of its switches."""
    for name in _shaders():
        if name.startswith(("frame/", "fft/")):  # hooks of transforms, compiled with these
            continue
        text = (data_dir("shaders") / name).read_text(encoding="utf-8")
        switches, numbers = SWITCH.findall(text), NUMBER.findall(text)
        for chosen in product((False, True), repeat=len(switches)):
            yield name, dict(zip(switches, chosen, strict=True)) | dict.fromkeys(numbers, 8)


def _run(device: Device, text: str, uniforms: list[Buffer], inputs: list[Buffer], out: Buffer, workgroups: int) -> None:
    pipeline = device.pipeline(link(DECLARATIONS, GeneratedWgsl("probe", text)))
    recorder = CommandRecorder(device)
    recorder.add(Dispatch.bind(device, pipeline, [uniforms, [*inputs, out]], (workgroups, 1, 1)))
    recorder.submit()


# --- compiling ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "constants"),
    [
        pytest.param(*found, id=" ".join([found[0], *(k for k, v in found[1].items() if v is True)]))
        for found in _permutations()
    ],
)
def test_a_shader_compiles_in_every_permutation(device: Device, name: str, constants: dict[str, int]) -> None:
    is_stage = "@compute" in (data_dir("shaders") / name).read_text(encoding="utf-8")
    probe = "" if is_stage else "@compute @workgroup_size(1) fn main() {}\n"
    for parts in STORAGES.get(name, [[]]):
        if INT64 in device.features or not any("texels" in part for part in (name, *parts)):
            device.pipeline(link(DECLARATIONS, *parts, name, GeneratedWgsl("probe", probe), label=name), constants)


def _compile(device: Device, transform: LineFft) -> None:
    for shader in transform.shaders:
        device.pipeline(shader.source, shader.constants)


_ROWS = ("plain", "tiled", "in_place", "two_buffers", "texels", "singles", "fours", "read", "load", "load_fours")
_ROWS = (*_ROWS, "store", "store_fours")
_PARTS = (
    *("columns", "propagation", "rows", "work", "work_texels", "observe_singles", "observe_fours"),
    *(f"rows_{name}" for name in _ROWS),
)
_WHOLE: Range = (-64, 63)
_HALF: Range = (-16, 15)
SHAPES = {
    "periodic": FrameShape(Grid((64, 128), (64, 128), (0, 0), 4e-6, 2), ((_WHOLE, _WHOLE), (_WHOLE, _WHOLE)), 2),
    "padded": FrameShape(Grid((32, 64), (64, 128), (16, 32), 4e-6, 2), ((_WHOLE, _WHOLE), (_WHOLE, _WHOLE)), 2, False),
    "stops": FrameShape(Grid((64, 128), (64, 128), (0, 0), 4e-6, 2), ((_HALF, _WHOLE), (_HALF, _HALF)), 2),
    "three places": FrameShape(
        Grid((32, 64), (64, 128), (16, 32), 4e-6, 1), ((_WHOLE, _HALF), (_WHOLE, _WHOLE), (_HALF, _HALF)), 3
    ),
    "one modulator": FrameShape(Grid((32, 64), (64, 128), (16, 32), 4e-6, 2), ((_WHOLE, _WHOLE), (_HALF, _HALF)), 1),
}


class _WithoutTexels(Device):
    """A device that reads buffers: pairs of f32, as cards do, or 64-bit integers, as other software drivers may."""

    def __init__(self, device: Device, without: set[str]) -> None:
        super().__init__(device.raw, replace(device.info, backend="another"), device.limits)
        self._without = without

    @property
    def features(self) -> frozenset[str]:
        return super().features - self._without


def _switches(kernel: str) -> list[str]:
    names = [kernel, "propagation"] if kernel in ("propagate", "image") else [kernel]
    texts = [(data_dir("shaders") / f"frame/{name}.wgsl").read_text(encoding="utf-8") for name in names]
    return [switch for text in texts for switch in SWITCH.findall(text)]


@pytest.mark.parametrize(
    ("kernel", "strategy", "shape", "half"),
    one_of_each(product(KERNELS, ["passes", "subgroup"], SHAPES, [False, True])),
)
def test_a_fused_kernel_compiles_in_every_permutation(
    device: Device, kernel: str, shape: str, half: bool, strategy: Strategy
) -> None:
    if strategy not in supported_strategies(device, (64, 128)):
        pytest.skip("this adapter's lanes exchange nothing")
    others = [_WithoutTexels(device, without) for without in (set[str](), {INT64})]
    assert not any(map(reads_texels, others))
    for each in (device, *others):
        _compile_permutations(each, kernel, shape, half, strategy)


def _compile_permutations(device: Device, kernel: str, shape: str, half: bool, strategy: Strategy) -> None:
    layout = FrameLayout(device, SHAPES[shape], strategy)
    first, last = layout.shape.first_relay, layout.shape.last_relay
    relays = {"light": [first], "propagate": range(first, last + 1), "modulate": range(min(first + 1, last), last + 1)}
    switches = _switches(kernel)
    for relay, two, *chosen in product(relays.get(kernel, [last]), (False, True), *[(False, True)] * len(switches)):
        constants = tuple(zip(switches, chosen, strict=True))
        variant = KernelVariant(SHAPES[shape], kernel, relay, constants, two)
        _compile(device, make_transform(layout, variant, half=half))


@pytest.mark.parametrize("shape", SHAPES)
def test_fused_kernels_can_be_compiled_ahead(device: Device, bench: Callable[..., Any], shape: str) -> None:
    kernels = FusedKernels(device, SHAPES[shape])
    modulators = {"modulators": [bench().modulators[0]], "gap": None} if shape == "one modulator" else {}
    kernels.precompile("workgroup", make_plan(bench(**modulators)))
    device.wait()


def test_there_is_a_shader_for_each_fused_kernel_and_none_besides() -> None:
    hooks = {name for name in _shaders() if name.startswith("frame/")}
    assert hooks == {f"frame/{kernel}.wgsl" for kernel in KERNELS} | {f"frame/{part}.wgsl" for part in _PARTS}
    switches = [["is_tilted", "is_dense"], ["has_pupil"], ["is_dense"], [], ["has_pupil"], ["accumulates"]]
    assert [_switches(kernel) for kernel in KERNELS] == switches


def test_an_error_in_a_fused_kernel_names_its_file_and_line(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(KERNELS, "light", ("x", ()))  # no struct PlaneWave
    layout = FrameLayout(device, SHAPES["periodic"], "passes")
    with pytest.raises(ShaderError, match=r"lib/source.wgsl:7: fn plane_wave\(wave: PlaneWave"):
        _compile(device, make_transform(layout, KernelVariant(SHAPES["periodic"], "light", 0)))


def test_the_permutations_cover_every_folder_and_the_pupil() -> None:
    found = list(_permutations())
    assert {name.split("/")[0] for name, _ in found} >= {"display", "lib", "stage"}
    assert ("stage/transmit.wgsl", {"has_pupil": True}) in found
    assert ("stage/transmit.wgsl", {"has_pupil": False}) in found


# --- structs --------------------------------------------------------------------------------------------------------


def _numbers(struct: WgslStruct) -> list[str]:
    """A WGSL f32 expression for every number in the struct, in order of fields."""
    return [
        f"f32(given.{name}{part})"
        for name, _ in struct.fields
        for part in ([f".{c}" for c in "xyzw"[: struct.dtype[name].shape[0]]] if struct.dtype[name].shape else [""])
    ]


@pytest.mark.parametrize("name", STRUCTS)
def test_a_stage_reads_back_every_field_of_its_struct_as_packed(device: Device, name: str) -> None:
    struct, numbers = STRUCTS[name], _numbers(STRUCTS[name])
    values, first = {}, 1
    for field, _ in struct.fields:
        shape = struct.dtype[field].shape
        count = int(np.prod(shape))
        values[field] = np.arange(first, first + count).reshape(shape)
        first += count
    lines = "".join(f"    echo[{i}] = {number};\n" for i, number in enumerate(numbers))
    text = (
        f"@group(0) @binding(0) var<uniform> given: {name};\n"
        "@group(1) @binding(0) var<storage, read_write> echo: array<f32>;\n"
        f"@compute @workgroup_size(1)\nfn main() {{\n{lines}}}\n"
    )
    echo = device.buffer(4 * len(numbers), "echo")
    _run(device, text, [device.uniform(struct.pack(**values), name)], [], echo, 1)
    assert device.download(echo, np.float32, (len(numbers),)).tolist() == list(range(1, first))


# --- phases ---------------------------------------------------------------------------------------------------------

COUNT = 4096
LARGEST = 8192**2  # n = k² at the largest frequency of the longest transform
MULTIPLY_TURNS = """//#include "lib/fixed.wgsl"
@group(1) @binding(0) var<storage, read> n: array<u32>;
@group(1) @binding(1) var<storage, read> words: array<vec2u>;
@group(1) @binding(2) var<storage, read_write> found: array<u32>;
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) { found[id.x] = multiply_turns(n[id.x], words[id.x]); }
"""


def _multiply_turns(device: Device, n: NDArray[np.uint32], words: NDArray[np.uint32]) -> list[int]:
    inputs = [device.upload(n, "n"), device.upload(words, "words")]
    out = device.buffer(4 * COUNT, "found")
    _run(device, MULTIPLY_TURNS, [], inputs, out, COUNT // 64)
    return [int(found) for found in device.download(out, np.uint32, (COUNT,))]


def _factors() -> NDArray[np.uint32]:
    """Whole numbers to 2²⁶: the largest ones, the seams of 16-bit halves, squares, and random ones."""
    rng = np.random.default_rng(4)
    seams = [0, 1, 0xFFFF, 0x10000, 0x10001, LARGEST - 1, LARGEST]
    squares = rng.integers(0, 8193, COUNT // 2) ** 2
    rest = rng.integers(0, LARGEST + 1, COUNT - COUNT // 2 - len(seams))
    return np.concatenate([seams, squares, rest]).astype(np.uint32)


def test_a_multiple_of_fixed_point_turns_is_exact_to_its_last_bit(device: Device) -> None:
    rng, n = np.random.default_rng(5), _factors()
    words = np.stack([rng.integers(0, 2**32, COUNT), rng.integers(0, 2**16, COUNT)], axis=1).astype(np.uint32)
    words[:8] = [0xFFFFFFFF, 0xFFFF]
    for factor, (high, low), found in zip(n.tolist(), words.tolist(), _multiply_turns(device, n, words), strict=True):
        assert found == (factor * ((high << 16) + low) >> 16) % 2**32


def test_a_multiple_of_a_phase_keeps_22_bits_of_a_turn(device: Device) -> None:
    rng, n = np.random.default_rng(6), _factors()
    turns = rng.uniform(-3, 3, COUNT) * 10.0 ** rng.uniform(-9, 0, COUNT)
    words = np.stack([turns_to_fixed_point(t) for t in turns.tolist()])
    for factor, phase, found in zip(n.tolist(), turns.tolist(), _multiply_turns(device, n, words), strict=True):
        off = (Fraction(found, 2**32) - factor * Fraction(phase)) % 1
        assert min(off, 1 - off) <= Fraction(1, 2**22)


PHASE_TOLERANCES = {"10 mm": 4e-7, "200 mm": 5e-6}
"""Radians; seen 3.4e-7 (the sine's polynomial) and 3.9e-6 (the quartic term in f32, which reaches 2.2 turns)."""


@pytest.mark.parametrize("plane", PHASE_TOLERANCES)
def test_the_phase_of_the_transfer_function_is_that_of_double_precision(
    both: Callable[..., Any], bench: Callable[..., Any], plane: str
) -> None:
    """450 nm at 4 µm a sample, 1024 × 768: up to 1400 turns."""
    system = bench(shape=[384, 512], propagation="periodic", wavelengths=["450 nm"], amplitudes=[[1.0]], planes=[plane])
    pair = both(system)
    plan = pair.plan
    ones = pair.shaders.upload_field(np.ones(plan.grid.padded, np.complex64), relay=1)
    found = pair.shaders.download_field(pair.shaders.transmit(ones, 1, 0)).astype(np.complex128)
    expected = transfer_function(plan.transfer(1, 0), plan.grid, torch.complex128, torch.device("cpu"))
    difference = np.angle(found * expected.numpy().conj())
    assert np.abs(difference).max() <= PHASE_TOLERANCES[plane]
    assert np.abs(np.abs(found) - 1).max() <= 4e-7
