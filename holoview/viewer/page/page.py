"""A hologram as one HTML file that any browser with WebGPU shows live: `export_html` writes it, `read_page` reads it.

The file holds the frame recording of each hologram (`recording`), the numbers from which its tables are computed
(`document`), the scripts beside this file, pictures of each plane for browsers without WebGPU, and the hologram itself.
It loads nothing: a content security policy in the file allows its own script and style and nothing else.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import io
import json
import os
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray
from PIL import Image

from holoview.holograms.hologram import Hologram
from holoview.holograms.metrics.fidelity import psnr_linear_srgb
from holoview.holograms.metrics.likeness import NO_OTHERS, OtherPlanes, luminance_contrast
from holoview.holograms.targets.focal_stack import Target
from holoview.holograms.view import View, simulate
from holoview.light.colour import COLOUR_SPACES, SRGB_TO_XYZ, XYZ_TO_SRGB, fitting_stops, to_srgb8
from holoview.light.model.bench_drawing import draw_bench
from holoview.light.model.focus import focused_planes
from holoview.light.model.system import System
from holoview.light.numerics.sampling import Region
from holoview.util.drawing import as_svg
from holoview.util.errors import UserError
from holoview.util.file_writer import write_file
from holoview.util.files import read_limited
from holoview.util.packages import __version__
from holoview.util.progress import StepCallback
from holoview.util.tables import parse_json_table
from holoview.viewer.page.frame_recording import gap_range, observer_table, page_document, read_document

FORMAT, VERSION = "holoview-page", "1"
FIRST_SCRIPTS = ("replay.js", "open.js")  # which run before the rest of the file is read
SCRIPTS = ("bench.js", "chain.js", "measure.js", "hologram.js", "link.js", "strip.js", "page.js")
_TARGET_BYTES = 900_000  # of the target's pictures: of these qualities the first that fits, or the last
_TARGET_QUALITIES: tuple[dict[str, Any], ...] = (
    {"lossless": True},
    *({"quality": q} for q in (98, 95, 90, 80, 70, 60)),
)
_LARGEST_BYTES = 256 << 20  # of a page that is read, and of the data that it unpacks to
_STORED_PLANES, _STORED_WIDTH, _QUALITY = 5, 512, 55
_SAME_PLANE_M = 1e-6  # as in page.js
_STARTS = tuple(f'<script type="{kind}" id="' for kind in ("application/json", "text/plain"))
_MOST_PARTS, _LONGEST_ID = 1000, 100  # of the data in a page


def export_html(
    path: str | os.PathLike[str],
    holograms: Hologram | Mapping[str, Hologram],
    *,
    target: Target | None = None,
    title: str = "",
    note: str = "",
    plane_m: float | None = None,
    region: Region | None = None,
    backend: str = "auto",
    progress: StepCallback | None = None,
) -> Path:
    """Writes a page that shows one hologram live in a browser, or compares several; returns its path.

    path: of the HTML file, which is replaced if it exists.
    holograms: one, or several by the names that the page gives them, all with images of the same shape.
    target: the light that they should show, as `target_for` makes it; the page then wipes to it and states the PSNR.
    title, note: text above the image; the names of the holograms when empty.
    plane_m: focal plane that the page opens with; the middle one of the first hologram when None.
    region: (x, y, width, height) in samples of the image, whose speckle contrast the page states and computes.
    backend: renders the stored pictures, as for `simulate`. progress: called as `simulate` does.

    Raises UserError for holograms with images of different shapes, a target of another shape, a plane that the bench
    doesn't reach, a region outside the image, a bench beyond WebGPU's default limits, and when the file can't be
    written.

    >>> import holoview as hv
    >>> system = hv.load("holochrome-8").with_(shape=[24, 32])
    >>> speckle = hv.Hologram(hv.random_drive(system), system)
    >>> hv.export_html("speckle.html", speckle, backend="torch").name
    'speckle.html'
    """
    text = page_html(
        holograms,
        target=target,
        title=title,
        note=note,
        plane_m=plane_m,
        region=region,
        backend=backend,
        progress=progress,
    )
    write_file(path, text)
    return Path(path)


def page_html(
    holograms: Hologram | Mapping[str, Hologram],
    *,
    target: Target | None = None,
    title: str = "",
    note: str = "",
    plane_m: float | None = None,
    region: Region | None = None,
    backend: str = "auto",
    progress: StepCallback | None = None,
) -> str:
    """The text of the page that `export_html` writes. Arguments and errors as of that."""
    holograms = {holograms.system.name or "hologram": holograms} if isinstance(holograms, Hologram) else holograms
    if not holograms:
        raise UserError("holograms", "none", expected="at least one")
    first = next(iter(holograms.values()))
    low, high = plane_range(first.system)
    if plane_m is not None and not low <= plane_m <= high:
        raise UserError("plane", f"{plane_m * 1e3:g} mm", expected=f"{low * 1e3:g} to {high * 1e3:g} mm")
    views = [_stored_view(hologram, backend, progress) for hologram in holograms.values()]
    _check([view.xyz.shape[1:3] for view in views], target, region)
    plane_m = _middle(views[0].focus_m) if plane_m is None else plane_m
    documents = [page_document(hologram, name, plane_m, (low, high)) for name, hologram in holograms.items()]
    stops = round(fitting_stops(views[0].xyz), 1) if first.system.is_field else 0.0
    drawing = draw_bench(first.system)
    page = _colours() | {
        "exposure": stops,
        "shape": list(views[0].xyz.shape[1:3]),
        "plane_m": plane_m,
        "plane_range_m": [low, high],
        "gap_range_m": gap_range(first.system, (low, high)),
        "region": None if region is None else _box(region),
        "target": None if target is None else _target(target),
        "stored": _stored(views[0].exposed(stops)),
        "stored_others": [_stored(view.exposed(stops)) for view in views[1:]],
        "claims": _claims(first, views[0], target, plane_m, region, backend),
        "bench_areas": drawing.areas,
        "holograms": [document for document, _, _ in documents],
    }
    return _html(page, documents, as_svg(drawing), title or " and ".join(holograms), note)


def _colours() -> dict[str, Any]:
    """The constants of every page: its format, and the colours of screens and eyes."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "holoview": __version__,
        "xyz_to_srgb": XYZ_TO_SRGB.tolist(),
        "srgb_luminance": SRGB_TO_XYZ[1].tolist(),
        "xyz_to_p3": COLOUR_SPACES["p3"].from_xyz.tolist(),
        "cones": observer_table("eye"),
    }


