"""After an edit a renderer has the results of a new one, and recomputes only what depends on the edit."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from holoview.holograms.view import random_drive
from holoview.light.colour import to_srgb8, xyz_to_linear_srgb
from holoview.light.engine import compositor
from holoview.light.engine.frame import compute_focal_stack
from holoview.light.engine.incremental import IncrementalRenderer
from holoview.light.engine.torch_executor import TorchExecutor
from holoview.light.gpu.device import SUBGROUP, Device, DeviceLost, open_device
from holoview.light.gpu.line_fft import Strategy, supported_strategies
from holoview.light.model.bench_parts import Modulator
from holoview.light.model.effects.registry import load_user_effects, without_user_effects
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.util.errors import UserError
from tests.explored import explored, one_of_each

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
AGREEMENT = 2e-6
"""Relative L2 of two XYZ that are each within 1e-6 of the truth, as `tests/parity` checks."""

NOTHING: dict[str, int] = {}
SRGB = {"show": 1}
XYZ = SRGB | {"composite": 1}
FROM_SECOND = XYZ | {"propagate": LIT, "observe": LIT}
FROM_FIRST = XYZ | {"propagate": 2 * LIT, "modulate": LIT, "observe": LIT}
ALL = FROM_FIRST | {"light": LIT}

EDITS: dict[str, tuple[dict[str, Any], dict[str, int]]] = {
    "nothing": ({}, NOTHING),
    "exposure": ({"exposure_stops": 1.5}, SRGB),
    "observer": ({"system": {"observer": "cie1931"}}, XYZ),
    "amplitudes": ({"system": {"amplitudes": [[0.5, 1.0, 0.0], [0.0, 2.0, 3.0]]}}, XYZ),
    "a laser that was off": (
        {"system": {"amplitudes": [[1.0, 2.0, 0.5], [1.0, 1.0, 3.0]]}},
        XYZ | {"light": 1, "propagate": 2, "modulate": 1, "observe": 1},
    ),
    "focal plane": ({"plane_m": 3.5e-3}, FROM_SECOND),
    "iris of the second relay": ({"system": {"relay2.iris_na": 0.02}}, FROM_SECOND),
    "gap": ({"system": {"gap": "1.5 mm"}}, FROM_FIRST),
    "iris of the first relay": ({"system": {"relay1.iris_na": 0.02}}, FROM_FIRST),
    "one wavelength": (
        {"system": {"wavelengths": ["460 nm", "550 nm", "638 nm"]}},
        XYZ | {"light": 2, "propagate": 4, "modulate": 2, "observe": 2},
    ),
    "pattern of modulator 2 in one frame": (
        {"drive": (1, 1)},
        XYZ | {"propagate": 4, "modulate": 2, "observe": 2},
    ),
    "pattern of modulator 1 in one frame": (
        {"drive": (1, 0)},
        XYZ | {"light": 2, "propagate": 4, "modulate": 2, "observe": 2},
    ),
    "direction of the light": ({"system": {"source": {"directions": [[0.0, 0.01]]}}}, ALL),
    "stroke": ({"system": {"stroke": "800 nm"}}, ALL),
}
"""Each edit, and the number of dispatches of each kernel that it takes."""


def _edited(renderer: IncrementalRenderer, drive: np.ndarray, change: dict[str, Any]) -> dict[str, Any]:
    """The arguments of `edit`."""
    out = dict(change)
    if "system" in out:
        out["system"] = renderer.system.edit(out["system"])
    if "drive" in out:
        changed = drive.copy()
        changed[out["drive"]] = 1 - changed[out["drive"]]
        out["drive"] = changed
    return out


def _cost(renderer: IncrementalRenderer, act: Callable[[], None]) -> dict[str, int]:
    before = Counter(renderer.dispatch_counts)
    act()
    return dict(renderer.dispatch_counts - before)


def _open(device: Device, system: System = SYSTEM, **settings: Any) -> IncrementalRenderer:
    renderer = IncrementalRenderer(system, random_drive(system), device, **{"max_wavelengths": 1} | settings)
    renderer.update()
    return renderer


def _xyz_stack(renderer: IncrementalRenderer, planes_m: list[float]) -> np.ndarray:
    """XYZ (plane, y, x, 3) at several planes; the renderer's own plane is restored."""
    before, images = renderer.plane_m, []
    for plane_m in planes_m:
        renderer.edit(plane_m=plane_m)
        renderer.update()
        images.append(renderer.xyz())
    renderer.edit(plane_m=before)
    return np.stack(images)


