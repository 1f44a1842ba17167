"""Lasers and a stage that a person sets: what is said, what is typed, and the end of the input."""

from __future__ import annotations

import io

import pytest

from holoview.bench.rig import open_rig
from holoview.bench.rig.devices import DeviceError, Devices
from holoview.util.errors import UserError
from tests.rig.kinds.conftest import WriteRig

MANUAL = 'device = "manual"'


def _typing(monkeypatch: pytest.MonkeyPatch, *lines: str) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("".join(f"{line}\n" for line in lines)))


@pytest.fixture
def devices(write_rig: WriteRig) -> Devices:
    return open_rig(write_rig(lasers=MANUAL, stage=MANUAL))


def _said(capsys: pytest.CaptureFixture[str]) -> list[str]:
    return [line for line in capsys.readouterr().err.splitlines() if not line.startswith("running")]


def test_lasers_are_asked_for_once_and_switched_off_at_the_end(
    devices: Devices, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _typing(monkeypatch, "", "", "")
    with devices:
        devices.lasers.switch_on(450e-9, 0.5)
        devices.lasers.switch_on(450e-9, 0.5)
        devices.lasers.switch_on(638e-9, 0.8)
    assert _said(capsys) == [
        "lasers: switch 450 nm on at 0.5 of its power, and all others off, then press Enter",
        "lasers: switch 638 nm on at 0.8 of its power, and all others off, then press Enter",
        "lasers: switch all lasers off, then press Enter",
    ]


def test_lasers_of_which_nothing_is_known_are_asked_to_be_off(
    devices: Devices, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _typing(monkeypatch, "")
    devices.lasers.switch_off()  # before a dark frame
    devices.lasers.switch_off()
    assert len(_said(capsys)) == 1


def test_safety_limits_hold_before_anything_is_said(devices: Devices, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(UserError, match=r"power: 0\.81"):
        devices.lasers.switch_on(450e-9, 0.81)
    with pytest.raises(UserError, match=r"stage: 0\.5 mm"):
        devices.stage.move_to(0.5e-3)
    assert _said(capsys) == []


@pytest.mark.parametrize(
    ("typed", "found_m"), [("", 5e-3), ("5.02", 5.02e-3), ("5.02 mm", 5.02e-3), ("5010 um", 5.01e-3)]
)
def test_the_position_that_is_read_can_be_typed(
    devices: Devices, monkeypatch: pytest.MonkeyPatch, typed: str, found_m: float
) -> None:
    _typing(monkeypatch, typed)
    assert devices.stage.move_to(5e-3) == pytest.approx(found_m, rel=1e-12)
    assert devices.stage.move_to(5e-3) == 5e-3  # nothing is asked where it is there already


def test_what_is_no_position_is_asked_again(
    devices: Devices, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _typing(monkeypatch, "five", "5 kg", "500", "5.1")
    assert devices.stage.move_to(5e-3) == pytest.approx(5.1e-3, rel=1e-12)
    said = _said(capsys)
    assert said[0] == "stage: move the camera to 5 mm (and type the position if you read another one), then press Enter"
    assert [line.partition(" is no")[0] for line in said[1:]] == ['stage: "five"', 'stage: "5 kg"', 'stage: "500"']


def test_the_end_of_the_input_is_an_error_of_the_device(devices: Devices, monkeypatch: pytest.MonkeyPatch) -> None:
    _typing(monkeypatch)
    with pytest.raises(
        DeviceError, match=r"lasers: nobody answered: switch 450 nm on .*; run the command in a terminal"
    ):
        devices.lasers.switch_on(450e-9, 0.5)
    with pytest.raises(DeviceError, match="lasers: nobody answered: switch all lasers off"):
        devices.close()


def test_a_camera_cannot_be_manual_and_a_stage_has_no_options(write_rig: WriteRig) -> None:
    with pytest.raises(
        UserError, match=r'camera.device: "manual" has no camera; expected this kind for: lasers, stage'
    ):
        open_rig(write_rig(camera=MANUAL))
    with pytest.raises(UserError, match=r'stage.port: unknown option of device = "manual"'):
        open_rig(write_rig(stage=MANUAL + '\nport = "COM3"'))
