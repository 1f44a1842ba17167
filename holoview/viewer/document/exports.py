"""Writes a session's images as files: figures, sweeps, the pupil's path, places of the eyebox; and its holograms."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from holoview.holograms.files.light_writer import check_light_suffix
from holoview.holograms.files.pictures import MAX_FRAMES, Pixels, open_encoder, path_with_suffix, png_texts, write_png
from holoview.holograms.files.pupil_path_file import SUFFIX, save_pupil_path
from holoview.holograms.hologram import Hologram
from holoview.holograms.targets.target_source import planes_with
from holoview.holograms.view import save, simulate
from holoview.light.model import preset
from holoview.light.model.focus import PupilPath, views_along, with_pupil_at
from holoview.light.numerics.sampling import positions
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.figures import CaptionedTile, contact_sheet, figure_bytes, label, new_figure, require_matplotlib
from holoview.util.file_writer import write_file
from holoview.util.packages import import_optional
from holoview.viewer.document.document import Document
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.focus_edits import dioptres_text, eye_of, eyebox_half_m, pupil_diameter_m
from holoview.viewer.document.jobs import BackgroundJob, JobControl
from holoview.viewer.document.legend import MAX_BAR_FRACTION, scale_bar, with_notes
from holoview.viewer.document.measurements import RegionMetrics, measure_region
from holoview.viewer.page.page import export_html
from holoview.viewer.render.planes import render_each, render_planes
from holoview.viewer.render.tone_mapping import tone_map

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def png_metadata(document: Document, plane_m: float | None = None) -> dict[str, str]:
    """PNG text chunks for an image of a document; `plane_m` is its focal plane if not that of the view settings."""
    view = document.view_settings
    return {
        "holoview.preset": document.system.name,
        "holoview.patterns": document.origin,
        "holoview.plane": units.format_exact(view.plane_m if plane_m is None else plane_m, "mm"),
        "holoview.exposure": f"{view.exposure_stops:g} stops",
        "holoview.channel": view.channel,
        "holoview.system": preset.dumps(document.system),
    }


def save_view(session: EditingSession, path: Path, pixels: NDArray[np.uint8]) -> None:
    """Writes 8-bit sRGB pixels (y, x, 3). Raises UserError."""
    file = with_default_suffix(path, ".png")
    write_png(file, pixels, png_metadata(session.displayed_document))
    session.messages.post(f"view written to {file}")


def save_light(session: EditingSession, path: Path) -> BackgroundJob:
    """Writes the light at the system's focal planes as numbers, without exposure and tone, in the background.

    Raises UserError for another suffix than those of light.
    """
    document, file = session.displayed_document, with_default_suffix(path, ".exr")
    check_light_suffix(file)

    def work(control: JobControl) -> Path:
        def progress(done: int, total: int) -> None:
            control.check()
            control.report(done, total, "light of the planes")

        view = simulate(document.system, document.drive, backend="torch", progress=progress)
        save(view, file)
        return file

    return _start(session, "Light", work)


def save_planes(session: EditingSession, path: Path) -> BackgroundJob:
    """Writes each focal plane of the system as PATH-10mm.png …, tone-mapped by the view settings, in the background.

    Raises UserError where one of these files is there already and isn't holoview's.
    """
    document, path = session.displayed_document, with_default_suffix(path, ".png")
    planes_m = [float(z) for z in np.unique(document.system.planes_m)]
    files = [path_with_suffix(path, units.format_exact(z, "mm").replace(" ", "")) for z in planes_m]
    for file in files:
        if file.exists() and not png_texts(file):
            raise UserError(str(file), "is there already, and isn't holoview's", remedy="choose another name")

    def work(control: JobControl) -> list[Path]:
        rendered = render_planes(document.system, document.drive, planes_m, control.check)
        for number, (xyz, plane_m, file) in enumerate(zip(rendered, planes_m, files, strict=True), start=1):
            seen = replace(document, view_settings=document.view_settings.with_(plane_m=plane_m))
            pixels = with_notes(tone_map(xyz, document.view_settings), seen)
            write_png(file, pixels, png_metadata(document, plane_m))
            control.report(number, len(planes_m), file.name)
        return files

    def report(written: list[Path]) -> None:
        session.messages.post(f"{len(written)} planes written to {path.parent}")

    return session.jobs.start("Save planes", work, report)


def png_bytes(pixels: NDArray[np.uint8]) -> bytes:
    """The bytes of a PNG file of 8-bit sRGB pixels (y, x, 3)."""
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="PNG")
    return buffer.getvalue()


# --- Writes a labelled figure of the displayed image as PNG or PDF: scale bar, focal plane, wavelengths, contrast ---


SUFFIXES = (".png", ".pdf")
_WIDTH_IN, _DPI = 6.4, 200


def save_figure(session: EditingSession, path: Path) -> BackgroundJob:
    """Writes the figure in the background. Raises UserError for another suffix, and if matplotlib isn't installed."""
    path = check_suffix(path, SUFFIXES)
    require_matplotlib("a figure")
    document, target, others = session.displayed_document, session.target_at(), session.other_targets()

    def work(control: JobControl) -> Path:
        control.report(0, 2, "rendering")
        (xyz,) = render_planes(document.system, document.drive, [document.view_settings.plane_m], control.check)
        control.report(1, 2, "drawing")
        metrics = measure_region(xyz, document.measured_region, target, others)
        figure = _draw(document, tone_map(xyz, document.view_settings), metrics)
        write_file(path, figure_bytes(figure, path.suffix.lower().removeprefix(".")))
        return path

    return _start(session, "Figure", work)


