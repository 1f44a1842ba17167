"""What a sweep of the viewer's document is: what is asked for, the curve that is found, and who measures its points.

What measures lies above the viewer: the program that opens the viewer gives a `Sweeper`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from holoview.light.model.effects.registry import get_effect
from holoview.light.model.system import System
from holoview.util import units
from holoview.util.progress import ProgressCallback
from holoview.viewer.document.document import Document
from holoview.viewer.render.scene import Drive

MEASURES = {
    "psnr": "PSNR (dB)",
    "contrast": "speckle contrast",
    "delta_e": "mean CIEDE2000",
    "ms_ssim": "MS-SSIM",
    "light": "light in the picture",
    "luminance": "mean luminance",
    "eyebox": "eyebox: darkest over mean",
}
"""What can be measured, by the names of `holoview sweep`, in words."""
_SPREAD = 0.5  # of a parameter about its own value, in `usual_sweeps`
_POINTS = 7


@dataclass(frozen=True)
class SweepRequest:
    """What to sweep.

    values: a parameter and its values as of `holoview sweep --set`, such as "gap=1mm:3mm:9". measure: one of
    `MEASURES`. iterations: with which patterns are found anew at each point; 0 shows those of the session.
    """

    values: str
    measure: str
    iterations: int = 0


@dataclass(frozen=True, eq=False)
class SweptPoint:
    """A point.

    text: the parameter in words. value: in the unit of the curve. measured: the measure. system: the point's bench.
    error: the standard error of the measure; 0 where none is known. drive: the patterns that were found for it; None
    for those of the session.
    """

    text: str
    value: float
    measured: float
    error: float
    system: System
    drive: Drive | None


@dataclass(frozen=True, eq=False)
class SweptCurve:
    """The points so far, by rising value. heading: the parameter with its unit."""

    heading: str
    points: tuple[SweptPoint, ...]


class Sweeper(Protocol):
    """Measures the points of a sweep one after the other."""

    def __call__(
        self,
        document: Document,
        request: SweepRequest,
        report: ProgressCallback,
        show: Callable[[SweptCurve], None],
    ) -> None:
        """Calls `show` after each point, and `report`, which may raise to end it.

        Raises UserError for parameters, values and measures that the bench can't have.
        """


def usual_sweeps(system: System) -> list[str]:
    """Sweeps of what this bench has, about its own values: its gap, its iris, and the effects that are on."""
    found: list[tuple[str, float, str]] = []
    if system.gap_m is not None:
        found.append(("gap", system.gap_m, "mm"))
    if system.relay2 is not None and system.relay2.iris_na is not None:
        found.append(("relay2.iris_na", system.relay2.iris_na, ""))
    for effect, values in system.effect_values.items():
        shown = {parameter.name: parameter.display_unit for parameter in get_effect(effect).parameters}
        found += [(f"effects.{effect}.{name}", value, shown[name]) for name, value in values.items() if name in shown]
    return [
        f"{key}={_text(value * (1 - _SPREAD), unit)}:{_text(value * (1 + _SPREAD), unit)}:{_POINTS}"
        for key, value, unit in found
        if isinstance(value, float) and value > 0
    ]


def _text(value: float, unit: str) -> str:
    """A value with its unit, without a blank; in SI units where the unit isn't converted."""
    try:
        return units.format_rounded(value, unit).replace(" ", "")
    except StopIteration:  # a plain number, or one of counts and the like
        return f"{value:.4g}"
