"""One real window on a virtual screen, moved by a real pointer: it draws, takes input, idles, and saves its session."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from PIL import Image, ImageGrab

from holoview.holograms.hologram import load_hologram
from holoview.light.model import preset
from holoview.light.model.system import System
from holoview.viewer.document.session_store import SessionStore
from tests.child_process import child_process
from tests.gui.conftest import Gui, small_bench
from tests.patience import PATIENCE_S

SIZE = (900, 700)
NEEDED = ("Xvfb", "xdotool")
SLOW = """
import sys, time
from wgpu.utils.imgui import ImguiWgpuBackend
from holoview.commands.cli import main

draw = ImguiWgpuBackend.render

def draw_slowly(*arguments):
    time.sleep(0.5)
    draw(*arguments)

ImguiWgpuBackend.render = draw_slowly
sys.exit(main())
"""  # two frames a second, whatever the machine
ITERATIONS = 60  # as the panel has it at first

pytestmark = [
    pytest.mark.gpu,
    pytest.mark.skipif(
        not all(shutil.which(name) for name in NEEDED), reason="needs Xvfb and xdotool (apt install xvfb xdotool)"
    ),
]


class Screen:
    """A virtual screen with a viewer on it."""

    def __init__(
        self,
        display: str,
        folder: Path,
        arguments: list[str],
        program: tuple[str, ...] = ("-m", "holoview"),
    ) -> None:
        self._display = display
        self._log = folder / "log.txt"
        self._environment = os.environ | {"DISPLAY": display, "XDG_STATE_HOME": str(folder), "OMP_NUM_THREADS": "1"}
        self._environment.pop("WAYLAND_DISPLAY", None)
        command = [
            sys.executable,
            *program,
            "view",
            *arguments,
            "--size",
            "x".join(map(str, SIZE)),
            "--new",
        ]
        with self._log.open("w") as log:
            self.viewer = subprocess.Popen(command, env=self._environment, stdout=log, stderr=log)

    @property
    def log(self) -> str:
        """What the viewer wrote."""
        return self._log.read_text(encoding="utf-8")

    def xdotool(self, *words: object) -> str:
        """Moves the pointer or presses keys."""
        done = subprocess.run(
            ["xdotool", *map(str, words)],
            env=self._environment,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=True,
        )
        return done.stdout.strip()

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """A drag in a few steps, as a hand does it."""
        self.xdotool("mousemove", round(start[0]), round(start[1]))
        time.sleep(0.3)
        self.xdotool("mousedown", 1)
        for step in range(1, 6):
            place = [start[i] + (end[i] - start[i]) * step / 5 for i in (0, 1)]
            self.xdotool("mousemove", round(place[0]), round(place[1]))
            time.sleep(0.1)
        self.xdotool("mouseup", 1)
        time.sleep(0.3)

    def drag_with_shift(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """The same with Shift held down."""
        self.xdotool("keydown", "shift")
        self.drag(start, end)
        self.xdotool("keyup", "shift")

    def picture(self) -> np.ndarray:
        """What is on the screen (y, x, 3)."""
        return _picture_of(self._display)

    def rests(self) -> bool:
        """Whether two seconds cost next to nothing; a loop that never rests takes all of them."""
        process = psutil.Process(self.viewer.pid)
        before = sum(process.cpu_times()[:2])
        time.sleep(2)
        return bool(sum(process.cpu_times()[:2]) - before < 0.3)

    def wait_until(self, is_so: Callable[[], bool]) -> None:
        """Waits for something, while the viewer lives."""
        until = time.monotonic() + PATIENCE_S
        while not is_so():
            assert self.viewer.poll() is None, self.log
            assert time.monotonic() < until, f"not so in {PATIENCE_S:g} s: {self.log}"
            time.sleep(0.25)

    def repeat_until(self, act: Callable[[], None], is_so: Callable[[np.ndarray], bool], pause_s: float = 20.0) -> None:
        """Acts, as a hand does again where a busy screen took a drag for a click, until the picture shows it."""
        next_s = time.monotonic()

        def seen() -> bool:
            nonlocal next_s
            if time.monotonic() >= next_s:
                act()
                next_s = time.monotonic() + pause_s
            return is_so(self.picture())

        self.wait_until(seen)

    def wait_for(self, is_so: Callable[[np.ndarray], bool]) -> np.ndarray:
        """The first picture for which something is so."""
        self.wait_until(lambda: is_so(self.picture()))
        return self.picture()


def _picture_of(display: str) -> np.ndarray:
    """What is on a screen (y, x, 3)."""
    return np.asarray(ImageGrab.grab(xdisplay=display).convert("RGB"))


@pytest.fixture
def display() -> Iterator[str]:
    """A virtual screen that stays as it is: without -noreset it starts anew, and refuses those who come meanwhile, each
    time its last client leaves (measured: 45 of 849 when three come and go)."""
    read, write = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-noreset", "-displayfd", str(write), "-screen", "0", f"{SIZE[0]}x{SIZE[1]}x24"],
        pass_fds=[write],
        stderr=subprocess.DEVNULL,
    )
    os.close(write)
    with os.fdopen(read) as number:
        yield f":{number.readline().strip()}"
    server.terminate()
    server.wait(PATIENCE_S)


@pytest.fixture
def screen(display: str, tmp_path: Path) -> Iterator[Screen]:
    bench, picture = tmp_path / "bench.toml", tmp_path / "picture.png"
    preset.save(_tiny_bench(), bench)
    Image.fromarray(np.full((64, 96, 3), 180, np.uint8)).save(picture)
    opened = Screen(display, tmp_path, [str(bench), str(picture)])
    yield opened
    opened.viewer.kill()
    opened.viewer.wait(PATIENCE_S)


def _shows_a_frame_inside(rect: tuple[float, float, float, float]) -> Callable[[np.ndarray], bool]:
    """Whether the yellow frame of a region is seen."""
    x0, y0, x1, y1 = (round(value) for value in rect)
    yellow = np.array([255, 220, 80])
    return lambda picture: int((np.abs(picture[y0:y1, x0:x1].astype(int) - yellow).max(axis=2) < 40).sum()) > 100


def _is_busy_inside(rect: tuple[float, float, float, float]) -> Callable[[np.ndarray], bool]:
    """Whether an image, rather than an even ground, is seen in a rectangle."""
    x0, y0, x1, y1 = (round(value) for value in rect)
    return lambda picture: bool(picture[y0:y1, x0:x1].std() > 15)


def _brightness_of_the_menu_bar(picture: np.ndarray) -> float:
    return float(picture[4, -50:].mean())


def test_a_real_window_draws_answers_rests_and_saves(
    screen: Screen, make_gui: Callable[..., Gui], tmp_path: Path
) -> None:
    twin = make_gui(_tiny_bench(name="bench"), size=SIZE)  # the same layout off screen tells where things are
    twin.draw_until_idle()
    screen.wait_for(_is_busy_inside(twin.context.item_rects["image"]))
    x, y = twin.item_position("laser 1")
    screen.drag((x, y), (x + 12, y + 10))
    screen.drag(twin.item_position("plane", 0.5), twin.item_position("plane", 0.8))
    ends = twin.item_position("image", 0.4, 0.4), twin.item_position("image", 0.6, 0.6)
    shown = _shows_a_frame_inside(twin.context.item_rects["image"])
    screen.repeat_until(partial(screen.drag_with_shift, *ends), shown)
    saved = SessionStore(tmp_path / "holoview")
    screen.wait_until(lambda: "Optimise" in _labels(saved))  # the quick look at the picture
    screen.xdotool("key", "ctrl+Return")
    screen.wait_until(lambda: f"Optimise, {ITERATIONS} iterations" in _labels(saved))
    bar = _brightness_of_the_menu_bar(screen.picture())
    screen.xdotool("key", "ctrl+s")
    screen.wait_for(lambda picture: abs(_brightness_of_the_menu_bar(picture) - bar) > 10)  # a dialog greys the rest
    time.sleep(1)  # it has the keyboard a frame later
    screen.xdotool("key", "ctrl+a")
    screen.xdotool("type", "--delay", 20, tmp_path / "mine")
    screen.xdotool("key", "Return")
    written = tmp_path / "mine.safetensors"
    screen.wait_until(written.is_file)
    screen.wait_until(screen.rests)
    screen.xdotool("key", "ctrl+q")
    assert screen.viewer.wait(PATIENCE_S) == 0, screen.log
    assert screen.log.strip() == ""
    last = saved.last_session()
    assert last is not None
    session, bench = last.restore(), _tiny_bench()
    assert session.system.wavelengths_m[1] > bench.wavelengths_m[1]
    assert session.view_settings.plane_m > 10.2e-3
    assert session.view_settings.region is not None
    assert np.array_equal(load_hologram(written).drive, session.drive)


@pytest.mark.explores
def test_regions_and_kept_holograms_by_a_real_hand_are_saved(
    display: str, make_gui: Callable[..., Gui], tmp_path: Path
) -> None:
    """Two regions drawn with the pointer, one chosen by a click, a snapshot, and a digit that shows it."""
    bench = tmp_path / "bench.toml"
    preset.save(_tiny_bench(), bench)
    twin = make_gui(_tiny_bench(name="bench"), size=SIZE)
    twin.draw_until_idle()
    screen = Screen(display, tmp_path, [str(bench)])
    try:
        screen.wait_for(_is_busy_inside(twin.context.item_rects["image"]))
        store = SessionStore(tmp_path / "holoview")
        for count, left in enumerate((0.3, 0.6), start=1):
            ends = twin.item_position("image", left, 0.45), twin.item_position("image", left + 0.15, 0.55)
            screen.repeat_until(
                partial(screen.drag_with_shift, *ends), lambda picture, n=count: _region_count(store) >= n, pause_s=60.0
            )
        screen.xdotool("mousemove", *map(round, twin.item_position("image", 0.37, 0.47)), "click", 1)
        screen.wait_until(lambda: _labels(store).endswith("Choose a region"))
        screen.xdotool("key", "p", "key", "2")
        screen.wait_until(lambda: _labels(store).endswith("Shown"))
        (saved,) = store.saved_sessions()
        session = saved.restore()
        view = session.view_settings
        assert [of.name for of in view.regions] == ["A", "B"] and view.region_name == "A"
        assert view.shown.name in session.snapshots and not session.can_undo
    finally:
        screen.viewer.kill()
        screen.viewer.wait(PATIENCE_S)


def _region_count(store: SessionStore) -> int:
    """How many regions the saved session has."""
    return max((len(saved.restore().view_settings.regions) for saved in store.saved_sessions()), default=0)


def _tiny_bench(**changes: Any) -> System:
    return small_bench(shape=[32, 48], **changes)


def _labels(store: SessionStore) -> str:
    """What was done in the sessions that are being saved: to the bench, then to the look at it."""
    sessions = [saved.restore() for saved in store.saved_sessions()]
    return " ".join(step.label for session in sessions for step in (*session.history, *session.looks[0]))


@pytest.mark.explores
def test_at_two_frames_a_second_nothing_is_lost(display: str, make_gui: Callable[..., Gui], tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    preset.save(_tiny_bench(), bench)
    twin = make_gui(_tiny_bench(name="bench"), size=SIZE)
    twin.draw_until_idle()
    image, tile = (
        tuple(map(round, twin.item_position(name)))
        for name in ("image", f"plane {twin.session.system.planes_m[0] * 1e3:g} mm")
    )
    screen = Screen(display, tmp_path, [str(bench)], program=("-c", SLOW))
    try:
        screen.wait_for(_is_busy_inside(twin.context.item_rects["image"]))
        screen.xdotool("mousemove", *tile, "click", 1, "mousemove", *image, *["click", 4] * 6, "key", "e", "key", "c")
        screen.xdotool("key", "ctrl+p", "type", "--delay", 1, "wipe")
        screen.xdotool("key", "Return", "key", "g")
        store = SessionStore(tmp_path / "holoview")
        screen.wait_until(lambda: _labels(store).endswith("Page"))
        assert _labels(store) == "Start Focal plane Exposure Channel Compare Page"
        (saved,) = store.saved_sessions()
        view = saved.restore().view_settings
        assert view.compare == "wipe" and view.plane_m == twin.session.system.planes_m[0]
    finally:
        screen.viewer.kill()
        screen.viewer.wait(PATIENCE_S)


def test_without_an_adapter_a_page_tells_what_to_do(display: str) -> None:
    """Where OpenGL can't draw either, the command's line on stderr has to do."""
    page = (
        "from holoview.util.errors import UserError; from holoview.viewer.app.no_adapter import show_no_adapter_page;"
        "show_no_adapter_page(UserError('graphics adapter', 'none was found', expected='a driver'))"
    )
    with child_process([sys.executable, "-c", page], env=os.environ | {"DISPLAY": display}) as viewer:
        until = time.monotonic() + PATIENCE_S
        while not _shows_text(_picture_of(display)):
            if viewer.poll() is not None:
                pytest.skip("no OpenGL on this screen")
            assert time.monotonic() < until
            time.sleep(0.5)
        viewer.kill()


def _shows_text(picture: np.ndarray) -> bool:
    """Whether something bright is seen in the corner where the page begins."""
    return bool((picture[:250, :640].max(axis=2) > 128).mean() > 0.01)
