"""Runs the viewer on a screen, off screen by a script, or in a browser."""

from __future__ import annotations

import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from threading import Event, Thread
from typing import Any

from rendercanvas.utils.asyncs import sleep

from holoview.holograms.hologram import Hologram
from holoview.light.gpu.device import Device, DeviceLost
from holoview.util.errors import UserError
from holoview.util.file_writer import save_elsewhere
from holoview.util.processes import ENDING, Interrupted, Interruption, handled_signals, is_left, leave
from holoview.util.text import plain_name
from holoview.viewer.app.app import App
from holoview.viewer.app.desktop import connect_desktop, fit_text_size
from holoview.viewer.app.panels.rig import open_rig
from holoview.viewer.app.script import InputDriver, run_script, screenshot, wait_until_idle
from holoview.viewer.app.serve import Address, ServeOptions, serve
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.example import shows_example
from holoview.viewer.document.file_loader import NO_FILES, FilesToOpen
from holoview.viewer.document.received_fields import ReceivedFields
from holoview.viewer.document.session_store import SessionStore, state_folder
from holoview.viewer.render.progressive_renderer import ProgressiveRenderer

_IDLE_S = 0.05  # between checks for work while there is none
_FRAME_POLL_S, _LONGEST_FRAME_S = 0.002, 0.1  # between checks for a drawn frame; a hidden window draws none
_TITLE = "holoview"
SCRIPT_FRAME_S = 1 / 60

Listen = Callable[[ReceivedFields], None]
"""Makes a viewer take fields of other programs, and tells where."""


def run_until_image(
    session: EditingSession,
    device: Device,
    renderer: ProgressiveRenderer,
    size: tuple[int, int],
    on_image: Callable[[], None],
    files: FilesToOpen = NO_FILES,
) -> None:
    """Draws an off-screen window of `size` (x, y) pixels until it shows an image, that of `files` if there are some.

    Calls `on_image` then. Raises UserError for files that can't be opened.
    """
    from rendercanvas.offscreen import OffscreenRenderCanvas

    app = App(session, device, OffscreenRenderCanvas(size=size), frame_s=SCRIPT_FRAME_S, renderer=renderer)
    try:
        driver = InputDriver(app)
        if files.names:
            app.context.loader.open(files.names, files.request)
        driver.draw_frames()
        while not app.has_shown_image:
            time.sleep(app.context.side_renderers.wait_s)
            session.poll()
            _raise_error_of(session)
            app.compute_slice()
            if app.awaits_frame:
                driver.draw_frames()
        on_image()
    finally:
        app.close()


def run_offscreen(
    session: EditingSession,
    device: Device,
    renderer: ProgressiveRenderer,
    size: tuple[int, int],
    script: str = "",
    where: str = "script",
    picture: Path | None = None,
    files: FilesToOpen = NO_FILES,
    rig: Path | None = None,
) -> None:
    """Draws an off-screen window of `size` (x, y) pixels, opens `files`, runs a script and writes a screenshot.

    where: names the script in errors. picture: the path of the screenshot; None for none. rig: rig.toml of the devices
    to open. Raises UserError for files that can't be opened, and where the lasers of the devices may be on at the end.
    """
    from rendercanvas.offscreen import OffscreenRenderCanvas

    app = App(session, device, OffscreenRenderCanvas(size=size), frame_s=SCRIPT_FRAME_S, renderer=renderer)
    try:
        driver = InputDriver(app)
        driver.draw_frames(3)
        if files.names:
            app.context.loader.open(files.names, files.request)
            wait_until_idle(driver)
            _raise_error_of(session)
        if rig is not None:
            open_rig(app.context, rig)
        wait_until_idle(driver)
        run_script(driver, script, where)
        if picture is not None:
            wait_until_idle(driver)
            screenshot(driver, picture)
    finally:
        app.close()
    if app.danger:
        raise UserError("rig", app.danger)


def _raise_error_of(session: EditingSession) -> None:
    """Raises UserError with the first error that a session has told: off the screen nobody reads its messages."""
    for message in session.messages.all:
        if message.kind == "error":
            raise UserError("", message.text)


def run_on_screen(
    session: EditingSession,
    device: Device,
    renderer: ProgressiveRenderer,
    size: tuple[int, int],
    store: SessionStore,
    files: FilesToOpen = NO_FILES,
    on_image: Callable[[], None] | None = None,
    rig: Path | None = None,
    listen: Listen | None = None,
) -> None:
    """Runs a window until it is closed, or with `on_image` until it shows an image. Raises UserError without a screen.

    on_image: called when the first image is displayed. rig: rig.toml of the devices to open. listen: as of `open_app`.
    """
    try:  # here: glfw can't be imported on a machine without its libraries
        import glfw
        from rendercanvas.glfw import RenderCanvas, loop
    except (ImportError, RuntimeError) as error:
        raise _no_screen(error) from error
    if not glfw.init():
        raise _no_screen(None)
    canvas = RenderCanvas(size=size, title=_TITLE, max_fps=60)
    app = open_app(session, device, canvas, store, files, renderer, rig=rig, listen=listen)
    connect_desktop(app.context, glfw, canvas._window)
    fit_text_size(app.context, glfw, canvas._window)
    if on_image is not None:
        loop.add_task(_close_after_image, app, on_image, bool(files.names), name="until image")
    _run_loop(app, store, loop, loop.run)