@pytest.mark.parametrize("name", EDITS)
def test_an_edit_costs_only_the_kernels_that_depend_on_it(device: Device, name: str) -> None:
    change, expected = EDITS[name]
    renderer, drive = _open(device), random_drive(SYSTEM)
    assert renderer.dispatch_counts == ALL
    renderer.edit(system=SYSTEM.edit({"gap": "0.9 mm"}))  # after an edit of the gap the first rows are stored
    renderer.update()
    renderer.edit(system=SYSTEM)
    renderer.update()
    renderer.edit(**_edited(renderer, drive, change))
    assert _cost(renderer, renderer.update) == expected
    assert _cost(renderer, renderer.update) == NOTHING


STOPS = {"relay1.square": "first order", "relay2.square": "first order", "propagation": "periodic", "shape": [24, 32]}


def test_a_focal_plane_behind_a_stop_is_computed_from_the_stored_spectrum(device: Device) -> None:
    renderer = _open(device, SYSTEM.edit(STOPS))
    assert renderer.dispatch_counts["spectrum"] == renderer.dispatch_counts["propagate"] == LIT
    renderer.edit(plane_m=3.5e-3)
    assert _cost(renderer, renderer.update) == XYZ | {"image": LIT, "observe": LIT}
    renderer.edit(system=renderer.system.edit({"gap": "0.9 mm"}))
    renderer.update()
    renderer.edit(system=renderer.system.edit({"gap": "1.1 mm"}))
    behind_gap = dict.fromkeys(("propagate", "modulate", "spectrum", "image", "observe"), LIT)
    assert _cost(renderer, renderer.update) == XYZ | behind_gap


@pytest.mark.explores
def test_stops_of_the_first_order_halve_the_memory(device: Device) -> None:
    """Rows and columns of spectra are halved; intensities have all samples, because their band is twice as wide. So
    large that whole rows of textures, of which small ones have three, are few."""
    narrow, wide = (
        _open(device, SYSTEM.edit({**STOPS, "shape": [192, 256], **stops}), strategy="workgroup")
        for stops in ({}, {"relay1.square": None, "relay2.square": None})
    )
    assert narrow.compositor.texel_bytes == wide.compositor.texel_bytes
    intensities = LIT * 384 * 512 * 4 + wide.compositor.texel_bytes
    assert narrow.memory_bytes - intensities <= 0.45 * (wide.memory_bytes - intensities)
    assert narrow.traffic_bytes <= 0.7 * wide.traffic_bytes


@pytest.mark.parametrize("strategy", explored(["passes", "workgroup"], ["passes"]))
def test_a_stop_can_be_narrowed_widened_and_moved(device: Device, strategy: Strategy) -> None:
    system = SYSTEM.edit(STOPS)
    renderer = _open(device, system, strategy=strategy)
    moved = {"relay2.square": 0.02, "relay2.centre_na": [0.0, 0.03]}
    for change in ({"relay2.square": 0.01}, moved, {"relay1.square": None}, {"relay2": {}}, STOPS):
        system = system.edit(change)
        renderer.edit(system=system)
        renderer.update()
        plan = make_plan(system, [renderer.plane_m])
        inputs = FrameInputs(plan, random_drive(SYSTEM.edit(STOPS)))
        expected = compute_focal_stack(TorchExecutor(plan, inputs, double=True))[1][0]
        assert np.linalg.norm(renderer.xyz() - expected) <= 1e-6 * np.linalg.norm(expected), change


@pytest.mark.parametrize(("name", "budget"), one_of_each(product(EDITS, [2**30, 200_000, 0])))
def test_after_an_edit_a_renderer_shows_what_a_fresh_one_shows(device: Device, name: str, budget: int) -> None:
    renderer, drive = _open(device, budget_bytes=budget), random_drive(SYSTEM)
    edit = _edited(renderer, drive, EDITS[name][0])
    renderer.edit(**edit)
    renderer.update()
    given = {"drive": drive, "system": SYSTEM} | edit
    fresh = IncrementalRenderer(given.pop("system"), given.pop("drive"), device, **given)
    fresh.update()
    both = [(renderer.xyz(), fresh.xyz())]
    both += [(renderer.intensity(wavelength), fresh.intensity(wavelength)) for wavelength in range(WAVELENGTHS)]
    for found, expected in both:
        if "iris" in name:  # the fresh one has kernels that compute less, and round in another order
            assert np.linalg.norm(found - expected) <= AGREEMENT * np.linalg.norm(expected)
        else:
            assert np.array_equal(found, expected)
    assert np.abs(renderer.srgb8().astype(int) - fresh.srgb8()).max() <= ("iris" in name)


