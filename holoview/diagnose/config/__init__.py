"""All settings of a diagnosis: one frozen tree of dataclasses, `SearchConfig`, with a group for each stage.

judgement     captures that aren't what their records say; one picture alone
preparation   split of the captures, budget, residuals, nuisances, drift of the lasers
fitting       screening of single effects, starting values, least-squares fits
known         corrections of known effects that were measured
stuck         stuck columns, rows and pixels of a modulator
planes        errors of single planes
selection     ranking on held-out captures, forward selection of causes
decision      verdict, check of the sampling, power laws, intervals, look-alikes
reporting     free maps, breakdown of the excess, report

Every field is followed by its unit in brackets, its meaning and its evidence. Units: 1 is a plain number; σ a standard
deviation of the noise; prior the `prior` of an effect's parameter, its common size; χ²/n the mean squared residual of a
pixel in σ², whose floor is 1; excess χ²/n − 1; Δχ² a difference of Σ residual²/σ² over the pixels of a comparison;
error the r.m.s. residual beyond the noise over the mean light (`SearchContext.relative_model_error`); cost the sum
Σ residual²/σ². Evidence is one of

- a measurement. The *screening study*: 31 effects, 40 captures of 10 wavelengths for fits and 10 held out, 1000
  electrons a pixel. The *search study*: 87 files of 29 effects in three sizes, 32 captures of 128 × 96 modulator
  pixels, four wavelengths, one plane, written by an independent program; its search named 84. Its thresholds were
  chosen after its results had been seen;
- a derivation, or a reason that follows from how the method works;
- "none recorded": the value works in `benchmarks/diagnosis.py`, and nobody noted why it isn't another.

`docs/diagnosis.md` states the thresholds that users see; a test compares them with these.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from holoview.diagnose.config.decision import (
    ConfounderConfig,
    IntervalConfig,
    PowerLawConfig,
    SamplingCheckConfig,
    VerdictConfig,
)
from holoview.diagnose.config.fitting import FitConfig, ScreeningConfig, StartConfig, StepConfig
from holoview.diagnose.config.judgement import JudgementConfig, OnePictureConfig
from holoview.diagnose.config.known import KnownConfig
from holoview.diagnose.config.planes import PlaneConfig
from holoview.diagnose.config.preparation import (
    BudgetConfig,
    ComparisonConfig,
    LaserDriftConfig,
    NuisanceConfig,
    RegionConfig,
    SplitConfig,
)
from holoview.diagnose.config.reporting import BreakdownConfig, FreeMapConfig, ReportConfig
from holoview.diagnose.config.selection import RankingConfig, SelectionConfig
from holoview.diagnose.config.stuck import StuckConfig

__all__ = [
    "BreakdownConfig",
    "BudgetConfig",
    "ComparisonConfig",
    "ConfounderConfig",
    "FitConfig",
    "FreeMapConfig",
    "IntervalConfig",
    "JudgementConfig",
    "KnownConfig",
    "LaserDriftConfig",
    "NuisanceConfig",
    "OnePictureConfig",
    "PlaneConfig",
    "PowerLawConfig",
    "RankingConfig",
    "RegionConfig",
    "ReportConfig",
    "SamplingCheckConfig",
    "ScreeningConfig",
    "SearchConfig",
    "SelectionConfig",
    "SplitConfig",
    "StartConfig",
    "StepConfig",
    "StuckConfig",
    "VerdictConfig",
]


@dataclass(frozen=True)
class SearchConfig:
    """The settings of a diagnosis, by stage; `dataclasses.replace` makes another one."""

    split: SplitConfig = field(default_factory=SplitConfig)
    judgement: JudgementConfig = field(default_factory=JudgementConfig)
    one_picture: OnePictureConfig = field(default_factory=OnePictureConfig)
    budget: BudgetConfig = field(default_factory=BudgetConfig)
    known: KnownConfig = field(default_factory=KnownConfig)
    region: RegionConfig = field(default_factory=RegionConfig)
    comparison: ComparisonConfig = field(default_factory=ComparisonConfig)
    nuisances: NuisanceConfig = field(default_factory=NuisanceConfig)
    laser_drift: LaserDriftConfig = field(default_factory=LaserDriftConfig)
    screening: ScreeningConfig = field(default_factory=ScreeningConfig)
    starts: StartConfig = field(default_factory=StartConfig)
    stuck: StuckConfig = field(default_factory=StuckConfig)
    planes: PlaneConfig = field(default_factory=PlaneConfig)
    fits: FitConfig = field(default_factory=FitConfig)
    ranking: RankingConfig = field(default_factory=RankingConfig)
    selection: SelectionConfig = field(default_factory=SelectionConfig)
    verdict: VerdictConfig = field(default_factory=VerdictConfig)
    sampling_check: SamplingCheckConfig = field(default_factory=SamplingCheckConfig)
    power_law: PowerLawConfig = field(default_factory=PowerLawConfig)
    intervals: IntervalConfig = field(default_factory=IntervalConfig)
    confounders: ConfounderConfig = field(default_factory=ConfounderConfig)
    free_maps: FreeMapConfig = field(default_factory=FreeMapConfig)
    breakdown: BreakdownConfig = field(default_factory=BreakdownConfig)
    report: ReportConfig = field(default_factory=ReportConfig)
