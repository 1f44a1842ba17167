"""The live hologram with which the manual's front page opens."""

from __future__ import annotations

import tempfile
from pathlib import Path

import holoview as hv
from docs._hooks.repository import ROOT

PAGE = "live/still-life.html"
_FRAME = f"""<iframe class="live-hologram" src="{PAGE}" loading="lazy"
title="A hologram, computed live in this browser"></iframe>

*A hologram of a still life with eight wavelengths, computed live in your browser: move its focal plane, its gap, its
lasers. Made by `holoview export`; [a hologram as a web page](live.md) says how.*"""


def page() -> str:
    """The page of the shipped hologram."""
    hologram = hv.load_hologram(ROOT / "assets" / "still-life.safetensors")
    with tempfile.TemporaryDirectory() as folder:
        file = hv.export_html(Path(folder) / "page.html", {"A still life": hologram}, region=(700, 120, 64, 64))
        return file.read_text(encoding="utf-8")


def embedded(markdown: str) -> str:
    """The front page with the hologram behind its first paragraph."""
    heading, first, rest = markdown.split("\n\n", 2)
    return "\n\n".join((heading, first, _FRAME, rest))
