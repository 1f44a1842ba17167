"""A viewer of a small system that draws off screen, driven by synthetic events; comparison with reference pictures."""

from __future__ import annotations

import faulthandler
import os
import shutil
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from _pytest.faulthandler import fault_handler_stderr_fd_key
from numpy.typing import NDArray
from PIL import Image
from rendercanvas.offscreen import OffscreenRenderCanvas

from holoview.light.gpu.device import Device
from holoview.light.model import preset
from holoview.light.model.system import System
from holoview.viewer.app.app import App
from holoview.viewer.app.run import SCRIPT_FRAME_S
from holoview.viewer.app.script import InputDriver
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.session_store import SessionStore
from holoview.viewer.render.progressive_renderer import ProgressiveRenderer

MakeRenderer = Callable[..., ProgressiveRenderer]
SIZE = (640, 400)
GOLDEN = Path(__file__).parent / "golden"
TOLERANCE = 1  # levels of 255: the rounding of another processor's vector units
_FRAMES = 600  # in which a test of the engine has to end


def small_bench(**changes: Any) -> System:
    """Three lasers, 96 × 64 pixels."""
    lasers = {"wavelengths": ["460 nm", "530 nm", "620 nm"], "amplitudes": "white"}
    return preset.load("holochrome-8").edit({"shape": [64, 96], **lasers, **changes})


def leave_crashed_session(store: SessionStore) -> None:
    """A saved session, with the gap set to 4 mm, whose program is gone."""
    lost = EditingSession(small_bench())
    autosave = store.start_autosave(lost)
    lost.change("Gap", {"gap": 4e-3})
    assert autosave.flush()
    left = autosave.folder.with_name("20260101-000000-1-0")
    shutil.copytree(autosave.folder, left)
    (left / "lock.json").write_text('{"pid": 999999999, "since": 0}')
    assert autosave.close() is None
    shutil.rmtree(autosave.folder)
    lost.close()


class Gui(InputDriver):
    """An input driver with ImGui's test engine, which finds widgets by name."""

    def __init__(self, app: App, engine: dict[str, Any]) -> None:
        super().__init__(app)
        self._engine = engine

    @property
    def session(self) -> EditingSession:
        """The session that is edited."""
        return self.app.session

    def last_message(self) -> str:
        """What the user was told last."""
        found = self.session.messages.all
        return found[-1].text if found else ""

    def engine(self, script: Callable[[Any], None]) -> None:
        """Runs a script of ImGui's test engine, e.g. lambda ctx: ctx.item_click("Lasers/White")."""
        from imgui_bundle import hello_imgui, imgui

        self.process_frames(3)  # tests are registered a few frames late
        self._engine["script"] = script
        engine, test = hello_imgui.get_imgui_test_engine(), self._engine["test"]
        imgui.test_engine.queue_test(engine, test)
        for _ in range(_FRAMES):
            self.process_frames()
            if imgui.test_engine.is_test_queue_empty(engine):
                break
        status = test.output.status
        assert status == imgui.test_engine.TestStatus.success, test.output.log.get_text()
        self.process_frames(2)


@pytest.fixture(autouse=True)
def no_table_left_to_fill() -> Iterator[None]:
    """Fails where a test leaves a renderer that goes on filling its table of gaps beside the next tests."""
    yield
    left = [thread for thread in threading.enumerate() if thread.name == "holoview: light by gap"]
    for thread in left:
        thread.join()
    assert not left, "close each renderer: see `make_renderer`"


@pytest.fixture
def make_renderer(device: Device) -> Iterator[MakeRenderer]:
    """Makes renderers of a picture, make_renderer(remembers=True), that are closed after the test."""
    made: list[ProgressiveRenderer] = []

    def make(**options: Any) -> ProgressiveRenderer:
        made.append(ProgressiveRenderer(device, **options))
        return made[-1]

    yield make
    for renderer in made:
        renderer.close()


