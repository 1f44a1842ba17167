"""Fits a monotone phase look-up table to a diffraction-efficiency sweep, with the stroke's 95 % interval.

read_sweep                    the sweep from a CSV file
fit_lut                       the table
save_lut, with_lut            the table as TOML, and in a bench
format_lut, plot_lut          the table for people

A binary grating of equal bars is shown. One half of the bars stays at the lowest grey level, the other half steps
through all grey levels; the power in the first diffraction order is measured at each step. A binary phase grating with
equal bars of phases 0 and φ sends the share (4/π²)·sin²(φ/2) of the light into each first order (Goodman, Introduction
to Fourier Optics, 3rd ed., sec. 4.4.3). With x the grey level scaled to 0 … 1,

    P(x) = b + a·(1 + c·x)·sin²(φ(x)/2),   φ(0) = 0,   φ monotone

a: full power of the order. b: stray light. c: change of the order's full power along the sweep, which fringing between
bars causes; it is fitted only if Schwarz's criterion prefers the model with it. φ is a monotone cubic interpolant
through equidistant knots (Fritsch & Carlson, SIAM J. Numer. Anal. 17, 238 (1980)), fitted by bounded least squares.

sin² doesn't distinguish φ from 2π − φ, so the least-squares problem has many local minima. It is started from the
monotone path of phases with the lowest cost among all, which dynamic programming finds exactly.

`plan_exposures` chooses laser power and exposure time for each wavelength so that captures fill the camera's range
unclipped.

The camera is linear: the 99.9th percentile of an image above the black level grows in proportion to power · exposure.
From first captures of any brightness,

    rate = max over captures of (99.9th percentile − black) / (power · exposure),

and power · exposure = headroom · (saturation − black) / rate. Of the pairs with this product the one with the highest
power is chosen, because short exposures suffer least from drift and vibration.
"""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.optimize import least_squares

from holoview.captures.dataset import Captures
from holoview.figures import label, png_figure
from holoview.model.system import System
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.file_writer import write_file
from holoview.util.files import read_text

Floats = NDArray[np.float64]

_EXPECTED = "two columns, grey level and power, separated by comma, semicolon or space"
_MIN_ROWS = 12
_MIN_CONTRAST = 0.2  # (highest − lowest power) / highest power


@dataclass(frozen=True)
class EfficiencySweep:
    """The first-order power of a grating whose bars are at two grey levels.

    levels: (n,), grey level of every other bar, strictly ascending; the bars between them are at levels[0].
    power: (n,), power in the first order, in any unit.
    """

    levels: Floats
    power: Floats

    @property
    def relative_levels(self) -> Floats:
        """The levels scaled linearly to 0 … 1, (n,)."""
        return (self.levels - self.levels[0]) / (self.levels[-1] - self.levels[0])


def read_sweep(path: str | os.PathLike[str]) -> EfficiencySweep:
    """Reads the columns grey level and power, separated by comma, semicolon, tab or space.

    The first line may hold headings, lines that begin with # are comments, and the rows may have any order.

    Raises UserError when the file is missing or a line isn't two finite numbers (it names the line), and when there are
    fewer than 12 levels, a level occurs twice, or the power hardly changes.
    """
    file = Path(path)
    lines = read_text(file, f"a CSV file of {_EXPECTED}").splitlines()
    rows = [(number, line.strip()) for number, line in enumerate(lines, 1) if line.strip() and line.strip()[0] != "#"]
    if rows and not any(_is_number(cell) for cell in _split_cells(rows[0][1])):
        rows = rows[1:]
    try:
        table = np.array([_parse_row(number, line) for number, line in rows], dtype=np.float64).reshape(-1, 2)
        return _validated_sweep(table)
    except UserError as error:
        raise error.inside(f"{file}: ") from error


def _split_cells(line: str) -> list[str]:
    return re.split(r"\s*[,;\t]\s*|\s+", line)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _parse_row(number: int, line: str) -> tuple[float, float]:
    cells = _split_cells(line)
    if len(cells) != 2:
        raise UserError(f"line {number}", f'"{line[:40]}", {len(cells)} columns', expected=_EXPECTED)
    for cell in cells:
        if not _is_number(cell) or not math.isfinite(float(cell)):
            raise UserError(f"line {number}", f'"{cell[:40]}" isn\'t a finite number', expected=_EXPECTED)
    return float(cells[0]), float(cells[1])


