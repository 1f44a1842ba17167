"""A session after an edit shows what a fresh one shows, and computes nothing that the edit leaves alone."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from holoview.colour import to_srgb8, xyz_to_linear_srgb
from holoview.engine.frame import compute_focal_stack
from holoview.engine.incremental import IncrementalRenderer
from holoview.engine.torch_executor import TorchExecutor
from holoview.gpu.device import Device, DeviceLost, open_device
from holoview.gpu.line_fft import supported_strategies
from holoview.model.bench_parts import Modulator
from holoview.model.plan import make_plan
from holoview.model.system import System
from holoview.optics.frame_inputs import make_frame_inputs
from holoview.util.errors import UserError
from holoview.view import random_drive

pytestmark = pytest.mark.gpu

MODULATOR = Modulator(pitch_m=8e-6, shape=(25, 32), stroke_m=825e-9)
SYSTEM = System(
    wavelengths_m=[460e-9, 540e-9, 638e-9],
    amplitudes=[[1.0, 2.0, 0.5], [0.0, 1.0, 3.0]],
    modulators=(MODULATOR, MODULATOR),
    gap_m=1e-3,
    planes_m=[3e-3, 4e-3],
)
LIT, WAVELENGTHS = 5, 3

NOTHING: dict[str, int] = {}
PICTURE = {"show": 1}
SEEN = PICTURE | {"composite": 1}
FROM_SECOND = SEEN | {"propagate": LIT, "observe": LIT}
FROM_FIRST = SEEN | {"propagate": 2 * LIT, "modulate": LIT, "observe": LIT}
ALL = FROM_FIRST | {"light": LIT}

EDITS: dict[str, tuple[dict[str, Any], dict[str, int]]] = {
    "nothing": ({}, NOTHING),
    "exposure": ({"exposure_stops": 1.5}, PICTURE),
    "observer": ({"system": {"observer": "cie1931"}}, SEEN),
    "amplitudes": ({"system": {"amplitudes": [[0.5, 1.0, 0.0], [0.0, 2.0, 3.0]]}}, SEEN),
    "a laser that was off": (
        {"system": {"amplitudes": [[1.0, 2.0, 0.5], [1.0, 1.0, 3.0]]}},
        SEEN | {"light": 1, "propagate": 2, "modulate": 1, "observe": 1},
    ),
    "focal plane": ({"plane_m": 3.5e-3}, FROM_SECOND),
    "iris of the second relay": ({"system": {"relay2.iris_na": 0.02}}, FROM_SECOND),
    "gap": ({"system": {"gap": "1.5 mm"}}, FROM_FIRST),
    "iris of the first relay": ({"system": {"relay1.iris_na": 0.02}}, FROM_FIRST),
    "one wavelength": (
        {"system": {"wavelengths": ["460 nm", "550 nm", "638 nm"]}},
        SEEN | {"light": 2, "propagate": 4, "modulate": 2, "observe": 2},
    ),
    "pattern of modulator 2 in one frame": (
        {"drive": (1, 1)},
        SEEN | {"propagate": 4, "modulate": 2, "observe": 2},
    ),
    "pattern of modulator 1 in one frame": (
        {"drive": (1, 0)},
        SEEN | {"light": 2, "propagate": 4, "modulate": 2, "observe": 2},
    ),
    "direction of the light": ({"system": {"source": {"directions": [[0.0, 0.01]]}}}, ALL),
    "stroke": ({"system": {"stroke": "800 nm"}}, ALL),
}
"""An edit, and the kernels that it costs."""


def _edited(session: IncrementalRenderer, drive: np.ndarray, change: dict[str, Any]) -> dict[str, Any]:
    """The arguments of `edit`."""
    out = dict(change)
    if "system" in out:
        out["system"] = session.system.edit(out["system"])
    if "drive" in out:
        changed = drive.copy()
        changed[out["drive"]] = 1 - changed[out["drive"]]
        out["drive"] = changed
    return out


def _cost(session: IncrementalRenderer, act: Callable[[], None]) -> dict[str, int]:
    before = Counter(session.dispatch_counts)
    act()
    return dict(session.dispatch_counts - before)


def _open(device: Device, system: System = SYSTEM, **settings: Any) -> IncrementalRenderer:
    session = IncrementalRenderer(system, random_drive(system), device, **settings)
    session.update()
    return session


def _xyz_stack(session: IncrementalRenderer, planes_m: list[float]) -> np.ndarray:
    """XYZ (plane, y, x, 3) at several planes; the renderer's own plane is restored."""
    before, images = session.plane_m, []
    for plane_m in planes_m:
        session.edit(plane_m=plane_m)
        session.update()
        images.append(session.xyz())
    session.edit(plane_m=before)
    return np.stack(images)


