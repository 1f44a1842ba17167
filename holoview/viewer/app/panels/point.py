"""The panels of a point of the image: sections along the axis, and where its light comes from."""

from __future__ import annotations

from functools import partial

from imgui_bundle import imgui

from holoview.viewer.app.context import AppContext
from holoview.viewer.app.panel import Panel
from holoview.viewer.app.viewport import Viewport, next_corner, tile_view_settings
from holoview.viewer.app.widgets import combo, share_of_width, show_tooltip, tooltip
from holoview.viewer.document.focus_edits import focus_at, focus_range_m
from holoview.viewer.render.point_probe import WINDOWS, SeenPoint, SeenSections, angle_deg
from holoview.viewer.render.scene import DeviceImage
from holoview.viewer.render.view_settings import ViewSettings

_MARK = imgui.IM_COL32(255, 220, 80, 200)
_OWN_COLOURS = ViewSettings(plane_m=0.0, page="field")
_DIRECTIONS_LINES = 14.0  # of text: the height of the picture of directions
_WAITING = "The light is on its way."
_HINT = "Ctrl+click on the image places the cursor."


class SectionsPanel(Panel):
    """Shows the light in the planes x–z and y–z through the cursor; a click moves the focal plane and the cursor."""

    title = "Sections"
    dock = "Low right"
    starts_open = False

    def set_up(self, context: AppContext) -> None:
        """Adds the command that opens the panel."""
        show = partial(context.show_panel, self.title)
        context.commands.add("Image", "Sections", show, "V", "The light in x–z and y–z through the cursor.")
        self._pictures = {name: Viewport(context, f"section {name}") for name in ("x-z", "y-z")}

    def draw(self, context: AppContext) -> None:
        """Draws both sections, below each other."""
        session, probe = context.session, context.point_probe
        low_m, high_m = focus_range_m(session.system)
        probe.request_sections(session.displayed_document.scene, session.view_settings, low_m, high_m)
        seen = probe.sections
        if seen is None:
            imgui.text_disabled(_WAITING)
            return
        y, x = seen.place
        height = (imgui.get_content_region_avail().y - 3 * imgui.get_text_line_height_with_spacing()) / 2 - 8
        for name, label, picture, at in (
            ("x-z", f"x–z at y {y}", seen.xz, x),
            ("y-z", f"y–z at x {x}", seen.yz, y),
        ):
            imgui.text(label)
            self._draw_section(context, seen, name, picture, at, height)
        text = f"z {seen.low_m * 1e3:.4g} to {seen.high_m * 1e3:.4g} mm, to the right"
        imgui.text_disabled(text if seen.share == 1 else f"{text}; {seen.share:.0%} of the planes")
        tooltip(_HINT)

    def _draw_section(
        self, context: AppContext, seen: SeenSections, name: str, picture: DeviceImage, at: int, height: float
    ) -> None:
        """Draws a section with lines at the focal plane and at the cursor, which a drag in it moves."""
        session, shown, span_m = context.session, self._pictures[name], seen.high_m - seen.low_m
        size = (max(int(imgui.get_content_region_avail().x), 16), max(int(height), 16))
        _draw_picture(context, shown, f"section {name}", picture, tile_view_settings(session.view_settings), size)
        planes = (session.view_settings.plane_m - seen.low_m) / span_m * picture.shape[1]
        middle, canvas = shown.to_screen(planes, at + 0.5), imgui.get_window_draw_list()
        canvas.push_clip_rect(shown.corner, shown.end, True)
        canvas.add_line(imgui.ImVec2(middle.x, shown.corner.y), imgui.ImVec2(middle.x, shown.end.y), _MARK)
        canvas.add_line(imgui.ImVec2(shown.corner.x, middle.y), imgui.ImVec2(shown.end.x, middle.y), _MARK)
        canvas.pop_clip_rect()
        if imgui.is_item_active():
            u, v = (min(max(share, 0.0), 1.0) for share in shown.to_image(imgui.get_io().mouse_pos))
            context.attempt(focus_at, session, seen.low_m + u * span_m)
            row, column = session.view_settings.cursor_in(session.document.image_shape)
            moved = min(int(v * picture.shape[0]), picture.shape[0] - 1)
            context.edit_view("Cursor", cursor=(moved, row) if name == "x-z" else (column, moved))


