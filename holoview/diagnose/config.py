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

Where none is stated, the value works in `benchmarks/diagnosis.py`, and nobody noted why it isn't another.
`docs/diagnosis.md` states the thresholds that users see; a test compares them with these.
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

    time_s: float = 60.0
    """[s] The command ends a search after so long, unless another time is given or it is thorough. Evidence: what a
    person waits for."""

    max_time_s: float = 300.0
    """[s] … which grows with the samples of a field, up to this. Evidence: the same."""

    max_fields: int = 32_000
    """[fields] After so many a search begins nothing new unless it is thorough. Evidence: measured: two minutes of one
    core for 128 × 96 modulator pixels, or one of two cores; with half as many, 4 of 23 pairs on 64 × 48 pixels were
    missed, which searches without a limit found in 29 to 139 s."""

    worker_start_s: float = 5.0
    """[s] Age of a diagnosis at which it starts its processes. Evidence: measured: starting them costs 3 s of processor
    time, and a small fault takes 4 s without them; the value: none recorded."""

    effects_per_batch: int = 8
    """[effects] Screened between two decisions whether to stop. Evidence: none recorded."""

    def time_for(self, samples: int) -> float:
        """The time (s) of a search whose fields have so many samples."""
        return min(max(self.time_s, self.time_s * samples / USUAL_SAMPLES), self.max_time_s)

    def fields_for(self, samples: int) -> float:
        """The budget of a search whose fields have so many samples."""
        return max(self.max_fields * min(1.0, USUAL_SAMPLES / samples), min(MIN_FIELDS, self.max_fields))


@dataclass(frozen=True)
class RegionConfig:
    """Middle of large pictures, which is searched in place of whole ones."""

    side_px: int = 128
    """[px] Modulator pixels across the middle, beside the margin for light that walks off sideways; on a Fourier bench
    the most speckles. Evidence: the search study's modulators had 128 × 96, and a far field has a speckle for each
    pixel."""

    further_px: int = 16
    """[px] Margin beside the walk-off of the steepest ray. Evidence: with stops at the first order and 10 mm to the
    camera, 0, 16 and 64 leave an error of 0.4, 0.26 and 0.15 % for smooth patterns, of 6.8, 5.9 and 4.5 % for white
    noise."""

    min_saving: float = 3.0
    """[1] Whole pictures are searched if they have less than so many times the pixels of the middle with its margin,
    on the modulator, or on the camera of a Fourier bench. Evidence: whole pictures are computed as well in the end,
    which takes about as long as searching the middle."""

    max_picture_pixels: int = 5_000_000
    """[px] Larger pictures are cut to so many. Evidence: measured: see `SplitConfig.max_pixels`; a set has a picture of
    each wavelength."""

    max_grid_samples: int = 40_000_000
    """[samples] Of a padded field; larger modulators, and finer samples, are cut to so many. Evidence: measured: a
    prediction takes six fields of 8 bytes a sample at once, 2 GB in each process."""


