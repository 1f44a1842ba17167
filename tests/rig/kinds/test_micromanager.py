"""Camera, lasers and stage of Micro-Manager: against a stand-in of CMMCore, and its demo devices if they are there.

The demo devices come with the package mm-test-adapters; without it and pymmcore-plus that test is skipped.
"""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from holoview.bench.rig import open_rig
from holoview.bench.rig.description import read_rig
from holoview.bench.rig.devices import DeviceError
from holoview.util.errors import UserError
from tests.rig.kinds.conftest import WriteRig


class FakeCore:
    """The calls of CMMCore that are used, in its units; `calls` lists those that change something."""

    last: Any = None

    def __init__(self) -> None:
        self.calls: list[tuple[Any, ...]] = []
        self.exposure_ms, self.position_um, self.bits, self.is_jammed = 1.0, 0.0, 12, False
        FakeCore.last = self

    def __getattr__(self, name: str) -> Any:
        return lambda *arguments: self.calls.append((name, *arguments))

    def loadSystemConfiguration(self, file: str) -> None:
        if "broken" in Path(file).read_text(encoding="utf-8"):
            raise RuntimeError("Line 1: Invalid configuration")

    def getLoadedDevices(self) -> tuple[str, ...]:
        return ("Camera", "L450", "L638", "Z", "Core")

    def getImageHeight(self) -> int:
        return 10

    def getImageWidth(self) -> int:
        return 12

    def getImageBitDepth(self) -> int:
        return self.bits

    def setExposure(self, label: str, exposure_ms: float) -> None:
        self.exposure_ms = round(exposure_ms, 1)

    def getExposure(self, label: str) -> float:
        return self.exposure_ms

    def getImage(self) -> Any:
        return np.full((10, 12), 321, np.uint16)

    def setPosition(self, label: str, position_um: float) -> None:
        self.position_um = 0.0 if self.is_jammed else position_um

    def getPosition(self, label: str) -> float:
        return self.position_um

    def setShutterOpen(self, label: str, is_open: bool) -> None:
        self.calls.append(("setShutterOpen", label, is_open))
        if self.is_jammed and label == "L450" and not is_open:
            raise RuntimeError("no answer")


COMMON = 'device = "micromanager"\nconfig = "scope.cfg"\n'
LASERS = COMMON + 'labels = ["L450", "L638"]\npower_property = "Power"\nfull_power = 20.0'


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setitem(sys.modules, "pymmcore_plus", SimpleNamespace(CMMCorePlus=FakeCore))
    file = tmp_path / "scope.cfg"
    file.write_text("Device,Camera,DemoCamera,DCam\n", encoding="utf-8")
    return file


def _shutters() -> list[tuple[Any, ...]]:
    return [call for call in FakeCore.last.calls if call[0] in ("setShutterOpen", "setProperty", "reset")]


@pytest.mark.usefixtures("config")
def test_devices_of_one_configuration_share_it(write_rig: WriteRig) -> None:
    rig = write_rig(camera=COMMON + 'label = "Camera"', stage=COMMON + 'label = "Z"\nzero = "1 mm"', lasers=LASERS)
    with open_rig(rig) as devices:
        core = FakeCore.last
        assert devices.camera.set_exposure(0.01234) == pytest.approx(0.0123)
        assert np.all(devices.camera.take() == 321)
        assert devices.stage.move_to(5e-3) == pytest.approx(5e-3) and core.position_um == pytest.approx(6000.0)
        assert FakeCore.last is core and ("setAutoShutter", False) in core.calls
        assert ("setTimeoutMs", 5012) in core.calls  # 5 s and the exposure
    assert core.calls.count(("reset",)) == 1 and core.calls[-1] == ("reset",)


@pytest.mark.usefixtures("config")
def test_one_shutter_is_open_at_a_time_and_none_at_the_end(write_rig: WriteRig) -> None:
    closed = [("setShutterOpen", "L450", False), ("setShutterOpen", "L638", False)]
    with open_rig(write_rig(lasers=LASERS)) as devices:
        assert _shutters() == closed
        devices.lasers.switch_on(638e-9, 0.5)
        with pytest.raises(UserError, match=r"power: 0\.9"):
            devices.lasers.switch_on(638e-9, 0.9)
        assert _shutters()[2:] == [*closed, ("setProperty", "L638", "Power", 10.0), ("setShutterOpen", "L638", True)]
    assert _shutters()[-3:] == [*closed, ("reset",)]


@pytest.mark.usefixtures("config")
def test_all_shutters_are_closed_even_if_one_fails(write_rig: WriteRig) -> None:
    message = "lasers: didn't close the shutter L450: no answer; make sure by hand"
    with pytest.raises(DeviceError, match=message), open_rig(write_rig(lasers=LASERS)) as devices:
        devices.lasers.switch_on(638e-9, 0.5)
        FakeCore.last.is_jammed = True
        FakeCore.last.calls.clear()
    assert ("setShutterOpen", "L638", False) in _shutters() and _shutters()[-1] == ("reset",)


