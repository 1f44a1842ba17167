"""The panels of a rig: live pictures, the switch that turns the lasers off, limits, plans, a viewer to look at."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from imgui_bundle import imgui

from holoview.bench.experiment.rig_bench import system_of_rig
from holoview.bench.rig import live_devices
from holoview.bench.rig.open_rig import KINDS, Opener
from holoview.viewer.app.panels.rig import CameraPanel, RigDiagnosisPanel, RigPanel, open_rig
from holoview.viewer.document.rig_session import RigSession
from tests.experiment.live.fake_bench import FakeBench, write_rig
from tests.gui.conftest import Gui
from tests.patience import wait_until
from tests.rig.test_chain_rig import write_chain_rig

pytestmark = pytest.mark.gpu

SIZE = (720, 960)
PANELS = (RigPanel, CameraPanel, RigDiagnosisPanel)


class RigGui:
    """A viewer with the panels of a rig, and the fake bench behind it; None for a virtual one."""

    def __init__(self, gui: Gui, path: Path, bench: FakeBench | None) -> None:
        self.gui, self.path = gui, path
        self._bench = bench

    @property
    def bench(self) -> FakeBench:
        """The fake bench."""
        assert self._bench is not None
        return self._bench

    @property
    def rig(self) -> RigSession:
        """The rig of the session."""
        return self.gui.context.rig

    def wait(self, condition: Callable[[], object]) -> None:
        """Draws frames until something is so."""
        wait_until(condition, meanwhile=self.gui.process_frames, pause_s=0.005)
        self.gui.draw_frames(2)

    def open(self) -> None:
        """Opens the rig."""
        self.gui.context.attempt(open_rig, self.gui.context, self.path)
        self.wait(lambda: not self.rig.is_busy)

    def click(self, *items: str) -> None:
        """Clicks items one after the other, each when the one before is done."""
        for item in items:
            self.gui.click(self.gui.item_position(item))
            self.wait(lambda: not self.rig.is_busy)

    def light_up(self) -> None:
        """Sets everything that a capture needs, by the pointer."""
        self.click("send", "move", "laser 638 nm")


@pytest.fixture
def rig_gui(make_gui: Callable[..., Gui], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[RigGui]:
    path = write_rig(tmp_path)
    bench = FakeBench(path)
    monkeypatch.setitem(cast(dict[str, Opener], KINDS), "fake", bench.open)
    for name in ("_CALL_TIMEOUT_S", "_CLOSE_TIMEOUT_S"):
        monkeypatch.setattr(live_devices, name, 0.2)
    yield RigGui(make_gui(system_of_rig(bench.rig), SIZE, panels=PANELS), path, bench)
    bench.hangs.clear()
    bench.fails.clear()


@pytest.mark.long
def test_the_camera_of_a_virtual_bench_is_shown_beside_its_prediction(
    make_gui: Callable[..., Gui], tmp_path: Path
) -> None:
    path = write_rig(tmp_path, "virtual")
    shown = RigGui(make_gui(size=SIZE, panels=PANELS), path, None)
    shown.open()
    shown.light_up()
    found, view = shown.rig.view.prediction, shown.gui.app.panel(CameraPanel).view
    assert found is not None and found.chi2 < 1.5 and view is not None
    pixels = view.picture.shown.pixels().astype(float).mean(axis=2)
    middle, half = slice(2 * len(pixels) // 5, 3 * len(pixels) // 5), pixels.shape[1] // 2
    left, right = pixels[middle, :half], pixels[middle, half + 1 : 2 * half]
    left = left[:, 1:]  # beside the line between both
    assert np.corrcoef(left.ravel(), right.ravel())[0, 1] > 0.95
    view.picture.mode = "difference"
    shown.gui.draw_frames(2)
    pixels = view.picture.shown.pixels().astype(float)
    assert pixels[pixels.shape[0] // 2].mean() > 150  # differences of noise alone are pale


@pytest.mark.long
def test_a_chains_rig_takes_the_documents_patterns_once_its_bench_is_taken(
    make_gui: Callable[..., Gui], tmp_path: Path
) -> None:
    shown = RigGui(make_gui(size=SIZE, panels=PANELS), write_chain_rig(tmp_path, {"virtual": {"seed": 3}}), None)
    shown.open()
    controls = shown.gui.app.panel(RigPanel).controls
    shown.gui.context.attempt(controls.patterns.send_drive, shown.gui.context)
    assert "take the bench of the rig" in shown.gui.session.messages.all[-1].text
    controls.patterns.take_bench(shown.gui.context)
    assert shown.gui.session.system.drive_shapes == {"phase": (1, 24, 32), "coarse": (1, 12, 16)}
    controls.patterns.send_drive(shown.gui.context)
    shown.click("move", "laser 638 nm")
    found = shown.rig.view.prediction
    assert found is not None and found.chi2 < 1.5


@pytest.mark.long
def test_the_key_switches_the_lasers_off_while_the_camera_hangs_and_text_is_typed(rig_gui: RigGui) -> None:
    rig_gui.open()
    rig_gui.light_up()
    rig_gui.bench.hangs["camera"] = True
    rig_gui.wait(rig_gui.bench.hung.is_set)
    rig_gui.wait(lambda: rig_gui.rig.waiting.startswith("waiting for the camera"))
    gui = rig_gui.gui
    gui.press_chord("Ctrl+P")
    gui.draw_frames(2)
    assert imgui.get_io().want_text_input and rig_gui.bench.laser is not None
    gui.press_chord("F9")
    rig_gui.wait(lambda: rig_gui.bench.laser is None)
    assert "lasers off" in gui.context.item_rects and "connect again" in gui.context.item_rects


@pytest.mark.long
def test_the_big_switch_does_so_as_well(rig_gui: RigGui) -> None:
    rig_gui.open()
    rig_gui.light_up()
    rig_gui.bench.hangs["camera"] = True
    rig_gui.wait(rig_gui.bench.hung.is_set)
    rig_gui.wait(lambda: rig_gui.rig.waiting.startswith("waiting for the camera"))  # the line moves the switch
    rig_gui.gui.click(rig_gui.gui.item_position("lasers off"))
    rig_gui.wait(lambda: rig_gui.bench.laser is None)


def test_what_a_rig_refuses_is_told(rig_gui: RigGui) -> None:
    rig_gui.open()
    rig_gui.click("take a capture")
    assert "send a pattern" in rig_gui.gui.last_message()
    rig_gui.gui.context.attempt(rig_gui.rig.switch_on, 638e-9, 1.5)
    assert "0 … 1" in rig_gui.gui.last_message() and "[limits]" in rig_gui.gui.last_message()
    assert "on" not in rig_gui.bench.calls


def test_a_plan_is_run_and_cancelled_by_the_pointer(rig_gui: RigGui) -> None:
    rig_gui.rig.diagnosis.is_on = False
    rig_gui.open()
    folder = rig_gui.path.parent
    rig_gui.bench.hangs_while["camera"] = lambda: len(list(folder.glob("*.captures/[0-9]*.h5"))) == 1
    rig_gui.gui.click(rig_gui.gui.item_position("default plan"))
    rig_gui.wait(rig_gui.bench.hung.is_set)
    rig_gui.wait(lambda: rig_gui.rig.waiting.startswith("waiting for the camera"))  # the line moves the button
    rig_gui.gui.click(rig_gui.gui.item_position("cancel the plan"))
    rig_gui.bench.hangs_while.clear()
    rig_gui.wait(lambda: rig_gui.rig.plan_job is None and rig_gui.bench.laser is None)
    assert 1 <= len(rig_gui.rig.captures) <= 2, "one, and perhaps the one in flight"


def test_an_error_of_a_device_is_shown_with_a_button_that_connects_again(rig_gui: RigGui) -> None:
    rig_gui.open()
    rig_gui.bench.fails["camera"] = True
    rig_gui.wait(lambda: rig_gui.rig.status == "failed")
    assert "check its cable" in rig_gui.gui.last_message()
    rig_gui.bench.fails["camera"] = False
    rig_gui.click("connect again")
    assert rig_gui.rig.is_open and rig_gui.rig.view.picture is not None


@pytest.mark.long
def test_closing_the_window_switches_the_lasers_off_though_the_camera_hangs(rig_gui: RigGui) -> None:
    rig_gui.open()
    rig_gui.light_up()
    rig_gui.bench.hangs["camera"] = True
    rig_gui.wait(rig_gui.bench.hung.is_set)
    rig_gui.gui.app.close()
    assert rig_gui.bench.laser is None and rig_gui.gui.app.danger == ""


def test_a_viewer_to_look_at_controls_nothing(make_gui: Callable[..., Gui], rig_gui: RigGui) -> None:
    rig_gui.gui.app.close()  # a process has one window at a time
    looking = RigGui(
        make_gui(system_of_rig(rig_gui.bench.rig), SIZE, panels=PANELS, is_read_only=True), rig_gui.path, rig_gui.bench
    )
    looking.open()
    assert looking.rig.view.picture is not None
    calls = len(looking.bench.calls)
    looking.click("send", "move", "laser 638 nm", "default plan", "take a capture")
    looking.gui.press_chord("F8")
    assert set(looking.bench.calls[calls:]) <= {"take"} and not len(looking.rig.captures)
    assert looking.gui.context.commands.of_group("Rig") == []


def test_without_a_rig_there_is_no_menu_for_it(rig_gui: RigGui) -> None:
    commands = rig_gui.gui.context.commands
    assert commands.of_group("Rig") == [] and rig_gui.gui.context.opened_rig is None
    rig_gui.open()
    assert any(command.name == "Lasers off" for command in commands.of_group("Rig"))
