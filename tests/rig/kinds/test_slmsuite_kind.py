"""Devices of slmsuite: raw levels are sent, pictures are raw, and what doesn't fit rig.toml is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from slmsuite.hardware.cameras.camera import Camera
from slmsuite.hardware.slms.slm import SLM

from holoview.bench.rig import open_rig
from holoview.bench.rig.devices import DeviceError
from holoview.bench.rig.kinds.checks import find_class
from holoview.holograms.files.pictures import CELL_MAPS, memory_cells
from holoview.util.errors import UserError
from tests.rig.kinds.conftest import WriteRig

LEVELS = np.arange(48, dtype=np.uint8).reshape(6, 8) % 16


class FakeSlm(SLM):  # type: ignore[misc]
    """A modulator that keeps what its hardware would get."""

    last: Any = None

    def __init__(self, resolution: tuple[int, int] = (8, 6), bitdepth: int = 4, **arguments: Any) -> None:
        super().__init__(resolution, bitdepth=bitdepth, **arguments)
        self.source["phase"] = np.ones(self.shape)  # a correction, which raw levels mustn't get
        FakeSlm.last = self

    def _set_phase_hw(self, display: Any) -> None:
        self.sent = np.array(display)

    def close(self) -> None:
        self.is_closed = True


class BrokenSlm(FakeSlm):
    """A modulator that doesn't open."""

    def __init__(self) -> None:
        raise RuntimeError("no device found")


class FakeCamera(Camera):  # type: ignore[misc]
    """A camera that sends a constant picture and counts its exposures."""

    last: Any = None

    def __init__(self, counts: int = 700, is_late: bool = False, **arguments: Any) -> None:
        self.counts, self.is_late, self.taken, self.timeouts_s = counts, is_late, 0, []
        super().__init__((12, 10), bitdepth=12, capture_attempts=1, **arguments)
        FakeCamera.last = self

    def _get_exposure_hw(self) -> float:
        return getattr(self, "exposure", 1e-3)

    def _set_exposure_hw(self, exposure_s: float) -> None:
        self.exposure = round(exposure_s, 5)

    def _get_image_hw(self, timeout_s: float) -> Any:
        if self.is_late:
            raise TimeoutError(f"no frame within {timeout_s:g} s")
        self.taken += 1
        self.timeouts_s.append(timeout_s)
        return np.full((10, 12), self.counts, np.uint16)

    def close(self) -> None:
        self.is_closed = True


def _device(name: str, more: str = "") -> str:
    return f'device = "slmsuite"\nclass = "{__name__}.{name}"\n{more}'


def test_levels_reach_the_hardware_as_they_are(write_rig: WriteRig) -> None:
    with open_rig(write_rig(slm1=_device("FakeSlm", "arguments = { settle_time_s = 0.4 }"))) as devices:
        assert devices.modulators[0].settle_s == 0.4
        devices.modulators[0].show(LEVELS)
        assert np.array_equal(FakeSlm.last.sent, LEVELS)
        devices.modulators[0].show(LEVELS.astype(np.uint16))
        assert np.array_equal(FakeSlm.last.sent, LEVELS) and FakeSlm.last.sent.dtype == np.uint8
    assert FakeSlm.last.is_closed


def test_the_settling_time_can_be_stated(write_rig: WriteRig) -> None:
    with open_rig(write_rig(slm1=_device("FakeSlm", "settle = 0.05"))) as devices:
        assert devices.modulators[0].settle_s == 0.05


def test_memory_cells_go_to_a_class_that_shows_pictures(write_rig: WriteRig) -> None:
    """The cells are those that `holoview export --cells p67` writes, black for 0 and white for 1."""
    more = 'arguments = { resolution = [16, 12], bitdepth = 8 }\ncells = "p67"'
    with open_rig(write_rig(slm1=_device("FakeSlm", more))) as devices:
        devices.modulators[0].show(LEVELS)
        assert np.array_equal(FakeSlm.last.sent, 255 * memory_cells(LEVELS, "p67"))


