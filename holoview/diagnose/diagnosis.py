"""The result of a diagnosis, and its JSON."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.diagnose.decide import Verdict
from holoview.diagnose.excess import Excess
from holoview.diagnose.uncertainty import Interval
from holoview.diagnose.unknowns import Found

Image = NDArray[np.float32]


@dataclass(frozen=True)
class Quality:
    """How well a model predicts captures: χ²/n, and PSNR against the brightest 0.1 % of each picture."""

    chi2: float
    psnr_db: float


@dataclass(frozen=True)
class Cause:
    """A cause that was named: values with intervals (SI) and units, what it explains, what it may be mistaken for.

    excess_explained: share of the excess of the model that lacks only this cause. gain_db: PSNR on held-out captures
    that it gains. confounded_with: effects whose pictures change alike, with the correlation (1: the same physics).
    """

    effect: str
    sentence: str
    intervals: dict[str, Interval]
    units: dict[str, str]
    excess_explained: float
    gain_db: float
    before: Quality
    after: Quality
    confounded_with: dict[str, float] = field(default_factory=dict)
    separate_by: str | None = None


@dataclass(frozen=True)
class Group:
    """Held-out captures of one wavelength and plane, before and after."""

    wavelength_m: float
    distance_m: float
    before: Quality
    after: Quality


@dataclass(frozen=True, eq=False)
class Sample:
    """A held-out capture for the eye: light (counts), predictions (counts) and residuals (σ) before, after: (y, x)."""

    capture: int
    wavelength_m: float
    distance_m: float
    light: Image
    predicted: tuple[Image, Image]
    residual: tuple[Image, Image]


@dataclass(frozen=True)
class Candidate:
    """Causes that were fitted, and χ²/n on the held-out captures."""

    causes: tuple[str, ...]
    chi2: float


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What is wrong, in the order in which it is told.

    values: the effects of the extended model (empty: the nominal one). rivals: sets of causes that can't be excluded.
    candidates: what else was tried, best first. samples: a few held-out captures to look at.
    unexplained: share of the excess that no cause explains; lives_in: share that free maps at each place explain.
    """

    verdict: Verdict
    before: Quality
    after: Quality
    causes: tuple[Cause, ...]
    values: Found
    rivals: tuple[tuple[str, ...], ...]
    unexplained: float
    lives_in: dict[str, float]
    groups: tuple[Group, ...]
    candidates: tuple[Candidate, ...]
    samples: tuple[Sample, ...]
    where_before: Excess
    where_after: Excess
    signal_explained: tuple[float, float]
    fixed_pattern: float
    gain_spread: float
    notes: tuple[str, ...]
    seconds: float
    noise_floor: float = 1.0

    def as_json(self) -> dict[str, Any]:
        """For programs; lengths in metres, angles in radians."""
        return {
            "verdict": str(self.verdict),
            "noise_floor": self.noise_floor,
            "before": _quality(self.before),
            "after": _quality(self.after),
            "causes": [_cause(cause) for cause in self.causes],
            "candidates": [{"causes": list(c.causes), "chi2_per_pixel": _figure(c.chi2)} for c in self.candidates],
            "rivals": [list(causes) for causes in self.rivals],
            "unexplained": {
                "share": _figure(self.unexplained),
                "lives_in": list(self.lives_in),
                "shares": {k: _figure(v) for k, v in self.lives_in.items()},
            },
            "held_out": [
                {
                    "wavelength": g.wavelength_m,
                    "distance": g.distance_m,
                    "before": _quality(g.before),
                    "after": _quality(g.after),
                }
                for g in self.groups
            ],
            "excess": {
                "before": _excess(self.where_before),
                "after": _excess(self.where_after),
            },
            "signal_explained": {
                "before": _figure(self.signal_explained[0]),
                "after": _figure(self.signal_explained[1]),
            },
            "fixed_pattern": _figure(self.fixed_pattern),
            "gain_spread": _figure(self.gain_spread),
            "notes": list(self.notes),
            "seconds": _figure(self.seconds),
        }


def _cause(cause: Cause) -> dict[str, Any]:
    return {
        "effect": cause.effect,
        "parameters": {
            name: {
                "value": interval.value,
                "unit": cause.units[name],
                "sigma": _figure(interval.sigma),
                "interval": [
                    _figure(interval.value - interval.half_width),
                    _figure(interval.value + interval.half_width),
                ],
            }
            for name, interval in cause.intervals.items()
        },
        "excess_explained": _figure(cause.excess_explained),
        "gain_db": _figure(cause.gain_db),
        "chi2_per_pixel": {"before": _figure(cause.before.chi2), "after": _figure(cause.after.chi2)},
        "confounded_with": list(cause.confounded_with),
        "correlations": {name: _figure(value) for name, value in cause.confounded_with.items()},
        "separate_by": cause.separate_by,
        "sentence": cause.sentence,
    }


def _quality(quality: Quality) -> dict[str, float | None]:
    return {"chi2_per_pixel": _figure(quality.chi2), "psnr_db": _figure(quality.psnr_db)}


def _excess(excess: Excess) -> dict[str, Any]:
    return {
        f.name: [
            {"name": b.name, "chi2_per_pixel": _figure(b.chi2), "share": _figure(b.share)}
            for b in getattr(excess, f.name)
        ]
        for f in dataclasses.fields(excess)
    }


def _figure(value: float) -> float | None:
    """Six significant digits; None for what isn't a number, which JSON can't write."""
    return float(f"{value:.6g}") if math.isfinite(value) else None