# --- a laser's light added to the sum of the others' ---------------------------------------------------------------

OTHERS, LAST = {"composite": 2}, {"composite": 1}
"""Dispatches of a laser's first edit, which stores the sum of the others, and of each further one."""


def _amplitudes(**changes: float) -> dict[str, Any]:
    """An edit of amplitudes of SYSTEM, by frame and wavelength, such as f0w2."""
    amplitudes = SYSTEM.amplitudes.copy()
    for name, value in changes.items():
        amplitudes[int(name[1]), int(name[3])] = value
    return {"system": SYSTEM.edit({"amplitudes": amplitudes})}


def _assert_equal_to_rounding(renderer: IncrementalRenderer, fresh: np.ndarray) -> None:
    """n products and n - 1 sums of numbers that aren't negative round n times, in either order."""
    assert np.all(np.abs(renderer.xyz() - fresh) <= 2 * (LIT + 1) * 2.0**-24 * fresh)


def _fresh(device: Device, edit: dict[str, Any]) -> np.ndarray:
    given = {"system": SYSTEM, "drive": random_drive(SYSTEM)} | edit
    fresh = IncrementalRenderer(given.pop("system"), given.pop("drive"), device, max_wavelengths=1, **given)
    fresh.update()
    return fresh.xyz()


@pytest.mark.parametrize(
    "edits",
    [
        [(_amplitudes(f0w1=0.3), OTHERS), (_amplitudes(f0w1=4.0), LAST), (_amplitudes(f0w1=4.0), NOTHING)],
        [(_amplitudes(f1w2=0.3), OTHERS), (_amplitudes(f1w2=0.3, f0w0=2.0), OTHERS), (_amplitudes(f0w0=3.0), OTHERS)],
        [(_amplitudes(f0w0=0.3, f0w1=0.1), OTHERS), (_amplitudes(f0w1=0.2), LAST), (_amplitudes(f0w1=0.9), LAST)],
        [(_amplitudes(f0w1=0.3), OTHERS), (_amplitudes(f0w1=0.0), LAST), (_amplitudes(f0w1=1.0), LAST)],
        [({"system": SYSTEM.edit({"amplitudes": 2 * SYSTEM.amplitudes})}, LAST)],
        [(_amplitudes(f0w1=0.3), OTHERS), ({"plane_m": 3.5e-3}, LAST | {"propagate": LIT, "observe": LIT})],
    ],
    ids=["one", "in turn", "two", "off and on", "all", "another plane"],
)
def test_the_light_of_an_edited_laser_is_added_to_the_sum_of_the_others(
    device: Device, edits: list[tuple[dict[str, Any], dict[str, int]]]
) -> None:
    renderer = _open(device)
    for edit, cost in edits:
        renderer.edit(**edit)
        assert _cost(renderer, lambda: renderer.update(with_srgb=False, may_reorder=True)) == cost
        fresh = _fresh(device, {"system": renderer.system, "plane_m": renderer.plane_m})
        _assert_equal_to_rounding(renderer, fresh)
    renderer.update()
    assert np.array_equal(renderer.xyz(), fresh)


@pytest.mark.parametrize("strategy", ["passes", "subgroup"])
def test_numbers_read_as_texels_or_from_a_buffer_give_the_same_image_bit_for_bit(
    device: Device, strategy: Strategy
) -> None:
    found = []
    for each in (device, open_device(device.info.name, features=(SUBGROUP,))):
        if strategy not in supported_strategies(each, (64, 64)):
            pytest.skip("this adapter's lanes exchange nothing")
        renderer = _open(each, strategy=strategy)
        found.append(renderer.xyz())
        renderer.edit(**_amplitudes(f0w1=0.3))
        renderer.update(may_reorder=True)
        found.append(renderer.xyz())
    assert np.array_equal(found[:2], found[2:]) and not np.array_equal(*found[:2])


