"""Cases of free-space propagation with their answers, on which any program can be checked.

A case is a field of samples, a wavelength and a distance; its answer is the field at that distance, without the carrier
exp(2πi·z/λ), at some of the samples. Answers don't come from holoview's propagation. They are closed forms, or one of
two integrals written out in float64:

- *plane waves*: u(X) = Σ_f U(f)·exp(2πi(f·X + z·(√(1/λ² − f²) − 1/λ)))·df², with U a sum over the samples; f in steps
  of 1/(8·side), up to 1/(2·pitch);
- *point sources*: Rayleigh and Sommerfeld's first integral as a sum over the samples, where neighbouring samples' waves
  differ by less than half a turn everywhere in the window.

Fields of the first kind vanish at the edges of their window and of their band, so that every correct definition of the
light between the samples gives the same answer.

The error of a result is the relative L2 difference over the answer's samples after one factor of modulus 1, as programs
differ in the carrier. The tolerance is 1e-5, which single precision allows, plus the bound of the answer's own error.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray
from scipy.special import fresnel

from holoview.evidence.conformance import score as conformance_score
from holoview.light.numerics.sampling import positions
from holoview.util.file_writer import write_file

Complexes = NDArray[np.complex128]
Floats = NDArray[np.float64]
Answer = Callable[["Case", Floats, Floats], Complexes]

_SINGLE = 1e-5
_FINER = 8  # periods of the sum over plane waves, in sides of the field
_ANSWERED = 16  # rows and columns of samples that have an answer


@dataclass(frozen=True, eq=False)
class Case:
    """One case.

    name: unique. family: the kind of field. field: (y, x) complex128. distance_m: below 0 for the way back.
    answer_from: how the answer was computed. own_error: relative error of the answer itself, known or bounded.
    """

    name: str
    family: str
    field: Complexes
    pitch_m: float
    wavelength_m: float
    distance_m: float
    answer_from: str
    own_error: float
    _answer: Answer

    @property
    def tolerance(self) -> float:
        """Largest relative L2 error of a correct program."""
        return _SINGLE + self.own_error

    @property
    def indices(self) -> NDArray[np.int64]:
        """The rows, and columns, of the samples that have an answer."""
        return np.linspace(0, len(self.field) - 1, _ANSWERED + 2)[1:-1].round().astype(np.int64)

    @cached_property
    def answer(self) -> Complexes:
        """The field at the samples `indices` × `indices`, complex128."""
        at = positions(len(self.field), self.pitch_m)[self.indices]
        return self._answer(self, at[:, None], at[None, :])


def sum_of_plane_waves(case: Case, y: Floats, x: Floats) -> Complexes:
    """The answer by plane waves, at positions y (rows, 1) and x (1, columns)."""
    n, λ = len(case.field), case.wavelength_m
    f = np.arange(-_FINER * n // 2, _FINER * n // 2) / (_FINER * n * case.pitch_m)
    to_band = np.exp(-2j * math.pi * np.outer(f, positions(n, case.pitch_m)))
    spectrum = to_band @ case.field @ to_band.T
    squared = (λ * f[:, None]) ** 2 + (λ * f[None, :]) ** 2
    root = np.sqrt(np.maximum(1 - squared, 0))
    turns = -case.distance_m / λ * squared / (1 + root)
    spectrum = spectrum * np.exp(2j * math.pi * (turns % 1.0)) * (squared < 1) / (_FINER * n) ** 2
    return np.exp(2j * math.pi * y * f[None, :]) @ spectrum @ np.exp(2j * math.pi * f[:, None] * x)


def sum_of_point_sources(case: Case, y: Floats, x: Floats) -> Complexes:
    """The answer by point sources, at positions y (rows, 1) and x (1, columns).

    Light that goes back is the conjugate of the conjugate field's light that goes on.
    """
    z, λ = abs(case.distance_m), case.wavelength_m
    field = case.field if case.distance_m > 0 else np.conj(case.field)
    at = positions(len(field), case.pitch_m)
    found = np.empty((y.size, x.size), complex)
    for row, column in np.ndindex(*found.shape):
        squared = (y[row, 0] - at[:, None]) ** 2 + (x[0, column] - at[None, :]) ** 2
        r = np.sqrt(squared + z * z)
        turns = squared / (r + z) / λ
        kernel = z / r**2 * (1 / (2 * math.pi * r) - 1j / λ) * np.exp(2j * math.pi * (turns % 1.0))
        found[row, column] = (field * kernel).sum() * case.pitch_m**2
    return found if case.distance_m > 0 else np.conj(found)


# --- families ---------------------------------------------------------------------------------------------------------

_N, _PITCH_M = 128, 8e-6
_WAVELENGTHS_M = (473e-9, 532e-9, 638e-9)


def all_cases() -> list[Case]:
    """Every case, in the order of families; the same fields at every call."""
    families = (
        _gaussian_beams,
        _lenses,
        _tilted_waves,
        _gratings,
        _soft_stops,
        _speckle,
        _slits,
        _random_phase,
        _still,
    )
    return [case for family in families for case in family()]


def _case(family: str, number: int, field: Floats | Complexes, λ: float, z: float, **options: Any) -> Case:
    """A case whose answer is the sum that is exact for its distance, unless the options state another answer."""
    pitch_m = options.get("pitch_m", _PITCH_M)
    side_m = len(field) * pitch_m
    # the waves of points differ by at most half a turn between samples: then no other order is in the window
    far = abs(z) > 0 and side_m / math.hypot(side_m, z) * pitch_m / λ < 0.5
    answer, words = (sum_of_point_sources, "point sources") if far else (sum_of_plane_waves, "plane waves")
    chosen: dict[str, Any] = {"answer_from": words, "own_error": 0.0, "_answer": answer, "pitch_m": pitch_m}
    name = f"{family.replace(' ', '-')}-{number:02d}"
    return Case(name, family, field.astype(np.complex128), wavelength_m=λ, distance_m=z, **(chosen | options))


def _axes(n: int = _N, pitch_m: float = _PITCH_M) -> tuple[Floats, Floats]:
    at = positions(n, pitch_m)
    return at[:, None], at[None, :]


def _gaussian(waist_m: float) -> Floats:
    y, x = _axes()
    return np.exp(-(y**2 + x**2) / waist_m**2)


def _beam(waist_m: float, focal_m: float = math.inf) -> Answer:
    """The closed form of a Gaussian beam with its waist in a lens: 1/q' = 1/q − 1/f (Kogelnik & Li, 1966), paraxial."""

    def answer(case: Case, y: Floats, x: Floats) -> Complexes:
        q = 1 / (1j * case.wavelength_m / (math.pi * waist_m**2) - 1 / focal_m)
        radius = y**2 + x**2
        factor = 1j * math.pi * radius / (case.wavelength_m * (q + case.distance_m))
        return np.exp(factor) * q / (q + case.distance_m)

    return answer