def _draw(document: Document, pixels: NDArray[np.uint8], metrics: RegionMetrics) -> Figure:
    rows, columns = pixels.shape[:2]
    caption_in = 0.55
    figure = new_figure((_WIDTH_IN, _WIDTH_IN * rows / columns + caption_in), dpi=_DPI, layout=None)
    height = 1 - caption_in / figure.get_figheight()
    axes = figure.add_axes((0, 1 - height, 1, height))
    axes.imshow(pixels, interpolation="nearest", aspect="auto")
    axes.set_axis_off()
    _draw_bar(axes, document, rows, columns)
    x, y, width, height_px = document.measured_region
    axes.plot(
        [x, x + width, x + width, x, x],
        [y, y, y + height_px, y + height_px, y],
        color="white",
        linewidth=0.8,
        alpha=0.8,
    )
    figure.text(0.015, 0.012, "\n".join(map(label, caption(document, metrics))), fontsize=7.5, va="bottom")
    return figure


def _draw_bar(axes: Any, document: Document, rows: int, columns: int) -> None:
    """A scale bar of a round length, white with a black outline."""
    bar = scale_bar(document, MAX_BAR_FRACTION * columns)
    x0, y = 0.04 * columns, 0.95 * rows
    for color, width in (("black", 5.0), ("white", 3.0)):
        axes.plot([x0, x0 + bar.samples], [y, y], color=color, linewidth=width, solid_capstyle="butt")
    text = axes.text(x0, y - 0.015 * rows, bar.text, color="white", fontsize=9, va="bottom")
    effects = import_optional("matplotlib.patheffects", "a figure")
    text.set_path_effects([effects.withStroke(linewidth=2, foreground="black")])


def caption(document: Document, metrics: RegionMetrics) -> list[str]:
    """The lines of text below the image."""
    system, view = document.system, document.view_settings
    lasers = ", ".join(f"{λ * 1e9:.4g}" for λ in system.wavelengths_m)
    fidelity = "" if metrics.psnr_db is None else f", PSNR {metrics.psnr_db:.1f} dB, ΔE2000 {metrics.delta_e:.1f}"
    known = "" if metrics.psnr_db is None or metrics.contrast is None else " (target divided out)"
    exposure = f", exposure {view.exposure_stops:+g} stops" if view.exposure_stops else ""
    return [
        f"{system.name or 'bench'}: {document.origin}",
        f"wavelengths {lasers} nm; focal plane {units.format_rounded(view.plane_m, 'mm')}{exposure}",
        f"in the frame: speckle contrast {metrics.text}{known}, mean luminance {metrics.mean:.3g}{fidelity}",
    ]


# --- Writes an animated focal sweep, from the farthest plane to the nearest and back, as PNG (APNG), GIF or MP4 ---


