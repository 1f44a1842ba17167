"""How well a model predicts captures."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FitQuality:
    """Quality of a prediction of one or several captures.

    chi2_per_pixel: Σ (residual / σ)² over the number of pixels; 1 where only noise is left. psnr_db: mean PSNR against
    the brightest pixels of each capture.
    """

    chi2_per_pixel: float
    psnr_db: float
