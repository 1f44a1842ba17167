"""Settings of the check of the records, with units and evidence."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RecordSettings:
    """How records are checked. z is atanh of a correlation (Fisher); its variance is one over the number of grains."""

    tested: int = 8
    """[captures] Most on which the best corrections are compared; more where there are more wavelengths. Evidence: the
    cost; eight smooth pictures have thousands of grains."""

    screened: int = 2
    """[captures] On which every correction is tried first. Evidence: the cost; two, so that one bad picture doesn't
    decide."""

    confirmed: int = 8
    """[captures] Others, from smooth to rough, which a correction mustn't predict worse. Evidence: measured: with an
    aberration of 50 nm, exchanged modulators were better on smooth captures (0.97 → 0.996), worse on rough ones
    (0.6 → 0.2)."""

    promising: int = 96
    """[corrections] Best on the first of the screened captures, which the others screen further. Evidence: the cost; as
    many as there are single corrections."""

    kept: int = 16
    """[corrections] Best of the screening, which are compared on all tested captures. Evidence: more than the number of
    corrections that are the same physics, such as a mirrored modulator and the other two parts mirrored."""

    largest_offset: int = 8
    """[captures] Largest offset between patterns and pictures that is tried. Evidence: none recorded."""

    paired_offset: int = 3
    """[captures] … together with another correction, where it isn't of all patterns alone. Evidence: the cost."""

    blurs_px: tuple[float, ...] = (0.7, 1.5, 3.0)
    """[px] Blurs of the compared pictures, which have about `side_px` rows. Evidence: factors of two from the pixel to
    the grains of smooth patterns."""

    side_px: int = 64
    """[px] Pictures are binned until the shorter side has fewer than twice as many pixels. Evidence: the cost; a grain
    of a smooth pattern is a tenth of the picture."""

    background: float = 0.125
    """[1] Blur of the background that is divided out, over the shorter side. Evidence: wider than grains, narrower than
    a beam or vignetting."""

    max_shift: float = 0.08
    """[1] Movement of the pictures that doesn't count, over the shorter side. Evidence: beyond the shifts of misaligned
    cameras and tilted light in the search study."""

    taper: float = 0.08
    """[1] Width of the soft edge of the compared region, over the side. Evidence: as `max_shift`, so that a moved
    picture compares inside."""

    false_alarms: float = 1e-6
    """[1] Probability that pictures without any relation to the patterns show one correction as better, of all that are
    tried. Evidence: a thousand sessions a day for a year give less than one."""

    min_gain: float = 0.15
    """[z] Mean gain that a correction must bring beside being significant. Evidence: derivation: a correlation of 0.5
    rises to 0.6, of 0.9 to 0.93; a wrong record changes what is seen, and doesn't only improve it a little."""

    well_predicted: float = 0.9
    """[1] Mean correlation from which no pair of corrections is tried. Evidence: one of two wrong records, put right
    alone, leaves the speckle of the other."""

    undecided: float = 4.0
    """[σ] A gain above it that chance could still give is measured on the confirming captures too. Evidence: measured:
    wavelengths mixed up beside a displaced modulator gained 6.1 σ where chance gives 6.5, and 14.1 σ with these."""

    exchanged: int = 4
    """[corrections] Of those next to what was found, how many are tried in its place with another beside it. Evidence:
    measured: of patterns out of step and distances mixed up, the patterns alone came second."""

    equal_gain: float = 0.05
    """[z] Predictions that differ by less are alike. Evidence: a third of `min_gain`."""

    equal_sigmas: float = 3.0
    """[σ] … or by less than this. Evidence: derivation: 0.3 % by chance."""

    sorted_orders: int = 4
    """[corrections] Hypotheses for which the best order of a mixed-up column is found. Evidence: the cost."""

    most_corrections: int = 3
    """[corrections] Named at most, beside the order of the powers. Evidence: two mistakes in one evening happen, and
    one more."""

    certain: float = 6.0
    """[σ] Significance of the prediction above which it is said what these captures can't decide, and of the loss of
    one capture that contradicts a correction. Evidence: as `false_alarms`."""

    region_px: int = 128
    """[px] Modulator pixels across the centre of a near-field bench that are compared, beside the walk-off. Evidence:
    the cost: sessions of 128 × 96 pixels are compared whole."""

    most_captures: int = 64
    """[captures] Of the middle of a long session that are considered. Evidence: the cost."""

    power_spread: float = 0.02
    """[1] Spread of the gains from which the order of the powers is checked. Evidence: jitter of ordinary laboratories
    is 0.003."""

    power_left: float = 0.5
    """[1] Another order of the powers must leave less than this share of the spread. Evidence: a reason: a law of the
    laser's power keeps the order, and half of the spread is more than it leaves by chance."""


DEFAULT = RecordSettings()