def save_sweep(session: EditingSession, path: Path, *, frames: int = 24, seconds: float = 3.0) -> BackgroundJob:
    """Writes `frames` evenly spaced planes, played forwards and backwards in `seconds`, in the background.

    Raises UserError for less than two frames, and as `open_encoder` does.
    """
    if frames < 2:
        raise UserError("sweep", f"{frames} frames", expected="2 or more")
    write, document = open_encoder(path, 2 * frames - 2, seconds), session.displayed_document

    def work(control: JobControl) -> Path:
        forward = list(_sweep_frames(document, frames, control))
        control.report(frames, frames, "encoding")
        write([*forward, *forward[-2:0:-1]], png_metadata(document))
        return path

    return _start(session, "Focal sweep", work)


def _sweep_frames(document: Document, count: int, control: JobControl) -> Iterator[Pixels]:
    far, near = float(document.system.planes_m.min()), float(document.system.planes_m.max())
    if far == near:
        raise UserError("focal sweep", "the bench has one focal plane", expected="two or more", remedy="add planes")
    planes_m = [float(z) for z in np.linspace(far, near, count)]
    for written, xyz in enumerate(render_planes(document.system, document.drive, planes_m, control.check), start=1):
        yield tone_map(xyz, document.view_settings)
        control.report(written, count, f"plane {written} of {count}")


# --- Writes the path of the pupil as a table, and the views along it as an animation or as pictures ---


_SHORTEST_S = 0.1  # of an animation


def save_path(session: EditingSession, path: Path) -> None:
    """Writes the path of the pupil as CSV. Raises UserError without one."""
    file = check_suffix(with_default_suffix(path, SUFFIX), (SUFFIX,))
    save_pupil_path(file, _path_of(session.document))
    session.messages.post(f"path of the pupil written to {file}")


def save_path_animation(session: EditingSession, path: Path, *, frames: int = 24) -> BackgroundJob:
    """Writes the views at `frames` equal steps along the path as an animation of its duration, in the background.

    Raises UserError without a path or an eye, and as `open_encoder` does.
    """
    document = session.displayed_document
    write = open_encoder(path, frames, max(_path_of(document).duration_s, _SHORTEST_S))
    views = _views(document, frames)

    def work(control: JobControl) -> Path:
        pixels = list(_path_frames(views, control))
        control.report(frames, frames, "encoding")
        write(pixels, png_metadata(document))
        return path

    return _start(session, "Path animation", work)


def save_path_pictures(session: EditingSession, path: Path, *, frames: int = 24) -> BackgroundJob:
    """Writes the views at `frames` equal steps along the path as PATH-000.png …, in the background.

    Raises UserError without a path or an eye, and for a number out of range.
    """
    path = check_suffix(with_default_suffix(path, ".png"), (".png",))
    if not 1 <= frames <= MAX_FRAMES:
        raise UserError("pictures", str(frames), expected=f"1 to {MAX_FRAMES}")
    views = _views(session.displayed_document, frames)

    def work(control: JobControl) -> Path:
        for number, pixels in enumerate(_path_frames(views, control)):
            write_png(path_with_suffix(path, f"{number:03}"), pixels, png_metadata(views[number]))
        return path.parent

    return _start(session, "Path pictures", work)


def _start(session: EditingSession, title: str, work: Callable[[JobControl], Path]) -> BackgroundJob:
    """Runs `work` in the background; then a message names the path that it returned."""

    def report(written: Path) -> None:
        session.messages.post(f"{title.lower()} written to {written}")

    return session.jobs.start(title, work, report)


def _path_of(document: Document) -> PupilPath:
    path = document.view_settings.pupil_path
    if path is None:
        raise UserError("pupil path", "there is none", expected="a path to write", remedy="record one, or open one")
    return path


def _views(document: Document, count: int) -> list[Document]:
    """The document as it is seen at some steps along its path."""
    view = document.view_settings
    _, seen = views_along(document.system, _path_of(document), count, view.plane_m)
    return [replace(document, system=system, view_settings=view.with_(plane_m=plane_m)) for system, plane_m in seen]


def _path_frames(views: list[Document], control: JobControl) -> Iterator[Pixels]:
    """The image as it is displayed, 8-bit sRGB, with the tone mapping of the view settings."""
    systems = [(view.system, view.view_settings.plane_m) for view in views]
    for done, xyz in enumerate(render_each(systems, views[0].drive, check=control.check), start=1):
        yield tone_map(xyz, views[0].view_settings)
        control.report(done, len(views), f"picture {done} of {len(views)}")


