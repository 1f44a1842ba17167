"""How a picture is placed on a grid of another aspect: all of it, the largest part that fills it, or a chosen one.

fill   the largest part of the grid's aspect, about the middle of the picture
fit    all of the picture, with black beside it
crop   a part of the grid's aspect, as large and where it is said
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

from holoview.util.errors import UserError

KINDS = ("fill", "fit", "crop")
LEAST_SHARE = 0.02
_UNSEEN = 0.005  # of a side: less is neither cut off nor black, but rounding


@dataclass(frozen=True)
class Framing:
    """How a picture is placed on a grid.

    kind: one of KINDS. centre: of the part that "crop" shows, (x, y) as fractions of the picture; it is moved so that
    the part lies inside. share: of the sides of this part in those of the largest one.

    Raises UserError for a share or a centre out of range.

    >>> import holoview as hv
    >>> hv.Framing("fit").window((100, 400), (100, 200))
    (0.0, -50.0, 400.0, 200.0)
    """

    kind: str = "fill"
    centre: tuple[float, float] = (0.5, 0.5)
    share: float = 1.0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise UserError("framing", f'"{self.kind}"', expected=", ".join(KINDS))
        if not LEAST_SHARE <= self.share <= 1:
            raise UserError("framing", f"a share of {self.share:g}", expected=f"{LEAST_SHARE:g} to 1")
        if not all(0 <= value <= 1 for value in self.centre):
            raise UserError("framing", f"a centre at {self.centre}", expected="fractions of the picture, 0 to 1")

    @classmethod
    def parse(cls, text: str, where: str = "framing") -> Framing:
        """The framing of text: "fill", "fit", "crop", or "crop:X,Y" and "crop:X,Y,SHARE" in fractions.

        where: the name of the text in errors. Raises UserError for other text, and as the constructor does.

        >>> import holoview as hv
        >>> hv.Framing.parse("crop:0.25,0.5,0.8")
        Framing(kind='crop', centre=(0.25, 0.5), share=0.8)
        """
        kind, has_numbers, rest = text.partition(":")
        expected = "fill, fit, crop, or crop:X,Y,SHARE in fractions of the picture, e.g. crop:0.5,0.3,0.8"
        try:
            numbers = [float(part) for part in rest.split(",")] if has_numbers else []
        except ValueError:
            numbers = [-1.0]
        if kind not in KINDS or (has_numbers and (kind != "crop" or len(numbers) not in (2, 3) or min(numbers) < 0)):
            raise UserError(where, f'"{text}"', expected=expected)
        x, y, share = chain(numbers, (0.5, 0.5, 1.0)[len(numbers) :])
        return cls(kind, (x, y), share)

    def window(self, picture: tuple[int, int], grid: tuple[int, int]) -> tuple[float, float, float, float]:
        """The part of a picture of a shape (y, x) that a grid of a shape shows: left, top, width, height in its pixels.

        Of "fit" it is larger than the picture.

        >>> import holoview as hv
        >>> hv.Framing("crop", (0.25, 0.5), 0.5).window((100, 400), (100, 200))
        (50.0, 25.0, 100.0, 50.0)
        """
        (rows, columns), ratios = picture, (grid[0] / picture[0], grid[1] / picture[1])
        scale = min(ratios) if self.kind == "fit" else max(ratios)
        share = self.share if self.kind == "crop" else 1.0
        height, width = grid[0] / scale * share, grid[1] / scale * share
        if self.kind != "crop":
            return (columns - width) / 2, (rows - height) / 2, width, height
        left = min(max(self.centre[0] * columns - width / 2, 0.0), max(columns - width, 0.0))
        return left, min(max(self.centre[1] * rows - height / 2, 0.0), max(rows - height, 0.0)), width, height

    def describe(self, picture: tuple[int, int], grid: tuple[int, int]) -> str:
        """What is cut off a picture of a shape (y, x), or black beside it, on a grid of a shape, in words.

        "" where all of it is seen and nothing else.

        >>> import holoview as hv
        >>> hv.Framing("fit").describe((100, 400), (100, 200))
        'black: 25 % above, 25 % below'
        """
        left, top, width, height = self.window(picture, grid)
        across, down = (left, picture[1] - left - width), (top, picture[0] - top - height)
        outside = dict(zip(("left", "right", "above", "below"), (*across, *down), strict=True))
        cut = _percent({side: px / picture[side in ("left", "right")] for side, px in outside.items()})
        black = _percent({side: -px / (width if side in ("left", "right") else height) for side, px in outside.items()})
        return "; ".join([f"cut off: {cut}"] * bool(cut) + [f"black: {black}"] * bool(black))


def _percent(shares: dict[str, float]) -> str:
    return ", ".join(f"{100 * share:.0f} % {side}" for side, share in shares.items() if share > _UNSEEN)


FILL = Framing()
