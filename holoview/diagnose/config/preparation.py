"""Settings of what precedes the search: split, budget, residuals, and what varies on every bench."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SplitConfig:
    """Which captures are searched, fitted and held out."""

    max_coarse: int = 6
    """[captures] Most that a screening uses. Evidence: the cost must not grow with the session; the search study
    used one of each wavelength; the number itself: none recorded."""

    max_fine: int = 12
    """[captures] Most that a joint fit uses. Evidence: as `max_coarse`; the search study used two of each
    wavelength."""

    max_rough: int = 18
    """[captures] Most that a search along axes uses. Evidence: as `max_coarse`; rough captures show small
    errors."""

    max_held_out: int = 16
    """[captures] Most that candidates are ranked on. Evidence: as `max_coarse`."""

    held_out_per_wavelength: int = 2
    """[captures] Held out of each wavelength, 1 or 2, if enough are left to fit. Evidence: the search study."""

    max_pixels: int = 8_000_000
    """[px] Pixels of the pictures in one set, but a picture of each wavelength at least. Evidence: measured: a fit
    keeps some ten arrays of them and one for each parameter, of four bytes a pixel, in every process."""

    scarce_stride: int = 3
    """[captures] With fewer than two captures a wavelength, every so many-th is held out. Evidence: none
    recorded."""


@dataclass(frozen=True)
class BudgetConfig:
    """How much is computed. A field is one coherent light field, propagated through the bench."""

    time_s: float = 60.0
    """[s] The command ends a search after so long, unless another time is given or it is thorough. Evidence: what a
    person waits for."""

    max_time_s: float = 300.0
    """[s] … which grows with the samples of a field, up to this. Evidence: the same."""

    max_stretch: float = 4.0
    """[1] Where other programs use the processor too, this time is divided by the share of it that the search gets, up
    to this factor. Evidence: beside three other programs on two cores, a fault that takes 28 s of one core stayed
    unexplained after a minute; the value: what a person waits for."""

    last_begin: float = 0.7
    """[1] After this share of the time nothing new is begun, so that what is underway ends in time. Evidence: the
    longest step of a pair, its causes fitted without each other, took 20 of 80 s."""

    max_fields: int = 32_000
    """[fields] After so many a search begins nothing new unless it is thorough. Evidence: measured: two minutes of one
    core for 128 × 96 modulator pixels, or one of two cores; with half as many, 4 of 23 pairs on 64 × 48 pixels were
    missed, which searches without a limit found in 29 to 139 s."""

    usual_samples: int = 256 * 192
    """[samples] Of a field up to which `max_fields` holds; larger fields are fewer in proportion. Evidence: measured:
    so many samples have 128 × 96 modulator pixels with two samples along each side."""

    min_fields: int = 400
    """[fields] … but not fewer than this. Evidence: a single cause is found within so many; the value: none
    recorded."""

    screening_factor: float = 4.0
    """[1] After so many times these fields no further effect is tried alone either. Evidence: single faults of 128 × 96
    modulator pixels take less than half of it, and a session whose fields take a second each has to end."""

    costly_fields: int = 5
    """[fields] A capture whose prediction adds so many or more is costly. Evidence: the search study summed a
    bandwidth at 5 Gauss–Hermite points; the limit itself: none recorded."""

    very_costly_fields: int = 25
    """[fields] A capture with so many or more is very costly. Evidence: 5², for the two dimensions of a source;
    none recorded."""

    costly_excess_share: float = 0.4
    """[1] Costly fits are pursued if their excess is below this share of the best simple fit's. Evidence: lost
    contrast imitates whatever is unknown; the value: none recorded."""

    costly_chance: float = 5.0
    """[√n] … or if Σ residual² exceeds the n pixels by less than this many √n. Evidence: derivation: 3.5 σ of χ²,
    whose standard deviation is √(2n)."""

    worker_start_s: float = 5.0
    """[s] Age of a diagnosis at which it starts its processes. Evidence: measured: starting them costs 3 s of processor
    time, and a small fault takes 4 s without them; the value: none recorded."""

    effects_per_batch: int = 8
    """[effects] Screened between two decisions whether to stop. Evidence: none recorded."""

    def time_for(self, samples: int) -> float:
        """The time (s) of a search whose fields have so many samples."""
        return min(max(self.time_s, self.time_s * samples / self.usual_samples), self.max_time_s)

    def fields_for(self, samples: int) -> float:
        """The budget of a search whose fields have so many samples."""
        return max(self.max_fields * min(1.0, self.usual_samples / samples), min(self.min_fields, self.max_fields))


@dataclass(frozen=True)
class RegionConfig:
    """Middle of large pictures, which is searched in place of whole ones."""

    side_px: int = 128
    """[px] Modulator pixels across the middle, beside the margin for light that walks off sideways; on a Fourier bench
    the most speckles. Evidence: the search study's modulators had 128 × 96, and a far field has a speckle for each
    pixel."""

    min_side_speckles: int = 64
    """[speckles] Across the middle on a Fourier bench with many captures. Evidence: measured: pairs of faults are named
    as well with modulators of 64 × 48 pixels, which have so many speckles; of 1024 × 768 pixels, a field with 128 takes
    1.4 times as long."""

    all_speckles: int = 1 << 16
    """[speckles] Of all captures together, in the middle on a Fourier bench. Evidence: 16 captures of 64 × 64 pixels;
    none recorded."""

    further_px: int = 16
    """[px] Margin beside the walk-off of the steepest ray. Evidence: with stops at the first order and 10 mm to the
    camera, 0, 16 and 64 leave an error of 0.4, 0.26 and 0.15 % for smooth patterns, of 6.8, 5.9 and 4.5 % for white
    noise."""

    cut_captures: int = 6
    """[captures] That are predicted whole to see what light the middle lacks. Evidence: that share grows steadily with
    the roughness of the patterns; the roughest is among them. The value: a whole field takes seconds."""

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

    max_time_share: float = 0.7
    """[1] Of the time of a search, after which the middle is given up with the best that was found there. Evidence: a
    reason: whole pictures have to be fitted and judged too. With 0.6, a pair of faults in 32 captures of 1600 × 1200
    pixels was found in time on one day, and not on another on which the machine was slower by a quarter."""

    max_displacement: float = 0.125
    """[1] Displacement of a far field from its prediction, over the middle's width, from which the middle is wider by
    it on either side. Evidence: a reason: seven eighths of it are seen and predicted."""


@dataclass(frozen=True)
class ComparisonConfig:
    """Residuals of a prediction, with the camera's movements taken out to first order."""

    max_shift_px: float = 0.5
    """[px] Largest movement of the camera in one capture. Evidence: beyond it the first order says nothing."""

    first_order_shift_px: float = 0.02
    """[px] Movements up to here are taken out in one step, larger ones in two. Evidence: none recorded."""

    typical_shift_px: float = 0.2
    """[px] Standard deviation of the Gaussian prior of a movement. Evidence: the screening study's jitter of 0.5 µm
    is 0.125 px of a camera with a pitch of 4 µm."""

    shared_shift_p_value: float = 1e-4
    """[1] A mean movement less probable than this under jitter alone is shared, and stays in the residual.
    Evidence: it replaced 5 σ of the mean, which few captures reach by chance; the value: none recorded."""

    max_part_pixels: int = 4_000_000
    """[1] Derivatives of so many pixels, or of one capture, are held at a time. Evidence: with all of eight pictures
    of 1600 × 1200 pixels, two processes took 9 to 11 GB; smaller sessions are one part."""

    infeasible_factor: float = 10.0
    """[1] Residuals of parameters that no bench can have are so many times those of a dark image. Evidence: they
    must exceed those of every bench that can be."""


