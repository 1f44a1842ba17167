"""A line drawing as data, lines, areas and labels in points, and as SVG or PNG.

Whoever makes one says what is where; how it looks by its role is said here once, so that all pictures look alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from io import BytesIO

from PIL import Image, ImageDraw

from holoview.util.fonts import picture_font
from holoview.util.text import printable

Place = tuple[float, float]
"""x to the right and y downwards, in points."""
Box = tuple[float, float, float, float]
"""Left, upper, right and lower edge, in points."""

_EM = 0.66  # width of a character over its height, of the widest usual fonts
_LINE = 1.3  # height of a line of text over that of its font
_COLOURS = {
    "axis": "#9aa0a6",
    "light": "#cfe8d5",
    "ray": "#2e7d4f",
    "device": "#27364b",
    "glass": "#8fb7dd",
    "stop": "#1b1b1f",
    "plane": "#b3541e",
    "image": "#9aa0a6",
    "distance": "#5f6368",
    "name": "#1b1b1f",
    "detail": "#4a4d52",
}
"""The colour of each role."""
_DASHED = ("axis", "image")
_WIDTHS = {
    "device": 2.5,
    "stop": 3.5,
    "plane": 2.0,
    "ray": 1.0,
    "axis": 1.0,
    "image": 1.5,
    "distance": 1.0,
    "glass": 1.5,
}
_PNG_SCALE = 2


@dataclass(frozen=True)
class DrawnLine:
    """A line through points. role: of `_COLOURS`. key: of what it stands for, "" for nothing in particular.

    is_filled: whether it is the edge of an area.
    """

    points: tuple[Place, ...]
    role: str
    key: str = ""
    is_filled: bool = False


@dataclass(frozen=True)
class Label:
    """A line of text about a point: centred across it, `y` being the middle of its height."""

    text: str
    x: float
    y: float
    size: float
    role: str
    key: str = ""

    @property
    def box(self) -> Box:
        """The room that it takes in a font of usual width."""
        half = text_width(self.text, self.size) / 2
        return self.x - half, self.y - _LINE * self.size / 2, self.x + half, self.y + _LINE * self.size / 2


@dataclass(frozen=True)
class Drawing:
    """Strokes, the lower ones first, and labels over them. areas: the room of each key, for clicks. title: in words."""

    width: float
    height: float
    strokes: tuple[DrawnLine, ...]
    labels: tuple[Label, ...]
    areas: tuple[tuple[str, Box], ...] = ()
    title: str = ""

    def key_at(self, x: float, y: float) -> str:
        """The key of what is drawn at a place; "" where nothing is."""
        return next((key for key, box in self.areas if box[0] <= x <= box[2] and box[1] <= y <= box[3]), "")


def text_width(text: str, size: float) -> float:
    """The width of a line of text in a font of usual width, in points."""
    return _EM * size * len(text)


def colour_of(role: str) -> str:
    """The colour of a role, as #rrggbb."""
    return _COLOURS[role]


def line_width(role: str) -> float:
    """The width of lines of a role, in points."""
    return _WIDTHS.get(role, 1.0)


def as_svg(drawing: Drawing) -> str:
    """The drawing as SVG, on white; each stroke and label of a key has it as data-key."""
    size = f"{drawing.width:g} {drawing.height:g}"
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size}" width="{drawing.width:g}" '
        f'height="{drawing.height:g}" role="img" font-family="system-ui, sans-serif">',
        f"<title>{escape(printable(drawing.title))}</title>",
        '<rect width="100%" height="100%" fill="#ffffff"/>',
    ]
    for stroke in drawing.strokes:
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in stroke.points)
        colour, key = colour_of(stroke.role), f' data-key="{escape(stroke.key)}"' if stroke.key else ""
        if stroke.is_filled:
            lines.append(f'<polygon points="{points}" fill="{colour}"{key}/>')
        else:
            dashes = ' stroke-dasharray="4 3"' if stroke.role in _DASHED else ""
            width = line_width(stroke.role)
            lines.append(
                f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="{width:g}"{dashes}{key}/>'
            )
    for label in drawing.labels:
        weight = ' font-weight="600"' if label.role == "name" else ""
        key = f' data-key="{escape(label.key)}"' if label.key else ""
        lines.append(
            f'<text x="{label.x:.1f}" y="{label.y:.1f}" font-size="{label.size:g}" text-anchor="middle" '
            f'dominant-baseline="central" fill="{colour_of(label.role)}"{weight}{key}>'
            f"{escape(printable(label.text))}</text>"
        )
    return "\n".join([*lines, "</svg>", ""])


def as_png(drawing: Drawing) -> bytes:
    """The drawing as PNG, on white, two pixels a point."""
    scale = _PNG_SCALE
    image = Image.new("RGB", (round(drawing.width * scale), round(drawing.height * scale)), "#ffffff")
    draw = ImageDraw.Draw(image)
    for stroke in drawing.strokes:
        points = [(x * scale, y * scale) for x, y in stroke.points]
        if stroke.is_filled:
            draw.polygon(points, fill=colour_of(stroke.role))
        else:
            draw.line(points, fill=colour_of(stroke.role), width=round(line_width(stroke.role) * scale), joint="curve")
    for label in drawing.labels:
        font, at = picture_font(label.size * scale), (label.x * scale, label.y * scale)
        draw.text(at, printable(label.text), colour_of(label.role), font, anchor="mm")
    buffer = BytesIO()
    image.save(buffer, format="PNG")
    return buffer.getvalue()
