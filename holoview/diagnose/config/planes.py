"""Settings of the search for errors of single planes."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PlaneConfig:
    """Distances that are tried for the captures of each plane."""

    captures: int = 2
    """[captures] Of each plane that are predicted, the smoothest. Evidence: a second wavelength has other minima
    beside the true one; the value: none recorded."""

    depths: tuple[float, ...] = (0.06, 0.12, 0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0)
    """[depths] Errors either way, in depths of field λ/NA². Evidence: as `JudgementConfig.defocus_depths`."""

    first_step: float = 0.2
    """[1] First step of the refinement over the error … Evidence: derivation: half the distance to the next one."""

    least_step: float = 0.02
    """[depths] … and at least this. Evidence: the same for errors of 0."""

    step_ratio: float = 0.4
    """[1] Each step over the one before. Evidence: none recorded."""

    rounds: int = 4
    """[1] Steps. Evidence: a local fit follows; the value: none recorded."""

    min_gain: float = 25.0
    """[Δχ²] By how much errors of single planes must beat one error of all, and each plane's its absence, times χ²/n
    where that is above 1. Evidence: 5 σ for one number, as for a cause (`VerdictConfig.min_delta_chi2`)."""