@pytest.fixture
def make_gui(device: Device, pytestconfig: pytest.Config) -> Iterator[Callable[..., Gui]]:
    """Opens viewers: make_gui(system, size=…, panels=…, engine=True); all are closed after the test."""
    opened: list[App] = []

    def make(system: System | None = None, size: tuple[int, int] = SIZE, *, engine: bool = False, **more: Any) -> Gui:
        box: dict[str, Any] = {"script": lambda ctx: None}
        canvas = OffscreenRenderCanvas(size=size, pixel_ratio=more.pop("pixel_ratio", 1.0))
        tests = (lambda: _register(box)) if engine else None
        session = EditingSession(system or small_bench())
        app = App(session, device, canvas, frame_s=SCRIPT_FRAME_S, register_tests=tests, **more)
        app.context.loader.optimises_new_targets = False  # no optimisation that nobody asked for
        opened.append(app)
        gui = Gui(app, box)
        gui.process_frames(4)
        return gui

    yield make
    for app in opened:
        failures = [guarded.failure for guarded in app.panels if guarded.failure is not None]
        app.close()
        _take_signals_back(pytestconfig)
        assert not failures, failures


def _take_signals_back(config: pytest.Config) -> None:
    """The test engine handles signals for good, and crashes where Python would go on: at a pipe that is broken.

    faulthandler takes its handlers back only if it is disabled first, and writes to the copy of stderr that pytest
    keeps: a crash would leave no trace otherwise.
    """
    if hasattr(signal, "SIGPIPE"):
        signal.signal(signal.SIGPIPE, signal.SIG_IGN)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    faulthandler.disable()
    faulthandler.enable(config.stash[fault_handler_stderr_fd_key])


def _register(box: dict[str, Any]) -> None:
    from imgui_bundle import hello_imgui, imgui

    engine = hello_imgui.get_imgui_test_engine()
    imgui.test_engine.get_io(engine).config_run_speed = imgui.test_engine.TestRunSpeed.fast
    box["test"] = imgui.test_engine.register_test(engine, "holoview", "script")
    box["test"].test_func = lambda ctx: box["script"](ctx)


@pytest.fixture
def gui(make_gui: Callable[..., Gui]) -> Gui:
    """A viewer of the small bench whose first image is there."""
    opened = make_gui()
    opened.draw_until_idle()
    return opened


@pytest.fixture
def golden(device: Device, tmp_path: Path, request: pytest.FixtureRequest) -> Callable[..., None]:
    """Compares pixels (y, x, 3) with a kept picture; HOLOVIEW_GOLDEN=write keeps new ones. On lavapipe only, and with
    the seeds with which it was made: a kept picture shows the speckle of random patterns.

    is_dark: whether the picture shows none.
    """

    def check(name: str, pixels: NDArray[np.uint8], *, is_dark: bool = False) -> None:
        if "llvmpipe" not in device.info.name:
            pytest.skip("kept pictures are of lavapipe")
        if request.config.getoption("reseed") and not is_dark:
            pytest.skip("the kept picture shows the speckle of patterns of other seeds")
        path = GOLDEN / f"{name}.png"
        if os.environ.get("HOLOVIEW_GOLDEN") == "write":
            path.parent.mkdir(exist_ok=True)
            Image.fromarray(pixels).save(path, optimize=True)
        kept = np.asarray(Image.open(path).convert("RGB")).astype(int)
        assert kept.shape == pixels.shape, f"{name}: {pixels.shape}, kept {kept.shape}"
        off = np.abs(kept - pixels.astype(int)).max(axis=2)
        if off.max() > TOLERANCE:
            where = tmp_path / f"{name}-difference.png"
            Image.fromarray(np.minimum(off * 32, 255).astype(np.uint8)).save(where)
            Image.fromarray(pixels).save(tmp_path / f"{name}.png")
            pytest.fail(f"{name}: {np.mean(off > TOLERANCE):.2%} of the pixels differ, at most by {off.max()}: {where}")

    return check
