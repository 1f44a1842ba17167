"""Complex numbers as texels: copies of a part of a buffer, and limits."""

import numpy as np
import pytest

from holoview.light.gpu.device import Device
from holoview.light.gpu.recorder import CommandRecorder, Dispatch
from holoview.light.gpu.shader import TEXELS, GeneratedWgsl, link
from holoview.light.gpu.texels import COLUMNS, TexelMemory, Texels, fits_texels
from holoview.util.errors import UserError

_READ = """
//#include "lib/texels.wgsl"
@group(0) @binding(0) var given: texture_storage_2d<rg32float, read>;
@group(0) @binding(1) var<storage, read_write> found: array<vec2f>;
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) at: vec3u) {
    if (at.x < arrayLength(&found)) {
        found[at.x] = textureLoad(given, texel_place(at.x)).xy;
    }
}
"""


@pytest.mark.gpu
@pytest.mark.parametrize(("first", "count"), [(0, 1), (3, COLUMNS - 1), (5, COLUMNS), (1, 2 * COLUMNS + 7)])
def test_a_shader_reads_a_part_of_a_buffer_as_it_is_when_it_runs(device: Device, first: int, count: int) -> None:
    numbers = np.random.default_rng(count).standard_normal((first + count + 4, 2)).astype(np.float32)
    source = link(GeneratedWgsl("read", _READ))
    assert source.bindings() == {0: {0: TEXELS, 1: "storage"}}
    given, found = device.upload(np.zeros_like(numbers), "given"), device.buffer(8 * count, "found")
    texels = Texels(TexelMemory(device, count, "texels"), given, first, count)
    step = Dispatch.bind(device, device.pipeline(source), [[texels, found]], (-(-count // 64), 1, 1))
    device.write(given, numbers)
    recorder = CommandRecorder(device)
    recorder.add(step)
    recorder.submit()
    assert np.array_equal(device.download(found, np.float32, (count, 2)), numbers[first : first + count])


@pytest.mark.gpu
def test_a_texture_holds_no_more_than_the_device_allows(device: Device) -> None:
    most = device.limits["max-texture-dimension-2d"]
    assert fits_texels(device, COLUMNS * (most - 1)) and not fits_texels(device, COLUMNS * most + 1)
    with pytest.raises(UserError, match=f"texture 'light': needs {most + 1} rows; expected at most {most} "):
        TexelMemory(device, COLUMNS * most + 1, "light")
    memory, buffer = TexelMemory(device, 10, "texels"), device.buffer(64, "numbers")
    for first, count in ((0, 0), (0, 11), (1, 8)):
        with pytest.raises(ValueError, match="numbers"):
            Texels(memory, buffer, first, count)


@pytest.mark.gpu
@pytest.mark.parametrize("rows", [1, 2, 3, 4, 7, 8, 96])
def test_no_texture_needs_shaders_of_its_own(device: Device, rows: int) -> None:
    """Lavapipe compiles a shader for each pair (columns, rows) of powers of two or not: here always the same pair."""
    memory = TexelMemory(device, rows * COLUMNS, "texels")
    width, height, _ = memory.raw.size
    assert width == COLUMNS and height >= rows and height.bit_count() > 1
    assert memory.nbytes == 8 * width * height
