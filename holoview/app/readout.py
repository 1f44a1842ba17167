"""The line below the image: where the pointer is and what the values there are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from imgui_bundle import imgui
from numpy.typing import NDArray

from holoview.app.parameter_widgets import tooltip
from holoview.session.measure import sample_pixel
from holoview.session.view_settings import DERIVED_PAGES, NOW, displayed_side

if TYPE_CHECKING:
    from holoview.app.app import App


def draw_readout(app: App, place: tuple[float, float] | None) -> None:
    """place: shares (x, y) of the image under the pointer, None elsewhere."""
    look, shape = app.session.view_settings, app.session.document.image_shape
    if place is None or look.page in DERIVED_PAGES:
        imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(imgui.Col_.text_disabled))
        imgui.text_wrapped(_idle_text(app))
        imgui.pop_style_color()
        return
    imgui.text_wrapped(describe_pixel(app, int(place[0] * shape[1]), int(place[1] * shape[0])))
    app.record_item_rect("readout")
    tooltip(
        "Linear sRGB and XYZ at this sample; 1 is white. Intensities are those of the lasers, in the table's order."
    )


def readout_height(app: App, width: float) -> float:
    """Room for the values in a panel so wide, whether they are shown or not: the image mustn't jump."""
    rows, columns = app.session.document.image_shape
    three, lasers = "0.000  0.000  0.000", " ".join(["0.00"] * len(app.session.system.wavelengths_m))
    text = f"x {columns}  y {rows}   RGB {three}   XYZ {three}   I {lasers}"
    return imgui.calc_text_size(text, wrap_width=width).y + imgui.get_style().item_spacing.y


def describe_pixel(app: App, x: int, y: int) -> str:
    """The values at a sample, in a line."""
    side = displayed_side(app.session.view_settings)
    xyz = app.side_renderers.xyz(side)
    values = (
        None if xyz is None else sample_pixel(x, y, xyz, app.side_renderers.now.intensities() if side == NOW else None)
    )
    if values is None:
        return f"x {x}  y {y}   values follow with the full image"
    parts = [f"x {x}  y {y}", f"RGB {_format_triple(values.linear_rgb)}", f"XYZ {_format_triple(values.xyz)}"]
    if values.intensity is not None:
        parts.append("I " + " ".join(f"{value:.2f}" for value in values.intensity))
    return "   ".join(parts)


def _format_triple(values: NDArray[np.float64]) -> str:
    return "  ".join(f"{value:.3f}" for value in values)


def _idle_text(app: App) -> str:
    rows, columns = app.session.document.image_shape
    if app.session.view_settings.page == "spectrum":
        return "the eyebox: light by direction, up to ±λ/(2·pitch)"
    if app.session.view_settings.page == "target":
        return "what the hologram should show here" + (
            f": {app.session.target_spec.title}" if app.session.target_spec else ""
        )
    if app.session.view_settings.page == "phase":
        return "phase at the laser in the middle of the spectrum; a turn of hue is a wave"
    return f"{columns} × {rows} samples   {app.session.document.origin}"
