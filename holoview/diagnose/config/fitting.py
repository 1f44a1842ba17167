"""Settings of the search for one effect's values: screening, starting values, least squares."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class ScreeningConfig:
    """First look at every effect: by tangents near the truth, by local fits further away, by scans far off."""

    max_early_samples: int = 200_000
    """[samples] Of a field, above which stuck pixels and effects of very many fields come last. Evidence: measured:
    with a million samples, a row that seemed to be stuck took four minutes, an extended source half a minute."""

    decisive_tangent_gain: float = 0.5
    """[1] Share of the cost that one effect's derivatives explain, from which those of effects of very many fields
    aren't computed. Evidence: measured: on a Fourier bench of 1024 × 768 pixels an extended source took 28 s, all
    others 11 s, of which undiffracted light explained 0.68."""

    tangent_max_error: float = 0.05
    """[error] Below it tangents rank the effects. Evidence: the screening study: tangents ranked the cause first
    for 31 of 31 faults at errors of 0.003 to 0.03, and for 30 of 31 at 0.15."""

    local_max_error: float = 0.35
    """[error] Below it every effect is fitted from its identity before any scan. Evidence: the screening study:
    tangents ranked the cause first for 26 of 31 faults at 0.5, for 8 of 31 at 1."""

    tangent_fits: int = 8
    """[effects] The best by their tangents are fitted. Evidence: the screening study: on smooth captures the cause
    was among the first 5; 3 more as a margin."""

    tangent_fits_at_once: int = 4
    """[effects] Of these, fitted between two decisions whether to stop. Evidence: of pairs, the second cause was mostly
    among the first two; a multiple of two keeps two processes busy."""

    costly_step_factor: float = 20.0
    """[1] Difference steps of costly effects are so many times longer. Evidence: over short steps an iris on a grid
    passes over whole samples, which changes more than the rest; the value: none recorded."""

    no_scan_chi2: float = 2.0
    """[χ²/n] Near the truth, no range is scanned if the model is this close. Evidence: nothing lies beyond the
    reach of tangents there; the value: none recorded."""

    scan_captures: int = 2
    """[captures] A scan compares. Evidence: none recorded."""

    costly_scan_points: int = 3
    """[points] Of the scan of a costly effect. Evidence: none recorded."""

    costly_max_cost: float = 0.9
    """[1] A costly effect is fitted if a point of its scan leaves less than this share of the cost without it.
    Evidence: none recorded."""

    local_iterations: int = 4
    """[1] Levenberg–Marquardt iterations of a local fit in a screening. Evidence: none recorded; the search study
    needed at most 6 for complete fits."""

    points_per_parameter: int = 3
    """[points] A local fit counts as so many points of a scan for each parameter. Evidence: none recorded; only the
    order in which effects are tried depends on this and the next three."""

    upstream_cost: float = 4.0
    """[1] Relative cost of a field where the effect acts before the camera. Evidence: none recorded."""

    camera_pose_cost: float = 0.2
    """[1] Relative cost of a prediction where the effect acts on the camera. Evidence: none recorded."""

    downstream_cost: float = 2.0
    """[1] Relative cost of a prediction where the effect acts on anything else. Evidence: none recorded."""


@dataclass(frozen=True)
class StartConfig:
    """Starting values that the images suggest."""

    min_displacement_px: float = 0.3
    """[px] Smaller displacements of the images give no start. Evidence: a local fit starts well from the identity
    there; the value: none recorded."""

    min_response_px: float = 0.05
    """[px] A parameter that moves images by less at its typical size isn't used. Evidence: none recorded."""

    displacement_rcond: float = 0.05
    """[1] Singular values of the displacements below this share of the largest are dropped. Evidence: none
    recorded."""

    ghost_peaks: int = 3
    """[1] Peaks of the correlation tried as ghost images. Evidence: none recorded."""

    ghost_min_shift_px: float = 3.0
    """[px] Peaks nearer to zero shift aren't ghost images. Evidence: none recorded."""

    ghost_separation_px: float = 3.0
    """[px] Peaks nearer to a higher one are part of it. Evidence: none recorded."""

    fringe_peaks: int = 3
    """[1] Peaks of the spectrum tried as fringes. Evidence: none recorded."""

    fringe_min_count: float = 1.5
    """[fringes] Fewer over the picture aren't told from shading, and peaks nearer to a higher one are part of it.
    Evidence: the main lobe of a full picture's spectrum ends at 1."""

    fringe_samples: int = 2
    """[1] Samples of the spectrum for each fringe more over the picture. Evidence: the worst error, a quarter of a
    fringe, is an eighth at the picture's edges, where a fit converges."""

    fringe_trial_depth: float = 0.02
    """[1] Fringes of a modulator so deep measure how deep ones lower χ² most. Evidence: that is linear to a tenth; the
    fit does the rest."""


@dataclass(frozen=True)
class StepConfig:
    """Steps of forward differences, in units of a parameter's prior."""

    regular: float = 0.02
    """[prior] Of parameters that images depend on smoothly. Evidence: small enough for a slope, large enough for
    images in single precision."""

    even: float = 0.1
    """[prior²] Of parameters whose square images depend on. Evidence: images are nearly linear in the square;
    smaller steps are lost in the jumps of irises on a grid."""

    hard_edge: float = 0.4
    """[prior] Of parameters that move a hard edge. Evidence: the edge passes over many samples."""


