"""Settings of what is reported beside the causes: where an error lives, breakdown of the excess, pictures."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FreeMapConfig:
    """Smooth maps, free at one place at a time, that show where an unexplained error lives."""

    surface_points: tuple[int, int] = (6, 8)
    """[points] Rows and columns of control points over a modulator or the camera. Evidence: none recorded."""

    pupil_points: tuple[int, int] = (8, 8)
    """[points] Rows and columns of control points over a pupil. Evidence: none recorded."""

    response_points: int = 9
    """[points] Control points of a response curve. Evidence: none recorded."""

    iterations: int = 15
    """[1] Iterations of L-BFGS. Evidence: none recorded."""

    path_scale_m: float = 50e-9
    """[m] Optical path that a map's unit stands for, which scales the optimiser's steps. Evidence: none
    recorded."""

    relative_scale: float = 0.1
    """[1] Relative amplitude or response that a map's unit stands for. Evidence: none recorded."""

    min_share: float = 0.1
    """[1] Places are told that explain at least this share of the excess … Evidence: none recorded."""

    near_best_share: float = 0.7
    """[1] … and this share of what the best place explains. Evidence: none recorded."""


@dataclass(frozen=True)
class BreakdownConfig:
    """Classes of pixels by which the excess is broken down. Evidence: presentation only."""

    frequency_bands: int = 4
    """[1] Bands of spatial frequency up to the camera's Nyquist frequency. Evidence: presentation only."""

    radii: tuple[float, ...] = (0.25, 0.5, 0.75)
    """[1] Limits between classes of radius, over the distance of the corners. Evidence: presentation only."""

    brightness: tuple[float, ...] = (0.5, 1.0, 2.0)
    """[1] Limits between classes of expected light, over its mean. Evidence: presentation only."""


@dataclass(frozen=True)
class ReportConfig:
    """Figures and pictures of held-out captures, and the comparison on the display."""

    samples: int = 4
    """[captures] Held-out captures that are shown. Evidence: presentation only."""

    peak_quantile: float = 0.999
    """[1] Quantile of a capture's light that PSNR takes as its peak. Evidence: a definition; single hot pixels
    don't count."""

    hologram_iterations: int = 40
    """[1] Iterations of each hologram that is optimised. Evidence: measured: half a minute; the value: none
    recorded."""