@pytest.mark.usefixtures("config")
def test_lasers_without_a_power_refuse_any_but_the_full_one(write_rig: WriteRig) -> None:
    lasers = COMMON + 'labels = ["L450", "L638"]'
    with open_rig(write_rig(lasers=lasers)) as devices, pytest.raises(UserError, match=r"power: 0\.5; expected 1"):
        devices.lasers.switch_on(638e-9, 0.5)


@pytest.mark.usefixtures("config")
def test_a_stage_that_stops_elsewhere_is_an_error(write_rig: WriteRig) -> None:
    with open_rig(write_rig(stage=COMMON + 'label = "Z"')) as devices:
        FakeCore.last.is_jammed = True
        with pytest.raises(DeviceError, match="stage: stopped at 0 mm; expected 5 mm"):
            devices.stage.move_to(5e-3)


@pytest.mark.parametrize(
    ("device", "options", "message"),
    [
        ("stage", 'label = "Zed"', r'stage: "Zed" isn\'t in scope\.cfg; did you mean Z\?|known'),
        ("stage", "", r"stage\.label: is missing"),
        ("lasers", 'labels = ["L450"]', r"lasers\.labels: 1 labels; expected 2, one for each wavelength"),
        ("slm1", 'label = "Camera"', r'slm1\.device: "micromanager" has no slm'),
    ],
)
@pytest.mark.usefixtures("config")
def test_wrong_options_are_named(write_rig: WriteRig, device: str, options: str, message: str) -> None:
    with pytest.raises(UserError, match=message):
        open_rig(write_rig(**{device: COMMON + options}))


def test_a_camera_of_other_bits_is_refused(write_rig: WriteRig, config: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FakeCore, "getImageBitDepth", lambda self: 16)
    with pytest.raises(DeviceError, match="camera: has 16 bits; expected 12"):
        open_rig(write_rig(camera=COMMON + 'label = "Camera"'))


def test_a_configuration_that_is_missing_or_wrong_is_named(write_rig: WriteRig, config: Path) -> None:
    rig = write_rig(stage=COMMON + 'label = "Z"')
    config.write_text("broken", encoding="utf-8")
    with pytest.raises(DeviceError, match=r"stage: didn't load scope\.cfg: Line 1: Invalid configuration"):
        open_rig(rig)
    config.unlink()
    with pytest.raises(UserError, match=r"scope\.cfg: no such file; expected a configuration of Micro-Manager"):
        open_rig(rig)


def test_the_demo_devices_of_micro_manager_work(write_rig: WriteRig) -> None:
    pytest.importorskip("pymmcore_plus")
    adapters = Path(pytest.importorskip("mm_test_adapters").__file__).parent / "libs"
    common = f'device = "micromanager"\nconfig = "{adapters}/MMConfig_demo.cfg"\nadapters = "{adapters}"\n'
    lasers = common + 'labels = ["White Light Shutter", "LED Shutter"]'
    with open_rig(write_rig(stage=common + 'label = "Z"\nzero = "-1 mm"', lasers=lasers)) as devices:
        assert devices.stage.move_to(1.2e-3) == pytest.approx(1.2e-3, abs=1e-6)
    rig = write_rig(camera=common + 'label = "Camera"')
    with pytest.raises(DeviceError, match="camera: has 512 × 512 pixels; expected 10 × 12"):
        open_rig(rig)
    text = rig.path.read_text(encoding="utf-8")
    rig.path.write_text(text.replace("[10, 12]", "[512, 512]").replace("bit_depth = 12", "bit_depth = 16"))
    with open_rig(read_rig(rig.path)) as devices:
        assert devices.camera.set_exposure(0.02) == pytest.approx(0.02)
        picture = devices.camera.take()
        assert picture.shape == (512, 512) and picture.max() > picture.min()


@pytest.mark.parametrize("wrong", ["label", "bits", "lasers"])
def test_a_device_that_doesnt_open_gives_the_configuration_back(
    write_rig: WriteRig, config: Path, monkeypatch: pytest.MonkeyPatch, wrong: str
) -> None:
    """Alone or beside one that is open: its ports are free for the next try, which loads the configuration anew."""
    camera = COMMON + f'label = "{"Cam" if wrong == "label" else "Camera"}"'
    if wrong == "bits":
        monkeypatch.setattr(FakeCore, "getImageBitDepth", lambda self: 16)
    lasers = {"lasers": COMMON + 'labels = ["L450", "L999"]'} if wrong == "lasers" else {}
    with pytest.raises(DeviceError, match=r"isn't in|has 16 bits"):
        open_rig(write_rig(camera=camera, **lasers))
    failed = FakeCore.last
    assert failed.calls.count(("reset",)) == 1 and failed.calls[-1] == ("reset",)
    monkeypatch.undo()
    monkeypatch.setitem(sys.modules, "pymmcore_plus", SimpleNamespace(CMMCorePlus=FakeCore))
    with open_rig(write_rig(camera=COMMON + 'label = "Camera"')):
        assert FakeCore.last is not failed and ("reset",) not in FakeCore.last.calls
