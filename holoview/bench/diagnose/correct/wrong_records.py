"""Wrong records: found and put right before any effect is searched for, and how much each correction gains."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.patterns import pattern_roughness
from holoview.bench.captures.prepared_captures import FitQuality, neighbour_variance, prepare_captures
from holoview.bench.captures.records import Correction, RecordFindings, find_record_errors
from holoview.bench.captures.records.corrections import Hypothesis, apply_corrections
from holoview.bench.captures.records.record_errors import PowerOrder
from holoview.bench.captures.validation import check_lengths
from holoview.bench.diagnose.capture_split import split_captures
from holoview.bench.diagnose.extended_model import PredictorWithKnownEffects
from holoview.bench.diagnose.fit_statistics import fit_quality
from holoview.bench.diagnose.likelihood import Comparison, Values
from holoview.util.errors import UserError

DOUBTFUL = ("slm_exchange", "slm1_inverted", "slm2_inverted", "inverted")
"""Wrong records that gross aberrations imitate: the light of rough patterns looks alike, inverted and exchanged."""
_NO_IMAGE = FitQuality(math.nan, math.nan)


@dataclass(frozen=True)
class RecordGain:
    """The gain of a correction beside all others.

    share: of the excess that it explains. gain_db: of PSNR on held-out captures, or of the spread of the gains. before,
    after: quality without and with it; NaN where no picture shows it.
    """

    correction: Correction
    share: float
    gain_db: float
    before: FitQuality
    after: FitQuality


@dataclass(frozen=True)
class CheckedRecords:
    """Captures whose records were put right.

    captures: with the right records. kept: the number of each in the file. findings: the corrections. gains: how much
    better the nominal bench predicts with each correction.
    """

    captures: Captures
    kept: tuple[int, ...]
    findings: RecordFindings
    gains: tuple[RecordGain, ...]

    @property
    def are_doubtful(self) -> bool:
        """Whether a gross error of the bench may have been taken for a wrong record."""
        return any(correction.kind in DOUBTFUL for correction in self.findings.corrections)

    def as_recorded(self, captures: Captures) -> CheckedRecords:
        """The uncorrected captures of the file, in the same form."""
        findings = dataclasses.replace(self.findings, corrections=(), rivals=())
        return CheckedRecords(captures, tuple(range(len(captures))), findings, ())


def check_records(captures: Captures, known: Values) -> CheckedRecords:
    """Finds wrong records and puts them right. known: effects that the nominal model has."""
    findings = find_record_errors(captures, known)
    gains = _gains(captures, findings.corrections, known)
    corrected = findings.corrected(captures) if gains else captures
    numbers = dataclasses.replace(captures, images=np.arange(len(captures), dtype=np.uint16)[:, None, None])
    kept = apply_corrections(numbers, findings.corrections).images[:, 0, 0].tolist()
    return CheckedRecords(corrected, tuple(kept), findings, tuple(gains))


def _gains(captures: Captures, corrections: Hypothesis, known: Values) -> list[RecordGain]:
    """The gain of each correction, against the records with all others put right."""
    shown = [correction for correction in corrections if not isinstance(correction, PowerOrder)]
    after = _quality(captures, corrections, known) if shown else _NO_IMAGE
    gains = []
    for correction in corrections:
        if isinstance(correction, PowerOrder):
            gains.append(_gain_of_powers(correction))
            continue
        before = _quality(captures, tuple(c for c in corrections if c is not correction), known)
        share = (before.chi2_per_pixel - after.chi2_per_pixel) / max(before.chi2_per_pixel - 1.0, 1e-9)
        gains.append(RecordGain(correction, share, after.psnr_db - before.psnr_db, before, after))
    return gains


def _gain_of_powers(correction: PowerOrder) -> RecordGain:
    """The spread of the gains shows powers of the wrong captures; no picture does, because each has its gain fitted."""
    recorded, corrected = correction.spreads
    gain_db = 20 * math.log10(recorded / max(corrected, 1e-9))
    return RecordGain(correction, 1.0 - (corrected / recorded) ** 2, gain_db, _NO_IMAGE, _NO_IMAGE)


def _quality(captures: Captures, corrections: Hypothesis, known: Values) -> FitQuality:
    """How well the nominal bench predicts held-out captures with these corrections; NaN for impossible lengths."""
    corrected = apply_corrections(captures, corrections)
    try:
        check_lengths(corrected)
    except UserError:
        return _NO_IMAGE
    data = prepare_captures(corrected)
    held_out = split_captures(corrected, pattern_roughness(corrected)).held_out
    predictor, variance = PredictorWithKnownEffects(corrected, known), neighbour_variance(data, held_out)
    comparison = Comparison(predictor, data, held_out, variance)
    return fit_quality(comparison, comparison.fit_gains({}))
