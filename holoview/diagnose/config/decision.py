"""Settings of the verdict, and of what is told beside it: sampling, power laws, intervals, look-alikes."""

from __future__ import annotations

from dataclasses import dataclass

from holoview.diagnose.sampling_config import SamplingConfig


@dataclass(frozen=True)
class VerdictConfig:
    """What the figures of a search allow one to say. Other stages use the same thresholds."""

    min_delta_chi2: float = 25.0
    """[Δχ²] A cause must gain more on held-out captures; so must a capture that separates two explanations, and a
    hard edge that is surely wrong costs so much. Evidence: derivation: 5 σ of one parameter. The search study: with
    frozen weights clean data gave at most 4.8. "Better than before" names a cause in every clean file."""

    min_explained_share: float = 0.5
    """[1] … and explain this share of the excess. Evidence: the screening study: no false alarm in 10 runs each of
    no fault, PRNU, and jitter of exposure, wavelength and camera; jitter gives many causes a little."""

    jitter_excess: float = 0.02
    """[χ²/n] Excess that jitter of an ordinary laboratory leaves: consistent below it, and a single cause that
    reaches it ends the search. Evidence: the search study."""

    chance_sigmas: float = 2.5
    """[σ] Excess within so many standard deviations √(2/n) is chance. Evidence: the standard deviation is a
    derivation; the number: none recorded."""

    explained_excess: float = 0.10
    """[χ²/n] Captures are explained up to this excess; above it free maps look for the place of the rest. Evidence:
    the search study; in the screening study wrong causes stayed at χ²/n of 1.4 to 680."""

    explained_max_share: float = 0.2
    """[1] … and up to this share of the nominal excess. Evidence: the search study; of a large error a blur
    explains nine tenths."""

    rival_factor: float = 2.0
    """[1] Causes that leave less than so many times the best excess can't be excluded. Evidence: the search
    study."""

    rival_excess: float = 0.01
    """[χ²/n] … for which the best excess counts as at least this. Evidence: the search study; smaller differences
    may be the model's own accuracy."""

    rival_excess_share: float = 0.1
    """[1] … but no more than this share of the nominal excess. Evidence: small faults are told apart too; the
    value: none recorded."""

    @property
    def explained_chi2(self) -> float:
        """χ²/n up to which captures may be explained."""
        return 1.0 + self.explained_excess

    @property
    def jitter_chi2(self) -> float:
        """χ²/n that jitter of an ordinary laboratory leaves."""
        return 1.0 + self.jitter_excess


@dataclass(frozen=True)
class SamplingCheckConfig:
    """Whether other samples of the same bench explain more than a cause does."""

    alternatives: tuple[SamplingConfig, ...] = (
        SamplingConfig(1, 2, 2),
        SamplingConfig(2, 2, 1),
        SamplingConfig(2, 2, 2),
        SamplingConfig(1, 3, 1),
        SamplingConfig(1, 4, 1),
        SamplingConfig(2, 3, 2),
    )
    """[1] Ways of sampling that are tried. Evidence: the screening study: data made with samples a fourth as large
    and read with half as large ones were misread as partial coherence; the list itself: none recorded."""

    captures: int = 4
    """[captures] Held-out captures that are predicted with each. Evidence: none recorded."""

    max_samples: int = 1 << 26
    """[samples] Larger grids aren't tried. Evidence: derivation: half a gigabyte for a field in single
    precision."""

    cache_mb: int = 64
    """[MB] Cache of each predictor. Evidence: causes are left out one after the other, which changes only a part of
    a prediction; the value: none recorded."""

    max_left_share: float = 0.5
    """[1] Other samples count if they leave less than this share of the excess; a cause is needed with them if it
    removes this share of what is left. Evidence: none recorded."""


@dataclass(frozen=True)
class PowerLawConfig:
    """Laws of the lasers' power, read off the gains of the captures."""

    min_spread: float = 0.003
    """[1] R.m.s. spread of the logarithm of the gains from which a law is fitted. Evidence: the search study;
    exposures of every laboratory jitter as much, which alarmed an information criterion in the screening study."""

    min_explained: float = 0.5
    """[1] Share of the variance that a law must explain. Evidence: the search study."""

    min_sigmas: float = 5.0
    """[σ] A parameter must lie so far from its identity. Evidence: derivation: as `VerdictConfig.min_delta_chi2`,
    5²."""

    interval_sigmas: float = 1.96
    """[σ] Half-width of an interval. Evidence: derivation: 95 % of a normal distribution."""

    spare_captures: int = 2
    """[captures] Needed beyond one for each wavelength and parameter. Evidence: none recorded; a spread needs
    some."""


@dataclass(frozen=True)
class IntervalConfig:
    """Intervals of the values that are reported."""

    level: float = 0.95
    """[1] Probability that an interval holds the true value. Evidence: a convention."""

    model_accuracy: float = 1e-3
    """[1] Share of a value that the model's own accuracy adds to its standard deviation. Evidence: two programs for
    the same physics hardly agree better on grids of this size; the value: none recorded; it was 5e-4 before."""


@dataclass(frozen=True)
class ConfounderConfig:
    """Effects that look like a cause that was named."""

    min_correlation: float = 0.5
    """[1] Canonical correlation from which an effect is told. Evidence: the screening study: most pairs are below
    0.3."""

    mean_light: float = 0.1
    """[1] Mean signal of a proposed capture over saturation. Evidence: none recorded."""
