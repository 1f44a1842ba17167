"""The shaders compute chains of elements as torch does in complex128, stage by stage and as a whole."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from holoview.evidence.benchmark.report_run import ExecutorPair, relative_error, stage_errors
from holoview.holograms.view import random_drive, simulate
from holoview.light.engine.compositor import Compositor
from holoview.light.engine.frame import light_along
from holoview.light.engine.fused import BufferRegion, FusedFrame, WavelengthSpan
from holoview.light.engine.fused_kernels import TILE_X, TILE_Y, StoredRows
from holoview.light.engine.light_behind import power_behind
from holoview.light.engine.wgpu_executor import WgpuExecutor
from holoview.light.gpu.device import Device
from holoview.light.gpu.line_fft import supported_strategies
from holoview.light.gpu.recorder import CommandRecorder
from holoview.light.model.chain import Modulate
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.light.optics.frame_inputs import FrameInputs
from tests.explored import explored

pytestmark = pytest.mark.gpu

UM, MM, NM = 1e-6, 1e-3, 1e-9
MOST = 1e-6
"""Relative L2 error of a stage by itself: single precision is 6e-8, a transform of 120 samples adds 2e-7."""


def _pixels(kind: str, **keys: Any) -> dict[str, Any]:
    return {"kind": kind, "pitch": 8 * UM, "shape": (30, 24)} | keys


_SPACE = {"kind": "space", "distance": 1 * MM, "iris_na": 0.03, "aberration": {"Z5": 50 * NM}}
_MASK = {"kind": "mask", "pitch": 4 * UM, "shape": (60, 48), "pattern": "random", "stroke": 700 * NM}
CHAINS: dict[str, list[dict[str, Any]]] = {
    "phase, coarse amplitude": [
        _pixels("phase", stroke=800 * NM),
        _SPACE,
        _pixels("amplitude", pitch=24 * UM, shape=(10, 8)),
    ],
    "a spectrum in place of rows": [
        _pixels("phase", stroke=800 * NM),
        _SPACE,
        _MASK,
        {"kind": "space", "iris_na": 0.01},
    ],
    "complex and mask": [_pixels("complex", stroke=600 * NM), _MASK],
    "side by side": [
        _MASK,
        _SPACE,
        _pixels("phase", stroke=800 * NM, name="one"),
        _pixels("amplitude", beside="one", offset=[8 * UM, 0.0]),
        _MASK | {"beside": "one", "seed": 2},
    ],
    "a modulator beside a mask": [_MASK | {"name": "still"}, _pixels("phase", stroke=800 * NM, beside="still")],
    "binary": [_pixels("amplitude", levels=2, range=[0.1, 0.9])],
    "lens and fourier": [
        _pixels("phase", stroke=800 * NM),
        {"kind": "lens", "focal_length": 20 * MM},
        _SPACE,
        {"kind": "fourier", "focal_length": 2.4 * MM},
        _pixels("amplitude"),
        _SPACE,
        _pixels("phase", stroke=800 * NM),
        {"kind": "space", "square": "first order"},
    ],
}


def _chain(elements: list[dict[str, Any]]) -> System:
    lasers = [532 * NM, 580 * NM]
    return System(lasers, [[1.0, 0.5], [0.0, 1.0]], elements=elements, planes_m=[3 * MM, 4 * MM], observer="mono")


@pytest.mark.parametrize("name", explored(CHAINS, 3))
def test_each_stage_of_a_chain_alone_gives_what_torch_gives(device: Device, name: str) -> None:
    errors = stage_errors(ExecutorPair.open(_chain(CHAINS[name]), device))
    assert not {step: error for step, error in errors.items() if error > MOST}


@pytest.mark.parametrize("name", CHAINS)
def test_a_whole_chain_is_the_same_on_all_backends(name: str) -> None:
    system = _chain(CHAINS[name])
    drive = random_drive(system, seed=2)
    exact = simulate(system, drive, backend="torch64").intensity
    for backend in ("torch", "wgpu"):
        found = simulate(system, drive, backend=backend).intensity
        # independent roundings of up to 30 stages of 2.6e-7 each, in quadrature, √2 times as much in intensity
        assert relative_error(found, exact) < np.sqrt(2 * 30) * 2.6e-7


@pytest.mark.parametrize("name", explored(CHAINS, 1))
def test_the_power_behind_a_chain_is_what_torch_finds(device: Device, name: str) -> None:
    """Of one place it isn't measured."""
    system = _chain(CHAINS[name])
    plan, drive = make_plan(system), random_drive(system, seed=2)
    executor = WgpuExecutor(plan, FrameInputs(plan, drive), device, measures_power=True)
    for wavelength in range(len(plan.system.wavelengths_m)):
        executor.run(wavelength)
    assert (executor.power_behind is None) == (len(plan.way.places) == 1)
    if executor.power_behind is not None:  # sums of 1e4 squares with a few roundings each: measured 5e-7
        np.testing.assert_allclose(executor.power_behind, power_behind(plan, drive), rtol=2e-5)


