"""View settings: how a hologram is displayed. Focal plane, exposure, channel, comparison, measured region."""

from __future__ import annotations

import dataclasses
import math
import string
from dataclasses import dataclass
from typing import Any

from holoview.holograms.metrics.perceptual_scores import PERCEPTUAL_SCORES
from holoview.light.model.focus import PupilPath
from holoview.util.errors import UserError, suggest_matches
from holoview.util.tables import check_keys

Region = tuple[int, int, int, int]
"""x, y, width, height in samples of the simulated image."""
Line = tuple[float, float, float, float]
"""x0, y0, x1, y1 in samples of the simulated image; whole numbers are centres of samples."""

CHANNELS = ("colour", "luminance", "R", "G", "B", "X", "Y", "Z", "L", "M", "S")
FALSE_COLOURS = ("", "cubehelix", "hue")
COMPARISON_MODES = ("off", "hold", "wipe", "side-by-side", "difference")
PAGES = ("image", "planes", "phase", "field", "spectrum", "target")
DERIVED_PAGES = ("phase", "field", "spectrum")
"""Pages that show an image other than a focal plane of a side."""
FIELD_QUANTITIES = ("amplitude", "phase", "real", "imaginary", "phase-colour", "spectrum")
"""The quantities that a picture of a complex field shows."""
QUANTITIES = (*FIELD_QUANTITIES, "intensity")
"""What the page "field" shows: a quantity of one laser's field, or the intensity of all that are on, in colours."""
SCORES = ("", *PERCEPTUAL_SCORES)
"""Scores that can stand beside the PSNR; "" for none."""
SPECKLE_EXPOSURE_STOPS = -1.5
"""An exposure at which the speckle of random patterns, whose mean luminance is that of white, is hardly clipped."""
MAX_EXPOSURE_STOPS = 60.0  # far beyond any useful exposure, and 2^120 is still finite in float64
_KINDS = ("now", "target", "achromatic", "snapshot", "preset")
_LABELS = {"now": "Now", "target": "Target", "achromatic": "Without colour error"}


def _check_choice(key: str, value: str, options: tuple[str, ...]) -> None:
    if value not in options:
        expected = ", ".join(f'"{option}"' for option in options)
        raise UserError(key, f'"{value}"', expected=expected, remedy=suggest_matches(value, options))


@dataclass(frozen=True)
class ComparisonSide:
    """One side of a comparison.

    kind: "now": the hologram as it is. "target": its target. "achromatic": the hologram seen by an eye without colour
    error. "snapshot", "preset": a pinned one, or a bench with random patterns, of a name.
    """

    kind: str = "now"
    name: str = ""

    def __post_init__(self) -> None:
        _check_choice("side", self.kind, _KINDS)
        if (self.kind in ("snapshot", "preset")) != bool(self.name):
            raise UserError(f"side {self.kind}", f'name "{self.name}"', expected="a name for a snapshot or a preset")

    @property
    def label(self) -> str:
        """The name that is shown above the image."""
        return self.name if self.name else _LABELS[self.kind]


@dataclass(frozen=True)
class NamedRegion:
    """A region of the image with a name. Raises UserError for an empty name or region."""

    name: str
    region: Region

    def __post_init__(self) -> None:
        if not self.name.strip():
            raise UserError("region", "no name", expected="a name")
        if min(self.region[:2]) < 0 or min(self.region[2:]) < 1:
            raise UserError("region", str(self.region), expected="x, y ≥ 0 and a width and height ≥ 1")


NOW, TARGET, ACHROMATIC = ComparisonSide("now"), ComparisonSide("target"), ComparisonSide("achromatic")