def _middle(planes_m: NDArray[np.floating]) -> float:
    return float(np.sort(planes_m)[len(planes_m) // 2])


def _box(region: Region) -> dict[str, int]:
    return dict(zip(("x", "y", "width", "height"), region, strict=True))


def _check(shapes: Sequence[tuple[int, ...]], target: Target | None, region: Region | None) -> None:
    """Raises UserError for pictures that can't be compared, or a region outside them."""
    height, width = shapes[0]
    sizes = {f"{w} × {h}" for h, w in shapes}
    if len(sizes) > 1:
        raise UserError("holograms", f"images of {' and '.join(sorted(sizes))} samples", expected="one size")
    if target is not None and target.stack.shape[1:3] != (height, width):
        raise UserError("target", f"pictures of shape {target.stack.shape[1:3]}", expected=f"{(height, width)}")
    if region is not None:
        x, y, w, h = region
        if min(x, y) < 0 or min(w, h) < 1 or x + w > width or y + h > height:
            raise UserError("region", f"{region}", expected=f"x, y, width, height inside {width} × {height} samples")


def plane_range(system: System) -> tuple[float, float]:
    """The nearest and the farthest focal plane that a page can show, m: half the stack beyond its ends.

    Of a bench with one plane, half of its distance to either side; never before the last modulator, but before a field.
    """
    planes = focused_planes(system)
    low, high = float(planes.min()), float(planes.max())
    margin = (high - low) / 2 or abs(low) / 2 or 1e-3
    nearest, farthest = system.plane_type.item.low + system.way.behind_m, system.plane_type.item.high
    return max(low - margin, nearest), min(high + margin, farthest)


def _stored_view(hologram: Hologram, backend: str, progress: StepCallback | None) -> View:
    """The pictures of a hologram at up to five of its planes."""
    planes = focused_planes(hologram.system)
    chosen = planes[np.unique(np.linspace(0, len(planes) - 1, min(len(planes), _STORED_PLANES)).round().astype(int))]
    return simulate(hologram.system, hologram.drive, planes=chosen, backend=backend, progress=progress)


def _claims(
    hologram: Hologram, view: View, target: Target | None, plane_m: float, region: Region | None, backend: str
) -> list[dict[str, Any]]:
    """The page's statements on the first hologram at the first plane, computed here; the page computes it again."""
    near = np.flatnonzero(np.isclose(view.focus_m, plane_m, rtol=0, atol=1e-9))
    if len(near) == 0:
        view, near = simulate(hologram.system, hologram.drive, planes=[plane_m], backend=backend), np.array([0])
    xyz, rgb, known = view.xyz[near[0]], view.rgb[near[0]], None if target is None else _at(target, plane_m)
    claims: list[dict[str, Any]] = []
    if region is not None:
        found = luminance_contrast(xyz[..., 1], region, known, others=_others(target, plane_m))
        how = "the structure of the target divided out" if found.has_target else "with the structure of the picture"
        value = f"{found.estimate.contrast:.3f} ± {found.estimate.standard_error:.3f}"
        if found.withheld:
            how, value = found.withheld, "withheld"
        claims.append(_claim("contrast", f"Speckle contrast in the marked region, {how}", value, _box(region)))
    if known is not None:
        score = psnr_linear_srgb(rgb, known).mean_db
        claims.append(_claim("psnr", "PSNR to the target", f"{score:.1f} dB", None))
    return claims


def _at(target: Target, plane_m: float) -> NDArray[np.floating] | None:
    """The picture (y, x, 3) of a target at a plane; None where it has none, as one out of focus is another picture."""
    near = np.flatnonzero(np.isclose(target.planes_m, plane_m, rtol=0, atol=_SAME_PLANE_M))
    return target.stack[near[0]] if len(near) else None


def _others(target: Target | None, plane_m: float) -> OtherPlanes:
    """The pictures (y, x, 3) of a target at its other planes."""
    if target is None:
        return NO_OTHERS
    pairs = zip(target.planes_m, target.stack, strict=True)
    far = {f"at {z * 1e3:.4g} mm": of for z, of in pairs if not np.isclose(z, plane_m, rtol=0, atol=_SAME_PLANE_M)}
    return OtherPlanes(far, are_mistakable=target.are_planes_given)


def _claim(quantity: str, text: str, value: str, region: dict[str, int] | None) -> dict[str, Any]:
    return {"quantity": quantity, "text": text, "value": value, "region": region}


def _target(target: Target) -> dict[str, Any]:
    """The target's pictures as 8-bit sRGB: without losses where all take at most 0.9 MB, else WebP with some."""
    codes = [to_srgb8(picture) for picture in target.stack]
    for options in _TARGET_QUALITIES:
        pictures = [_webp(code, **options) for code in codes]
        if sum(map(len, pictures)) <= _TARGET_BYTES:
            break
    planes = {"planes_m": list(target.planes_m), "are_planes_given": target.are_planes_given}
    return planes | {"pictures": list(map(_data_url, pictures))}


def _stored(view: View) -> dict[str, Any]:
    """Pictures of the planes for browsers that can't compute them."""
    planes = np.asarray(view.focus_m, dtype=float).tolist()
    return {
        "planes_m": planes,
        "pictures": [_data_url(_webp(code, quality=_QUALITY, small=True)) for code in view.srgb8],
    }


def _webp(code: NDArray[np.uint8], *, lossless: bool = False, quality: int = 80, small: bool = False) -> bytes:
    image, out = Image.fromarray(code), io.BytesIO()
    if small and image.width > _STORED_WIDTH:
        image = image.resize((_STORED_WIDTH, round(image.height * _STORED_WIDTH / image.width)), Image.Resampling.BOX)
    image.save(out, "WEBP", lossless=lossless, quality=quality)
    return out.getvalue()


def _data_url(webp: bytes) -> str:
    return f"data:image/webp;base64,{base64.b64encode(webp).decode('ascii')}"


def _html(
    page: dict[str, Any], documents: Sequence[tuple[Any, Any, bytes]], drawing: str, title: str, note: str
) -> str:
    """The text of the file. Text of strangers is escaped, and JSON can't end its element.

    documents: of `page_document`, for each hologram. drawing: of the bench, as SVG.
    """
    frames = [_packed(json.dumps(heads, separators=(",", ":")).encode()) for _, heads, _ in documents]
    folder = Path(__file__).parent
    first_script, script = (
        "".join((folder / name).read_text(encoding="utf-8") for name in names) for names in (FIRST_SCRIPTS, SCRIPTS)
    )
    style = (folder / "page.css").read_text(encoding="utf-8")
    policy = (
        f"default-src 'none'; script-src '{_digest(first_script)}' '{_digest(script)}'; "
        f"style-src '{_digest(style)}'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )
    import jinja2  # slow start: who opens a page, or the viewer, needs none

    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    template = environment.from_string((folder / "page.html").read_text(encoding="utf-8"))
    document = json.dumps(page, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return template.render(
        title=title,
        note=note,
        version=__version__,
        policy=Markup(policy),
        style=Markup(style),
        first_script=Markup(first_script),
        script=Markup(script),
        document=Markup(document),
        drawing=Markup(drawing),
        frames=list(map(Markup, frames)),
        data=[Markup(_packed(binary)) for _, _, binary in documents],
    )


def _packed(binary: bytes) -> str:
    return base64.b64encode(zlib.compress(binary, 9)).decode("ascii")


def _digest(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode('utf-8')).digest()).decode('ascii')}"


def is_page(path: str | os.PathLike[str]) -> bool:
    """Whether a file is named as a page (.html or .htm)."""
    return Path(path).suffix.lower() in (".html", ".htm")


def read_page(path: str | os.PathLike[str]) -> dict[str, Hologram]:
    """The holograms of a page that `export_html` wrote, by name. It is read as data: nothing in the file is run.

    Raises UserError for a file that is missing, too large, no such page, of a later version, or damaged.
    """
    expected = "a page that `holoview export --html` wrote"
    try:
        parts = _scripts_with_data(read_limited(path, expected, _LARGEST_BYTES).decode("utf-8"))
    except UnicodeDecodeError as error:
        raise UserError(str(path), "isn't text in UTF-8", expected=expected) from error
    if "holoview-page" not in parts:
        raise UserError(str(path), "holds no hologram", expected=expected)
    try:
        page = parse_json_table(parts["holoview-page"], str(path), expected)
        if (page["format"], page["version"]) != (FORMAT, VERSION):
            raise UserError(str(path), f"{page['format']} {page['version']}", expected=f"{FORMAT} {VERSION}")
        if not page["holograms"]:
            raise UserError(str(path), "holds no hologram", expected=expected)
        return {
            str(document["name"]): read_document(document, _inflate(parts[f"holoview-data-{i}"]))
            for i, document in enumerate(page["holograms"])
        }
    except UserError as error:
        raise error if error.where.startswith(str(path)) else error.inside(f"{path}: ") from error
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, RecursionError, zlib.error) as error:
        raise UserError(str(path), f"is damaged: {error}", expected=expected) from error


def _scripts_with_data(text: str) -> dict[str, str]:
    """The contents of the scripts that hold data, by the names that a page gives them; each character is read once.

    Where a script doesn't end, it and whatever follows it are left out.
    """
    parts: dict[str, str] = {}
    place = 0
    while len(parts) < _MOST_PARTS:
        place = text.find('<script type="', place)
        if place < 0:
            break
        start = next((start for start in _STARTS if text.startswith(start, place)), None)
        place += len(_STARTS[1]) if start is None else len(start)
        close = text.find('">', place, place + _LONGEST_ID)
        if start is None or close < 0 or not text.startswith("holoview-", place):
            continue
        end = text.find("</script>", close)
        if end < 0:
            break
        parts[text[place:close]] = text[close + 2 : end]
        place = end
    return parts


def _inflate(text: str) -> bytes:
    """The binary data of a page. Raises ValueError for other text, and for data that unpack to more than 256 MiB."""
    try:
        packed = base64.b64decode(text, validate=True)
    except binascii.Error as error:
        raise ValueError("data that aren't base64") from error
    unpacker = zlib.decompressobj()
    data = unpacker.decompress(packed, _LARGEST_BYTES)
    if unpacker.unconsumed_tail or not unpacker.eof:
        raise ValueError("data that are incomplete or too large")
    return data