@dataclass(frozen=True)
class NuisanceConfig:
    """Differences of sensitivity between pixels (PRNU) and a camera that moves from capture to capture."""

    prnu_max_chi2: float = 3.0
    """[χ²/n] Up to here residuals tell PRNU from errors of the model. Evidence: none recorded; it was 1.5
    before."""

    max_prnu: float = 0.1
    """[1] Largest standard deviation of the pixels' relative sensitivity. Evidence: none recorded; the benchmark
    has 0.01."""

    min_prnu_chi2: float = 0.005
    """[χ²/n] PRNU that adds less than this is ignored. Evidence: none recorded."""

    jitter_max_excess: float = 0.5
    """[1] The camera moves if taking movements out leaves less than this share of the excess. Evidence: real
    movements explain nearly all of it, those that imitate a wrong model little; the value: none recorded."""


@dataclass(frozen=True)
class LaserDriftConfig:
    """Wavelengths that change from capture to capture without a common direction."""

    step_m: float = 0.02e-9
    """[m] Distance between two wavelengths that are tried. Evidence: none recorded; the screening study detected an
    offset of 0.0026 nm in bright captures."""

    steps: int = 10
    """[1] Steps tried either way, ± 0.2 nm with the default step. Evidence: the benchmark drifts by 0.05 nm r.m.s.,
    of which this is 4 σ."""

    p_value: float = 1e-3
    """[1] A mean drift less probable than this under jitter alone is systematic. Evidence: it replaced 3 σ of the
    mean; the value: none recorded."""
