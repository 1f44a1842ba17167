"""A viewer that is served to look at: no dialogs, no files, no end; the rest of it works."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import ClientConnection, connect

from holoview.commands.cli import main
from holoview.light.gpu.device import Device
from holoview.util.errors import UserError
from holoview.viewer.app.panels.files import FilesPanel, HistoryPanel
from holoview.viewer.app.panels.image import ImagePanel
from holoview.viewer.app.serve import Address, ServeOptions
from tests.gui.conftest import Gui
from tests.gui.served import browser_cookie, next_frame, serving

pytestmark = pytest.mark.gpu
_OF_FILES = ("Open…", "Save hologram…", "Save view…", "Save focal sweep…", "Copy image", "Paste picture", "Quit")
_SIZE = {"width": 640, "height": 400, "pwidth": 640, "pheight": 400, "ratio": 1.0}


def test_what_reads_or_writes_files_or_ends_the_viewer_isnt_there(make_gui: Callable[..., Gui]) -> None:
    plain = {command.name for command in make_gui(panels=(ImagePanel, FilesPanel)).context.commands}
    assert plain >= set(_OF_FILES)


def test_only_that_is_missing(make_gui: Callable[..., Gui], tmp_path: Path) -> None:
    gui = make_gui(size=(800, 480), engine=True, panels=(ImagePanel, FilesPanel, HistoryPanel), is_read_only=True)
    gui.draw_until_idle()
    dialog = gui.app.panel(FilesPanel).dialog
    dialog.folder = tmp_path
    for name in _OF_FILES:
        with pytest.raises(UserError, match="command"):
            gui.context.commands.run(name)
    for chord in ("Ctrl+S", "Ctrl+O", "Ctrl+E", "Ctrl+Q", "Ctrl+V", "Ctrl+Shift+C"):
        gui.press_chord(chord)
        gui.draw_frames(2)
        assert not dialog.is_open and not gui.app.window.closed, chord
    gui.engine(lambda ctx: _expect_no_buttons(ctx))
    assert not list(tmp_path.iterdir())
    gui.context.commands.run("Random patterns")
    assert [step.label for step in gui.session.history] == ["Start", "Random patterns"], "it can be used"
    assert len(gui.app.tour.steps) == 4, "the tour's step to files is left out"


def _expect_no_buttons(ctx: Any) -> None:
    assert not any(ctx.item_exists(f"Files/{name}") for name in ("Open…", "Save hologram…", "Save preset…"))


@pytest.mark.long
def test_served_to_look_at_it_writes_nothing_and_cant_be_ended(device: Device, tmp_path: Path) -> None:
    with serving(tmp_path, "--look", "--clients", "1") as served:
        cookie = {"Cookie": browser_cookie(served.address, served.token)}
        with connect(f"ws://{served.address}/", additional_headers=cookie, max_size=None) as browser:
            browser.send(json.dumps({"type": "resize", "timestamp": 0.0, **_SIZE}))
            next_frame(browser)
            for key, modifiers in (("s", ["Control"]), ("e", []), ("q", ["Control"])):
                _press(browser, key, modifiers)
            browser.send(json.dumps({"type": "close", "timestamp": 0.0}))
            browser.send(json.dumps({"type": "_clients_change", "ids": []}))
            browser.send(json.dumps({"type": "resize", "timestamp": 0.0, **_SIZE, "pwidth": 10**9}))
            browser.send('{"type": "pointer_move", "x": NaN, "y": 1e999, "timestamp": 0}')
            _press(browser, "F1", [])
            for _ in range(4):
                assert next_frame(browser).shape[:2] == (400, 640)
        assert served.process.poll() is None
        written = [path.name for path in (tmp_path / "holoview").rglob("*")]
        assert all(name.startswith("declarations-") for name in written), "a cache of the program, nothing of a user's"


def _press(browser: ClientConnection, key: str, modifiers: list[str]) -> None:
    for kind in ("key_down", "key_up"):
        browser.send(json.dumps({"type": kind, "key": key, "modifiers": modifiers, "timestamp": 0.0}))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--look"], "--look: without --serve"),
        (["--clients", "3"], "--clients: without --serve"),
        (["--host-name", "a.example"], "--host-name: without --serve"),
        (["--serve", ":0", "--clients", "0"], "--clients: '0'; expected a whole number of at least 1, at most 1000"),
        (["--serve", ":0", "--idle", "-1"], "--idle: -1"),
        (["--serve", ":0", "--idle", "nan"], "--idle: 'nan'"),
        (["--serve", ":0", "--host-name", "http://a.example"], '--host-name: "http://a.example"'),
        (["--serve", ":0", "--key", "k.pem"], "--key: without --certificate"),
        (["--serve", ":0", "--certificate", "none.pem"], "--certificate: none.pem isn't a file"),
    ],
)
def test_options_that_make_no_sense_are_refused(
    options: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", *options]) == 2
    assert words in capsys.readouterr().err


def test_the_warning_says_what_others_may_do() -> None:
    everywhere, here = Address("0.0.0.0", 80), Address("127.0.0.1", 80)
    assert "open and write files as you" in ServeOptions().warning(everywhere)
    looked = ServeOptions(is_read_only=True).warning(everywhere)
    assert "see and change what is shown" in looked and "files" not in looked and "not encrypted" in looked
    assert ServeOptions().warning(here) == ""