def _paraxial_error(λ: float, sine: float, z: float) -> float:
    """Phase beyond the paraxial one of light of a direction sine: 2π·z/λ·s⁴/8."""
    return 2 * math.pi * abs(z) / λ * sine**4 / 8


def _gaussian_beams() -> Iterator[Case]:
    """Waists of 60 to 120 µm, whose edges are at 1e-8 or less; their light has sines up to 3·λ/(π·w)."""
    setups = [(w, z) for w in (60e-6, 90e-6, 120e-6) for z in (1e-3, 5e-3, 0.02, 0.1, 0.5, 2.0)]
    for number, (waist_m, z) in enumerate(setups, start=1):
        λ = _WAVELENGTHS_M[number % 3]
        error = _paraxial_error(λ, 2 * λ / (math.pi * waist_m), z)
        words = {"answer_from": "closed form", "_answer": _beam(waist_m), "own_error": error}
        yield _case("gaussian beam", number, _gaussian(waist_m), λ, z, **words)


def _lenses() -> Iterator[Case]:
    """Gaussian beams through a thin lens, in its focus and before and behind it."""
    setups = [(f, part) for f in (0.1, 0.2, 0.5, 1.0) for part in (0.5, 1.0, 1.5)]
    y, x = _axes()
    for number, (focal_m, part) in enumerate(setups, start=1):
        λ, waist_m = _WAVELENGTHS_M[number % 3], 110e-6
        field = _gaussian(waist_m) * np.exp(-1j * math.pi * (y**2 + x**2) / (λ * focal_m))
        sine = 2 * λ / (math.pi * waist_m) + 2 * waist_m / focal_m
        words = {"answer_from": "closed form", "_answer": _beam(waist_m, focal_m)}
        z = part * focal_m
        yield _case("lens", number, field, λ, z, own_error=_paraxial_error(λ, sine, z), **words)