@dataclass(frozen=True)
class VerdictConfig:
    """What the figures of a search allow one to say. Other stages use the same thresholds."""

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
class JudgementConfig:
    """Which captures are bad. Each is judged against the others, by medians, which a few bad ones don't move."""

    dark_sigmas: float = 3.0
    """[σ] A capture is dark if its mean light is below so many standard deviations of a dark mean. Evidence:
    derivation: the chance of a dark picture to pass is 0.1 %."""

    dark_share: float = 0.02
    """[1] … or, over power × exposure, below this share of the median of its wavelength. Evidence: rough patterns
    scatter some of the light outside the stops, and power laws change it by less than a factor of ten."""

    flat_variance: float = 2.0
    """[1] A picture whose variance is below so many times that of the noise shows no pattern … Evidence: derivation:
    speckle varies by its mean, hundreds of times as much."""

    dim_share: float = 0.5
    """[1] … and is dark if it also has less than this share of the usual light of its wavelength: a black level that is
    higher than recorded isn't light. Evidence: flat patterns, which show no speckle either, are brighter."""

    saturated_share: float = 0.05
    """[1] A capture is saturated if more of its pixels are … Evidence: derivation: speckle has an exponential
    distribution; exposed as advised, a thousandth of the pixels is near saturation, and a twentieth at three times
    that exposure."""

    saturated_factor: float = 5.0
    """[1] … and so many times the median share of all captures. Evidence: where the zero order or the whole session
    is saturated, one capture isn't to blame; the value: none recorded."""

    min_captures: int = 3
    """[captures] Captures are judged against each other from so many on. Evidence: derivation: the median of fewer
    isn't free of a bad one."""

    min_plane_captures: int = 2
    """[captures] Where more than half of a plane's captures stand out before the search, and there are so many, the
    plane is searched with the others: its distance may be wrong. Evidence: derivation: a single capture may as well be
    bad itself."""

    trend_captures: int = 8
    """[captures] From so many on, excesses are compared with a trend over roughness. Evidence: derivation: of
    eight, the line bears two bad ones (29 %)."""

    roughness_share: float = 0.8
    """[1] The peers of a capture are the others whose roughness is at least this share of its own. Evidence: an error
    of the model decorrelates rough patterns first, so that a good capture resembles its prediction at least as much as
    its peers do."""

    min_peers: int = 2
    """[captures] A capture with fewer peers isn't judged by them. Evidence: derivation: `min_captures` with itself."""

    min_reach: float = 0.5
    """[1] A picture whose correlation with its prediction, beyond that with other captures' predictions, is less than
    this share of its peers' isn't of its record. Evidence: halfway between another pattern and a good capture."""

    unrelated_sigmas: float = 3.0
    """[σ] … and less than so many standard deviations of correlations with other captures' predictions. Evidence:
    derivation: it can't be told from an unrelated picture."""

    reach_sigmas: float = 5.0
    """[σ] … if that of the peers exceeds so many of them. Evidence: derivation: otherwise the model resembles
    nothing."""

    correlated_pixels: int = 500_000
    """[px] Of each picture by which it is correlated with predictions, spread over it. Evidence: derivation: a
    correlation scatters by 1/√n, by 0.0014 for so many pixels, or by 0.02 where a speckle has two hundred of them."""

    false_alarm: float = 0.01
    """[1] Chance that a session without a bad capture gets one blamed for its χ², if the logarithms of the excesses
    are normally distributed: each capture has this over their number. Evidence: a convention."""

    min_ratio: float = 3.0
    """[1] … and the capture's excess, with that of ordinary jitter added to all, must be so many times that of the
    others. Evidence: what jitter leaves differs between captures; the value: none recorded."""

    tolerant_ratio: float = 30.0
    """[1] The same before the search, and where the model leaves more than `VerdictConfig.explained_excess` in half of
    the captures: what an effect that isn't explained leaves differs between captures. Evidence: measured: of 900
    captures with one effect each and judged without it, 1 % exceeded this or the next."""

    bad_share: float = 0.2
    """[1] With more than this share of bad captures, a session is neither consistent nor explained. Evidence:
    derivation: medians and trends of the others bear up to 29 % (Theil–Sen)."""

    candidates: int = 4
    """[candidates] Tried as the model that suits most captures, where what is named doesn't. Evidence: none
    recorded."""

    rounds: int = 3
    """[1] Searches at most, each without the captures that the one before found bad. Evidence: none recorded."""

    examined: int = 6
    """[captures] Bad captures whose pictures are compared with all other patterns, the worst first. Evidence: the cost
    must not grow with the square of the session; the value: none recorded."""

    reason_max_share: float = 0.5
    """[1] A reason must leave less than this share of a capture's excess. Evidence: none recorded."""

    defocus_depths: tuple[float, ...] = (0.06, 0.12, 0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0)
    """[depths] Distances, in depths of field λ/NA², by which a capture may be out of focus, either way. Evidence:
    derivation: speckle decorrelates within one depth, so that steps of half a depth miss nothing, and of small errors
    half a step too much or too little leaves a quarter of the excess."""

    blurs_px: tuple[float, ...] = (0.4, 0.6, 0.8, 1.2, 1.8, 2.7, 4.0)
    """[px] Blurs that a capture out of focus may have. Evidence: steps of a factor of 1.5, as for `defocus_depths`."""

    white_correlation: float = 0.15
    """[1] Residuals of a noisy capture correlate with their neighbours' by less. Evidence: neighbouring pixels of
    speckle correlate by 0.5 and more; the value: none recorded."""


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
    the same physics hardly agree better on grids of this size; the value: none recorded."""


@dataclass(frozen=True)
class ConfounderConfig:
    """Effects that look like a cause that was named."""

    min_correlation: float = 0.5
    """[1] Canonical correlation from which an effect is told. Evidence: the screening study: most pairs are below
    0.3."""

    mean_light: float = 0.1
    """[1] Mean signal of a proposed capture over saturation. Evidence: none recorded."""


@dataclass(frozen=True)
class FreeMapConfig:
    """Smooth maps, free at one place at a time, that show where an unexplained error lives."""

    surface_points: tuple[int, int] = (6, 8)
    """[points] Rows and columns of control points over a modulator or the camera. Evidence: none recorded."""

    pupil_points: tuple[int, int] = (8, 8)
    """[points] Rows and columns of control points over a pupil. Evidence: none recorded."""

    response_points: int = 9
    """[points] Control points of a response curve. Evidence: none recorded."""

    iterations: int = 15
    """[1] Iterations of L-BFGS. Evidence: none recorded."""

    path_scale_m: float = 50e-9
    """[m] Optical path that a map's unit stands for, which scales the optimiser's steps. Evidence: none
    recorded."""

    relative_scale: float = 0.1
    """[1] Relative amplitude or response that a map's unit stands for. Evidence: none recorded."""

    min_share: float = 0.1
    """[1] Places are told that explain at least this share of the excess … Evidence: none recorded."""

    near_best_share: float = 0.7
    """[1] … and this share of what the best place explains. Evidence: none recorded."""


