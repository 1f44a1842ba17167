"""Devices in a Python file of one's own: run once, checked against rig.toml, and their exceptions name the device."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from holoview.bench.rig import open_rig
from holoview.bench.rig.devices import DeviceError
from holoview.util.errors import UserError
from tests.rig.kinds.conftest import FAKES, WriteRig


def _python(class_name: str, file: str = "mine.py") -> str:
    return f'device = "python"\nfile = "{file}"\nclass = "{class_name}"'


def test_a_rig_of_ones_own_devices_shows_and_takes(write_rig: WriteRig, capsys: pytest.CaptureFixture[str]) -> None:
    rig = write_rig()
    with open_rig(rig) as devices:
        devices.lasers.switch_on(450e-9, 0.5)
        devices.modulators[0].show(np.full((6, 8), 15, np.uint8))
        picture = devices.camera.take()
    assert picture.dtype == np.uint16 and picture.shape == (10, 12)
    said = capsys.readouterr().err.splitlines()
    assert said == [f"running {rig.path.parent / 'fakes.py'} for its devices"]  # once, for four devices


def test_arguments_reach_the_class(write_rig: WriteRig, tmp_path: Path) -> None:
    source = FAKES + "\nclass Mine(Slm):\n    def __init__(self, *, settle): self.settle_s = settle\n"
    (tmp_path / "mine.py").write_text(source, encoding="utf-8")
    with open_rig(write_rig(slm1=_python("Mine") + "\narguments = { settle = 0.25 }")) as devices:
        assert devices.modulators[0].settle_s == 0.25
    with open_rig(write_rig(slm1=_python("Slm") + "\nsettle = 0.5")) as devices:
        assert devices.modulators[0].settle_s == 0.5


def test_safety_limits_hold(write_rig: WriteRig) -> None:
    with open_rig(write_rig()) as devices:
        with pytest.raises(UserError, match=r"power: 0\.9"):
            devices.lasers.switch_on(450e-9, 0.9)
        with pytest.raises(UserError, match="exposure: 1 s"):
            devices.camera.set_exposure(1.0)
        with pytest.raises(UserError, match="stage: 16 mm"):
            devices.stage.move_to(16e-3)
        assert devices.camera.exposures_s == (1e-5, 0.5)
        assert devices.stage.range_m == (1e-3, 15e-3)


@pytest.mark.parametrize(
    ("device", "name", "source", "message"),
    [
        ("camera", "Bad", "class Bad(Camera): shape = (5, 5)", "camera: has 5 × 5 pixels; expected 10 × 12"),
        ("camera", "Bad", "class Bad:\n    shape = (10, 12)", "rig.toml: camera.class: Bad has no `exposures_s`"),
        ("camera", "Bad", "class Bad(Camera):\n    def __init__(self): 1 / 0", "camera: didn't open: division by zero"),
        (
            "lasers",
            "Bad",
            "class Bad(Lasers): wavelengths_m = (450e-9,)",
            "lasers: has 450 nm; expected 450 nm, 638 nm",
        ),
        ("slm1", "Bad", "class Bad(Slm): shape = (8, 6)", "slm1: has 8 × 6 pixels; expected 6 × 8"),
        (
            "stage",
            "Bed",
            "class Bad(Stage): pass",
            'rig.toml: stage.class: mine.py has no class "Bed"; did you mean Bad',
        ),
        ("stage", "Bad", "1 / 0", r"rig.toml: stage.file: .*mine.py: failed: ZeroDivisionError"),
    ],
)
def test_what_does_not_fit_is_named(
    write_rig: WriteRig, tmp_path: Path, device: str, name: str, source: str, message: str
) -> None:
    (tmp_path / "mine.py").write_text(f"{FAKES}\n{source}\n", encoding="utf-8")
    with pytest.raises(UserError, match=message):
        open_rig(write_rig(**{device: _python(name)}))


def test_a_missing_file_is_named(write_rig: WriteRig) -> None:
    with pytest.raises(UserError, match=r"rig.toml: stage.file: .*mine.py: no such file"):
        open_rig(write_rig(stage=_python("Stage")))


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        ("np.zeros((10, 12))", "camera: sent values of float64; expected whole numbers"),
        ("np.zeros((12, 10), np.uint16)", "camera: sent a picture of 12 × 10; expected 10 × 12"),
        ("np.full((10, 12), 4096)", "camera: sent counts from 4096 to 4096; expected 0 … 4095"),
        ("np.full((10, 12), -1)", "camera: sent counts from -1 to -1; expected 0 … 4095"),
        ("1 / 0", "camera: didn't send a picture: division by zero; see mine.py"),
    ],
)
def test_a_wrong_picture_is_refused(write_rig: WriteRig, tmp_path: Path, answer: str, message: str) -> None:
    source = f"{FAKES}\nclass Mine(Camera):\n    def take(self): return {answer}\n"
    (tmp_path / "mine.py").write_text(source, encoding="utf-8")
    with open_rig(write_rig(camera=_python("Mine"))) as devices, pytest.raises(DeviceError, match=message):
        devices.camera.take()


def test_a_level_that_the_modulator_does_not_have_is_refused(write_rig: WriteRig) -> None:
    with (
        open_rig(write_rig()) as devices,
        pytest.raises(DeviceError, match="slm1: was to show level 16; expected 0 … 15"),
    ):
        devices.modulators[0].show(np.full((6, 8), 16, np.uint8))


def test_a_stage_that_returns_no_number_is_refused(write_rig: WriteRig, tmp_path: Path) -> None:
    source = f"{FAKES}\nclass Mine(Stage):\n    def move_to(self, distance_m): return None\n"
    (tmp_path / "mine.py").write_text(source, encoding="utf-8")
    with (
        open_rig(write_rig(stage=_python("Mine"))) as devices,
        pytest.raises(DeviceError, match="stage: returned None"),
    ):
        devices.stage.move_to(2e-3)


def test_lasers_are_switched_off_whatever_ends_the_block(write_rig: WriteRig, tmp_path: Path) -> None:
    source = (
        f"{FAKES}\nfrom pathlib import Path\n"
        f"class Mine(Lasers):\n    def switch_off(self): Path({str(tmp_path / 'off')!r}).touch()\n"
        "class Broken(Stage):\n    def close(self): raise OSError('gone')\n"
    )
    (tmp_path / "mine.py").write_text(source, encoding="utf-8")
    rig = write_rig(lasers=_python("Mine"), stage=_python("Broken"))
    with pytest.raises(DeviceError, match="stage: didn't close: gone"), open_rig(rig):
        raise KeyboardInterrupt
    assert (tmp_path / "off").exists()