def _tilted_waves() -> Iterator[Case]:
    """Tilted plane waves with a Gaussian profile, up to 0.8 of the steepest that the samples hold."""
    y, x = _axes()
    setups = [(t, z) for t in ((0.3, 0.0), (-0.4, 0.6), (0.0, 0.8)) for z in (1e-3, 3e-3, -3e-3, 8e-3, -8e-3)]
    for number, ((down, right), z) in enumerate(setups, start=1):
        phase = math.pi / _PITCH_M * (down * y + right * x)
        yield _case("tilted wave", number, _gaussian(100e-6) * np.exp(1j * phase), _WAVELENGTHS_M[number % 3], z)


def _gratings() -> Iterator[Case]:
    """Amplitude and phase gratings, also at Talbot's distance 2·Λ²/λ and at a half of it."""
    y, x = _axes()
    setups = [(period, part) for period in (40e-6, 64e-6) for part in (0.5, 1.0, -1.0, 2.0, 0.1, 20.0)]
    for number, (period_m, part) in enumerate(setups, start=1):
        λ = _WAVELENGTHS_M[number % 3]
        wave = np.cos(2 * math.pi * (x if number % 2 else y) / period_m)
        grating = (1 + wave) / 2 if number % 4 < 2 else np.exp(0.8j * wave)
        yield _case("grating", number, _gaussian(100e-6) * grating, λ, part * 2 * period_m**2 / λ)


def _soft_stops() -> Iterator[Case]:
    """Round and square stops and rings whose edges fall as an error function, so that samples hold them."""
    y, x = _axes()
    shapes = {
        "round": np.hypot(y, x) - 200e-6,
        "square": np.maximum(np.abs(y), np.abs(x)) - 180e-6,
        "ring": np.abs(np.hypot(y, x) - 180e-6) - 60e-6,
    }
    setups = [(shape, z) for shape in shapes for z in (2e-3, 0.01, -0.01, 0.2, 1.0)]
    for number, (shape, z) in enumerate(setups, start=1):
        field = (1 - np.tanh(shapes[shape] / 20e-6)) / 2
        blurred = _smoothed(field, 16e-6)
        yield _case("stop", number, blurred, _WAVELENGTHS_M[number % 3], z)


def _smoothed(field: Floats | Complexes, width_m: float) -> Complexes:
    """A field times exp(−(π·f·width)²) in its spectrum: nothing is left at the edge of the band from 16 µm on."""
    f = np.fft.fftfreq(len(field), _PITCH_M)
    gain = np.exp(-((math.pi * width_m * f) ** 2))
    return np.fft.ifft2(np.fft.fft2(field) * gain[:, None] * gain[None, :])


def _speckle() -> Iterator[Case]:
    """Random fields with a Gaussian spectrum and a Gaussian profile."""
    for number, z in enumerate((5e-4, 2e-3, -2e-3, 5e-3, 0.01, -0.01, 0.1, -0.1, 0.3, 1.0, 2.0, -2.0), start=1):
        rng = np.random.default_rng(number)
        random = rng.normal(size=(_N, _N)) + 1j * rng.normal(size=(_N, _N))
        yield _case("speckle", number, _smoothed(random, 18e-6) * _gaussian(110e-6), _WAVELENGTHS_M[number % 3], z)