def run_in_browser(
    session: EditingSession,
    device: Device,
    renderer: ProgressiveRenderer,
    size: tuple[int, int],
    store: SessionStore | None,
    files: FilesToOpen,
    address: Address,
    options: ServeOptions,
    began: Callable[[str], None],
    rig: Path | None = None,
    listen: Listen | None = None,
) -> None:
    """Serves the viewer to a browser until it is interrupted; `began` is called with the address.

    store: None where the viewer is served to look at only. rig: rig.toml of the devices to open. listen: as of
    `open_app`.
    """
    from holoview.viewer.app import served_canvas

    canvas = served_canvas.ServedCanvas(size=size, title=_TITLE, max_fps=30)
    app = open_app(session, device, canvas, store, files, renderer, options.is_read_only, rig, listen)
    _run_loop(app, store, served_canvas.loop, lambda: serve(address, began, canvas.get_closed, options=options))


def open_app(
    session: EditingSession,
    device: Device,
    canvas: Any,
    store: SessionStore | None,
    files: FilesToOpen,
    renderer: ProgressiveRenderer | None = None,
    is_read_only: bool = False,
    rig: Path | None = None,
    listen: Listen | None = None,
) -> App:
    """The viewer with the user's preferences, opening `files`; a user who hasn't seen the tour gets it or a hint.

    The tour is of the example; who begins with something else is told where help is. store: None where nothing is
    stored, nor the tour remembered. is_read_only: see `App`. rig: rig.toml of devices to open, without the tour.
    listen: makes the viewer take fields of other programs, without the tour.
    """
    app = App(
        session, device, canvas, store=store, tunes=not is_read_only, renderer=renderer, is_read_only=is_read_only
    )
    if files.names:
        app.context.attempt(app.context.loader.open, files.names, files.request)
    if rig is not None:
        app.context.attempt(open_rig, app.context, rig)
    if listen is not None:
        _listen_or_close(app, listen)
    if store is None or app.tour.was_seen or rig is not None or listen is not None:
        return app
    if shows_example(session) and not files.names:
        app.tour.start()
    elif not store.preferences.get("has_begun", False):
        session.messages.post(
            "Drop a picture here to see it as a hologram. ? shows all keys, Ctrl+P finds any command."
        )
        app.context.attempt(store.preferences.set, "has_begun", True)
    return app


def _listen_or_close(app: App, listen: Listen) -> None:
    try:
        listen(app.context.received_fields)
    except UserError:
        app.close()
        raise


def _run_loop(app: App, store: SessionStore | None, loop: Any, run: Callable[[], None]) -> None:
    """Runs the window's loop; Ctrl-C, SIGTERM and SIGHUP close the window as its user does, with all saved.

    store: None where nothing is to be saved. Ctrl-C is a usual way to end it. Raises Interrupted after another signal,
    and UserError after a failure.
    """
    autosave, interruption = None if store is None else store.start_autosave(app.session), Interruption()
    app.session.wake = partial(_wake_window, loop, app)
    loop.add_task(compute_loop, app, name="compute")

    def save() -> bool:
        """Called on another thread, where the window's can't be waited for."""
        return not app.context.has_rig and (autosave is None or autosave.close() is None)

    with handled_signals(interruption.ask) as take_signals, ending_after_grace(save) as window_is_closed:
        loop.add_task(_close_at_signal, app, interruption, take_signals, name="signals")
        try:
            run()
        finally:
            take_signals()
            if app.window.error is None and not interruption():
                window_is_closed()
            app.session.jobs.cancel_all()  # what they have found is queued to be saved, which takes a processor
            failed = app.window.error
            unsaved = None
            if autosave is not None and failed is None:
                unsaved = autosave.close()
            elif autosave is not None:  # the session is offered for recovery
                autosave.flush()
            app.close()
    if isinstance(failed, DeviceLost):
        raise failed
    if isinstance(failed, UserError):
        raise UserError(failed.where, failed.found, remedy="start again: your work is saved and will be offered")
    if app.danger:
        raise UserError("rig", app.danger)
    if unsaved is not None:
        raise _unsaved_error(app.session, unsaved)
    if interruption.signal not in (0, signal.SIGINT):
        raise Interrupted(interruption.signal)