@dataclass(frozen=True)
class ViewSettings:
    """How a document is displayed.

    plane_m: distance of the focal plane behind the last modulator, in metres; negative before a field.
    exposure_stops: a factor 2^stops on the light. gamma: an exponent 1/gamma after the sRGB transfer function.
    channel: one of CHANNELS. false_colour: a colour map for a single channel, "" for grey.
    low, high: values of the channel, after exposure, that are shown black and white. keeps_hue: whether a colour that
    the screen can't show keeps its hue, in place of clipping each channel.
    solo, muted: indices of the only laser shown, and of lasers left out.
    page: one of PAGES. frame, modulator: indices of the pattern on the page "phase". is_one_frame: whether the image is
    that of this frame alone, in place of the mean of all.
    stage, quantity: of the light on the page "field", of the frame and the solo laser, or else the first: one of
    `System.stages`, "plane" where the bench doesn't have it, and one of QUANTITIES; "intensity" is that of all lasers.
    a, b, compare: the two sides of a comparison and its mode. wipe: fraction of the width that shows a. shown: what is
    shown while nothing is compared, the edited hologram or a snapshot.
    region, region_name: where speckle is measured, the chosen one of the regions that were drawn; other_regions: the
    rest of them. profile: a line along which light is plotted. cursor: the sample (x, y) whose light is looked into;
    the middle of the image when None.
    has_scale_bar, has_legend: whether a length, and what is shown, are written on the image.
    score: one of SCORES, shown beside the PSNR.
    zoom: screen pixels for each sample, 0 to fit the window. centre: (x, y) of the middle of the view, as fractions of
    the image. pupil_path: a path of the pupil through the eyebox that was recorded or opened.

    Raises UserError for invalid values.
    """

    plane_m: float
    exposure_stops: float = 0.0
    gamma: float = 1.0
    channel: str = "colour"
    false_colour: str = ""
    low: float = 0.0
    high: float = 1.0
    keeps_hue: bool = True
    solo: int | None = None
    muted: frozenset[int] = frozenset()
    page: str = "image"
    frame: int = 0
    is_one_frame: bool = False
    modulator: int = 0
    stage: str = "plane"
    quantity: str = "phase-colour"
    a: ComparisonSide = NOW
    b: ComparisonSide = TARGET
    compare: str = "off"
    shown: ComparisonSide = NOW
    wipe: float = 0.5
    region: Region | None = None
    region_name: str = "A"
    other_regions: tuple[NamedRegion, ...] = ()
    profile: Line | None = None
    cursor: tuple[int, int] | None = None
    has_scale_bar: bool = False
    has_legend: bool = False
    score: str = ""
    zoom: float = 0.0
    centre: tuple[float, float] = (0.5, 0.5)
    pupil_path: PupilPath | None = None

    def __post_init__(self) -> None:
        for key, options in (
            ("channel", CHANNELS),
            ("false_colour", FALSE_COLOURS),
            ("compare", COMPARISON_MODES),
            ("page", PAGES),
            ("quantity", QUANTITIES),
            ("score", SCORES),
        ):
            _check_choice(key, getattr(self, key), options)
        if not math.isfinite(self.plane_m):
            raise UserError("plane", f"{self.plane_m:g} m", expected="a finite distance")
        if not abs(self.exposure_stops) <= MAX_EXPOSURE_STOPS:
            raise UserError(
                "exposure",
                f"{self.exposure_stops:g}",
                expected=f"from -{MAX_EXPOSURE_STOPS:g} to {MAX_EXPOSURE_STOPS:g}",
            )
        if not 0.1 <= self.gamma <= 10:
            raise UserError("gamma", f"{self.gamma:g}", expected="from 0.1 to 10")
        if not self.low < self.high:
            raise UserError("black and white", f"{self.low:g} and {self.high:g}", expected="black below white")
        names = [of.name for of in self.regions]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise UserError("region", f'"{twice[0]}" twice', expected="a name that isn't taken")
        if self.cursor is not None and min(self.cursor) < 0:
            raise UserError("cursor", str(self.cursor), expected="x, y ≥ 0")
        if min(self.frame, self.modulator, self.solo or 0, *self.muted) < 0:
            raise UserError("frame, modulator and lasers", "a negative number", expected="whole numbers from 0")
        if not (0 <= self.wipe <= 1 and 0 <= self.zoom < math.inf):
            raise UserError("wipe and zoom", f"{self.wipe:g} and {self.zoom:g}", expected="0 to 1, and 0 or more")

    def with_(self, **changes: Any) -> ViewSettings:
        """A copy with some fields changed. Raises UserError for an unknown field or an invalid value."""
        check_keys(changes, {field.name for field in dataclasses.fields(self)}, noun="field of the look")
        return dataclasses.replace(self, **changes)

    def shows_laser(self, index: int) -> bool:
        """Whether a laser contributes to the image: the solo laser alone, or else all that aren't muted."""
        return self.solo == index if self.solo is not None else index not in self.muted

    @property
    def regions(self) -> tuple[NamedRegion, ...]:
        """All regions that were drawn, by their names."""
        chosen = () if self.region is None else (NamedRegion(self.region_name, self.region),)
        return tuple(sorted((*self.other_regions, *chosen), key=lambda of: of.name.casefold()))

    def with_new_region(self, region: Region) -> ViewSettings:
        """A copy with one region more, under the next letter, which is the chosen one."""
        taken = {of.name for of in self.regions}
        letters = (f"{letter}{n or ''}" for n in range(len(taken) + 1) for letter in string.ascii_uppercase)
        name = next(letter for letter in letters if letter not in taken)
        return self.with_(region=region, region_name=name, other_regions=self.regions)

    def with_region_chosen(self, name: str) -> ViewSettings:
        """A copy in which the region of a name is the chosen one. Raises UserError when there is none."""
        found = {of.name: of.region for of in self.regions}
        if name not in found:
            raise UserError("region", f'"{name}"', remedy=suggest_matches(name, found))
        others = tuple(of for of in self.regions if of.name != name)
        return self.with_(region=found[name], region_name=name, other_regions=others)

    def with_region_renamed(self, name: str, to: str) -> ViewSettings:
        """A copy in which a region has another name. Raises UserError for a name that is taken or empty."""
        if name == self.region_name and self.region is not None:
            return self.with_(region_name=to.strip())
        others = (NamedRegion(to.strip() if of.name == name else of.name, of.region) for of in self.other_regions)
        return self.with_(other_regions=tuple(others))

    def without_region(self, name: str) -> ViewSettings:
        """A copy without the region of a name; if it was the chosen one, the first of the others is."""
        left = tuple(of for of in self.regions if of.name != name)
        if name != self.region_name or not left:
            view = self.with_(other_regions=tuple(of for of in self.other_regions if of.name != name))
            return view.with_(region=None) if name == self.region_name else view
        return self.with_(region=left[0].region, region_name=left[0].name, other_regions=left[1:])

    def cursor_in(self, shape: tuple[int, int]) -> tuple[int, int]:
        """Row and column of the cursor in an image of a shape (y, x)."""
        x, y = (shape[1] // 2, shape[0] // 2) if self.cursor is None else self.cursor
        return min(y, shape[0] - 1), min(x, shape[1] - 1)

    def with_side_replaced(self, old: ComparisonSide, new: ComparisonSide) -> ViewSettings:
        """A copy in which the side `old` of the comparison is replaced by `new`."""
        return self.with_(**{key: new for key in ("a", "b", "shown") if getattr(self, key) == old})

    def clamped_to(self, lasers: int, shape: tuple[int, int], frames: int, modulators: int) -> ViewSettings:
        """A copy that refers only to what exists: lasers, samples of the image (y, x), frames and modulators."""
        muted = frozenset(laser for laser in self.muted if laser < lasers)
        solo = self.solo if self.solo is not None and self.solo < lasers else None
        if len(muted) == lasers:
            muted = frozenset()
        return dataclasses.replace(
            self,
            solo=solo,
            muted=muted,
            region=_clip_region(self.region, shape),
            other_regions=tuple(
                dataclasses.replace(of, region=inside)
                for of in self.other_regions
                if (inside := _clip_region(of.region, shape)) is not None
            ),
            cursor=None if self.cursor is None else self.cursor_in(shape)[::-1],
            frame=min(self.frame, frames - 1),
            modulator=min(self.modulator, modulators - 1),
        )


def displayed_side(view_settings: ViewSettings) -> ComparisonSide:
    """The side that is shown where there is room for one: A of a comparison, else a hologram or the target."""
    if view_settings.page == "target":
        return TARGET
    if view_settings.page != "image":
        return NOW
    return view_settings.shown if view_settings.compare == "off" else view_settings.a


def _clip_region(region: Region | None, shape: tuple[int, int]) -> Region | None:
    if region is None:
        return None
    x, y, width, height = region
    width, height = min(x + width, shape[1]) - x, min(y + height, shape[0]) - y
    return (x, y, width, height) if width > 0 and height > 0 else None
