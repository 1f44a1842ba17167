"""`holoview.show` in JupyterLab, in Chromium: a cell shows the viewer, a slider moves its picture, kernels restart."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from holoview.light.gpu.device import Device
from holoview.light.model import preset
from holoview.viewer.app.script import Point
from tests.chromium import needs_chromium, started_browser
from tests.gui.conftest import Gui
from tests.patience import PATIENCE_S, wait_until

if find_spec("jupyterlab") is None:  # importing it takes seconds, and a process of its own runs it
    pytest.skip("JupyterLab shows the notebook", allow_module_level=True)
playwright = pytest.importorskip("playwright.sync_api", reason="playwright drives the browser")
pytestmark = [pytest.mark.gpu, needs_chromium]
TOKEN = "right"
_PRINTED = ".jp-OutputArea-output pre"
_OF_JUPYTERLAB = ("debug_request", "No kernel to restart")  # errors that it reports when a kernel starts or restarts
SIZE = (640, 420)
SHOW = f"""import holoview as hv
viewer = hv.show(hv.load("holochrome-8").edit({{"shape": [32, 48]}}), size={SIZE})
viewer"""
TELL = """print(f"the plane is at {viewer.session.view_settings.plane_m * 1e3:.2f} mm")"""
MOVE = """viewer.session.edit_view("Plane", plane_m=9e-3)"""


@pytest.fixture(scope="module")
def lab(device: Device, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a JupyterLab with an empty configuration."""
    folder = tmp_path_factory.mktemp("lab")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    (folder / "show.ipynb").write_text(json.dumps(_notebook(SHOW, MOVE, TELL)), encoding="utf-8")
    folders = {f"JUPYTER_{name}_DIR": str(folder / name) for name in ("CONFIG", "DATA", "RUNTIME")}
    options = {
        "ServerApp.port": port,
        "ServerApp.root_dir": folder,
        "ServerApp.allow_root": True,
        "IdentityProvider.token": TOKEN,
        "LabApp.check_for_updates_class": "jupyterlab.handlers.announcements.NeverCheckForUpdate",
    }
    command = [
        sys.executable,
        "-m",
        "jupyterlab",
        "--no-browser",
        *(f"--{key}={value}" for key, value in options.items()),
    ]
    log = folder / "log.txt"
    with log.open("w") as file:
        process = subprocess.Popen(command, env=os.environ | folders, stdout=file, stderr=file)
    address = f"http://127.0.0.1:{port}"
    try:
        wait_until(lambda: _answers(address) or process.poll() is not None)
        assert process.poll() is None, log.read_text()
        yield address
    finally:
        process.terminate()
        process.wait(PATIENCE_S)


@pytest.mark.explores
def test_a_cell_shows_the_viewer_and_kernels_restart(lab: str, make_gui: Callable[..., Gui], tmp_path: Path) -> None:
    twin = make_gui(preset.load("holochrome-8").edit({"shape": [32, 48]}), size=SIZE)
    start, end = (twin.item_position("plane", share) for share in (0.4, 0.8))
    with started_browser() as browser:
        page = browser.open(f"{lab}/lab/tree/show.ipynb?token={TOKEN}", 1200, 1000)
        page.set_default_timeout(PATIENCE_S * 1000)
        page.locator(".jp-Notebook .jp-Cell").first.wait_for()
        for _ in ("first", "after a restart"):
            wait_until(lambda: _has_idle_kernel(lab))
            _check_that_the_slider_moves_the_picture(page, start, end, tmp_path)
        problems = browser.close_pages()
        assert [text for text in problems if not any(own in text for own in _OF_JUPYTERLAB)] == []


def _check_that_the_slider_moves_the_picture(page: Any, start: Point, end: Point, folder: Path) -> None:
    _restart_and_run_all(page, "the plane is at 9.00 mm")
    picture = page.locator(".jp-OutputArea .renderview-view")
    wait_until(lambda: _size(picture) == list(SIZE) and _pixels(picture, folder).std() > 20)
    before = _pixels(picture, folder)
    _drag(page, picture, start, end)
    wait_until(lambda: np.abs(_pixels(picture, folder) - before).mean() > 2)


def _restart_and_run_all(page: Any, text: str) -> None:
    """Restarts the kernel and runs all cells until the last one has printed a text.

    JupyterLab now and then restarts the kernel but drops the run that should follow. Then it is asked again.
    """
    page.locator(".jp-Notebook-ExecutionIndicator[data-status=idle]").wait_for()  # earlier clicks would be ignored
    for patience_s in (60.0, 180.0, PATIENCE_S):
        page.locator(".jp-NotebookPanel-toolbar [data-jp-item-name=restart-and-run] *").first.click()
        page.locator(".jp-Dialog .jp-mod-accept").click()
        page.locator(_PRINTED).wait_for(state="hidden")  # of the last kernel
        try:
            page.locator(_PRINTED, has_text=text).wait_for(timeout=patience_s * 1000)
            return
        except playwright.TimeoutError:
            if patience_s == PATIENCE_S:
                raise


def _drag(page: Any, picture: Any, start: Point, end: Point) -> None:
    box = picture.bounding_box()
    page.mouse.move(box["x"] + start[0], box["y"] + start[1])
    page.mouse.down()
    page.mouse.move(box["x"] + end[0], box["y"] + end[1], steps=5)
    page.mouse.up()


def _pixels(picture: Any, folder: Path) -> np.ndarray:
    file = folder / "picture.png"
    picture.screenshot(path=file)
    return np.asarray(Image.open(file).convert("RGB")).astype(int)


def _size(picture: Any) -> list[int]:
    return picture.evaluate("image => [image.naturalWidth, image.naturalHeight]")


def _answers(address: str) -> bool:
    try:
        with urllib.request.urlopen(f"{address}/api", timeout=5):
            return True
    except OSError:
        return False


def _has_idle_kernel(address: str) -> bool:
    """Whether the notebook's kernel has started; restarting one that hasn't is an error."""
    with urllib.request.urlopen(f"{address}/api/sessions?token={TOKEN}", timeout=PATIENCE_S) as answer:
        sessions = json.load(answer)
    return any(session["kernel"]["execution_state"] == "idle" for session in sessions)


def _notebook(*cells: str) -> dict[str, Any]:
    code = [
        {
            "cell_type": "code",
            "id": f"cell-{number}",
            "metadata": {},
            "source": text,
            "outputs": [],
            "execution_count": None,
        }
        for number, text in enumerate(cells)
    ]
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    return {"nbformat": 4, "nbformat_minor": 5, "metadata": kernel, "cells": code}
