"""The line below the image: where the pointer is and what the values there are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from imgui_bundle import imgui

from holoview.app.fields import tip
from holoview.session.look import NOW
from holoview.session.measure import pixel_at

if TYPE_CHECKING:
    from holoview.app.app import App


def draw_readout(app: App, place: tuple[float, float] | None) -> None:
    """place: shares (x, y) of the image under the pointer, None elsewhere."""
    look, shape = app.session.look, app.session.state.shape
    if place is None or look.page != "image":
        imgui.text_disabled(_idle_text(app))
        return
    side = look.a if look.compare != "off" else NOW
    xyz = app.sides.xyz(side)
    x, y = int(place[0] * shape[1]), int(place[1] * shape[0])
    values = None if xyz is None else pixel_at(x, y, xyz, app.sides.now.intensities() if side == NOW else None)
    if values is None:
        imgui.text_disabled(f"x {x}  y {y}   values follow with the full image")
        return
    rgb, tristimulus = _three(values.linear_rgb), _three(values.xyz)
    imgui.text(f"x {x}  y {y}   RGB {rgb}   XYZ {tristimulus}")
    app.mark("readout")
    if values.intensity is not None:
        lasers = "\n".join(
            f"{1e9 * nm:7.2f} nm   {i:.4g}"
            for nm, i in zip(app.session.system.wavelengths_m, values.intensity, strict=True)
        )
        imgui.same_line()
        imgui.text_disabled(f"  I {np.array2string(values.intensity, precision=2, max_line_width=400)[1:-1]}")
        tip(f"Linear sRGB and XYZ at this sample, and the intensity of each laser:\n{lasers}")


def _three(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> str:
    return "  ".join(f"{value:.3f}" for value in values)


def _idle_text(app: App) -> str:
    rows, columns = app.session.state.shape
    if app.session.look.page == "spectrum":
        return "the eyebox: light by direction, up to ±λ/(2·pitch)"
    if app.session.look.page == "phase":
        return "phase at the laser in the middle of the spectrum; a turn of hue is a wave"
    return f"{columns} × {rows} samples   {app.session.state.origin}"
