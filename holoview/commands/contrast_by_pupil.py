"""The table and the plot of `holoview contrast --pupils`: speckle contrast on the retina against the pupil."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from holoview.commands.console import progress_bar
from holoview.io.hologram import Hologram
from holoview.metrics.speckle import RetinalContrast, independent_contrast, pupils_of, retinal_contrast
from holoview.numerics.tensors import Region
from holoview.study.plots import line_plot
from holoview.view import simulate

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class ContrastByPupil:
    """Contrasts of a region for some pupils, and that of independent patterns of the same lasers."""

    contrasts: tuple[RetinalContrast, ...]
    independent: float

    @property
    def rows(self) -> list[dict[str, Any]]:
        """The contrasts as JSON values."""
        return [
            {
                "pupil_mm": round(found.pupil_m * 1e3, 6),
                "contrast": found.contrast,
                "cone_contrast": found.cone_contrast,
                "grain_arcmin": found.grain_arcmin,
            }
            for found in self.contrasts
        ]

    def figure(self) -> Callable[[Figure], None]:
        """A function that draws the contrasts against the pupil."""
        x = [row["pupil_mm"] for row in self.rows]
        curves: dict[str, tuple[Sequence[float], Sequence[float]]] = {
            "every sample": (x, [found.contrast for found in self.contrasts]),
            "as cones see it": (x, [found.cone_contrast for found in self.contrasts]),
            "independent patterns": (x, [self.independent] * len(x)),
        }
        return line_plot(curves, "pupil (mm)", "speckle contrast", dashed=("independent patterns",))


def contrast_by_pupil(hologram: Hologram, plane_m: float, pupils_m: Sequence[float], region: Region) -> ContrastByPupil:
    """Measures the region of a hologram at a plane through each pupil (m). Raises UserError as `simulate` does."""
    found, systems = [], pupils_of(hologram.system, pupils_m)
    with progress_bar("pupils") as progress:
        for number, system in enumerate(systems, start=1):
            view = simulate(system, hologram.drive, [plane_m], backend="torch")
            found.append(retinal_contrast(system, view.xyz[0, ..., 1], region))
            progress(number, len(systems), f"{found[-1].pupil_m * 1e3:.3g} mm")
    return ContrastByPupil(tuple(found), independent_contrast(hologram.system))


def format_rows(rows: Sequence[dict[str, Any]], independent: float) -> list[str]:
    """The rows of a table as lines of text."""
    lines = ["", "pupil      contrast  as cones see it  grains"]
    lines += [
        f"{row['pupil_mm']:<5.3g} mm   {row['contrast']:.4f}    {row['cone_contrast']:.4f}           "
        f"{row['grain_arcmin']:.2f} arcmin"
        for row in rows
    ]
    return [*lines, f"independent patterns of these lasers have {independent:.4f}, whatever the pupil"]