class PointPanel(Panel):
    """Shows which directions reach the cursor, and which lasers, orders and areas of the modulators lit it."""

    title = "Point"
    dock = "Low right"
    starts_open = False

    def __init__(self) -> None:
        self._window = 64

    def set_up(self, context: AppContext) -> None:
        """Adds the command that opens the panel."""
        show = partial(context.show_panel, self.title)
        context.commands.add("Image", "Light of a point", show, "I", "Where the light at the cursor comes from.")
        self._pictures = dict[str, Viewport]()

    def draw(self, context: AppContext) -> None:
        """Draws numbers, the local spectrum and the areas."""
        session, probe = context.session, context.point_probe
        probe.request_point(session.displayed_document.scene, session.view_settings, self._window)
        seen = probe.point
        if seen is None:
            imgui.text_disabled(_WAITING)
            return
        _draw_numbers(seen)
        self._draw_directions(context, seen)
        imgui.separator_text("Areas of the field" if session.system.is_field else "Areas of the modulators")
        width = share_of_width(len(seen.areas))
        for number, picture in enumerate(seen.areas, start=1):
            self._draw_own(context, f"areas {number}", picture, width)
            tooltip("The power of what each sample contributes to the field at the cursor, in the lasers' colours.")
            imgui.same_line()
        imgui.new_line()

    def _draw_directions(self, context: AppContext, seen: SeenPoint) -> None:
        imgui.separator_text("Directions that reach it")
        self._window = _window_choice(context, self._window)
        side = min(imgui.get_content_region_avail().x, _DIRECTIONS_LINES * imgui.get_font_size())
        self._draw_own(context, "directions", seen.directions, side)
        light, wavelengths_m = seen.light, seen.light.wavelengths_m
        if imgui.is_item_hovered():
            place = self._pictures["directions"].to_image(imgui.get_io().mouse_pos)
            show_tooltip(_direction_text(seen.frequency_at(*place), wavelengths_m.tolist()))
        edge, step = 0.5 / light.pitch_m, light.frequency_step
        λ = float(sorted(wavelengths_m)[len(wavelengths_m) // 2])
        imgui.text_wrapped(
            f"to ±{edge * 1e-3:.4g} cycles/mm, ±{angle_deg(edge, λ):.3g}° at {λ * 1e9:.4g} nm; "
            f"resolved {2 * step * 1e-3:.3g} cycles/mm, {angle_deg(2 * step, λ):.2g}°"
        )

    def _draw_own(self, context: AppContext, name: str, picture: DeviceImage, width: float) -> None:
        """Draws a picture in units of its own."""
        if name not in self._pictures:
            self._pictures[name] = Viewport(context, f"point {name}")
        size = (max(int(width), 16), max(int(width * picture.shape[0] / picture.shape[1]), 16))
        _draw_picture(context, self._pictures[name], f"point {name}", picture, _OWN_COLOURS, size)


def _draw_picture(
    context: AppContext, shown: Viewport, name: str, picture: DeviceImage, view: ViewSettings, size: tuple[int, int]
) -> None:
    """Draws the whole of a picture as an item of this name."""
    corner = next_corner()
    shown.draw(picture, None, view, size, corner, is_stretched=True)
    imgui.invisible_button(f"##{name}", imgui.ImVec2(*size))
    context.record_item_rect(name)


def _window_choice(context: AppContext, window: int) -> int:
    """Draws the choice of the window; the window that is chosen."""
    width_m = window * context.session.document.sample_pitch_m
    tip = (
        f"The width, {width_m * 1e6:.4g} µm, of the Hann window around the cursor whose spectrum is shown: a wider one "
        "resolves finer angles."
    )
    names = [f"{count} samples" for count in WINDOWS]
    return WINDOWS[names.index(combo("window", f"{window} samples", names, tip))]


def _direction_text(frequency: tuple[float, float], wavelengths_m: list[float]) -> str:
    """A direction in cycles/mm, and in degrees for each laser."""
    y, x = frequency
    lines = [f"x {x * 1e-3:+.4g}, y {y * 1e-3:+.4g} cycles/mm"]
    lines += [f"{λ * 1e9:.4g} nm: x {angle_deg(x, λ):+.3f}°, y {angle_deg(y, λ):+.3f}°" for λ in wavelengths_m]
    return "\n".join(lines)


def _draw_numbers(seen: SeenPoint) -> None:
    """The sample, the shares of the lasers, and those of the diffraction orders."""
    light = seen.light
    y, x = light.place
    progress = "" if light.share == 1 else f"   {light.share:.0%} computed"
    imgui.text_wrapped(f"x {x}  y {y}   luminance {light.xyz[1]:.4g}{progress}")
    tooltip(_HINT)
    total = float(light.intensities.sum()) or 1.0
    shares = [f"{λ * 1e9:.4g} nm {i / total:.1%}" for λ, i in zip(light.wavelengths_m, light.intensities, strict=True)]
    imgui.text_wrapped("   ".join(shares))
    tooltip("Shares of the lasers in the intensity here.")
    orders = sorted(light.orders.items(), key=lambda item: -abs(item[1]))[:9]
    imgui.text_wrapped("orders (y, x)   " + "   ".join(f"({a}, {b}) {share:.1%}" for (a, b), share in orders))
    tooltip(
        "Shares of the diffraction orders of the last modulator in the field here. They add up to 100 %; an order "
        "below 0 is out of phase and cancels others."
    )