def _validated_sweep(table: Floats) -> EfficiencySweep:
    """The sweep of a table (n, 2) of levels and powers, sorted by level. Raises UserError if it can't be one."""
    if len(table) < _MIN_ROWS:
        raise UserError("sweep", f"{len(table)} rows", expected=f"at least {_MIN_ROWS} grey levels")
    table = table[np.argsort(table[:, 0], kind="stable")]
    levels, power = table[:, 0], table[:, 1]
    repeated = np.flatnonzero(np.diff(levels) == 0)
    if len(repeated):
        raise UserError("sweep", f"grey level {levels[repeated[0]]:g} occurs twice", expected="each grey level once")
    if levels[0] < 0:
        raise UserError("sweep", f"grey level {levels[0]:g}", expected="levels from 0")
    if power.max() <= 0 or power.max() - power.min() < _MIN_CONTRAST * power.max():
        found = f"power from {power.min():g} to {power.max():g}"
        remedy = "the columns are grey level, then power; the first level must leave the grating flat"
        raise UserError("sweep", found, expected="power that rises from almost none", remedy=remedy)
    return EfficiencySweep(levels, power)


# --- the fit ---


KNOTS = 16
_OTHER_KNOTS = (12, 24)  # the spread of the stroke over the numbers of knots is part of its interval
_MAX_STROKE_TURNS = 4.0
_PHASE_STATES = 241  # of the dynamic programme
_JUMP_PENALTY = 0.05  # cost of a phase step of 1 rad, as a share of the full power
_TOLERANCE = 1e-6  # relative; noise of 1 % changes a fit by 1e-3
_MAX_EVALUATIONS = 60  # of the least squares; only a contrast slope that the data don't determine needs more
_MIN_STEP = 1e-6  # rad between knots, because a modulator's levels must be strictly ascending


@dataclass(frozen=True)
class LutFit:
    """The fitted model at the n levels of the sweep.

    phase: (n,), rad, from 0.
    power: (n,), in the sweep's unit.
    relative_rms: root mean square of the residual, divided by the highest power of the sweep.
    contrast_slope: c, or 0 where it wasn't fitted.
    stroke_sigma: standard deviation of the stroke from the residuals, rad.
    """

    phase: Floats
    power: Floats
    relative_rms: float
    contrast_slope: float
    stroke_sigma: float

    @property
    def stroke(self) -> float:
        """Phase at the last level, rad."""
        return float(self.phase[-1])


@dataclass(frozen=True)
class Lut:
    """A fitted look-up table, and the residuals of simpler models to compare it with.

    stroke_interval: 95 % confidence interval of the stroke, rad.
    rms_linear_2pi, rms_linear_free: relative r.m.s. residual of a phase that is linear in the grey level, with a stroke
    of 2π and with the best stroke.
    """

    sweep: EfficiencySweep
    fit: LutFit
    stroke_interval: tuple[float, float]
    rms_linear_2pi: float
    rms_linear_free: float

    @property
    def stroke_fractions(self) -> Floats:
        """The phase at each level divided by the stroke, (n,), from 0 to 1: a modulator's `levels`."""
        return self.fit.phase / self.fit.stroke

    def stroke_m(self, wavelength_m: float) -> float:
        """Stroke as an optical path difference, for a sweep that was measured at this wavelength."""
        return self.fit.stroke * wavelength_m / (2 * math.pi)


