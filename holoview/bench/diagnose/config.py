"""The settings of a diagnosis that callers choose: one frozen tree of dataclasses, `SearchConfig`.

All other thresholds are constants of the modules that use them. Each is followed by its unit in brackets, its meaning
and, where there is one, its evidence. Units: 1 is a plain number; σ a standard deviation of the noise; prior the
`prior` of an effect's parameter, its common size; χ²/n the mean squared residual of a pixel in σ², whose floor is 1;
excess χ²/n − 1; Δχ² a difference of Σ residual²/σ² over the pixels of a comparison; error the r.m.s. residual beyond
the noise over the mean light (`SearchContext.relative_model_error`); cost the sum Σ residual²/σ². Evidence is

- a measurement. The *screening study*: 31 effects, 40 captures of 10 wavelengths for fits and 10 held out, 1000
  electrons a pixel. The *search study*: 87 files of 29 effects in three sizes, 32 captures of 128 × 96 modulator
  pixels, four wavelengths, one plane, written by an independent program; its search named 84. Its thresholds were
  chosen after its results had been seen;
- or a derivation, or a reason that follows from how the method works.

"None recorded" means that the value works in `benchmarks/diagnosis.py`, without a record of others that were tried.
`docs/diagnosis-evidence.md` states the thresholds that users see; a test compares them with these.
"""

from __future__ import annotations

from dataclasses import dataclass, field

USUAL_SAMPLES = 256 * 192
"""[samples] Of a field up to which `BudgetConfig.max_fields` holds; larger fields are fewer in proportion. Evidence:
measured: so many samples have 128 × 96 modulator pixels with two samples along each side."""
MIN_FIELDS = 400
"""[fields] A search computes, however large they are. Evidence: a single cause is found within so many."""


@dataclass(frozen=True)
class BudgetConfig:
    """How much is computed. A field is one coherent light field, propagated through the bench."""

    max_fields: int = 32_000
    """[fields] After so many a search begins nothing new unless it is thorough. Evidence: measured: two minutes of one
    core for 128 × 96 modulator pixels, or one of two cores; with half as many, 4 of 23 pairs on 64 × 48 pixels were
    missed, which searches without a limit found in 29 to 139 s."""

    max_growth: float = 5.0
    """[1] The middle of larger pictures gets more fields, in proportion to the samples of whole ones, up to so many
    times as many. Evidence: what a person waits for: about a minute on two cores, or five for large modulators."""

    worker_start_s: float = 5.0
    """[s] Age of a diagnosis at which it starts its processes. Evidence: measured: starting them costs 3 s of processor
    time, and a small fault takes 4 s without them; the value: none recorded."""

    effects_per_batch: int = 8
    """[effects] Screened between two decisions whether to stop. Evidence: none recorded."""

    def fields_for(self, samples: int) -> float:
        """The budget of a search whose fields have so many samples."""
        return max(self.max_fields * min(1.0, USUAL_SAMPLES / samples), min(MIN_FIELDS, self.max_fields))

    def fields_for_middle(self, samples: int, whole_samples: int) -> float:
        """The budget of a search in the middle of pictures; samples: of its fields and of those of whole pictures."""
        return self.fields_for(samples) * min(max(1.0, whole_samples / USUAL_SAMPLES), self.max_growth)


@dataclass(frozen=True)
class RegionConfig:
    """Middle of large pictures, which is searched in place of whole ones."""

    side_px: int = 128
    """[px] Most modulator pixels across the middle, beside the margin for light that walks off sideways; on a Fourier
    bench speckles. Many captures need fewer (`crop._MIN_SIDE_PX`). Evidence: the search study's modulators had 128 ×
    96, and a far field has a speckle for each pixel."""

    further_px: int = 16
    """[px] Margin beside the walk-off of the steepest ray. Evidence: with stops at the first order and 10 mm to the
    camera, 0, 16 and 64 leave an error of 0.4, 0.26 and 0.15 % for smooth patterns, of 6.8, 5.9 and 4.5 % for white
    noise."""

    min_saving: float = 3.0
    """[1] Whole pictures are searched if they have less than so many times the pixels of the middle with its margin,
    on the modulator, or on the camera of a Fourier bench. Evidence: whole pictures are computed as well in the end,
    which takes about as long as searching the middle."""

    max_picture_pixels: int = 5_000_000
    """[px] Larger pictures are cut to so many. Evidence: measured: see `capture_split.MAX_SET_PIXELS`; a set has a
    picture of each wavelength."""

    max_grid_samples: int = 40_000_000
    """[samples] Of a padded field; larger modulators, and finer samples, are cut to so many. Evidence: measured: a
    prediction takes six fields of 8 bytes a sample at once, 2 GB in each process."""


@dataclass(frozen=True)
class VerdictConfig:
    """Thresholds of the verdict, which other stages use as well."""

    min_delta_chi2: float = 25.0
    """[Δχ²] A cause must gain more on held-out captures; so must a capture that separates two explanations, and a
    hard edge that is surely wrong costs so much. Evidence: derivation: 5 σ of one parameter. The search study: with
    frozen weights clean data gave at most 4.8. "Better than before" names a cause in every clean file."""

    explained_excess: float = 0.10
    """[χ²/n] Captures are explained up to this excess; above it free maps look for the place of the rest. Evidence:
    the search study; in the screening study wrong causes stayed at χ²/n of 1.4 to 680."""

    @property
    def explained_chi2(self) -> float:
        """χ²/n up to which captures may be explained."""
        return 1.0 + self.explained_excess


@dataclass(frozen=True)
class SearchConfig:
    """The settings of a diagnosis; `dataclasses.replace` makes another one."""

    bases: int = 3
    """[candidates] Single causes beside which a second cause is tried; of larger sets, the best alone. The cause that
    the best pair adds to one of them is tried as well. Evidence: the search study."""

    budget: BudgetConfig = field(default_factory=BudgetConfig)
    region: RegionConfig = field(default_factory=RegionConfig)
    verdict: VerdictConfig = field(default_factory=VerdictConfig)