@dataclass(frozen=True)
class FitConfig:
    """Least-squares fits of one effect or of several together."""

    steps: StepConfig = field(default_factory=StepConfig)
    """[prior] Steps of forward differences. Evidence: see there."""

    iterations: int = 6
    """[1] Levenberg–Marquardt iterations of a fit. Evidence: the search study."""

    tolerance: float = 2e-3
    """[1] A fit ends when an iteration lowers the cost by less than this share. Evidence: the search study."""

    final_iterations: int = 5
    """[1] Iterations of the last joint fit. Evidence: none recorded."""

    refit_iterations: int = 3
    """[1] Iterations of a fit from values that were fitted before. Evidence: none recorded."""

    final_tolerance: float = 1e-4
    """[1] Tolerance of the last joint fit and of refits. Evidence: none recorded."""

    last_iterations: int = 20
    """[1] Iterations of the last fit of what is near the floor. Evidence: measured: after the others, the two
    parameters of crosstalk were 11 and 21 % off with χ²/n 1.0196; with these 0.01 and 0.02 %, and 0.9935."""

    last_tolerance: float = 1e-6
    """[1] Its tolerance. Evidence: as `last_iterations`."""

    starts: int = 2
    """[1] Points of a scan from which an effect is fitted. Evidence: the search study fitted from the best one or
    two."""

    single_start_parameters: int = 4
    """[parameters] Effects with so many or more are fitted from one point. Evidence: none recorded."""

    compared_starts: int = 4
    """[1] … the best of so many, on all captures that it is fitted to. Evidence: measured: of fringes on a modulator,
    two captures took the opposite wedge for the better one."""

    start_separation: float = 1.5
    """[scan steps] Points this near to a better one aren't starts of their own. Evidence: they are neighbours in
    the scan."""

    second_cycle_cost: float = 0.99
    """[1] Parameters are scanned a second time if the first cycle left less than this share of the cost. Evidence:
    the search study used two cycles for Zernike terms."""

    negligible: float = 0.02
    """[prior] Values this near to the identity are set to it unless the captures insist. Evidence: fewer
    parameters, and an image that isn't rotated at all needs no interpolation; the value: none recorded."""

    insistence: float = 9.0
    """[Δχ²] The captures insist on a value if the identity costs more. Evidence: derivation: 3 σ of one
    parameter."""

    longer_step_factor: float = 5.0
    """[1] Fits with few parameters are repeated with steps so many times longer. Evidence: where irises on a grid
    jump, short differences find no slope; the value: none recorded."""

    few_parameters: int = 2
    """[parameters] So many are few: the fit is repeated with longer steps, and axes are searched. Evidence: none
    recorded."""

    axis_max_chi2: float = 1.01
    """[χ²/n] Axes are searched while χ²/n is above. Evidence: none recorded; it was 1.05 before."""

    axis_reach: float = 10.0
    """[steps] An axis is searched this far either way. Evidence: none recorded."""

    axis_points: int = 17
    """[points] Of the scan of an axis. Evidence: none recorded."""

    axis_evaluations: int = 10
    """[1] Evaluations of the golden section that follows. Evidence: none recorded."""

    edge_max_cost: float = 0.9
    """[1] Hard edges are searched exactly if the fit left less than this share of the cost. Evidence: none
    recorded."""

    scan_edge_size: float = 1.0
    """[prior] First simplex for hard edges after a scan. Evidence: none recorded."""

    first_edge_size: float = 0.5
    """[prior] First simplex for hard edges after a fit. Evidence: none recorded."""

    last_edge_size: float = 0.05
    """[prior] Last simplex for hard edges. Evidence: none recorded."""

    edge_evaluations: int = 100
    """[1] Evaluations of one simplex search. Evidence: none recorded."""

    edge_iterations: int = 3
    """[1] Iterations of the fit of other parameters between two simplex searches. Evidence: none recorded."""

    edge_tolerance: float = 1e-3
    """[1] Tolerance of that fit. Evidence: none recorded."""

    max_tolerated_error: float = 1.0
    """[error] Weights tolerate at most so large an error of the model. Evidence: the search study screened with
    weights that tolerate an error of the mean light."""

    half_tolerated_error: float = 0.5
    """[1] First joint fits tolerate this share of the present error, and at most this error. Evidence: the search
    study."""

    tolerant_min_error: float = 0.02
    """[error] Below it no tolerant fit precedes the one with the noise's weights. Evidence: none recorded; paired
    with `SelectionConfig.near_error`."""

    far_error: float = 0.15
    """[error] A tolerant fit that leaves more isn't refined. Evidence: weights of the noise alone lead nowhere
    there; the value: none recorded."""

    tolerant_rounds: int = 6
    """[1] Tolerant fits after each other, while the last one leaves a large error. Evidence: measured: two aberrations
    of 0.35 µm left 0.18 of the light after one, 0.019 after two; three of 0.4 µm, from a fifth of them, needed five."""

    tolerant_gain: float = 0.95
    """[1] … and lowered it below this share. Evidence: measured: causes that were wrong left 0.99 or more."""

    better_cost: float = 0.95
    """[1] The same causes are refined again from values that cost less than this share. Evidence: none recorded."""
