"""The result of a diagnosis, and its JSON."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from holoview.bench.captures.prepared_captures import FitQuality
from holoview.bench.captures.records import RecordFindings
from holoview.bench.diagnose.correct.bad_captures import BadCapture
from holoview.bench.diagnose.extended_model import add_effect_values
from holoview.bench.diagnose.fit import FittedValues
from holoview.bench.diagnose.fit_statistics import ExcessBreakdown, HeldOutGroup, SampleCapture, SpeckleChange
from holoview.bench.diagnose.intervals import Interval
from holoview.bench.diagnose.judge import Verdict
from holoview.bench.diagnose.report.error_places import FreeMapFit, PixelMap, suggest_for


@dataclass(frozen=True)
class Cause:
    """A named cause.

    effect: its id. sentence: the finding in words. intervals, units: of each parameter, SI; each entry of a list is a
    parameter. lists: values without intervals (rows and columns). excess_explained: share of the excess of the model
    that lacks only this cause. gain_db: PSNR that it gains on held-out captures. before, after: quality without and
    with it. confounded_with: effects that change the captures in nearly the same way, with the correlation (1: the same
    physics). separate_by: the capture, in words, that would separate the causes from their first rival. choice: what
    happened to a wrong record; None for effects.
    """

    effect: str
    sentence: str
    intervals: dict[str, Interval]
    units: dict[str, str]
    excess_explained: float
    gain_db: float
    before: FitQuality
    after: FitQuality
    confounded_with: dict[str, float] = field(default_factory=dict)
    separate_by: str | None = None
    choice: str | None = None
    lists: dict[str, tuple[float, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class CandidateResult:
    """Causes that were fitted together, and χ²/n on the held-out captures."""

    causes: tuple[str, ...]
    chi2_per_pixel: float


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The result of a diagnosis. "Before" is the nominal model, "after" the extended model.

    values: the effects of the extended model; empty for the nominal model. rivals: sets of causes that can't be
    excluded. unexplained: share of the excess that no cause explains. free_maps: the places where free maps explain
    much of it. pixel_maps: how far single pixels of each modulator stand out in it. groups: quality by wavelength and
    plane. candidates: all ranked sets of causes, best first. samples: a few held-out captures. signal_explained: share
    of the captures' variance, before and after. speckle: how well predicted speckle stands in the pictures.
    fixed_pattern: standard deviation of the pixels' relative sensitivity. gain_spread: standard deviation of the
    logarithm of the gains about the mean of their wavelength. captures: number of captures. bad_captures: captures that
    don't fit their records; no fit used them, and all other fields describe the other captures. known: the effects of
    the nominal model, corrected where they were uncertain. records: the mistakes in the records; all other fields
    describe the corrected captures.
    """

    verdict: Verdict
    before: FitQuality
    after: FitQuality
    causes: tuple[Cause, ...]
    values: FittedValues
    rivals: tuple[tuple[str, ...], ...]
    unexplained: float
    free_maps: tuple[FreeMapFit, ...]
    groups: tuple[HeldOutGroup, ...]
    candidates: tuple[CandidateResult, ...]
    samples: tuple[SampleCapture, ...]
    excess_before: ExcessBreakdown
    excess_after: ExcessBreakdown
    signal_explained: tuple[float, float]
    speckle: SpeckleChange
    fixed_pattern: float
    gain_spread: float
    captures: int
    bad_captures: tuple[BadCapture, ...]
    notes: tuple[str, ...]
    seconds: float
    records: RecordFindings = field(default_factory=RecordFindings)
    pixel_maps: tuple[PixelMap, ...] = ()
    known: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def all_values(self) -> dict[str, dict[str, Any]]:
        """The known effects, and the effects that were found beside them."""
        return add_effect_values(self.known, self.values)

    @property
    def lives_in(self) -> dict[str, float]:
        """By place, the share of the unexplained excess that free maps there explain."""
        return {fit.location: fit.share for fit in self.free_maps}

    @property
    def suggestions(self) -> dict[str, str]:
        """Advice on an error at each of these places."""
        return {fit.location: suggest_for(fit.location) for fit in self.free_maps}

    def as_json(self) -> dict[str, Any]:
        """The diagnosis as JSON values; lengths in metres, angles in radians (docs/diagnosis.md lists the keys)."""
        return {
            "verdict": str(self.verdict),
            "noise_floor": 1.0,
            "before": _quality(self.before),
            "after": _quality(self.after),
            "causes": [_cause(cause) for cause in self.causes],
            "candidates": [
                {"causes": list(c.causes), "chi2_per_pixel": _json_number(c.chi2_per_pixel)} for c in self.candidates
            ],
            "rivals": [list(causes) for causes in self.rivals],
            "captures": self.captures,
            "known": {name: dict(own) for name, own in self.known.items()},
            "bad_captures": [dataclasses.asdict(bad) for bad in self.bad_captures],
            "unexplained": {
                "share": _json_number(self.unexplained),
                "lives_in": list(self.lives_in),
                "shares": {k: _json_number(v) for k, v in self.lives_in.items()},
                "maps": {fit.location: _maps(fit) for fit in self.free_maps},
                "suggestions": self.suggestions,
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
                "before": _excess(self.excess_before),
                "after": _excess(self.excess_after),
            },
            "signal_explained": {
                "before": _json_number(self.signal_explained[0]),
                "after": _json_number(self.signal_explained[1]),
            },
            "speckle_correlation": {
                name: _json_number(value) for name, value in dataclasses.asdict(self.speckle).items()
            },
            "fixed_pattern": _json_number(self.fixed_pattern),
            "gain_spread": _json_number(self.gain_spread),
            "records": self.records.as_json(),
            "notes": list(self.notes),
            "seconds": _json_number(self.seconds),
        }