@dataclass(frozen=True)
class BreakdownConfig:
    """Classes of pixels by which the excess is broken down. Evidence: presentation only."""

    frequency_bands: int = 4
    """[1] Bands of spatial frequency up to the camera's Nyquist frequency. Evidence: presentation only."""

    radii: tuple[float, ...] = (0.25, 0.5, 0.75)
    """[1] Limits between classes of radius, over the distance of the corners. Evidence: presentation only."""

    brightness: tuple[float, ...] = (0.5, 1.0, 2.0)
    """[1] Limits between classes of expected light, over its mean. Evidence: presentation only."""


@dataclass(frozen=True)
class ReportConfig:
    """Figures and pictures of held-out captures, and the comparison on the display."""

    samples: int = 4
    """[captures] Held-out captures that are shown. Evidence: presentation only."""

    peak_quantile: float = 0.999
    """[1] Quantile of a capture's light that PSNR takes as its peak. Evidence: a definition; single hot pixels
    don't count."""

    hologram_iterations: int = 40
    """[1] Iterations of each hologram that is optimised. Evidence: measured: half a minute; the value: none
    recorded."""


@dataclass(frozen=True)
class SearchConfig:
    """The settings of a diagnosis; `dataclasses.replace` makes another one."""

    bases: int = 3
    """[candidates] Single causes on which a second one is tried; of larger sets, the best alone. One more is what the
    best pair adds to one of them. Evidence: the search study."""

    max_early_samples: int = 200_000
    """[samples] Of a field, above which stuck pixels and effects of very many fields come last. Evidence: measured:
    with a million samples, a row that seemed to be stuck took four minutes, an extended source half a minute."""

    budget: BudgetConfig = field(default_factory=BudgetConfig)
    region: RegionConfig = field(default_factory=RegionConfig)
    verdict: VerdictConfig = field(default_factory=VerdictConfig)
    judgement: JudgementConfig = field(default_factory=JudgementConfig)
    power_law: PowerLawConfig = field(default_factory=PowerLawConfig)
    intervals: IntervalConfig = field(default_factory=IntervalConfig)
    confounders: ConfounderConfig = field(default_factory=ConfounderConfig)
    free_maps: FreeMapConfig = field(default_factory=FreeMapConfig)
    breakdown: BreakdownConfig = field(default_factory=BreakdownConfig)
    report: ReportConfig = field(default_factory=ReportConfig)


@dataclass(frozen=True)
class SamplingConfig:
    """The keywords of `Predictor` that set its sampling.

    finer: samples on each axis for every one of the model's own. padding: sides of the grid over the modulators'.
    points: points on each axis that a camera pixel averages; None: one for each sample on it.
    """

    finer: int = 1
    padding: int = 2
    points: int | None = None

    @property
    def description(self) -> str:
        """How it differs from the default."""
        parts = ["finer samples"] if self.finer > 1 else []
        parts += [f"a grid {self.padding} times the modulators' size"] if self.padding > 2 else []
        parts += ["camera pixels that integrate"] if (self.points or self.finer) > 1 else []
        return " and ".join(parts)

    @property
    def cli_options(self) -> str:
        """The options of `holoview diagnose` for it."""
        points = f" --points {self.points}" if self.points else ""
        return f"--finer {self.finer} --padding {self.padding}{points}"


PLAIN = SamplingConfig()
