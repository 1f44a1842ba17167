"""Wrong records as causes of a diagnosis: found and put right before any effect is searched for."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from holoview.captures.dataset import Captures
from holoview.captures.patterns import pattern_roughness
from holoview.captures.prepared_captures import FitQuality, neighbour_variance, prepare_captures
from holoview.captures.records import Correction, RecordFindings, find_record_errors
from holoview.captures.records.corrections import Hypothesis, apply_corrections
from holoview.captures.records.power_order import PowerOrder
from holoview.captures.validation import check_lengths
from holoview.diagnose.capture_split import split_captures
from holoview.diagnose.config import SearchConfig
from holoview.diagnose.extended_model import PredictorWithKnownEffects
from holoview.diagnose.fit_statistics import fit_quality
from holoview.diagnose.judge import RIVAL_FACTOR, with_further_cause
from holoview.diagnose.likelihood import Comparison, Values
from holoview.diagnose.report.diagnosis import Cause, Diagnosis
from holoview.util.errors import UserError

DOUBTFUL = ("slm_exchange", "slm1_inverted", "slm2_inverted")
"""Wrong records that gross aberrations imitate: patterns that are rough look alike, inverted and exchanged."""
_NO_IMAGE = FitQuality(math.nan, math.nan)


@dataclass(frozen=True)
class CheckedRecords:
    """Records put right.

    captures: as they should have been recorded. kept: the number of each in the file. findings: what was wrong.
    causes: the same, as they are reported.
    """

    captures: Captures
    kept: tuple[int, ...]
    findings: RecordFindings
    causes: tuple[Cause, ...]

    @property
    def are_doubtful(self) -> bool:
        """Whether a gross error of the bench may have been taken for a wrong record."""
        return any(correction.effect in DOUBTFUL for correction in self.findings.corrections)

    def as_recorded(self, captures: Captures) -> CheckedRecords:
        """The same for the captures of the file without any correction."""
        findings = dataclasses.replace(self.findings, corrections=(), rivals=())
        return CheckedRecords(captures, tuple(range(len(captures))), findings, ())

    def or_as_recorded(self, corrected: Diagnosis, as_recorded: Diagnosis) -> Diagnosis:
        """Of the diagnoses with and without corrections the latter, with a note, if that excludes the former."""
        before, after = (d.after.chi2_per_pixel - 1.0 for d in (corrected, as_recorded))
        if before < RIVAL_FACTOR * after:
            return corrected
        names = " and ".join(correction.effect for correction in self.findings.corrections)
        note = f"The records look as if they were wrong ({names}), but the captures are explained better as recorded."
        return dataclasses.replace(as_recorded, notes=(note, *as_recorded.notes))

    def added_to(self, diagnosis: Diagnosis) -> Diagnosis:
        """The diagnosis of the corrected captures with the wrong records as its first causes."""
        found = dataclasses.replace(diagnosis, records=self.findings, notes=(*self.findings.notes, *diagnosis.notes))
        if not self.causes:
            return found
        bad = tuple(dataclasses.replace(one, index=self.kept[one.index]) for one in found.bad_captures)
        samples = tuple(dataclasses.replace(one, capture=self.kept[one.capture]) for one in found.samples)
        found = dataclasses.replace(found, bad_captures=bad, samples=samples)
        return dataclasses.replace(
            found, verdict=with_further_cause(found.verdict), causes=(*self.causes, *found.causes)
        )


def check_records(captures: Captures, known: Values, config: SearchConfig) -> CheckedRecords:
    """Finds wrong records and puts them right. known: effects that the nominal model has."""
    findings = find_record_errors(captures, known)
    causes = _describe_all(captures, findings.corrections, known, config)
    corrected = findings.corrected(captures) if causes else captures
    numbers = dataclasses.replace(captures, images=np.arange(len(captures), dtype=np.uint16)[:, None, None])
    kept = apply_corrections(numbers, findings.corrections).images[:, 0, 0].tolist()
    return CheckedRecords(corrected, tuple(kept), findings, tuple(causes))


def _describe_all(captures: Captures, corrections: Hypothesis, known: Values, config: SearchConfig) -> list[Cause]:
    """Wrong records as causes. The gain of each one is relative to the records with all others put right."""
    shown = [correction for correction in corrections if not isinstance(correction, PowerOrder)]
    after = _quality(captures, corrections, known, config) if shown else _NO_IMAGE
    causes = []
    for correction in corrections:
        if isinstance(correction, PowerOrder):
            causes.append(_describe_powers(correction))
            continue
        before = _quality(captures, tuple(c for c in corrections if c is not correction), known, config)
        share = (before.chi2_per_pixel - after.chi2_per_pixel) / max(before.chi2_per_pixel - 1.0, 1e-9)
        causes.append(_cause(correction, share, after.psnr_db - before.psnr_db, before, after))
    return causes


def _describe_powers(correction: PowerOrder) -> Cause:
    """Powers of the wrong captures as a cause: the gain of each capture is fitted, so that no picture shows it."""
    recorded, corrected = correction.spreads
    gain_db = 20 * math.log10(recorded / max(corrected, 1e-9))
    return _cause(correction, 1.0 - (corrected / recorded) ** 2, gain_db, _NO_IMAGE, _NO_IMAGE)


def _cause(correction: Correction, share: float, gain_db: float, before: FitQuality, after: FitQuality) -> Cause:
    return Cause(
        effect=correction.effect,
        choice=correction.choice,
        sentence=correction.sentence,
        intervals={},
        units={},
        excess_explained=float(np.clip(share, 0.0, 1.0)),
        gain_db=gain_db,
        before=before,
        after=after,
    )


def _quality(captures: Captures, corrections: Hypothesis, known: Values, config: SearchConfig) -> FitQuality:
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
