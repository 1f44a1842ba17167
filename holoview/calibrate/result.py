"""What a calibration leaves behind: a preset and the file of its maps, figures, words."""

from __future__ import annotations

import dataclasses
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from holoview.calibrate.checkpoint import captures_digest
from holoview.calibrate.prediction_score import PredictionScore, ScoreRow
from holoview.captures.dataset import Captures
from holoview.effects.calibration_file import write_calibration
from holoview.effects.learned_maps import LearnedMaps
from holoview.model import preset
from holoview.model.effects.active_effects import EffectValues
from holoview.model.system import System
from holoview.util import units
from holoview.util.errors import UserError

_GROUPS = {
    "train": "learned from",
    "captures": "other captures",
    "planes": "another plane",
    "wavelengths": "another wavelength",
}
_CLOSE = 1e-6  # relative


@dataclass(frozen=True)
class CalibrationResult:
    """bench: as described, with the effects that are known; learned: its maps; score: how well they predict.

    normalised: state the lasers' powers that make wavelengths as bright as the camera saw them.
    """

    captures: Captures
    bench: System
    learned: LearnedMaps
    score: PredictionScore
    normalise_amplitudes: bool = False

    def calibrated_system(self, maps: Path) -> System:
        """The bench with its maps in a file, and its lasers' response where light isn't proportional to power."""
        effects: dict[str, Any] = {**self.bench.effect_values, "calibrated": {"file": str(maps.resolve())}}
        response = self.score.response
        if response.is_nonlinear:
            already = effects.get("laser_power", {}).get("exponent", 0.0)
            effects["laser_power"] = {"exponent": already + response.common_exponent[0]}
        changes: dict[str, Any] = {"effects": effects}
        if self.normalise_amplitudes:
            scale = np.interp(self.bench.wavelengths_m, response.wavelength_m, response.scale)
            changes["amplitudes"] = [(scale / scale.max()).tolist()]
        return self.bench.edit(changes)

    def as_json(self) -> dict[str, Any]:
        """For JSON: what was learned from, how well it predicts, what the lasers emit."""
        response = self.score.response
        common, sigma = response.common_exponent
        lasers = [
            {"wavelength_nm": _nm(λ), "scale": float(a), "exponent": _number(1 + e), "sigma": _number(s)}
            for λ, a, e, s in zip(*dataclasses.astuple(response), strict=True)
        ]
        return {
            "captures": captures_digest(self.captures),
            "scores": [_row(row) for row in self.score.rows],
            "lasers": lasers,
            "laser_exponent": {"value": _number(1 + common), "sigma": _number(sigma)},
        }

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Writes the maps beside the preset, then the preset, each whole or not at all; returns the maps' path."""
        maps = maps_path(Path(path))
        write_calibration(maps, self.learned, self.as_json())
        preset.save(self.calibrated_system(maps), path)
        return maps


def maps_path(path: Path) -> Path:
    """Where the maps of a preset's file are written."""
    return path.with_suffix(".safetensors")


def starting_bench(captures: Captures, preset_system: System | None, name: str) -> System:
    """The bench that the captures are of: as their file tells, or as a preset does that agrees with it.

    Raises UserError that names what a preset states differently, and where it is calibrated already.
    """
    nominal = captures.nominal_system()
    if preset_system is None:
        return nominal.edit({"name": name, "description": f"Calibrated from {len(captures)} captures."})
    if "calibrated" in preset_system.effect_values:
        raise UserError("preset", "is calibrated already", remedy="start from the preset without [effects.calibrated]")
    facts = {"gap": "gap_m", "relay1": "relay1", "modulators": "modulators", "relay2": "relay2"}
    for key, attribute in facts.items():
        mine, theirs = getattr(preset_system, attribute), getattr(nominal, attribute)
        if not _nearly_equal(mine, theirs):
            raise UserError(
                f"preset: {key}",
                _format_value(mine),
                expected=f"{_format_value(theirs)}, as the captures' file tells",
                remedy="change the preset with --set, or leave it out",
            )
    return preset_system


def known_effects(bench: System) -> EffectValues:
    """What the bench is known to do."""
    return bench.effect_values


def _nearly_equal(mine: Any, theirs: Any) -> bool:
    """Whether descriptions are the same but for rounding."""
    if isinstance(mine, tuple) and isinstance(theirs, tuple):
        return len(mine) == len(theirs) and all(_nearly_equal(a, b) for a, b in zip(mine, theirs, strict=True))
    if dataclasses.is_dataclass(mine):
        names = [field.name for field in dataclasses.fields(mine) if field.name != "levels"]
        return all(_nearly_equal(getattr(mine, n), getattr(theirs, n)) for n in names)
    if isinstance(mine, float) and isinstance(theirs, float | int):
        return math.isclose(mine, theirs, rel_tol=_CLOSE)
    return bool(np.all(mine == theirs))


def _format_value(value: Any) -> str:
    return units.format_rounded(value, "mm", 6) if isinstance(value, float) else str(value)


def _row(row: ScoreRow) -> dict[str, Any]:
    return {
        "group": row.group,
        "wavelength_nm": None if row.wavelength_m is None else _nm(row.wavelength_m),
        "captures": row.captures,
        "before": {"chi2_per_pixel": _number(row.before.chi2), "psnr_db": _number(row.before.psnr_db)},
        "after": {"chi2_per_pixel": _number(row.after.chi2), "psnr_db": _number(row.after.psnr_db)},
    }


def format_score(score: PredictionScore) -> list[str]:
    """Lines for people."""
    lines = [f"{'':22}{'captures':>9}{'PSNR before':>14}{'after':>9}{'chi2/n before':>15}{'after':>9}"]
    for row in score.rows:
        name = _GROUPS[row.group] if row.wavelength_m is None else f"  {_nm(row.wavelength_m):g} nm"
        lines.append(
            f"{name:22}{row.captures:>9}{row.before.psnr_db:>11.1f} dB{row.after.psnr_db:>6.1f} dB"
            f"{row.before.chi2:>15.3g}{row.after.chi2:>9.3g}"
        )
    exponent, sigma = score.response.common_exponent
    if math.isfinite(sigma):
        bent = "" if score.response.is_nonlinear else ": no departure from proportionality is told"
        lines.append(f"lasers' light rises as power to the {1 + exponent:.3f} ± {max(sigma, 5e-4):.3f}{bent}")
    return lines


def _nm(wavelength_m: float) -> float:
    return round(wavelength_m * 1e9, 3)


def _number(value: float) -> float | None:
    return float(f"{value:.6g}") if math.isfinite(value) else None