# --- Writes the views from nine places of the eyebox as a contact sheet ---


_SIDE = 3  # places along each axis
_SPACING = 0.5  # between places, over half the side of the eyebox at the shortest wavelength


def save_pupil_sheet(session: EditingSession, path: Path) -> BackgroundJob:
    """Writes a contact sheet as PNG: 3 x 3 places around the pupil, at the displayed plane, in the background.

    The places are a quarter of the eyebox of the shortest wavelength apart. Raises UserError without an eye.
    """
    document, path = session.displayed_document, with_default_suffix(path, ".png")
    system, eye = document.system, eye_of(document.system)
    steps = positions(_SIDE, _SPACING * eyebox_half_m(system, float(system.wavelengths_m.min()))).tolist()
    places = [(eye.pupil_y_m + y, eye.pupil_x_m + x) for y in steps for x in steps]
    plane_m = document.view_settings.plane_m
    dioptres = dioptres_text(system, plane_m)
    title = f"Through a pupil of {pupil_diameter_m(system) * 1e3:.3g} mm, focused at {dioptres}, from nine places"

    def work(control: JobControl) -> Path:
        views = [(with_pupil_at(system, place), plane_m) for place in places]
        tiles = []
        for xyz, (y, x) in zip(render_each(views, document.drive, control.check), places, strict=True):
            caption = f"y {y * 1e3:+.2f}, x {x * 1e3:+.2f} mm"
            tiles.append(CaptionedTile(tone_map(xyz, document.view_settings), caption))
            control.report(len(tiles), len(views), caption)
        rows = [tiles[i : i + _SIDE] for i in range(0, len(tiles), _SIDE)]
        write_png(path, contact_sheet(title, [""] * _SIDE, rows), png_metadata(document))
        return path

    return session.jobs.start("Save pupil sheet", work, lambda written: session.messages.post(f"{written} written"))


# --- Writes the session's hologram and system as files, or as a page that any browser shows live ---


def save_hologram(session: EditingSession, path: Path) -> None:
    """Writes patterns and system as a hologram file, and makes it the document's path. Raises UserError."""
    document, file = session.document, with_default_suffix(path, ".safetensors")
    Hologram(document.drive, document.system).save(file)
    session.edit("Save", path=file, undoable=False)
    session.mark_saved()
    session.messages.post(f"hologram written to {file}")


def save_preset(session: EditingSession, path: Path) -> None:
    """Writes the system as a preset. Raises UserError."""
    file = with_default_suffix(path, ".toml")
    preset.save(session.system, file)
    session.messages.post(f"preset written to {file}")


def save_page(session: EditingSession, path: Path) -> BackgroundJob:
    """Writes the hologram, its bench and its target, opened at the present focal plane.

    Raises UserError for another suffix.
    """
    document, file = session.displayed_document, check_suffix(with_default_suffix(path, ".html"), [".html"])
    hologram = Hologram(document.drive, document.system)

    def work(control: JobControl) -> Path:
        def progress(done: int, total: int) -> None:
            control.check()
            control.report(done, total, "pictures of the planes")

        name, plane_m = document.system.name or file.stem, document.view_settings.plane_m
        spec = document.target_spec
        planes_m = None if spec is None or spec.is_stack else planes_with(document.system, plane_m)
        target = None if spec is None else spec.build(document.system, planes_m)
        return export_html(file, {name: hologram}, target=target, plane_m=plane_m, progress=progress)

    return _start(session, "Page", work)


# --- Suffixes of the files that are written: a default one, and a check ---


def with_default_suffix(path: Path, suffix: str) -> Path:
    """The path, with `suffix` added if it has none."""
    return path if path.suffix else path.with_suffix(suffix)


def check_suffix(path: Path, suffixes: Sequence[str]) -> Path:
    """The path. Raises UserError if it has another suffix than these, in lower or upper case."""
    path = Path(path)
    if path.suffix.lower() not in suffixes:
        raise UserError(str(path), f'the suffix "{path.suffix}"', expected=" or ".join(suffixes))
    return path