def _slits() -> Iterator[Case]:
    """Square openings with hard edges between samples, by Fresnel's integrals.

    Samples are points and the opening is continuous: light of local frequency s = D/(λz), with D the largest sideways
    distance, is weaker by sinc(pitch·s), at most by (π·pitch·s)²/6 along each axis.
    """
    n, pitch_m = 256, 2e-6
    setups = [(samples, z) for samples in (60, 120) for z in (0.06, 0.1, 0.2, 0.5, 2.0)]
    for number, (samples, z) in enumerate(setups, start=1):
        λ, low = _WAVELENGTHS_M[number % 3], (n - samples) // 2
        field = np.zeros((n, n))
        field[low : low + samples, low : low + samples] = 1
        farthest_m = (n + samples) / 2 * pitch_m
        error = 2 * (math.pi * pitch_m * farthest_m / (λ * z)) ** 2 / 6
        error += _paraxial_error(λ, math.sqrt(2) * farthest_m / z, z)
        words = {"answer_from": "closed form", "_answer": _opening(samples * pitch_m), "own_error": error}
        yield _case("slit", number, field, λ, z, pitch_m=pitch_m, **words)


def _opening(width_m: float) -> Answer:
    def answer(case: Case, y: Floats, x: Floats) -> Complexes:
        scale = math.sqrt(2 / (case.wavelength_m * case.distance_m))

        def along(at: Floats) -> Complexes:
            high, low = fresnel(scale * (width_m / 2 - at)), fresnel(scale * (-width_m / 2 - at))
            return ((high[1] - low[1]) + 1j * (high[0] - low[0])) / math.sqrt(2)

        return -1j * along(y) * along(x)

    return answer


def _random_phase() -> Iterator[Case]:
    """Random phases up to hard edges, as a phase modulator shows them, so far away that samples act as points."""
    for number, z in enumerate((0.1, 0.2, 0.4, -0.4, 1.0, 2.0), start=1):
        field = np.exp(2j * math.pi * np.random.default_rng(100 + number).random((64, 64)))
        yield _case("random phase", number, field, _WAVELENGTHS_M[number % 3], z)


def _still() -> Iterator[Case]:
    """No distance, and a hundredth of a wavelength: the field itself."""
    for number, z in enumerate((0.0, 5e-9), start=1):
        yield _case("no distance", number, _smoothed(_gaussian(100e-6), 16e-6), 532e-9, z)


# --- files ------------------------------------------------------------------------------------------------------------


def write_cases(folder: Path, cases: list[Case], progress: Callable[[int, int, str], None]) -> None:
    """Writes every case as two arrays, a list of all cases, and the program that scores results.

    NAME.field.npy, NAME.answer.npy (complex128), cases.toml, score.py (which needs numpy alone).
    """
    table: dict[str, Any] = {}
    for number, case in enumerate(cases, start=1):
        for kind, values in (("field", case.field), ("answer", case.answer)):
            buffer = io.BytesIO()
            np.save(buffer, values, allow_pickle=False)
            write_file(folder / f"{case.name}.{kind}.npy", buffer.getvalue())
        table[case.name] = describe_case(case)
        progress(number, len(cases), case.name)
    write_file(folder / "cases.toml", tomli_w.dumps(table).encode())
    write_file(folder / "score.py", Path(conformance_score.__file__).read_bytes())


def describe_case(case: Case) -> dict[str, Any]:
    """The properties of a case as TOML has them."""
    return {
        "family": case.family,
        "wavelength_m": case.wavelength_m,
        "pitch_m": case.pitch_m,
        "distance_m": case.distance_m,
        "answer_from": case.answer_from,
        "tolerance": case.tolerance,
        "rows_and_columns": case.indices.tolist(),
    }
