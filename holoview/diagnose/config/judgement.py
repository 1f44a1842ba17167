"""Settings of the judgement of captures: which ones aren't what their records say, and why."""

from __future__ import annotations

from dataclasses import dataclass


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
class OnePictureConfig:
    """A session of one picture: blocks of its pixels are held out."""

    block_widths: float = 6.0
    """[speckles] Side of a block. Evidence: a block holds more than 30 speckles, and the margins don't eat it up."""

    margin_widths: float = 2.0
    """[speckles] Distance between pixels that are fitted and pixels that are held out. Evidence: derivation: the
    picture's autocorrelation is below a hundredth there."""

    min_blocks: int = 3
    """[blocks] Smallest number of blocks along each side of the picture; narrower blocks are used if needed.
    Evidence: derivation: with three, one is held out in the middle."""

    max_excess: float = 0.02
    """[χ²/n] An explanation of one picture is complete up to this excess. Evidence: as `VerdictConfig.jitter_excess`:
    captures of other patterns, which would refute a cause that only imitates this picture, are missing; so nothing but
    what a laboratory's jitter leaves is allowed."""
