"""Opens the device and the session that the command line asks for, and runs the viewer with them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from holoview.holograms.fields.reading import ReadRequest
from holoview.light.gpu.device import Device
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.viewer.app.serve import Address, ServeOptions, require_serving_libraries
from holoview.viewer.app.startup import Startup
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.example import new_session
from holoview.viewer.document.received_fields import ReceivedFields
from holoview.viewer.document.session_store import SessionStore
from holoview.viewer.document.sweeper import Sweeper
from holoview.viewer.render.progressive_renderer import ProgressiveRenderer
from holoview.viewer.render.view_settings import NOW


@dataclass(frozen=True)
class LaunchOptions:
    """How `holoview view` opens the viewer.

    is_random: whether a new session shows random patterns instead of the example. names: files to open in it. request:
    the user's statements on them as the parts of a field of another program; None where they may be anything. size: of
    the window (x, y) in pixels. adapter: part of the name of a WebGPU adapter, None for any. restores: whether the last
    session is restored instead of opening `system`. serve: HOST:PORT to serve a browser, None for a window.
    serve_options: to whom it is served; where that is to look at only, nothing is stored and no session restored.
    is_offscreen: draws without a screen, runs `script` (its text) and writes `screenshot`; script_name names the script
    in errors. until_image: whether the viewer ends when its first image is displayed, and prints that. recovers: id of
    the process of a viewer that crashed, whose session is opened if it was saved; None for none. rig: rig.toml of the
    devices to open; None for none. listen_port: where fields of other programs are taken; 0 for a free port, None for
    not listening. sweeper: what measures the points of sweeps; None for a viewer without.
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
    until_image: bool = False
    recovers: int | None = None
    serve_options: ServeOptions = field(default_factory=ServeOptions)
    rig: Path | None = None
    request: ReadRequest | None = None
    listen_port: int | None = None
    sweeper: Sweeper | None = None


IMAGE_DISPLAYED = "the first image is displayed"
"""The line that is printed with `until_image`."""


def launch(options: LaunchOptions, startup: Startup, report: Callable[[str], None]) -> None:
    """Runs the viewer until it is closed; `report` prints a line, such as the address that is served.

    startup: opens the device, beside which the session is opened; its thread then computes the first picture, while
    this one imports what the window needs.
    Raises UserError where a library is missing, or the device, the window or a file can't be opened.
    """
    address = None if options.serve is None else Address.parse(options.serve)
    if address is not None:
        require_serving_libraries()
    is_read_only = address is not None and options.serve_options.is_read_only
    store = None if options.is_offscreen or is_read_only else SessionStore()
    has_window = address is None and not options.is_offscreen
    crashed = None
    if store is not None and options.recovers is not None:
        _device(options, startup, has_window)  # what crashed stays as it is for a program that can show it
        with suppress(UserError):  # nothing of it can be read: it is offered, and kept aside then
            crashed = store.take_over(options.recovers)
    session, notes = (crashed, []) if crashed is not None else open_session(options, store)
    for note in notes:
        report(f"note: {note}")
        session.messages.post(note, "warning")
    session.sweeper = options.sweeper
    names = options.names if crashed is None else ()
    device = _device(options, startup, has_window)
    renderer = ProgressiveRenderer(device, remembers=True)
    if not names:
        renderer.start(session.scene_for(NOW), startup.thread)
    from holoview.viewer.app.run import (  # slow start: ImGui
        run_in_browser,
        run_offscreen,
        run_on_screen,
        run_until_image,
    )
    from holoview.viewer.document.file_loader import FilesToOpen  # slow start

    files = FilesToOpen(names, options.request)
    on_image = partial(print, IMAGE_DISPLAYED, flush=True) if options.until_image else None
    window = (session, device, renderer, options.size)
    listen = None if options.listen_port is None else partial(_listen, options.listen_port, report)
    if address is not None:
        run_in_browser(*window, store, files, address, options.serve_options, report, options.rig, listen)
    elif store is None and on_image is not None:
        run_until_image(*window, on_image, files)
    elif store is None:
        run_offscreen(*window, options.script, options.script_name, options.screenshot, files, options.rig)
    else:
        run_on_screen(*window, store, files, on_image, options.rig, listen)


def _listen(port: int, report: Callable[[str], None], received_fields: ReceivedFields) -> None:
    report(f"takes fields of other programs at {received_fields.listen(port)}")


def open_session(options: LaunchOptions, store: SessionStore | None) -> tuple[EditingSession, list[str]]:
    """The last session or a new one, and a line about each part of the stored state that is damaged."""
    notes = [] if store is None else [*filter(None, [store.preferences.problem]), *store.set_damaged_aside()]
    last = store.last_session() if store is not None and options.restores else None
    if store is not None and last is not None:
        try:
            return last.restore(), notes
        except UserError:
            notes.append(f"{store.set_aside(last.folder)}; a new one is begun")
    return new_session(options.system, is_random=options.is_random), notes


def _device(options: LaunchOptions, startup: Startup, has_window: bool) -> Device:
    """The WebGPU device; without any adapter, a window first shows a page that says what to do."""
    try:
        return startup.device()
    except UserError as error:
        if has_window and options.adapter is None:
            from holoview.viewer.app.no_adapter import show_no_adapter_page  # slow start: ImGui

            show_no_adapter_page(error)
        raise