def test_intensities_that_are_added_a_few_at_a_time_give_the_same_bits(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = _open(device)
    for each in (1, 2):
        monkeypatch.setattr(compositor, "MOST_TEXELS", each * whole.compositor.intensity_bytes // 8)
        assert np.array_equal(_open(device).xyz(), whole.xyz())


def test_without_room_for_the_sum_of_the_others_all_are_added_anew(device: Device) -> None:
    intensities = _open(device).compositor.intensity_bytes * 6
    renderer = _open(device, budget_bytes=intensities)
    renderer.edit(**_amplitudes(f0w1=0.3))
    assert _cost(renderer, lambda: renderer.update(with_srgb=False, may_reorder=True)) == LAST
    assert np.array_equal(renderer.xyz(), _fresh(device, _amplitudes(f0w1=0.3)))


# --- results ----------------------------------------------------------------------------------------------------

TOLERANCE = 1e-6
"""Relative L2 of XYZ against complex128; 4.8e-7 is the worst seen."""
HALF_PSNR_DB = 80.0

SYSTEMS: dict[str, dict[str, Any]] = {
    "two modulators, padded": {},
    "periodic": {"propagation": "periodic"},
    "one modulator": {"modulators": [{"pitch": "8 um", "shape": [25, 32], "stroke": "825 nm"}], "gap": None},
    "two sources": {"source": {"directions": [[0.0, 0.0], [0.01, -0.02]]}},
    "pupils": {"relay1.iris_na": 0.03, "relay1.aberration": {"Z5": "40 nm"}, "relay2.apodisation_na": 0.02},
    "stops, compact": {"relay2.iris_na": 0.02, "relay2.dc_block_na": 0.003, "propagation": "compact"},
}


def _error(actual: np.ndarray, expected: np.ndarray) -> float:
    return float(np.linalg.norm(actual - expected) / np.linalg.norm(expected))


def _reference(system: System, planes_m: list[float]) -> np.ndarray:
    """XYZ (plane, y, x, 3) by torch in complex128."""
    plan = make_plan(system, planes_m)
    return compute_focal_stack(TorchExecutor(plan, FrameInputs(plan, random_drive(system)), double=True))[1]


@pytest.mark.parametrize("together", explored([1, 2, 3], [2]))
@pytest.mark.parametrize("name", explored(SYSTEMS, 3))
def test_a_renderer_shows_what_torch_computes_in_double_precision(device: Device, name: str, together: int) -> None:
    system = SYSTEM.edit(SYSTEMS[name])
    renderer = _open(device, system, max_wavelengths=together)
    expected = _reference(system, [*system.planes_m])[0]
    assert _error(renderer.xyz(), expected) <= TOLERANCE
    codes = to_srgb8(xyz_to_linear_srgb(renderer.xyz()))
    assert np.abs(renderer.srgb8().astype(int) - codes).max() <= 1
    assert np.ptp(codes) > 150


def test_wavelengths_computed_together_or_one_by_one_are_the_same_bit_for_bit(device: Device) -> None:
    alone, together = _open(device), _open(device, max_wavelengths=3)
    assert np.array_equal(alone.xyz(), together.xyz())
    assert together.dispatch_counts["light"] == 2  # three wavelengths of the first frame, two of the second


@pytest.mark.parametrize(
    ("kind", "budget_bytes", "together"),
    [("DiscreteGPU", 2**30, 3), ("DiscreteGPU", 0, 1), ("IntegratedGPU", 2**30, 1), ("CPU", 2**30, 1)],
)
def test_a_card_computes_wavelengths_together_as_memory_allows(
    device: Device, monkeypatch: pytest.MonkeyPatch, kind: str, budget_bytes: int, together: int
) -> None:
    monkeypatch.setattr(device, "info", replace(device.info, kind=kind))
    renderer = _open(device, max_wavelengths=None, budget_bytes=budget_bytes)
    lit = int((SYSTEM.amplitudes > 0).sum())
    assert (renderer.dispatch_counts["light"] < lit) == (together > 1)
    assert np.array_equal(renderer.xyz(), _open(device, max_wavelengths=together).xyz())


def test_planes_of_a_focal_stack_share_the_second_rows(device: Device) -> None:
    renderer, planes_m = _open(device), [3e-3, 3.5e-3, 4e-3]
    cost: dict[str, int] = {}
    stacks = []
    cost = _cost(renderer, lambda: stacks.append(_xyz_stack(renderer, planes_m)))
    assert _error(stacks[0], _reference(SYSTEM, planes_m)) <= TOLERANCE
    assert cost == {name: 2 * count for name, count in FROM_SECOND.items()}  # the first plane was there
    assert renderer.plane_m == 3e-3


@pytest.mark.parametrize("name", explored(SYSTEMS, ["one modulator"]))
def test_half_precision_between_kernels_costs_less_than_a_code_of_255(device: Device, name: str) -> None:
    system = SYSTEM.edit(SYSTEMS[name])
    full, half = _open(device, system), _open(device, system, half=True)
    expected = full.xyz()
    psnr = 10 * np.log10(expected.max() ** 2 / np.mean((half.xyz() - expected) ** 2))
    assert psnr >= HALF_PSNR_DB


def test_exposure_is_in_stops_of_light(device: Device) -> None:
    renderer = _open(device)
    renderer.edit(exposure_stops=-2.0)
    renderer.update()
    codes = to_srgb8(xyz_to_linear_srgb(renderer.xyz() / 4))
    assert np.abs(renderer.srgb8().astype(int) - codes).max() <= 1


# --- in steps -------------------------------------------------------------------------------------------------------


def test_an_update_can_be_dropped_and_gone_on_with(device: Device) -> None:
    renderer = IncrementalRenderer(SYSTEM, random_drive(SYSTEM), device)
    steps = renderer.steps(wait=True)
    done = [next(steps) for _ in range(3)]
    assert [step.done for step in done] == [1, 2, 3] and done[0].total == LIT + 2
    renderer.edit(exposure_stops=1.0)
    assert list(steps) == []
    assert _cost(renderer, renderer.update) == XYZ | {
        "light": 2, "propagate": 4, "modulate": 2, "observe": 2
    }  # fmt: skip
    assert np.array_equal(renderer.xyz(), _open(device).xyz())


def test_an_impossible_edit_changes_nothing(device: Device) -> None:
    renderer = _open(device)
    before = renderer.xyz()
    with pytest.raises(UserError, match="drive"):
        renderer.edit(drive=np.zeros((1, 1)), plane_m=5e-3)
    with pytest.raises(UserError, match="planes"):
        renderer.edit(plane_m=-1.0)
    assert renderer.plane_m == 3e-3
    assert _cost(renderer, renderer.update) == NOTHING
    assert np.array_equal(renderer.xyz(), before)


FAILING = """
from holoview.light.effects import Effect, Parameter


class Failing(Effect):
    id, cause, finding = "failing", "It fails.", "It fails by {on}."
    parameters = (Parameter("on", "How much.", low=0.0, high=2.0),)
    acts_on = ("modulator 1", "modulator 2", "relay 1", "relay 2")

    def {hook}(self, value, {arguments}v):
        if v["on"] == 2 and {is_last}:
            raise ValueError("late")
        return {result}
"""
LAST_MODULATOR, LAST_RELAY = "context.number == 1 and context.laser == 2", "context.relay == 1"
FAILING_HOOKS = {
    "actual_system": ("", "True", 'value.edit({"gap": value.gap_m + 1e-5})'),
    "laser_power": ("", "True", "value * 0.9"),
    "stroke_response": ("context, ", LAST_MODULATOR, "value * 0.9"),
    "settled_share": ("before, context, ", LAST_MODULATOR, "value * 0.9 + 0.1 * before"),
    "optical_path": ("context, ", LAST_MODULATOR, "value * 0.9"),
    "transmission": ("context, ", LAST_MODULATOR, "value * 0.9"),
    "slm2_pose": ("", "True", "type(value)((0.0, 1e-6))"),
    "pupil": ("context, ", LAST_RELAY, "value * 0.9"),
}
"""Of each hook on light: its further arguments, whether a call is one of the last, and what it returns."""


@pytest.mark.parametrize(("hook", "begins_without"), one_of_each(product(FAILING_HOOKS, [False, True])))
def test_an_effect_that_fails_late_changes_nothing(
    device: Device, tmp_path: Path, hook: str, begins_without: bool
) -> None:
    """Beside other edits, with tables of the same size and of another: the next picture is that before, to the bit."""
    arguments, is_last, result = FAILING_HOOKS[hook]
    file = tmp_path / "failing.py"
    text = FAILING.replace("{hook}", hook).replace("{arguments}", arguments).replace("{is_last}", is_last)
    file.write_text(text.replace("{result}", result), encoding="utf-8")
    with without_user_effects():
        load_user_effects(file)
        system = SYSTEM if begins_without else SYSTEM.edit({"effects": {"failing": {"on": 1.0}}})
        renderer = _open(device, system)
        before, drive = renderer.xyz(), renderer.drive
        others = {"gap": "3 mm", "wavelengths": ["450 nm", "550 nm", "620 nm"], "source": {"directions": [[0, 0.01]]}}
        with pytest.raises(UserError, match=f"effects.failing: its {hook} failed"):
            renderer.edit(
                system=system.edit({**others, "effects": {"failing": {"on": 2.0}}}), drive=1 - drive, plane_m=4e-3
            )
        assert renderer.system == system and renderer.plane_m == 3e-3 and renderer.drive is drive
        assert _cost(renderer, renderer.update) == NOTHING
        renderer.invalidate()
        renderer.update()
        assert np.array_equal(renderer.xyz(), before)
        edited = system.edit({"gap": "1.5 mm"})
        renderer.edit(system=edited, plane_m=3.5e-3)
        renderer.update()
        fresh = IncrementalRenderer(edited, drive, device, plane_m=3.5e-3, max_wavelengths=1)
        fresh.update()
        assert np.array_equal(renderer.xyz(), fresh.xyz())


def test_the_first_edit_of_the_gap_begins_at_the_source_and_the_next_ones_at_the_gap(device: Device) -> None:
    renderer = _open(device)
    for gap, cost in (("1.2 mm", ALL), ("1.3 mm", FROM_FIRST), ("1.4 mm", FROM_FIRST)):
        renderer.edit(system=SYSTEM.edit({"gap": gap}))
        assert _cost(renderer, renderer.update) == cost


@pytest.mark.parametrize("propagation", explored(["periodic", "linear"], ["periodic"]))
@pytest.mark.parametrize("name", explored(SYSTEMS, ["periodic"]))
def test_transforms_in_subgroups_show_the_same(device: Device, name: str, propagation: str) -> None:
    """Lines of 256 samples, which are read and written in fours."""
    shape = [32, 128] if propagation == "periodic" else [16, 64]
    system = SYSTEM.edit({"shape": shape, **SYSTEMS[name], "sampling.propagation": propagation})
    if "modulators" in SYSTEMS[name]:
        system = system.edit({"shape": shape})
    if "subgroup" not in supported_strategies(device, make_plan(system).grid.padded):
        pytest.skip("the lanes of this adapter exchange nothing")
    shown = [_open(device, system, strategy=strategy).xyz() for strategy in ("passes", "subgroup")]
    assert _error(shown[1], shown[0]) <= TOLERANCE


def test_another_grid_is_computed_from_the_start(device: Device) -> None:
    renderer = _open(device)
    renderer.edit(system=SYSTEM.edit({"upsample": 1}))
    renderer.update()
    assert renderer.dispatch_counts == ALL
    assert renderer.xyz().shape == (25, 32, 3)


# --- limits and failures ----------------------------------------------------------------------------------------


def _limited(device: Device, **limits: int) -> Device:
    """The device with lower limits, which are checked before the driver is asked for anything."""
    lower = {name.replace("_", "-"): limit for name, limit in limits.items()}
    return Device(device.raw, device.info, {**device.limits, **lower})


def test_a_bench_beyond_the_limits_is_refused_with_what_to_lower_and_the_renderer_goes_on(device: Device) -> None:
    renderer = _open(_limited(device, max_storage_buffer_binding_size=2**18))
    before = renderer.xyz()
    with pytest.raises(UserError, match=r"needs 1.587 MiB; expected at most 262144 bytes .*lower the size of the grid"):
        renderer.edit(system=SYSTEM.edit({"shape": [100, 128]}), drive=np.zeros((2, 2, 100, 128), np.float32))
    assert renderer.system == SYSTEM
    renderer.edit(plane_m=4e-3)
    renderer.update()
    renderer.edit(plane_m=3e-3)
    renderer.update()
    assert np.array_equal(renderer.xyz(), before)


def test_a_lost_device_is_told_at_the_next_step(device: Device, wgpu_log: list[str]) -> None:
    lost = open_device(device.info.name)
    renderer = _open(lost)
    lost.raw.destroy()
    renderer.invalidate()
    for act in (renderer.update, renderer.xyz, lambda: renderer.edit(plane_m=5e-3)):
        with pytest.raises(DeviceLost, match="reopen the device"):
            act()
    wgpu_log.clear()
