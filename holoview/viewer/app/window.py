"""Dear ImGui in a window of rendercanvas, drawn by wgpu on the device that renders the holograms.

HelloImGui runs with its null platform and null renderer backends, so that docking, themes and the stored layout work
in the same way on a screen, off screen and in a browser.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

from imgui_bundle import hello_imgui, imgui, immapp
from wgpu.utils.imgui import ImguiWgpuBackend

from holoview.light.gpu.device import Device, DeviceLost
from holoview.viewer.app.user_input import EVENT_TYPES, ImguiInputQueue

_LONGEST_FRAME_S, _SHORTEST_FRAME_S = 0.25, 1e-4
_TOOLTIP_MOMENTS_S = (0.2, 0.45, 0.7)  # after the last event; ImGui's tooltip delay advances only with drawn frames
_BLINK_S = 0.4  # between frames while a text field has the focus
_CURSORS = {
    imgui.MouseCursor_.text_input: "text",
    imgui.MouseCursor_.resize_all: "pointer",
    imgui.MouseCursor_.resize_ns: "ns_resize",
    imgui.MouseCursor_.resize_ew: "ew_resize",
    imgui.MouseCursor_.resize_nesw: "nesw_resize",
    imgui.MouseCursor_.resize_nwse: "nwse_resize",
    imgui.MouseCursor_.hand: "pointer",
    imgui.MouseCursor_.not_allowed: "not_allowed",
}
_SETTLING_FRAMES = 3  # drawn after an event: ImGui responds to some events one or two frames later
_UNSEEN_S = 0.05  # of frames that process input that waits; then one is drawn, so that its effect is seen


class Window:
    """Draws ImGui into a canvas when something has happened: an event, or a call of `wake`.

    frame_s: a fixed time between frames, which makes pictures repeatable (all input that waits is processed then before
    a frame is drawn, however slow the machine is); measured when None. Call `open` once before
    the first frame and `close` at the end: a process has one ImGui window at a time.

    title: what is written above it. draw_s: time that drawing the last frame took on the CPU. error: the exception that
    ended the last frame, or None.
    """

    def __init__(self, canvas: Any, device: Device, *, frame_s: float | None = None) -> None:
        self.canvas, self.device = canvas, device
        self._params = hello_imgui.RunnerParams()
        self.title, self.draw_s = "", 0.0
        self.closed = False
        self.error: BaseException | None = None
        self._frame_s, self._last = frame_s, time.perf_counter()
        self._settling, self._event_at, self._rested = _SETTLING_FRAMES, self._last, 0
        self._cursor, self._input = "", ImguiInputQueue()
        self._has_more, self._is_seen, self._unseen_until = False, True, self._last
        self._context = canvas.get_wgpu_context()
        self._format = self._context.get_preferred_format(device.raw.adapter).removesuffix("-srgb")
        self._context.configure(device=device.raw, format=self._format)
        self._backend: ImguiWgpuBackend | None = None

    def open(self, params: hello_imgui.RunnerParams) -> None:
        """Starts HelloImGui as `params` describe, and takes the canvas's events from now on."""
        self._params = params
        self._set_up(params)
        self.canvas.add_event_handler(self._on_event, *EVENT_TYPES, "resize")
        self.canvas.request_draw(self.draw)

    def texture(self, view: Any) -> imgui.ImTextureRef:
        """Registers the view of a device texture with ImGui; the reference is for `imgui.image` and draw lists."""
        assert self._backend is not None
        return self._backend.register_texture(view)

    def forget_texture(self, reference: imgui.ImTextureRef) -> None:
        """Ends the use of a texture; it may be drawn until the end of this frame."""
        assert self._backend is not None
        self._backend.unregister_texture(reference)

    def wake(self) -> None:
        """Requests a frame. Call it on the window's thread."""
        self._settling = max(self._settling, 1)
        self.canvas.request_draw()

    @property
    def has_pending_input(self) -> bool:
        """Whether events wait to be processed; drawing frames processes them."""
        return self._input.has_pending

    @property
    def rested_s(self) -> float:
        """The time since the last event."""
        return time.perf_counter() - self._event_at

    def needs_redraw(self) -> bool:
        """Whether a frame is due without an event: for a tooltip after a rest of the pointer, for a blinking cursor."""
        if self.closed:
            return False
        now = time.perf_counter()
        rested = sum(self._event_at + moment <= now for moment in _TOOLTIP_MOMENTS_S)
        if rested > self._rested:
            self._rested = rested
            return True
        return imgui.get_io().want_text_input and now - self._last > _BLINK_S

    def set_title(self, title: str) -> None:
        """Writes a title above the window, if it is another one."""
        if title != self.title:
            self.title = title
            self.canvas.set_title(title)

    def request_close(self) -> None:
        """Closes the window after the present frame."""
        self._params.app_shall_exit = True

    def draw(self, *, is_seen: bool = True) -> None:
        """Draws a frame; input that waits is processed in frames before it that aren't drawn.

        is_seen: whether the frame is drawn into the canvas; panels respond to input in either case.
        An exception is stored as `error` and raised, since the canvas would only log it.
        When the device was lost, nothing can be drawn any more: the exception is stored and the window closes.
        A canvas may ask for one more frame after it was closed: nothing is drawn then, since ImGui has ended.
        """
        if self.closed:
            return
        begun, self._is_seen = time.perf_counter(), is_seen
        self._unseen_until = math.inf if self._frame_s else begun + _UNSEEN_S
        try:
            self._has_more = True
            while self._has_more:
                self._has_more = False
                immapp.manual_render.render()
        except BaseException as error:
            if (lost := self.device.loss_behind(error)) is not None:
                self.end(lost)
                return
            self.error = error
            raise
        self.draw_s = time.perf_counter() - begun
        if self._params.app_shall_exit:
            self.canvas.close()
        elif self._settling > 0 or self._input.has_pending:
            self._settling = max(self._settling - 1, 0)
            self.canvas.request_draw()

    def end(self, error: DeviceLost) -> None:
        """Closes the window, since the device was lost."""
        self.error = error
        self.canvas.close()

    def close(self) -> None:
        """Ends ImGui and closes the canvas."""
        if not self.closed:
            self.closed = True
            self._backend = None
            immapp.manual_render.tear_down()
            self.canvas.close()

    # --- HelloImGui -------------------------------------------------------------------------------------------------

    def _set_up(self, params: hello_imgui.RunnerParams) -> None:
        params.platform_backend_type = hello_imgui.PlatformBackendType.null
        params.renderer_backend_type = hello_imgui.RendererBackendType.null
        params.fps_idling.enable_idling = False
        calls = params.callbacks
        calls.post_init = _chain(self._begin, calls.post_init)
        calls.pre_new_frame = _chain(self._begin_frame, calls.pre_new_frame)
        calls.before_swap = self._present
        calls.before_exit_post_cleanup = imgui.destroy_context  # the null runner doesn't
        addons = immapp.AddOnsParams(with_implot=True)
        immapp.manual_render.setup_from_runner_params(params, addons)

    def _begin(self) -> None:
        self._backend = ImguiWgpuBackend(self.device.raw, self._format)

    def _begin_frame(self) -> None:
        io = imgui.get_io()
        self._input.begin_frame()
        io.display_size = imgui.ImVec2(*self._context.logical_size)
        io.display_framebuffer_scale = imgui.ImVec2(self._context.pixel_ratio, self._context.pixel_ratio)
        now = time.perf_counter()
        io.delta_time = self._frame_s or min(max(now - self._last, _SHORTEST_FRAME_S), _LONGEST_FRAME_S)
        self._last = now

    def _present(self) -> None:
        """Draws the frame, unless more input waits and there is time to process it in a frame that nobody sees."""
        assert self._backend is not None
        is_late = time.perf_counter() > self._unseen_until
        self._has_more = self._input.has_pending and not is_late and not self._params.app_shall_exit
        if self._has_more or not self._is_seen:
            return
        cursor = _CURSORS.get(imgui.MouseCursor_(imgui.get_mouse_cursor()), "default")
        if cursor != self._cursor:
            self._cursor = cursor
            self.canvas.set_cursor(cursor)
        self.device.check_alive()
        encoder = self.device.raw.create_command_encoder(label="window")
        attachment = {
            "view": self._context.get_current_texture().create_view(),
            "resolve_target": None,
            "clear_value": (0, 0, 0, 1),
            "load_op": "clear",
            "store_op": "store",
        }
        drawn = encoder.begin_render_pass(color_attachments=[attachment])
        self._backend.render(imgui.get_draw_data(), drawn)
        drawn.end()
        self.device.raw.queue.submit([encoder.finish()])

    # --- events -----------------------------------------------------------------------------------------------------

    def _on_event(self, event: dict[str, Any]) -> None:
        if self.closed:
            return
        self._input.enqueue(event)
        self._settling, self._event_at, self._rested = _SETTLING_FRAMES, time.perf_counter(), 0
        self.canvas.request_draw()


def _chain(first: Callable[[], None], then: Callable[[], None] | None) -> Callable[[], None]:
    def both() -> None:
        first()
        if then is not None:
            then()

    return both