# --- the fused kernels ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", explored(CHAINS, 1))
def test_each_fused_stage_of_a_chain_alone_gives_what_torch_gives(device: Device, name: str) -> None:
    pair = ExecutorPair.open(_chain(CHAINS[name]), device)
    for strategy in supported_strategies(device, pair.plan.grid.padded):
        fused = FusedFrame(pair.plan, pair.shaders.inputs, device, strategy=strategy, plane=0)
        for span in (WavelengthSpan(0, 0, 0), WavelengthSpan(1, 0, 1)):
            errors = _fused_errors(pair, fused, span)
            assert not {stage: error for stage, error in errors.items() if error > MOST}, strategy


def _fused_errors(pair: ExecutorPair, fused: FusedFrame, span: WavelengthSpan) -> dict[str, float]:
    """Relative L2 error of the light behind each place from the exact light before it, and of the intensity."""
    errors, given, device, plan = {}, None, fused.device, pair.plan
    for place, light in enumerate(_behind_places(pair, span)):
        rows, recorder = fused.rows_behind(place), CommandRecorder(device)
        target = fused.allocate_rows("rows", rows)
        fused.record_place(recorder, span, place, given, target)
        recorder.submit()
        exact, at = _stored(fused, place, light), _indices(rows, is_tiled=fused.strategy == "subgroup")
        errors[f"place {place}"] = relative_error(
            device.download(target.buffer, np.complex64, (rows.samples,))[at], exact
        )
        memory = np.zeros(rows.samples, np.complex64)
        memory[at] = exact
        given = BufferRegion(device.upload(memory, "exact rows"))
    assert given is not None
    recorder, intensity = CommandRecorder(device), Compositor(device, plan.grid.shape).intensity_buffer(1, "intensity")
    fused.record_intensity(recorder, span, given, BufferRegion(intensity))
    recorder.submit()
    spectrum, last = pair.reference.spectrum(pair.reference.upload_field(light), plan.way.places[-1][-1]), plan.way.last
    seen = pair.reference.field(pair.reference.transmit(spectrum, last, span.wavelength, 0), last)
    exact = np.abs(pair.reference.download_field(seen)) ** 2
    errors["intensity"] = relative_error(device.download(intensity, np.float32, plan.grid.shape), exact)
    return errors


def _behind_places(pair: ExecutorPair, span: WavelengthSpan) -> list[NDArray[np.complexfloating]]:
    """The light (y, x) of torch behind the last element at each place."""
    lasts = {numbers[-1] for numbers in pair.plan.way.places}
    along = light_along(pair.reference, span.wavelength, span.frame, span.source)
    return [
        pair.reference.download_field(light)
        for step, (_, light) in zip(pair.plan.way.steps, along, strict=False)
        if isinstance(step, Modulate) and step.number in lasts
    ]


def _stored(fused: FusedFrame, place: int, light: NDArray[np.complexfloating]) -> NDArray[np.complex128]:
    """What a frame stores of light (y, x): its spectra along x, or along both axes, at the stored frequencies."""
    grid, relay = fused.grid, fused.fused_kernels.shape.first_relay + place
    padded = np.zeros(grid.padded, np.complex128)
    padded[grid.inside] = light
    lines = np.fft.fft(padded, axis=1)[:, fused.layout.columns(relay).frequencies()]
    if fused.rows_behind(place) == fused.layout.spectrum and fused.layout.keeps_spectrum:
        return np.fft.fft(lines, axis=0)[fused.layout.spectrum_rows().frequencies()]
    return lines[grid.inside[0]]


def _indices(rows: StoredRows, *, is_tiled: bool) -> NDArray[np.int64]:
    """Where each number (y, x) of rows lies in memory: row by row, or in tiles."""
    y, x = np.arange(rows.rows)[:, None], np.arange(rows.columns)[None, :]
    if not is_tiled:
        return y * rows.stride + x
    bands = y // TILE_Y * rows.stride * TILE_Y + y % TILE_Y * TILE_X
    return bands + x // TILE_X * TILE_X * TILE_Y + x % TILE_X
