"""Opens the device and the session that the command line asks for, and runs the viewer with them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from holoview.app.no_adapter import show_no_adapter_page
from holoview.app.run import run_in_browser, run_offscreen, run_on_screen
from holoview.app.serve import Address, require_serving_libraries
from holoview.gpu.device import Device, open_device
from holoview.model.system import System
from holoview.session.example import new_session
from holoview.session.session_store import SessionStore
from holoview.util.errors import UserError


@dataclass(frozen=True)
class LaunchOptions:
    """How `holoview view` opens the viewer.

    is_random: whether a new session shows random patterns instead of the example. names: files to open in it. size: of
    the window (x, y) in pixels. adapter: part of the name of a WebGPU adapter, None for any. restores: whether the last
    session is restored instead of opening `system`. serve: HOST:PORT to serve a browser, None for a window.
    is_offscreen: draws without a screen, runs `script` (its text) and writes `screenshot`; script_name names the script
    in errors.
    """

    system: System
    is_random: bool
    names: Sequence[str]
    size: tuple[int, int]
    adapter: str | None
    restores: bool
    serve: str | None
    is_offscreen: bool
    script: str
    script_name: str
    screenshot: Path | None


def launch(options: LaunchOptions, report: Callable[[str], None]) -> None:
    """Runs the viewer until it is closed; `report` prints a line, such as the address that is served.

    Raises UserError where a library is missing, or the device, the window or a file can't be opened.
    """
    address = None if options.serve is None else Address.parse(options.serve)
    if address is not None:
        require_serving_libraries()
    device = _open_device(options, has_window=address is None and not options.is_offscreen)
    if options.is_offscreen:
        session = new_session(options.system, is_random=options.is_random)
        run_offscreen(
            session, device, options.size, options.script, options.script_name, options.screenshot, options.names
        )
        return
    store = SessionStore()
    last = store.last_session() if options.restores else None
    session = new_session(options.system, is_random=options.is_random) if last is None else last.restore()
    if address is not None:
        run_in_browser(session, device, store, address, report, options.size, options.names)
    else:
        run_on_screen(session, device, store, options.size, options.names)


def _open_device(options: LaunchOptions, has_window: bool) -> Device:
    """The WebGPU device; without any adapter, a window first shows a page that says what to do."""
    try:
        return open_device(options.adapter)
    except UserError as error:
        if has_window and options.adapter is None:
            show_no_adapter_page(error)
        raise