@pytest.mark.parametrize("device", sorted(CELL_MAPS))
def test_slmsuites_own_modulator_for_cells_sets_the_same_cells(device: str) -> None:
    """An independent program with the same tables: raw levels through its `_gray2display`."""
    cells_class = find_class("slmsuite.hardware.slms.texasinstruments.PLM", "test")
    plm, facts = object.__new__(cells_class), cells_class.load_model_config(device)
    plm.xp, plm.data_flip = np, tuple(facts["data_flip"])
    plm.memory_lut = np.array(facts["memory_lut"], np.uint8)
    plm.electrode_layout = np.array(facts["electrode_layout"], np.uint8)
    plm.display = np.zeros((12, 16), np.uint8)
    assert np.array_equal(plm._gray2display(LEVELS), 255 * memory_cells(LEVELS, device))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            _device("FakeSlm", "arguments = { resolution = [6, 8] }"),
            r"slm1: has 8 × 6 pixels; expected 6 × 8; correct slm1\.shape",
        ),
        (_device("FakeSlm", "arguments = { bitdepth = 8 }"), "slm1: has 8 bits; expected 4"),
        (_device("FakeSlm", 'cells = "p67"'), "slm1: has 6 × 8 pixels; expected 12 × 16"),
        (_device("BrokenSlm"), "slm1: didn't open: no device found; see that it is on and connected"),
        (_device("FakeCamera"), r"slm1\.class: .* has no `set_phase`; expected a modulator of slmsuite"),
        (_device("FakeSln"), r'slm1\.class: .* has no class "FakeSln"; did you mean FakeSlm'),
        ('device = "slmsuite"\nclass = "Holoeye"', r'slm1\.class: "Holoeye"; expected the dotted path of a class'),
        (
            'device = "slmsuite"\nclass = "slmsuite.no.Holoeye"',
            r"slm1\.class: \"slmsuite\.no\" can't be imported: ModuleNotFoundError",
        ),
        (
            'device = "slmsuite"\nclass = "slmsuite.hardware.slms.holoeye.Holoeye"',
            r"slm1: didn't open: SDK HEDS not installed\. Install to use Holoeye SLMs; see that it is on",
        ),
        ('device = "slmsuite"', r"slm1\.class: is missing"),
        (_device("FakeSlm", "argument = {}"), r"slm1\.argument: unknown option .*; did you mean arguments\?"),
    ],
)
def test_a_modulator_that_does_not_fit_is_refused(write_rig: WriteRig, options: str, message: str) -> None:
    with pytest.raises(UserError, match=message):
        open_rig(write_rig(slm1=options))


def test_a_device_that_does_not_fit_is_closed(write_rig: WriteRig) -> None:
    with pytest.raises(DeviceError, match="8 bits"):
        open_rig(write_rig(slm1=_device("FakeSlm", "arguments = { bitdepth = 8 }")))
    assert FakeSlm.last.is_closed


def test_a_picture_is_one_raw_frame_exposed_after_the_call(write_rig: WriteRig) -> None:
    """Without averaging and high dynamic range, even if the camera was made with them."""
    more = "arguments = { averaging = 4, hdr = 3, exposure_bounds_s = [1e-4, 0.2] }\ntimeout = 3.0"
    with open_rig(write_rig(camera=_device("FakeCamera", more))) as devices:
        assert devices.camera.exposures_s == (1e-4, 0.2)
        assert devices.camera.set_exposure(0.123456) == 0.12346
        FakeCamera.last.taken, FakeCamera.last.timeouts_s = 0, []
        picture = devices.camera.take()
        assert picture.dtype == np.uint16 and np.all(picture == 700)
        assert FakeCamera.last.taken == 3  # two that may have waited in the buffer, and this one
        assert FakeCamera.last.timeouts_s == pytest.approx([3.12346] * 3)
        with pytest.raises(UserError, match=r"exposure: 0\.6 s"):
            devices.camera.set_exposure(0.6)
    assert FakeCamera.last.is_closed


def test_a_camera_without_a_buffer_needs_no_flush(write_rig: WriteRig) -> None:
    with open_rig(write_rig(camera=_device("FakeCamera", "flush = false"))) as devices:
        FakeCamera.last.taken = 0
        devices.camera.take()
        assert FakeCamera.last.taken == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("counts = 5000", "camera: sent counts from 5000 to 5000; expected 0 … 4095"),
        ("is_late = true", "camera: didn't send a picture: no frame within 5.001 s; see that it is on"),
    ],
)
def test_a_camera_that_fails_is_named(write_rig: WriteRig, arguments: str, message: str) -> None:
    rig = write_rig(camera=_device("FakeCamera", f"arguments = {{ {arguments} }}"))
    with open_rig(rig) as devices, pytest.raises(DeviceError, match=message):
        devices.camera.take()


def test_a_camera_of_another_shape_is_refused(write_rig: WriteRig) -> None:
    with pytest.raises(DeviceError, match="camera: has 12 × 10 pixels; expected 10 × 12"):
        open_rig(write_rig(camera=_device("FakeCamera", 'arguments = { rot = "90" }')))


def test_lasers_are_not_of_slmsuite(write_rig: WriteRig) -> None:
    with pytest.raises(
        UserError, match=r'lasers\.device: "slmsuite" has no lasers; expected this kind for: slm, camera'
    ):
        open_rig(write_rig(lasers=_device("FakeSlm")))
