"""RIG.placement.toml, and what a rig is with it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from holoview.bench.rig import read_rig
from holoview.bench.rig.registration import (
    Registration,
    UncertainValue,
    read_registration,
    register_devices,
    registration_path,
    write_registration,
)
from holoview.util.errors import UserError
from tests.rig.align.hidden_bench import Hidden, devices_of

VALUES = {
    "pitch": UncertainValue(3.9e-6, 1e-9), "rotation": UncertainValue(2e-3, 1e-4),
    "shift_y": UncertainValue(0.4e-6, 1e-7), "shift_x": UncertainValue(1e-8, 1e-7),
    "walk_y": UncertainValue(0.0, 1e-5), "walk_x": UncertainValue(0.0, 1e-5),
    "stage_offset": UncertainValue(0.25e-3, 1e-6), "stage_scale": UncertainValue(0.02, 1e-4),
}  # fmt: skip
REGISTRATION = Registration("rotate_90", None, (3, 5), (80, 96), (40, 48), (148, 132), VALUES)


def test_a_placement_is_read_as_it_was_written_and_written_the_same(tmp_path: Path) -> None:
    file = tmp_path / "rig.placement.toml"
    write_registration(file, REGISTRATION)
    first = file.read_bytes()
    read = read_registration(file)
    write_registration(file, read)
    assert file.read_bytes() == first
    assert dataclasses.replace(read, values={}) == dataclasses.replace(REGISTRATION, values={})
    for name, own in VALUES.items():
        assert abs(read[name] - own.value) <= 0.1 * own.uncertainty


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('camera = "rotate_90"', 'camera = "rotate_80"', "turned.camera"),
        ("first = [3, 5]", "first = [3]", "picture.first"),
        ("first = [3, 5]", "first = [99, 5]", "beyond"),
        ('pitch = ["3.9 um", "0.001 um"]', 'pitch = ["-3.9 um", "0.001 um"]', "can't be"),
        ('pitch = ["3.9 um", "0.001 um"]', "", "values.pitch: is missing"),
        ("[values]", "[valued]", "values: is missing"),
        ("stage_scale", "stage_scales", "stage_scales"),
    ],
)
def test_a_wrong_placement_names_its_key(old: str, new: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "rig.placement.toml"
    write_registration(file, REGISTRATION)
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(UserError, match=message):
        read_registration(file)


def test_what_may_as_well_be_zero_is_not_known() -> None:
    assert REGISTRATION.known_effects() == {"camera_alignment": {"rotation": 2e-3, "shift_y": 0.4e-6}}


def test_a_placed_rig_has_the_measured_pitch_shape_and_distances(tmp_path: Path) -> None:
    described = Hidden("one", (40, 48), camera="rotate_90").write(tmp_path)
    write_registration(registration_path(described.path), REGISTRATION)
    rig = read_rig(described.path)
    assert rig.camera_shape == (80, 96) and rig.bench.camera.pitch_m == 3.9e-6
    assert np.allclose(rig.limits.stage_m, (0.25e-3, 0.25e-3 + 1.02 * 10e-3), rtol=1e-12)
    assert rig.as_described == described


def test_a_placement_of_another_camera_is_refused(tmp_path: Path) -> None:
    rig = Hidden("one", (40, 48)).write(tmp_path)
    write_registration(registration_path(rig.path), REGISTRATION)
    with pytest.raises(UserError, match=r"found_for.camera_shape: \(148, 132\); expected \(132, 148\)"):
        read_rig(rig.path)


def test_placed_devices_turn_crop_and_go_to_distances(tmp_path: Path) -> None:
    """A spot that modulator and camera show is where the pattern has it, whatever both displays are turned by."""
    rig = Hidden("one", (40, 48), camera="rotate_90").write(tmp_path)
    devices, bench = devices_of(rig)
    registered = register_devices(devices, REGISTRATION)
    assert registered.stage.move_to(3e-3) == pytest.approx(3e-3, rel=1e-12)
    assert bench.distance_m == pytest.approx((3e-3 - 0.25e-3) / 1.02, rel=1e-12)
    raw = devices.camera.take()
    bench.take = lambda: raw  # type: ignore[method-assign]
    assert np.array_equal(registered.camera.take(), np.rot90(raw, -1)[3:83, 5:101])
    two = Hidden("two", (48, 48)).write(tmp_path)
    devices, bench = devices_of(two)
    registered = register_devices(devices, dataclasses.replace(REGISTRATION, slm2_turn="rotate_90"))
    pattern = np.zeros((48, 48), np.uint8)
    pattern[3, 7] = 9
    for modulator in registered.modulators:
        modulator.show(pattern)
    bench.wait(1.0)
    assert np.array_equal(bench.levels_now(0), pattern)
    assert np.array_equal(np.rot90(bench.levels_now(1)), pattern)