def _maps(fit: FreeMapFit) -> dict[str, Any]:
    return {shown.name: {"unit": shown.unit, "values": shown.values.tolist()} for shown in fit.maps}


def _cause(cause: Cause) -> dict[str, Any]:
    return {
        "effect": cause.effect,
        "choice": cause.choice,
        "parameters": {
            name: {
                "value": interval.value,
                "unit": cause.units[name],
                "sigma": _json_number(interval.sigma),
                "interval": [
                    _json_number(interval.value - interval.half_width),
                    _json_number(interval.value + interval.half_width),
                ],
            }
            for name, interval in cause.intervals.items()
        }
        | {
            name: {"value": list(entries), "unit": "1", "sigma": None, "interval": None}
            for name, entries in cause.lists.items()
        },
        "excess_explained": _json_number(cause.excess_explained),
        "gain_db": _json_number(cause.gain_db),
        "chi2_per_pixel": {
            "before": _json_number(cause.before.chi2_per_pixel),
            "after": _json_number(cause.after.chi2_per_pixel),
        },
        "confounded_with": list(cause.confounded_with),
        "correlations": {name: _json_number(value) for name, value in cause.confounded_with.items()},
        "separate_by": cause.separate_by,
        "sentence": cause.sentence,
    }


def _quality(quality: FitQuality) -> dict[str, float | None]:
    return {"chi2_per_pixel": _json_number(quality.chi2_per_pixel), "psnr_db": _json_number(quality.psnr_db)}


def _excess(excess: ExcessBreakdown) -> dict[str, Any]:
    return {
        f.name: [
            {"name": b.name, "chi2_per_pixel": _json_number(b.chi2_per_pixel), "share": _json_number(b.share)}
            for b in getattr(excess, f.name)
        ]
        for f in dataclasses.fields(excess)
    }


def _json_number(value: float) -> float | None:
    """Six significant digits; None for infinity and NaN, which JSON doesn't have."""
    return float(f"{value:.6g}") if math.isfinite(value) else None
