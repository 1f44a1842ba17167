"""The panel of regions: their names, places and figures in a table, for all images that are shown; line and cursor."""

from __future__ import annotations

from functools import partial

from imgui_bundle import imgui

from holoview.viewer.app import theme
from holoview.viewer.app.context import AppContext
from holoview.viewer.app.panel import Panel
from holoview.viewer.app.widgets import command_button, dimmed, is_taken_over, same_line_for, tooltip, wrapped_text
from holoview.viewer.document.measurements import RegionRow
from holoview.viewer.document.region_table import region_rows, table_text
from holoview.viewer.render.view_settings import ViewSettings

_ENTER = imgui.InputTextFlags_.enter_returns_true
_LINE_SHARE = 0.8  # of the panel's width at most, for the ends of the line
_COLUMNS = {
    "region": "Its name: type another; Enter takes it over, Escape drops it.",
    "x, y, w, h": "Left, top, width and height in samples of the image; Enter takes them over, Escape drops them.",
    "contrast": "Speckle contrast with its standard error, without the target's structure; raw without a target.",
    "raw": "The contrast with the picture's structure.",
    "mean": "Mean luminance; 1 is white.",
    "PSNR": "To the target in this region, linear sRGB clipped to 0…1, in dB.",
    "ΔE2000": "Mean colour difference to the target; 1 is about the least that can be seen.",
}


class RegionsPanel(Panel):
    """Shows the table; it opens with the second region that is drawn."""

    title = "Regions"
    dock = "Bottom"
    starts_open = False

    def __init__(self) -> None:
        self._count = 0  # of regions, in the last frame

    def set_up(self, context: AppContext) -> None:
        add, session = partial(context.commands.add, "Speckle"), context.session
        add("Regions", partial(context.show_panel, self.title), help="All regions and their figures in a table.")
        add("Copy regions", partial(_copy, context), help="The table to the clipboard, with tabs.")
        add(
            "Forget this region",
            lambda: _edit(context, "Forget this region", session.view_settings.without_region(_chosen(context))),
            "Delete",
            "The chosen one.",
            is_enabled=lambda: session.view_settings.region is not None,
        )

    def wants_to_open(self, context: AppContext) -> bool:
        before, self._count = self._count, len(context.session.view_settings.regions)
        return before < self._count and self._count > 1

    def draw(self, context: AppContext) -> None:
        """Draws the buttons, the table, why a figure is missing, and the numbers of line and cursor."""
        context.wants_measurement = True
        measurements, view = context.live_measurement.measurements, context.session.view_settings
        _draw_buttons(context)
        rows = () if measurements is None else measurements.rows
        shown = {row.name for row in rows} == {of.name for of in context.session.document.measured_regions}
        with dimmed(context.has_old_figures or not shown):
            _draw_table(context, rows if shown else (), view)
        for row in rows if shown else ():
            reason = row.problem or (row.metrics.withheld if row.metrics is not None else "")
            if reason:
                wrapped_text(f"{row.name}: {reason}", theme.signal_colour("warning"))
        _draw_line_and_cursor(context, view)


def _draw_buttons(context: AppContext) -> None:
    is_on = context.drag_tool == "region"
    command_button(context, "Draw a region", "Draw", is_on=is_on, name="regions: draw")
    for command, label in (("Copy regions", "Copy"), ("Save regions…", "Save…"), ("Forget this region", "Forget")):
        imgui.same_line()
        command_button(context, command, label, name=f"regions: {label.lower().rstrip('…')}")
    for field, label, doc in (
        ("has_scale_bar", "scale bar", "A length on the image, and below pictures that are saved."),
        ("has_legend", "legend", "Plane, lasers and colours on the image, and below pictures that are saved."),
    ):
        same_line_for(label, has_arrow=True)  # whose arrow is as wide as the box
        changed, is_on = imgui.checkbox(label, getattr(context.session.view_settings, field))
        context.record_item_rect(label)
        tooltip(doc)
        if changed:
            context.edit_view(label.capitalize(), **{field: is_on})


