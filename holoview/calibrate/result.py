"""Writes a calibration's result: the preset, the file of its maps, and the scores as JSON and as a table."""

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
from holoview.model import preset
from holoview.model.effects.learned_maps import LearnedMaps, write_calibration
from holoview.model.system import System
from holoview.util import units
from holoview.util.errors import UserError

_GROUPS = {
    "train": "learned from",
    "captures": "other captures",
    "planes": "another plane",
    "wavelengths": "another wavelength",
}
_GEOMETRY_TOLERANCE = 1e-6  # relative


@dataclass(frozen=True)
class CalibrationResult:
    """The result of a calibration.

    bench: nominal bench with its known effects. learned: its maps. score: how well they predict the captures.
    normalise_amplitudes: set the bench's laser amplitudes to the relative brightness of the wavelengths that the
    camera recorded (`LaserResponse.scale`).
    """

    captures: Captures
    bench: System
    learned: LearnedMaps
    score: PredictionScore
    normalise_amplitudes: bool = False

    def calibrated_system(self, maps: Path) -> System:
        """The bench with the effect `calibrated`, whose maps are in the file `maps`.

        Where the lasers' light isn't proportional to power, their exponent is added to the effect `laser_power`.
        """
        effects: dict[str, Any] = {**self.bench.effect_values, "calibrated": {"file": str(maps.resolve())}}
        response = self.score.response
        if response.is_nonlinear:
            known_exponent = effects.get("laser_power", {}).get("exponent", 0.0)
            effects["laser_power"] = {"exponent": known_exponent + response.common_exponent[0]}
        changes: dict[str, Any] = {"effects": effects}
        if self.normalise_amplitudes:
            scale = np.interp(self.bench.wavelengths_m, response.wavelength_m, response.scale)
            changes["amplitudes"] = [(scale / scale.max()).tolist()]
        return self.bench.edit(changes)

    def as_json(self) -> dict[str, Any]:
        """Digest of the captures, scores, and response of the lasers, for JSON."""
        response = self.score.response
        common, sigma = response.common_exponent
        lasers = [
            {"wavelength_nm": _nm(λ), "scale": float(a), "exponent": _rounded(1 + e), "sigma": _rounded(s)}
            for λ, a, e, s in zip(*dataclasses.astuple(response), strict=True)
        ]
        return {
            "captures": captures_digest(self.captures),
            "scores": [_row_as_json(row) for row in self.score.rows],
            "lasers": lasers,
            "laser_exponent": {"value": _rounded(1 + common), "sigma": _rounded(sigma)},
        }

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Writes the maps beside the preset, then the preset, each atomically. Returns the path of the maps."""
        maps = maps_path(Path(path))
        write_calibration(maps, self.learned, self.as_json())
        preset.save(self.calibrated_system(maps), path)
        return maps


def maps_path(path: Path) -> Path:
    """The file beside a preset into which its maps are written: the same name with the suffix .safetensors."""
    return path.with_suffix(".safetensors")


def starting_bench(captures: Captures, preset_system: System | None, name: str) -> System:
    """The bench that the calibration begins with: the captures' nominal bench, or a preset of the same geometry.

    preset_system: the preset, whose effects count as known; None for the nominal bench.
    name: of the nominal bench.

    Raises UserError, naming the quantity, where the preset's geometry differs from that of the captures, or if the
    preset has learned maps already.
    """
    nominal = captures.nominal_system()
    if preset_system is None:
        return nominal.edit({"name": name, "description": f"Calibrated from {len(captures)} captures."})
    if "calibrated" in preset_system.effect_values:
        raise UserError("preset", "is calibrated already", remedy="start from the preset without [effects.calibrated]")
    geometry = {"gap": "gap_m", "relay1": "relay1", "modulators": "modulators", "relay2": "relay2"}
    for key, attribute in geometry.items():
        stated, expected = getattr(preset_system, attribute), getattr(nominal, attribute)
        if not _nearly_equal(stated, expected):
            raise UserError(
                f"preset: {key}",
                _format_value(stated),
                expected=f"{_format_value(expected)}, as the captures' file tells",
                remedy="change the preset with --set, or leave it out",
            )
    return preset_system


def _nearly_equal(a: Any, b: Any) -> bool:
    """Whether two parts of a System are equal except for rounding; the levels of modulators may differ."""
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(_nearly_equal(x, y) for x, y in zip(a, b, strict=True))
    if dataclasses.is_dataclass(a):
        names = [field.name for field in dataclasses.fields(a) if field.name != "levels"]
        return all(_nearly_equal(getattr(a, name), getattr(b, name)) for name in names)
    if isinstance(a, float) and isinstance(b, float | int):
        return math.isclose(a, b, rel_tol=_GEOMETRY_TOLERANCE)
    return bool(np.all(a == b))


def _format_value(value: Any) -> str:
    return units.format_rounded(value, "mm", 6) if isinstance(value, float) else str(value)


def _row_as_json(row: ScoreRow) -> dict[str, Any]:
    return {
        "group": row.group,
        "wavelength_nm": None if row.wavelength_m is None else _nm(row.wavelength_m),
        "captures": row.captures,
        "before": {"chi2_per_pixel": _rounded(row.before.chi2_per_pixel), "psnr_db": _rounded(row.before.psnr_db)},
        "after": {"chi2_per_pixel": _rounded(row.after.chi2_per_pixel), "psnr_db": _rounded(row.after.psnr_db)},
    }


def format_score(score: PredictionScore) -> list[str]:
    """The scores as lines of a table, and the exponent of the lasers if it was determined."""
    lines = [f"{'':22}{'captures':>9}{'PSNR before':>14}{'after':>9}{'chi2/n before':>15}{'after':>9}"]
    for row in score.rows:
        name = _GROUPS[row.group] if row.wavelength_m is None else f"  {_nm(row.wavelength_m):g} nm"
        lines.append(
            f"{name:22}{row.captures:>9}{row.before.psnr_db:>11.1f} dB{row.after.psnr_db:>6.1f} dB"
            f"{row.before.chi2_per_pixel:>15.3g}{row.after.chi2_per_pixel:>9.3g}"
        )
    exponent, sigma = score.response.common_exponent
    if math.isfinite(sigma):
        remark = "" if score.response.is_nonlinear else ": no departure from proportionality is told"
        lines.append(f"lasers' light rises as power to the {1 + exponent:.3f} ± {max(sigma, 5e-4):.3f}{remark}")
    return lines


def _nm(wavelength_m: float) -> float:
    return round(wavelength_m * 1e9, 3)


def _rounded(value: float) -> float | None:
    """The value with six significant digits; None, which JSON can hold, for one that isn't finite."""
    return float(f"{value:.6g}") if math.isfinite(value) else None