def fit_lut(sweep: EfficiencySweep) -> Lut:
    """Fits the look-up table. The interval allows for noise and for the choice of the number of knots.

    Raises UserError if the power has no maximum inside the sweep: then the stroke is below π, and a and φ can't be
    determined separately.
    """
    _check_has_maximum(sweep)
    initial_phase = _unwrap_phase(sweep)

    def fit(knots: int, *, with_slope: bool) -> LutFit:
        return _fit_monotone_phase(sweep, initial_phase, knots, fit_contrast_slope=with_slope)

    without_slope, with_slope = fit(KNOTS, with_slope=False), fit(KNOTS, with_slope=True)
    needs_slope = _bic(with_slope, KNOTS + 2, sweep) < _bic(without_slope, KNOTS + 1, sweep)
    best = with_slope if needs_slope else without_slope
    other_strokes = [fit(knots, with_slope=needs_slope).stroke for knots in _OTHER_KNOTS]
    spread = float(np.std([best.stroke, *other_strokes], ddof=1))
    half_width = 1.96 * math.hypot(best.stroke_sigma, spread)
    x = sweep.relative_levels
    return Lut(
        sweep,
        best,
        (best.stroke - half_width, best.stroke + half_width),
        rms_linear_2pi=_relative_rms(sweep, 2 * math.pi * x),
        rms_linear_free=min(
            _relative_rms(sweep, turns * 2 * math.pi * x) for turns in np.arange(0.2, _MAX_STROKE_TURNS, 0.002)
        ),
    )


