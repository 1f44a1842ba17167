"""A gross aberration that looks like inverted patterns: the captures are searched as recorded, too."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from holoview.bench.captures.prepared_captures import FitQuality
from holoview.bench.captures.records import RecordFindings
from holoview.bench.captures.records.corrections import CameraOrientation, Correction, SlmInversion
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose.correct.wrong_records import CheckedRecords
from holoview.bench.diagnose.judge import Verdict
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.diagnose.report.assemble import better_explained
from holoview.light.model.bench_parts import Modulator, Relay
from holoview.light.model.effects.registry import listed_effects
from holoview.light.model.system import System


@dataclass(frozen=True)
class _Diagnosis:
    """What `better_explained` reads of a diagnosis."""

    after: FitQuality
    notes: tuple[str, ...] = ()


def _checked(*corrections: Correction) -> CheckedRecords:
    return CheckedRecords(None, (), RecordFindings(corrections), ())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("corrected", "as_recorded", "wins"), [(300.0, 1.0, True), (3.0, 2.1, False), (3.0, 1.9, True), (1.5, 400.0, False)]
)
def test_what_explains_clearly_better_counts(corrected: float, as_recorded: float, wins: bool) -> None:
    one, other = (_Diagnosis(FitQuality(chi2, 30.0)) for chi2 in (corrected, as_recorded))
    found: Any = better_explained(_checked(SlmInversion(0)), one, other)  # type: ignore[arg-type]
    assert (found.after is other.after) is wins
    assert ("slm1_inverted" in " ".join(found.notes)) is wins


def test_only_inverted_and_exchanged_patterns_are_doubted() -> None:
    assert _checked(SlmInversion(0)).are_doubtful and _checked(SlmInversion(2, "coarse")).are_doubtful
    assert not _checked(CameraOrientation("flip_x")).are_doubtful and not _checked().are_doubtful


def test_as_recorded_nothing_is_corrected() -> None:
    captures: Any = [1, 2, 3]
    plain = _checked(SlmInversion(0)).as_recorded(captures)
    assert plain.captures is captures and plain.kept == (0, 1, 2) and not plain.findings.corrections
    assert not plain.findings.rivals and not plain.gains


@pytest.mark.slow
def test_a_gross_aberration_is_named_though_patterns_look_inverted() -> None:
    """Astigmatism and spherical aberration of relay 1, 0.45 µm r.m.s. in all; minutes."""
    modulator = Modulator(pitch_m=8e-6, shape=(96, 128), stroke_m=825e-9, levels=np.linspace(0.0, 1.0, 16))
    system = System(
        wavelengths_m=[450e-9, 520e-9, 580e-9, 638e-9],
        amplitudes=np.ones((1, 4)),
        modulators=(modulator, modulator),
        gap_m=1e-3,
        planes_m=[4e-3],
        relay1=Relay(iris_na=0.03),
        relay2=Relay(iris_na=0.03),
        observer="mono",
    )
    hidden = {"aberration1": {"z6": 3.24e-7, "z11": -3.14e-7}}
    captures = make_captures(system, hidden, AcquisitionSettings(captures_per_condition=8))
    effects = [listed_effects()[name] for name in ("aberration1", "gap", "stroke", "slm_alignment", "tilt")]
    found = diagnose(captures, effects, free_maps=False)
    assert found.verdict is Verdict.EXPLAINED and [cause.effect for cause in found.causes] == ["aberration1"]
    assert any("slm1_inverted" in note for note in found.notes)
