"""The live holograms of the manual: that of the front page, and those with which the gallery opens."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import holoview as hv
from docs._hooks.repository import ROOT

STILL_LIFE = "live/still-life.html"
GALLERY = "gallery.md"
_ASSETS = ROOT / "assets"
_EIGHT, _THREE, _ONE = "8 wavelengths, two modulators", "3 wavelengths, two modulators", "8 wavelengths, one modulator"
_FILES = {_EIGHT: "holochrome-8", _THREE: "simultaneous", _ONE: "holochrome-8-1slm"}
_EYE = {"pupil": "3 mm"}
_TEXTS = {
    STILL_LIFE: "A hologram of a still life with eight wavelengths, computed live in your browser: move its focal "
    "plane, its gap, its lasers. Made by `holoview export`; [a hologram as a web page](live.md) says how.",
    "live/schemes.html": "HoloChrome's eight wavelengths against the three of simultaneous colour, both through two "
    "modulators: wipe between them, and drag a region to compare speckle.",
    "live/modulators.html": "Eight wavelengths through two modulators and through one.",
    "live/eye.html": "The hologram of eight wavelengths and two modulators, seen by an eye with a pupil of 3 mm. "
    "Switch its chromatic aberration off, move the pupil, or let the focal plane play.",
}
"""Each live page, and what stands below it."""
_HEAD = """## Live

Three holograms of the still life, of 192 × 144 modulator pixels, optimised in 60 iterations each and computed in your
browser ([a hologram as a web page](live.md))."""


def pages() -> dict[str, str]:
    """The HTML of each live page, by its place in the manual."""
    still_life = {"A still life": hv.load_hologram(_ASSETS / "still-life.safetensors")}
    eight, three, one = ({name: hv.load_hologram(_ASSETS / "live" / f"{_FILES[name]}.safetensors")} for name in _FILES)
    behind_eye = {name: hv.Hologram(of.drive, of.system.with_(eye=_EYE)) for name, of in eight.items()}
    target = hv.target_for(
        eight[_EIGHT].system, _ASSETS / "still-life.png", hv.Placement(depth=_ASSETS / "still-life-depth.png")
    )
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "page.html"

        def html(holograms: dict[str, hv.Hologram], **options: Any) -> str:
            return hv.export_html(file, holograms, **options).read_text(encoding="utf-8")

        return {
            STILL_LIFE: html(still_life, region=(700, 120, 64, 64)),
            "live/schemes.html": html(eight | three, target=target, title="HoloChrome against simultaneous colour"),
            "live/modulators.html": html(eight | one, target=target, title="One against two modulators"),
            "live/eye.html": html(behind_eye, title="Seen by an eye"),
        }


def embedded(markdown: str) -> str:
    """The front page with its hologram behind its first paragraph."""
    heading, first, rest = markdown.split("\n\n", 2)
    return "\n\n".join((heading, first, _frame(STILL_LIFE), rest))


def with_gallery(markdown: str) -> str:
    """The gallery, which begins with its live holograms."""
    head, mark, rest = markdown.partition("\n## ")
    frames = [_frame(page) for page in _TEXTS if page != STILL_LIFE]
    return "\n\n".join((head.rstrip(), _HEAD, *frames, "")) + mark + rest


def _frame(page: str) -> str:
    frame = f'<iframe class="live-hologram" src="{page}" loading="lazy" title="A hologram, computed live"></iframe>'
    return f"{frame}\n\n*{_TEXTS[page]}*"
