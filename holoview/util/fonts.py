"""The font of texts that are drawn into pictures."""

from __future__ import annotations

import importlib.util
from functools import cache
from pathlib import Path

from PIL import ImageFont

_FILE = "assets/fonts/Roboto/Roboto-Regular.ttf"


def picture_font(size_px: float) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Roboto, which also has the window's texts: it has Latin, Greek and Cyrillic letters, and signs such as × and µ.

    It comes with Dear ImGui Bundle, which isn't imported for it. Pillow's own font, which lacks most of these signs,
    takes its place where an installation has left the file out.
    """
    path = _path()
    return ImageFont.load_default(size_px) if path is None else ImageFont.truetype(path, size_px)


@cache
def _path() -> str | None:
    spec = importlib.util.find_spec("imgui_bundle")
    folders = (spec.submodule_search_locations or []) if spec is not None else []
    return next((str(path) for folder in folders if (path := Path(folder, _FILE)).is_file()), None)
