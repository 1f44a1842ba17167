"""The first picture is computed on a thread while the window is built, and without the libraries that load slowly."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from holoview.holograms.view import random_drive
from holoview.light.gpu.device import Device
from holoview.util.errors import UserError
from holoview.viewer.app.launch import IMAGE_DISPLAYED
from holoview.viewer.render.progressive_renderer import ProgressiveRenderer
from holoview.viewer.render.scene import Scene
from tests.gui.conftest import Gui, MakeRenderer, small_bench
from tests.patience import PATIENCE_S

SLOW_LIBRARIES = {"torch", "scipy", "colour", "matplotlib", "h5py", "rich"}


class _Later(Executor):
    """Runs what it is given when told to."""

    def __init__(self) -> None:
        self._work: list[Callable[[], None]] = []

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **keywords: Any) -> Future[Any]:
        future: Future[Any] = Future()

        def work() -> None:
            try:
                future.set_result(function(*arguments, **keywords))
            except Exception as error:
                future.set_exception(error)

        self._work.append(work)
        return future

    def run(self) -> None:
        while self._work:
            self._work.pop()()


def _scene(**changes: Any) -> Scene:
    system = small_bench(**changes)
    return Scene(system, random_drive(system, seed=3), 1e-2)


def _finish(renderer: ProgressiveRenderer) -> None:
    while renderer.is_busy:
        renderer.compute_slice()


def test_nothing_is_computed_here_until_the_thread_has_the_first_picture(make_renderer: MakeRenderer) -> None:
    renderer, thread = make_renderer(), _Later()
    renderer.start(_scene(), thread)
    assert renderer.is_busy
    assert renderer.wait_s > 0
    assert not renderer.compute_slice()
    assert renderer.picture is None
    thread.run()
    assert renderer.picture is not None
    assert renderer.wait_s == 0
    assert renderer.compute_slice()
    _finish(renderer)
    assert renderer.is_fresh


def test_the_full_image_is_that_of_a_renderer_that_began_later(make_renderer: MakeRenderer) -> None:
    scene, thread = _scene(), _Later()
    early, late = make_renderer(), make_renderer()
    early.start(scene, thread)
    thread.run()
    late.request(scene)
    _finish(early)
    _finish(late)
    assert np.array_equal(early.xyz(), late.xyz())


def test_what_is_requested_meanwhile_follows(make_renderer: MakeRenderer) -> None:
    renderer, thread, scene = make_renderer(), _Later(), _scene()
    renderer.start(scene, thread)
    other = replace(scene, plane_m=1.2e-2)
    renderer.request(other)
    thread.run()
    _finish(renderer)
    assert renderer.full_scene is other


def test_a_return_to_the_first_scene_is_no_new_request(make_renderer: MakeRenderer) -> None:
    renderer, thread, scene = make_renderer(), _Later(), _scene()
    renderer.start(scene, thread)
    renderer.request(replace(scene, plane_m=1.2e-2))
    renderer.request(replace(scene))
    thread.run()
    _finish(renderer)
    assert renderer.full_scene is not None
    assert renderer.full_scene.is_same(scene)


def test_an_impossible_scene_is_reported_where_slices_are_computed(make_renderer: MakeRenderer) -> None:
    renderer, thread, scene = make_renderer(), _Later(), _scene()
    renderer.start(replace(scene, drive=scene.drive[..., 1:]), thread)
    thread.run()
    with pytest.raises(UserError, match="drive"):
        renderer.compute_slice()
    assert not renderer.is_busy


def test_a_frame_is_awaited_after_each_new_image(gui: Gui) -> None:
    assert gui.app.has_shown_image
    gui.session.edit_view("Plane", plane_m=1.1e-2)
    while not gui.app.awaits_frame:
        gui.app.compute_slice()
    gui.draw_frames()
    assert not gui.app.awaits_frame


@pytest.mark.long
def test_the_viewer_shows_an_image_without_the_libraries_that_load_slowly(device: Device, tmp_path: Path) -> None:
    program = (
        "import sys; from holoview.commands.cli import main; "
        "assert main(['view', '--set', 'shape=[64, 96]', '--offscreen', '--until-image', '--size', '640x400']) == 0; "
        f"assert not {SLOW_LIBRARIES!r} & sys.modules.keys(), {SLOW_LIBRARIES!r} & sys.modules.keys()"
    )
    environment = {"XDG_CACHE_HOME": str(tmp_path), "HOME": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=environment,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == IMAGE_DISPLAYED