def _check_has_maximum(sweep: EfficiencySweep) -> None:
    """Raises UserError if the power rises to the end of the sweep, within its noise."""
    width = max(1, len(sweep.power) // 32)
    smooth = np.convolve(sweep.power, np.ones(width) / width, mode="valid")
    noise = float(np.std(np.diff(sweep.power, n=2))) / math.sqrt(6)
    if smooth.max() - smooth[-1] < max(0.02 * smooth.max(), 3 * noise) and int(smooth.argmax()) > 0.8 * len(smooth):
        raise UserError(
            "sweep",
            "the power rises to its end, without a maximum",
            expected="a phase of more than π at the last level",
            remedy="drive further or measure at a shorter wavelength: below π the full power isn't known",
        )


def _unwrap_phase(sweep: EfficiencySweep) -> Floats:
    """Phases (n,) of the best monotone path, for several full powers near the highest reading."""
    scales = sweep.power.max() * np.linspace(0.95, 1.1, 4) - sweep.power.min()
    return min((_monotone_path(sweep, float(scale)) for scale in scales), key=lambda result: result[0])[1]


def _monotone_path(sweep: EfficiencySweep, scale: float) -> tuple[float, Floats]:
    """Cost and phases (n,) of the monotone path with the lowest cost, by the Viterbi algorithm.

    The cost is the squared residual, plus a penalty on squared phase steps that prefers an even rise to jumps.
    """
    phase = np.linspace(0.0, _MAX_STROKE_TURNS * 2 * math.pi, _PHASE_STATES)
    expected = scale * np.sin(phase / 2) ** 2
    step = np.subtract.outer(phase, phase)
    step_cost = np.where(step < 0, np.inf, (_JUMP_PENALTY * scale * step) ** 2)
    cost = np.where(phase == 0, 0.0, np.inf)
    predecessors = []
    for reading in sweep.power[1:] - sweep.power.min():
        through = cost[None, :] + step_cost
        predecessors.append(through.argmin(axis=1))
        cost = through.min(axis=1) + (reading - expected) ** 2
    states = [int(cost.argmin())]
    for predecessor in reversed(predecessors):
        states.append(int(predecessor[states[-1]]))
    return float(cost.min()), phase[states[::-1]]


def _fit_monotone_phase(
    sweep: EfficiencySweep, initial_phase: Floats, knots: int, *, fit_contrast_slope: bool
) -> LutFit:
    """Fits the phase steps between knots, a, b and, if asked, c by bounded least squares from an initial phase (n,).

    The vector of unknowns u holds the knots − 1 steps, then a and b relative to the highest power, then c.
    """
    x, highest = sweep.relative_levels, float(sweep.power.max())
    knot_x = np.linspace(0.0, 1.0, knots)
    steps = np.clip(np.diff(np.interp(knot_x, x, initial_phase)), 10 * _MIN_STEP, None)

    def phase_of(u: Floats) -> Floats:
        return PchipInterpolator(knot_x, np.concatenate([[0.0], np.cumsum(u[: knots - 1])]))(x)

    def power_of(u: Floats) -> Floats:
        slope = u[knots + 1] if fit_contrast_slope else 0.0
        return highest * (u[knots] + u[knots - 1] * (1 + slope * x) * np.sin(phase_of(u) / 2) ** 2)

    u0 = np.concatenate([steps, [0.95, float(sweep.power.min()) / highest], [0.0] * fit_contrast_slope])
    low = np.concatenate([np.full(knots - 1, _MIN_STEP), [0.05, -0.5], [-0.8] * fit_contrast_slope])
    high = np.concatenate([np.full(knots - 1, np.inf), [4.0, 0.5], [4.0] * fit_contrast_slope])
    solution = least_squares(
        lambda u: (power_of(u) - sweep.power) / highest,
        u0,
        bounds=(low, high),
        x_scale="jac",
        ftol=_TOLERANCE,
        xtol=_TOLERANCE,
        max_nfev=_MAX_EVALUATIONS,
    )
    phase = np.maximum.accumulate(phase_of(solution.x) + _MIN_STEP * 1e-3 * np.arange(len(x)))
    phase[0] = 0.0
    off_bound = solution.x > low * (1 + 1e-6)
    sigma = _stroke_sigma(solution.jac, solution.fun, off_bound, knots)
    slope = float(solution.x[knots + 1]) if fit_contrast_slope else 0.0
    return LutFit(phase, power_of(solution.x), float(np.sqrt(np.mean(solution.fun**2))), slope, sigma)


def _stroke_sigma(jacobian: Floats, residual: Floats, free: NDArray[np.bool_], knots: int) -> float:
    """Standard deviation (rad) of the sum of the phase steps.

    jacobian: (n, unknowns); residual: (n,); free: mask of the unknowns that aren't at their bounds. Residuals that are
    correlated with their neighbours by ρ count as (1 − ρ)/(1 + ρ) times as many independent ones.
    """
    correlation = float(np.clip(np.corrcoef(residual[:-1], residual[1:])[0, 1], 0.0, 0.95))
    variance = float(residual @ residual) / max(1, len(residual) - int(free.sum()))
    covariance = np.linalg.pinv(jacobian[:, free].T @ jacobian[:, free])
    is_step = (np.arange(len(free)) < knots - 1)[free].astype(np.float64)
    return math.sqrt(float(is_step @ covariance @ is_step) * variance * (1 + correlation) / (1 - correlation))


def _bic(fit: LutFit, unknowns: int, sweep: EfficiencySweep) -> float:
    """Schwarz's Bayesian information criterion (Ann. Statist. 6, 461 (1978)); an r.m.s. below 1e-6 counts as 1e-6."""
    count = len(sweep.power)
    return 2 * count * math.log(max(fit.relative_rms, 1e-6)) + unknowns * math.log(count)


def _relative_rms(sweep: EfficiencySweep, phase: Floats) -> float:
    """R.m.s. residual over the highest power for a phase (n,), with the best full power and no stray light."""
    expected = np.sin(phase / 2) ** 2
    scale = float(expected @ sweep.power) / float(expected @ expected)
    return float(np.sqrt(np.mean((sweep.power - scale * expected) ** 2)) / sweep.power.max())


# --- the table in files, in a bench and for people ---


FORMAT, VERSION = "holoview-lut", 1


def lut_table(lut: Lut, source: str, wavelength_m: float | None = None) -> dict[str, Any]:
    """The look-up table as keys and values for TOML or JSON.

    source: name of the file with the sweep.
    wavelength_m: of the sweep; with it the table states strokes as lengths.

    `levels` and `stroke` have the form of a preset's `[[modulators]]`.
    """
    low, high = lut.stroke_interval
    table: dict[str, Any] = {"format": FORMAT, "version": VERSION, "source": source}
    table["model"] = "power = b + a (1 + c x) sin(phase(x) / 2)^2, phase monotone; binary grating with equal bars"
    table["stroke_pi"] = lut.fit.stroke / math.pi
    table["stroke_pi_interval"] = [low / math.pi, high / math.pi]
    if wavelength_m is not None:
        per_radian = wavelength_m / (2 * math.pi)
        table["wavelength"] = units.format_exact(wavelength_m, "nm")
        table["stroke"] = units.format_rounded(lut.stroke_m(wavelength_m), "nm", 6)
        table["stroke_interval"] = [units.format_rounded(bound * per_radian, "nm", 6) for bound in (low, high)]
    table["contrast_slope"] = lut.fit.contrast_slope
    table["residual"] = {
        "monotone": lut.fit.relative_rms,
        "linear_free_stroke": lut.rms_linear_free,
        "linear_2pi": lut.rms_linear_2pi,
    }
    table["sent"] = lut.sweep.levels.tolist()
    table["levels"] = lut.stroke_fractions.tolist()
    return table


def save_lut(path: str | os.PathLike[str], lut: Lut, source: str, wavelength_m: float | None = None) -> None:
    """Writes `lut_table` as TOML. An existing file is replaced only by a complete one. Raises UserError."""
    write_file(path, tomli_w.dumps(lut_table(lut, source, wavelength_m)))


def with_lut(system: System, lut: Lut, wavelength_m: float | None) -> System:
    """A bench whose modulators have this look-up table and stroke. Raises UserError if `wavelength_m` is None."""
    if wavelength_m is None:
        expected = "the wavelength of the sweep, e.g. --wavelength 820nm"
        raise UserError("--wavelength", "is missing", expected=expected, remedy="a stroke is a length")
    levels = lut.stroke_fractions.copy()
    levels[0], levels[-1] = 0.0, 1.0
    return system.edit({"stroke": lut.stroke_m(wavelength_m), "levels": levels})


def format_lut(lut: Lut, wavelength_m: float | None) -> list[str]:
    """Stroke, linearity and residuals as lines of text."""
    low, high = (bound / math.pi for bound in lut.stroke_interval)
    stroke = f"stroke {lut.fit.stroke / math.pi:.3g} π (95 %: {low:.3g} to {high:.3g} π)"
    if wavelength_m is not None:
        stroke += (
            f" = {units.format_rounded(lut.stroke_m(wavelength_m), 'nm')} at {units.format_rounded(wavelength_m, 'nm')}"
        )
    half = float(np.interp(0.5, lut.sweep.relative_levels, lut.stroke_fractions))
    lines = [stroke, f"half drive gives {half:.2f} of it, a linear response would give 0.5"]
    lines.append(
        f"residual {lut.fit.relative_rms:.3g} of the highest power; "
        f"a straight line leaves {lut.rms_linear_free:.3g} with a free stroke and {lut.rms_linear_2pi:.3g} with 2 π"
    )
    if lut.fit.contrast_slope:
        lines.append(
            f"the order's full power changes by {100 * lut.fit.contrast_slope:+.0f} % along the sweep (fitted)"
        )
    return lines


def plot_lut(path: str | os.PathLike[str], lut: Lut, title: str) -> None:
    """Writes a PNG with two plots against grey level: measured and fitted power, and the fitted phase."""
    x = lut.sweep.levels
    with png_figure(path, (10.0, 4.2)) as figure:
        power, phase = figure.subplots(1, 2)
        power.plot(x, lut.sweep.power, ".", markersize=4, label="measured")
        power.plot(x, lut.fit.power, label="monotone LUT")
        power.set(xlabel="grey level", ylabel="first-order power", title=label(title))
        power.legend()
        phase.plot(x, lut.fit.phase / math.pi, label="fitted")
        phase.plot(x, lut.sweep.relative_levels * lut.fit.stroke / math.pi, "--", label="linear")
        phase.axhspan(*(bound / math.pi for bound in lut.stroke_interval), alpha=0.2, label="stroke, 95 %")
        phase.set(xlabel="grey level", ylabel="phase / π", title="phase of each level")
        phase.legend()


# --- laser power and exposure time ------------------------------------------------------------------------------------


HEADROOM = 0.9
"""Share of the range from black to saturation that the 99.9th percentile is to reach."""

_CLIPPED_SHARE = 1e-3  # share of the pixels that may clip
_BACK_OFF = 4.0  # a clipped image only bounds the rate from below: assume that it is so many times higher
_DIM = 0.02  # share of the range; the rate of a dimmer image is too uncertain


@dataclass(frozen=True)
class ExposureLimits:
    """The lowest and highest settings of the equipment. The field names appear in error messages.

    powers: laser power, in the unit of the captures.
    exposures_s: exposure times.
    """

    powers: tuple[float, float] = (0.05, 1.0)
    exposures_s: tuple[float, float] = (1e-4, 1.0)

    def __post_init__(self) -> None:
        for name in ("powers", "exposures_s"):
            low, high = getattr(self, name)
            if not 0 < low <= high < np.inf:
                raise UserError(name.removesuffix("_s"), f"{low:g} to {high:g}", expected="positive, rising numbers")


@dataclass(frozen=True)
class ExposureSetting:
    """The planned setting for a wavelength. The field names are keys of the JSON that `holoview captures plan` writes.

    reached: expected 99.9th percentile of an image, in counts above black.
    note: a warning, or "".
    """

    wavelength_m: float
    power: float
    exposure_s: float
    reached: float
    note: str = ""


_DEFAULT_LIMITS = ExposureLimits()


def plan_exposures(
    captures: Captures,
    dark: NDArray[np.unsignedinteger] | None = None,
    limits: ExposureLimits = _DEFAULT_LIMITS,
    headroom: float = HEADROOM,
) -> list[ExposureSetting]:
    """One setting for each wavelength in ascending order, from at least one capture of each.

    dark: image (y, x) in counts with the lasers off; its mean replaces the camera's nominal black level.
    limits: powers and exposures that can be set.
    headroom: share of the range from black to saturation to use, 0.05 … 1.

    Raises UserError when `dark` doesn't have the camera's shape or isn't darker than the captures.
    """
    if not 0.05 <= headroom < 1:
        raise UserError("headroom", f"{headroom:g}", expected="from 0.05 to below 1")
    black = _black_level(captures, dark)
    return [_plan_wavelength(captures, λ, black, limits, headroom) for λ in captures.wavelengths_m]


def _black_level(captures: Captures, dark: NDArray[np.unsignedinteger] | None) -> float:
    if dark is None:
        return captures.camera.black_level
    if dark.shape != captures.shape:
        raise UserError("dark picture", f"{dark.shape} pixels", expected=f"{captures.shape}, as the captures")
    black = float(dark.mean(dtype=np.float64))
    if black >= float(captures.images.mean(axis=(1, 2)).min()):
        raise UserError(
            "dark picture", f"{black:g} counts", expected="a picture with the lasers off", remedy="retake it"
        )
    return black


def _plan_wavelength(
    captures: Captures, wavelength_m: float, black: float, limits: ExposureLimits, headroom: float
) -> ExposureSetting:
    full_range = captures.camera.saturation - black
    indices = np.flatnonzero(captures.wavelength_m == wavelength_m)
    images = captures.images[indices].reshape(len(indices), -1)
    brightest = np.quantile(images, 1 - _CLIPPED_SHARE, axis=1) - black
    clipped = brightest >= full_range
    brightest = np.where(clipped, _BACK_OFF * brightest, np.maximum(brightest, 1e-3))
    rates = brightest / (captures.power[indices] * captures.exposure_s[indices])
    note = ""
    if clipped.any():
        note = "a first capture was clipped: take this one and plan again"
    elif brightest.max() < _DIM * full_range:
        note = "the first captures were dim: take this one and plan again"
    return _choose_power_and_exposure(wavelength_m, float(rates.max()), headroom * full_range, limits, note)


def _choose_power_and_exposure(
    wavelength_m: float, rate: float, target: float, limits: ExposureLimits, note: str
) -> ExposureSetting:
    """The highest power, with its exposure, at which rate · power · exposure is the target (counts above black)."""
    (weakest, strongest), (shortest, longest) = limits.powers, limits.exposures_s
    product = target / rate
    power = float(np.clip(product / shortest, weakest, strongest))
    exposure = float(np.clip(product / power, shortest, longest))
    power, exposure = _round_down(power), _round_down(exposure)
    reached = rate * power * exposure
    if reached > 1.001 * target:
        note = "too bright at the lowest power and shortest exposure: dim the laser"
    elif reached < 0.5 * target and not note:
        note = "dim at the highest power and longest exposure"
    return ExposureSetting(float(wavelength_m), power, exposure, reached, note)


def _round_down(value: float) -> float:
    """The value rounded down to three significant digits."""
    scale = 10.0 ** (np.floor(np.log10(value)) - 2)
    return float(f"{np.floor(value / scale * (1 + 1e-12)) * scale:.3g}")