@pytest.mark.parametrize("name", EDITS)
def test_an_edit_costs_only_the_kernels_that_depend_on_it(device: Device, name: str) -> None:
    change, expected = EDITS[name]
    session, drive = _open(device), random_drive(SYSTEM)
    assert session.dispatch_counts == ALL
    session.edit(system=SYSTEM.edit({"gap": "0.9 mm"}))  # that it is edited makes the first rows worth keeping
    session.update()
    session.edit(system=SYSTEM)
    session.update()
    session.edit(**_edited(session, drive, change))
    assert _cost(session, session.update) == expected
    assert _cost(session, session.update) == NOTHING


@pytest.mark.parametrize("name", EDITS)
@pytest.mark.parametrize("budget", [2**30, 200_000, 0], ids=["all kept", "some kept", "nothing kept"])
def test_after_an_edit_a_session_shows_what_a_fresh_one_shows(device: Device, name: str, budget: int) -> None:
    session, drive = _open(device, budget_bytes=budget), random_drive(SYSTEM)
    edit = _edited(session, drive, EDITS[name][0])
    session.edit(**edit)
    session.update()
    given = {"drive": drive, "system": SYSTEM} | edit
    fresh = IncrementalRenderer(given.pop("system"), given.pop("drive"), device, **given)
    fresh.update()
    assert np.array_equal(session.xyz(), fresh.xyz())
    assert np.array_equal(session.srgb8(), fresh.srgb8())
    for wavelength in range(WAVELENGTHS):
        assert np.array_equal(session.intensity(wavelength), fresh.intensity(wavelength))


# --- what is shown --------------------------------------------------------------------------------------------------

TOLERANCE = 1e-6
"""Relative L2 of XYZ against complex128; 4.8e-7 is the worst seen."""
HALF_PSNR_DB = 80.0

BENCHES: dict[str, dict[str, Any]] = {
    "two modulators, padded": {},
    "periodic": {"propagation": "periodic"},
    "one modulator": {"modulators": [{"pitch": "8 um", "shape": [25, 32], "stroke": "825 nm"}], "gap": None},
    "two sources": {"source": {"directions": [[0.0, 0.0], [0.01, -0.02]]}},
    "glass": {"relay1.iris_na": 0.03, "relay1.aberration": {"Z5": "40 nm"}, "relay2.apodisation_na": 0.02},
    "stops, compact": {"relay2.iris_na": 0.02, "relay2.dc_block_na": 0.003, "propagation": "compact"},
}