def _draw_table(context: AppContext, rows: tuple[RegionRow, ...], view: ViewSettings) -> None:
    has_images = len({row.image for row in rows}) > 1
    flags = imgui.TableFlags_.row_bg | imgui.TableFlags_.sizing_fixed_fit | imgui.TableFlags_.scroll_x
    line = imgui.get_frame_height_with_spacing() if view.regions else imgui.get_text_line_height_with_spacing()
    height = (len(rows) + 1) * line + imgui.get_style().scrollbar_size
    columns = (*_COLUMNS, *(("image",) if has_images else ()))
    if not imgui.begin_table("regions", len(columns), flags, imgui.ImVec2(0, height)):
        return
    imgui.table_next_row(imgui.TableRowFlags_.headers)
    for name in columns:
        imgui.table_next_column()
        imgui.table_header(name)
        tooltip(_COLUMNS.get(name, "Which of the images beside each other."))
    first = rows[0].image if rows else ""
    for number, row in enumerate(rows):
        imgui.push_id(number)
        imgui.table_next_row()
        is_own = row.image == first and bool(view.regions)
        _draw_place(context, row, view) if is_own else _draw_plain_place(row)
        for text in (*_figures(row), *((row.image,) if has_images else ())):
            imgui.table_next_column()
            imgui.text(text)
        imgui.pop_id()
    imgui.end_table()
    context.record_item_rect("table of regions")


def _figures(row: RegionRow) -> tuple[str, ...]:
    found = row.metrics
    if found is None:
        return ("–",) * 5
    psnr, delta_e = (f"{value:.2f}" if value is not None else "–" for value in (found.psnr_db, found.delta_e))
    return found.text, f"{found.raw_contrast:.3f}", f"{found.mean:.4g}", psnr, delta_e


def _draw_plain_place(row: RegionRow) -> None:
    for text in (row.name, ", ".join(map(str, row.region))):
        imgui.table_next_column()
        imgui.text(text)


def _draw_place(context: AppContext, row: RegionRow, view: ViewSettings) -> None:
    """The name and the numbers of a region, to be typed; a click on the circle chooses it."""
    em = imgui.get_font_size()
    imgui.table_next_column()
    if imgui.radio_button("##chosen", row.name == view.region_name):
        _edit(context, "Choose a region", view.with_region_chosen(row.name))
    context.record_item_rect(f"region {row.name}")
    tooltip("The chosen region, whose histogram and curves the panel Speckle shows.")
    imgui.same_line()
    imgui.set_next_item_width(4 * em)
    is_entered, name = imgui.input_text("##name", row.name, _ENTER)
    is_entered = is_taken_over(is_entered)
    context.record_item_rect(f"name of region {row.name}")
    if is_entered and name != row.name:
        context.attempt(lambda: _edit(context, "Rename a region", view.with_region_renamed(row.name, name)))
    imgui.table_next_column()
    imgui.set_next_item_width(10.5 * em)
    is_entered, numbers = imgui.input_int4("##place", list(row.region), _ENTER)
    is_entered = is_taken_over(is_entered)
    context.record_item_rect(f"place of region {row.name}")
    if is_entered:
        x, y, width, height = numbers
        context.attempt(lambda: _edit(context, "Region", view.with_region_chosen(row.name), (x, y, width, height)))


def _draw_line_and_cursor(context: AppContext, view: ViewSettings) -> None:
    em = imgui.get_font_size()
    if view.profile is not None:
        imgui.set_next_item_width(min(16 * em, _LINE_SHARE * imgui.get_content_region_avail().x))
        is_entered, ends = imgui.input_float4("line", list(view.profile), "%.5g", _ENTER)
        is_entered = is_taken_over(is_entered)
        context.record_item_rect("line")
        tooltip("From x, y to x, y in samples of the image; Enter takes them over, Escape drops them.")
        if is_entered:
            context.edit_view("Line", profile=tuple(float(f"{end:.6g}") for end in ends))
        same_line_for("Save profile…")
        command_button(context, "Save profile…", name="save profile")
    row, column = view.cursor_in(context.session.document.image_shape)
    imgui.set_next_item_width(8 * em)
    is_entered, place = imgui.input_int2("cursor", [column, row], _ENTER)
    is_entered = is_taken_over(is_entered)
    context.record_item_rect("cursor")
    tooltip(
        "x, y in samples, whose light the panels Sections and Point show; Enter takes them over, Escape drops them."
    )
    if is_entered:
        context.edit_view("Cursor", cursor=(place[0], place[1]))


def _edit(context: AppContext, label: str, view: ViewSettings, region: tuple[int, int, int, int] | None = None) -> None:
    """Takes a look over, with other numbers of its chosen region if they are given."""
    context.session.edit(label, view_settings=view if region is None else view.with_(region=region))


def _chosen(context: AppContext) -> str:
    return context.session.view_settings.region_name


def _copy(context: AppContext) -> None:
    imgui.set_clipboard_text(table_text(region_rows(context.session, context.shown_images())))
    context.session.messages.post("copied the table of regions")