async def _close_at_signal(app: App, interruption: Interruption, take_signals: Callable[[], None]) -> None:
    """Closes the window after a signal; it takes the signals from rendercanvas and uvicorn, which have begun by now."""
    take_signals()
    while not interruption():
        await sleep(_IDLE_S)
    app.window.canvas.close()


def _unsaved_error(session: EditingSession, unsaved: Exception) -> UserError:
    """The last message when the session couldn't be saved; its hologram is kept at another place."""
    document = session.document
    name = f"{plain_name(document.system.name, 'hologram')}.safetensors"
    kept = save_elsewhere(state_folder() / name, Hologram(document.drive, document.system).save)
    where = "" if kept is None else f"the hologram as it was at last is in {kept}"
    return UserError("session", f"the last edits aren't saved: {unsaved}", remedy=where)


def _wake_window(loop: Any, app: App) -> None:
    """Has the loop call the window's `wake`; without effect when the loop has ended. May be called on any thread."""
    with suppress(AttributeError, RuntimeError):  # of an ended loop, for which rendercanvas has no public test
        loop.call_soon_threadsafe(app.window.wake)


async def compute_loop(app: App) -> None:
    """Computes slices and yields to the window's loop in between; sleeps while there is nothing to compute.

    Ends with the window, which it closes if the device was lost.
    """
    try:
        while not app.window.canvas.get_closed():
            app.window.device.check_alive()  # a canvas that lost it in the middle of a frame may ask for no other frame
            app.redraw_if_due()
            is_more_to_do = app.compute_slice()
            until = time.perf_counter() + _LONGEST_FRAME_S
            while app.awaits_frame and time.perf_counter() < until:  # an image is shown before the next one is begun
                await sleep(_FRAME_POLL_S)
            await sleep(0 if is_more_to_do else app.context.side_renderers.wait_s or _IDLE_S)
    except Exception as error:
        if (lost := app.window.device.loss_behind(error)) is None:
            raise
        app.window.end(lost)


async def _close_after_image(app: App, on_image: Callable[[], None], opens_files: bool) -> None:
    """Closes the window when it has shown an image, that of the files if there are some."""
    while app.context.loader.is_opening or not app.has_shown_image:
        await sleep(_FRAME_POLL_S)
    while opens_files and (app.context.side_renderers.is_busy or app.awaits_frame):
        await sleep(_FRAME_POLL_S)
    app.window.device.wait()
    on_image()
    app.window.canvas.close()


def _no_screen(error: BaseException | None) -> UserError:
    found = f"can't be opened: {error}" if error else "can't be opened: no display was found"
    return UserError("window", found, remedy="use --serve for a browser, or --offscreen with --screenshot")


# Ends a viewer that was asked to end while its window's thread is inside a graphics driver, which nothing interrupts,
# or whose threads work on when the window is closed.
#
# A driver that compiles a shader or draws a large picture in software can keep a thread for many seconds; Python takes
# signals only after that. Compiling an optimisation's model takes as long, and ends no earlier when it is cancelled.


GRACE_S = 2.0
"""Seconds from the signal that the window's thread has to close the window in good order."""
_CLOSED, _AFTER_CLOSING_S = 0, 0.5  # in place of a signal's number; what the threads then have to end by themselves


@contextmanager
def ending_after_grace(save: Callable[[], bool], grace_s: float = GRACE_S) -> Iterator[Callable[[], None]]:
    """While the block runs, a signal that asks the viewer to end does so after `grace_s`, if the block still runs then.

    Yields a function that says that the window was closed: then the viewer ends after half a second likewise, with
    code 0. Only where this process may be left so (`util.processes.is_left`), and on its main thread. save: called on
    another thread, saves the work; tells whether that worked and nothing else has to be done first, such as switching
    lasers off. Otherwise the block goes on.
    """
    if not is_left():
        yield lambda: None
        return
    over = Event()
    reading, writing = socket.socketpair()
    with reading, writing:
        writing.setblocking(False)
        watch = Thread(target=_watch, args=(reading, over, save, grace_s), name="end of viewer", daemon=True)
        watch.start()
        before = signal.set_wakeup_fd(writing.fileno(), warn_on_full_buffer=False)
        try:
            yield lambda: writing.sendall(bytes([_CLOSED]))
        finally:
            over.set()
            signal.set_wakeup_fd(before)
            writing.close()  # ends the watch, if it still reads
            watch.join()


def _watch(reading: socket.socket, over: Event, save: Callable[[], bool], grace_s: float) -> None:
    """Waits for a signal, whose number the interpreter writes at once, and then for the end of the block."""
    while (number := reading.recv(1)) and number[0] not in (*ENDING, _CLOSED):
        pass
    if number and not over.wait(grace_s if number[0] != _CLOSED else min(grace_s, _AFTER_CLOSING_S)) and save():
        leave(0 if number[0] in (_CLOSED, signal.SIGINT) else 128 + number[0])