def _error(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def _reference(system: System, planes_m: list[float]) -> np.ndarray:
    """XYZ (plane, y, x, 3) by torch in complex128."""
    plan = make_plan(system, planes_m)
    return compute_focal_stack(TorchExecutor(plan, make_frame_inputs(plan, random_drive(system)), double=True))[1]


@pytest.mark.parametrize("together", [1, 2, 3])
@pytest.mark.parametrize("name", BENCHES)
def test_a_session_shows_what_torch_computes_in_double_precision(device: Device, name: str, together: int) -> None:
    system = SYSTEM.edit(BENCHES[name])
    session = _open(device, system, max_wavelengths=together)
    expected = _reference(system, [*system.planes_m])[0]
    assert _error(session.xyz(), expected) <= TOLERANCE
    codes = to_srgb8(xyz_to_linear_srgb(session.xyz()))
    assert np.abs(session.srgb8().astype(int) - codes).max() <= 1
    assert np.ptp(codes) > 150


def test_wavelengths_computed_together_or_one_by_one_are_the_same_bit_for_bit(device: Device) -> None:
    alone, together = _open(device), _open(device, max_wavelengths=3)
    assert np.array_equal(alone.xyz(), together.xyz())
    assert together.dispatch_counts["light"] == 2  # three wavelengths of the first frame, two of the second


def test_a_stack_is_what_each_plane_shows_and_shares_the_second_rows(device: Device) -> None:
    session, planes_m = _open(device), [3e-3, 3.5e-3, 4e-3]
    cost: dict[str, int] = {}
    stacks = []
    cost = _cost(session, lambda: stacks.append(_xyz_stack(session, planes_m)))
    assert _error(stacks[0], _reference(SYSTEM, planes_m)) <= TOLERANCE
    assert cost == {name: 2 * count for name, count in FROM_SECOND.items()}  # the first plane was there
    assert session.plane_m == 3e-3


@pytest.mark.parametrize("name", BENCHES)
def test_half_precision_between_kernels_costs_less_than_a_code_of_255(device: Device, name: str) -> None:
    system = SYSTEM.edit(BENCHES[name])
    full, half = _open(device, system), _open(device, system, half=True)
    expected = full.xyz()
    psnr = 10 * np.log10(expected.max() ** 2 / np.mean((half.xyz() - expected) ** 2))
    assert psnr >= HALF_PSNR_DB


def test_exposure_is_in_stops_of_light(device: Device) -> None:
    session = _open(device)
    session.edit(exposure_stops=-2.0)
    session.update()
    codes = to_srgb8(xyz_to_linear_srgb(session.xyz() / 4))
    assert np.abs(session.srgb8().astype(int) - codes).max() <= 1


# --- in steps -------------------------------------------------------------------------------------------------------


def test_an_update_can_be_dropped_and_gone_on_with(device: Device) -> None:
    session = IncrementalRenderer(SYSTEM, random_drive(SYSTEM), device)
    steps = session.steps(wait=True)
    done = [next(steps) for _ in range(3)]
    assert [step.done for step in done] == [1, 2, 3] and done[0].total == LIT + 2
    session.edit(exposure_stops=1.0)
    assert list(steps) == []
    assert _cost(session, session.update) == SEEN | {
        "light": 2, "propagate": 4, "modulate": 2, "observe": 2
    }  # fmt: skip
    assert np.array_equal(session.xyz(), _open(device).xyz())


def test_an_impossible_edit_changes_nothing(device: Device) -> None:
    session = _open(device)
    before = session.xyz()
    with pytest.raises(UserError, match="drive"):
        session.edit(drive=np.zeros((1, 1)), plane_m=5e-3)
    with pytest.raises(UserError, match="planes"):
        session.edit(plane_m=-1.0)
    assert session.plane_m == 3e-3
    assert _cost(session, session.update) == NOTHING
    assert np.array_equal(session.xyz(), before)


def test_the_first_edit_of_the_gap_begins_at_the_source_and_the_next_ones_at_the_gap(device: Device) -> None:
    session = _open(device)
    for gap, cost in (("1.2 mm", ALL), ("1.3 mm", FROM_FIRST), ("1.4 mm", FROM_FIRST)):
        session.edit(system=SYSTEM.edit({"gap": gap}))
        assert _cost(session, session.update) == cost


@pytest.mark.parametrize("name", BENCHES)
def test_transforms_in_subgroups_show_the_same(device: Device, name: str) -> None:
    system = SYSTEM.edit({"shape": [32, 64], **BENCHES[name], "sampling.propagation": "periodic"})
    if "modulators" in BENCHES[name]:
        system = system.edit({"shape": [32, 64]})
    if "subgroup" not in supported_strategies(device, (64, 128)):
        pytest.skip("the lanes of this adapter exchange nothing")
    shown = [_open(device, system, strategy=strategy).xyz() for strategy in ("passes", "subgroup")]
    assert _error(shown[1], shown[0]) <= TOLERANCE


def test_another_grid_is_computed_from_the_start(device: Device) -> None:
    session = _open(device)
    session.edit(system=SYSTEM.edit({"upsample": 1}))
    session.update()
    assert session.dispatch_counts == ALL
    assert session.xyz().shape == (25, 32, 3)


# --- where it can't go on -------------------------------------------------------------------------------------------


def _limited(device: Device, **limits: int) -> Device:
    """The device with lower limits, which are checked before the driver is asked for anything."""
    lower = {name.replace("_", "-"): limit for name, limit in limits.items()}
    return Device(device.raw, device.info, {**device.limits, **lower})


def test_a_bench_beyond_the_limits_is_refused_with_what_to_lower_and_the_session_goes_on(device: Device) -> None:
    session = _open(_limited(device, max_storage_buffer_binding_size=2**18))
    before = session.xyz()
    with pytest.raises(UserError, match=r"needs 1.587 MiB; expected at most 262144 bytes .*lower the size of the grid"):
        session.edit(system=SYSTEM.edit({"shape": [100, 128]}), drive=np.zeros((2, 2, 100, 128), np.float32))
    assert session.system == SYSTEM
    session.edit(plane_m=4e-3)
    session.update()
    session.edit(plane_m=3e-3)
    session.update()
    assert np.array_equal(session.xyz(), before)


def test_a_lost_device_is_told_at_the_next_step(device: Device, wgpu_log: list[str]) -> None:
    lost = open_device(device.info.name)
    session = _open(lost)
    lost.raw.destroy()
    session.invalidate()
    for act in (session.update, session.xyz, lambda: session.edit(plane_m=5e-3)):
        with pytest.raises(DeviceLost, match="reopen the device"):
            act()
    wgpu_log.clear()
