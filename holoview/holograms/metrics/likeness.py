"""The contrast of a luminance beside its target, and whether the picture shows the target at all.

Only of a picture I = g·M·s that shows its target T as M can the structure of M be divided out of the speckle s.

**The resolution.** A hologram of few pixels or iterations shows T as its stops, its grid and its patterns allow:
M = h∗T, h a Gaussian of standard deviation w. With picture and target over their means, y = I − 1 and x = h∗T − 1, w is
that of `WIDTHS` at which the picture is best a multiple of the target, Σ(y − b·x)² being least: no other leaves
the mean of the ratio I/M free of T. It is sought from fine to coarse, up to the first that is worse.

**The share.** The slope b = Σ x·y / Σ x² is the share of the target's structure that the picture has: 1 where the
speckle s is independent of T, 0 where the picture is, and m/(m + c) for a target of mean m in even stray light c. Its
standard error is that of a ratio of sums over blocks: Σ_k (n_k − b·d_k)² over (Σ d_k)² is its square, n and d being the
sums of x·y and x² in each of 8 × 8 blocks.

**What is left.** In r = I/(g·M) − 1 nothing but speckle is left, which knows nothing of T: it isn't correlated with any
function f of T, and none over more than a grain. With the sums e_k of r·f over the blocks, which are independent,

    ((Σ e_k)² − Σ e_k²)/(Σ f²·Σ r²) ± √2·Σ e_k²/(Σ f²·Σ r²)

is the share of the variance of r that f explains, 0 for speckle. Taken as f are

    levels   each eighth of the pixels by their level in M: a tone curve, a black level, another picture
    edges    both derivatives of ln M: the first order of a displacement

and where something else stands in some places,

    places   the blocks whose mean of r, times the root of its samples, is off the median by more than 5 standard
             deviations s, s being 1.4826 of the median deviation: the share of Σ r² that is in these means, less s²

A contrast is withheld where, by two standard errors,

    b is below a half,
    levels or places is above a fifth: C, whose square it adds to, would be a tenth too large,
    edges is above 0.15, as the first order isn't all that a displacement leaves; what is even to 10 % r.m.s.,
    as displays are, is only said,
    a part of the region departs from M further than speckle does (`local_misfit`), and C is a fifth above that of the
    rest; above a tenth it is said. Holograms of few iterations have such parts,
    C is above 1, all that speckle has, and by a tenth: its standard error is √(Σ_k (q_k − C²·n_k)²)/(2·C·n), q_k being
    the sum of r² over the n_k samples of a block,

or where I/(g·M) has a larger contrast than I by more than 5 %: of I = g·M·s division leaves C of C² + C_M²·(1 + C²).
What isn't found of a wrong target adds to C: the contrast that is stated is then too high.

**Other targets.** First of all, targets that are mistaken for one another are tried in the place of T: T displaced by
up to 32 samples (the peak of the cross-correlation of ln I with ln T, and from there and from none to the least
contrast), mirrored, upside down, turned, with the tone curve of a signal taken off or put on, and those of other planes
that a caller has. With M' of the other target, the share of the structure of M'/M that I/M has is 0 where M is what is
shown and 1 where M' is. The other one is better where this share is above a half by two standard errors, in what four
blocks hold or more, and the reverse, that of M/M' in I/M', isn't. That is said, and the contrast is withheld where C is
a tenth above what the other one leaves. A hologram of few pixels or iterations shows at its first and last planes what
is between them, and its tones aren't yet right, so that the target of another plane or with a tone curve fits better by
up to a fifth: there the limit is this, and 10 % r.m.s. Where the targets were made for their planes, from a depth, none
is another plane's, however much better that fits: this is said, and what the hologram lacks of its depth adds to C.

A target with hardly any structure decides nothing, and changes nothing: division changes C² by C_T²·(1 − 2b), and a
share b decides where that can be a hundredth of C². Division by a T that isn't shown raises C by about C_T²/2C, which
exceeds the standard error of C, C/√(2n) of n grains, only where b is known to C/(C_T·√n) = (2n)^(−1/4). What is left is
judged where C_T² is a tenth of C² or more.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.metrics.grains import ContrastEstimate, PixelNoise, SumNoise, block_sums, contrast_estimate
from holoview.holograms.metrics.local_misfit import LocalMisfit, local_misfit
from holoview.holograms.metrics.speckle import (
    Floats,
    SpeckleContrast,
    SpecklePattern,
    speckle_pattern,
    target_luminance,
)
from holoview.light.numerics.sampling import Region

LEAST_SHARE = 0.5
"""Share of a target's structure below which, by two standard errors, a picture doesn't show it."""

MOST_LEFT = 0.2
"""Share of the square of a contrast that isn't speckle above which, by two standard errors, it is withheld."""

MOST_OF_SPECKLE = 1.1
"""A contrast that is a tenth more than speckle has."""

WIDTHS = (0.0, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0)
"""Standard deviations of the blur by which a picture may show its target, in samples."""

_LEVELS = 8
_SIGMAS = 2.0
_LEAST_STRUCTURE = 0.1  # C_T² over C², from which what is left of a target is judged
_LEAST_CHANGE = 0.01  # of C² by division, from which the share of a target's structure is judged
_MOST_EDGES = 0.15  # of the variance left
_MOST_ADDED = 1.05  # of the contrast by division
_MOST_UNEVEN = 0.1  # r.m.s. of the brightness
_OUTLIER, _MAD = 5.0, 1.4826  # standard deviations of a block; a normal law's over the median deviation
_LEAST_BETTER = 1e-12  # of the squares, by which a blur is better than rounding makes it
_REACH = 4.0  # standard deviations of a blur
_FARTHEST = 32  # samples, or a quarter of a region, by which a target is looked for
_FLOOR = 0.05  # of the mean: darker samples tell no displacement
_LEAST_BLOCKS = 4.0  # that tell a better target
_MOST_ABOVE, _MOST_ABOVE_COMMON = 1.1, 1.2  # of a contrast over what a better target leaves, or a common one
_MOST_WORSE = 1.05  # of a contrast that another target leaves with the same blur, beyond which it isn't looked into
_MOST_STEPS = 8  # to the displacement that fits best
_SIGNAL = 2.2  # power of a display


@dataclass(frozen=True)
class Likeness:
    """How much of a target's structure a picture has. standard_error: of the share; infinite of an even target."""

    share: float
    standard_error: float

    @property
    def at_least(self) -> float:
        """The share less two standard errors."""
        return self.share - _SIGMAS * self.standard_error

    @property
    def at_most(self) -> float:
        """The share and two standard errors more."""
        return self.share + _SIGMAS * self.standard_error


@dataclass(frozen=True)
class StructureLeft:
    """Shares of the variance of what division by the target leaves that aren't speckle.

    levels, edges: that follow the target's levels, and its edges. places: in some places alone.
    """

    levels: Likeness
    edges: Likeness
    places: Likeness

    @property
    def doubtful(self) -> list[tuple[Likeness, str]]:
        """Those that are too large, and what they do."""
        limits = (
            (self.levels, MOST_LEFT, "follows its levels"),
            (self.edges, _MOST_EDGES, "follows its edges, as if it were displaced"),
            (self.places, MOST_LEFT, "is in places alone"),
        )
        return [(share, what) for share, most, what in limits if share.at_least > most]


@dataclass(frozen=True, eq=False)
class OtherPlanes:
    """The targets (y, x, 3) of other planes than the one that is measured, by what they are in words.

    are_mistakable: whether one of them may be that of the measured plane: those of a focal stack out of order. Where
    each was made for its plane, from a depth, it is only said that another one fits better.
    """

    targets: Mapping[str, NDArray[np.floating]] = field(default_factory=dict)
    are_mistakable: bool = True


NO_OTHERS = OtherPlanes()


@dataclass(frozen=True)
class BetterTarget:
    """Another target that a picture fits clearly better than the one it is measured beside.

    what: the other one, in words that go on "the target". contrast, given: that are left by it and by the given one,
    over the samples that both light. displacement_px: (y, x) of the given one; 0 of others. is_common: whether a
    hologram of the right target may fit it, too: that of another plane, one with a tone curve. is_known_wrong: whether
    it is known not to be the one that the picture should show.
    """

    what: str
    contrast: float
    given: float
    displacement_px: tuple[int, int] = (0, 0)
    is_common: bool = False
    is_known_wrong: bool = False

    @property
    def decides(self) -> bool:
        """Whether the contrast beside the given target is too far off to be stated."""
        if self.is_known_wrong:
            return False
        if not self.is_common:
            return self.given > _MOST_ABOVE * self.contrast
        return self.given > max(_MOST_ABOVE_COMMON * self.contrast, math.hypot(self.contrast, _MOST_UNEVEN))

    @property
    def text(self) -> str:
        """What fits better, and by how much."""
        return f"{self.what} it leaves a contrast of {self.contrast:.3f}, as it is {self.given:.3f}"


@dataclass(frozen=True, eq=False)
class LuminanceContrast:
    """The speckle contrast of a region's luminance.

    estimate: of `pattern`, without the structure of a target where `has_target`. raw: with the structure of the
    picture. withheld: why the contrast isn't to be stated, "" where it is; `estimate` is then the raw one.
    likeness: to the target; None without one. blur_px: standard deviation of the target's blur in the picture.
    left: of the structure; None where there is no target, or hardly any structure in it. better: another target that
    fits better; None where none was found. displacement_px: (y, x) by which the target was moved, as `is_aligned` asks.
    misfit: the part of the region that departs from it; None where none was found, or another reason decides.
    doubt: why a contrast beside a target that is stated may be wrong; "" where nothing says so.
    """

    estimate: ContrastEstimate
    pattern: SpecklePattern
    raw: SpeckleContrast
    has_target: bool
    withheld: str = ""
    likeness: Likeness | None = None
    blur_px: float = 0.0
    left: StructureLeft | None = None
    better: BetterTarget | None = None
    displacement_px: tuple[int, int] = (0, 0)
    misfit: LocalMisfit | None = None
    doubt: str = ""


def luminance_contrast(
    luminance: NDArray[np.floating],
    region: Region,
    target: NDArray[np.floating] | None = None,
    noise: PixelNoise | SumNoise | None = None,
    others: OtherPlanes = NO_OTHERS,
    *,
    is_aligned: bool = False,
) -> LuminanceContrast:
    """The contrast of a region of a luminance (y, x), as viewer, page, `contrast` and `report` state it.

    target: (y, x, 3) in linear sRGB, whose structure is divided out unless it is black in the region. noise: of a
    camera's pixels in the luminance, which is taken off. others: targets that may be shown in its place. is_aligned:
    moves the target to where it fits, by whole samples.
    Raises UserError as `speckle_contrast` does.
    """
    own_noise = noise.within(region) if isinstance(noise, SumNoise) else noise
    plain = speckle_pattern(luminance, region)
    known = None if target is None else target_luminance(target, region)
    if target is None or known is None:
        return LuminanceContrast(contrast_estimate(plain, own_noise), plain, plain.contrast, False)
    if known.shape != luminance.shape:
        speckle_pattern(luminance, region, known)  # which says so
    blur_px, shown = _resolved(plain.values, known, region)
    pattern = speckle_pattern(plain.values, None, shown)
    estimate, raw, alike = contrast_estimate(pattern, own_noise), plain.contrast, likeness(plain.values, shown)
    has_structure = float(shown.std() / shown.mean()) ** 2 >= _LEAST_STRUCTURE * pattern.contrast.contrast**2
    left = structure_left(pattern, shown) if has_structure else None
    better = _better_target(plain.values, known, region, blur_px, shown, others)
    if is_aligned and better is not None and any(better.displacement_px):
        moved = displaced(target, better.displacement_px)
        found = luminance_contrast(luminance, region, moved, noise, others)
        return replace(found, displacement_px=better.displacement_px)
    reason = _why_withheld(alike, left, pattern, shown, raw.contrast)
    if better is not None and better.decides:
        is_shown_in_part = better.is_common and alike.at_most < LEAST_SHARE
        said = reason if is_shown_in_part else "the target isn't what is shown here"
        reason = f"{said}; {better.text}"
    misfit = local_misfit(pattern) if has_structure and not reason else None
    doubts = [f"another target fits better: {better.text}"] if better is not None else []
    if misfit is not None:
        contrast, most = pattern.contrast.contrast, math.hypot(misfit.contrast, _MOST_UNEVEN)
        in_words = _part_in_words(misfit, region)
        if contrast > max(_MOST_ABOVE_COMMON * misfit.contrast, most):
            reason = f"the target isn't what is shown here: {in_words}, as it is {contrast:.3f}"
        elif contrast > max(_MOST_ABOVE * misfit.contrast, most):
            doubts.append(in_words)
    if estimate.contrast > MOST_OF_SPECKLE:
        doubts.append(
            f"speckle has a contrast of 1 at most, and {estimate.contrast:.3f} is left beside the target: few bright "
            "samples decide it, or the target isn't what is shown"
        )
    if reason:
        own = contrast_estimate(plain, own_noise)
        return LuminanceContrast(own, plain, raw, False, reason, alike, blur_px, left, better, misfit=misfit)
    doubt = "; ".join(doubts)
    return LuminanceContrast(estimate, pattern, raw, True, "", alike, blur_px, left, better, misfit=misfit, doubt=doubt)


def _why_withheld(
    alike: Likeness, left: StructureLeft | None, pattern: SpecklePattern, shown: Floats, raw: float
) -> str:
    """Why a contrast isn't to be stated; "" where it is. shown: (y, x), by which the pattern is divided."""
    contrast, structure = pattern.contrast.contrast, float(shown.std() / shown.mean())
    is_judged = structure**2 * (1 + 2 * abs(alike.share)) >= _LEAST_CHANGE * contrast**2
    if is_judged and alike.at_most < LEAST_SHARE:
        return (
            f"the picture doesn't show the target here: it has {100 * alike.share:.0f} ± "
            f"{100 * alike.standard_error:.0f} % of its structure"
        )
    if contrast > _MOST_ADDED * raw:
        return (
            f"the target isn't what is shown here: division by it raises the contrast from {raw:.3f} to {contrast:.3f}"
            ", and would lower that of a picture which shows it"
        )
    if contrast > MOST_OF_SPECKLE and contrast - _SIGMAS * _error_of_blocks(pattern) > 1:
        return f"the target isn't what is shown here: division by it leaves {contrast:.3f}, and speckle has 1 at most"
    if left is None:
        return ""
    for share, what in left.doubtful:
        if contrast * math.sqrt(share.share) > _MOST_UNEVEN:
            return (
                f"the target isn't what is shown here: {100 * share.share:.0f} ± {100 * share.standard_error:.0f} % of "
                f"the variance that division leaves {what}"
            )
    return ""


def _part_in_words(misfit: LocalMisfit, region: Region) -> str:
    x, y, width, height = misfit.box
    return (
        f"{100 * misfit.share:.0f} % of the samples, within {width} × {height} from ({region[0] + x}, "
        f"{region[1] + y}), depart from the target further than speckle does; without them the contrast is "
        f"{misfit.contrast:.3f}"
    )


# --- the resolution ---------------------------------------------------------------------------------------------------


def resolved_contrast(luminance: NDArray[np.floating], region: Region, target: NDArray[np.floating]) -> SpeckleContrast:
    """The contrast of a region of a luminance (y, x) beside its target (y, x), at the resolution that it shows.

    That of `luminance_contrast`, without its verdict: whatever is shown. Raises UserError as `speckle_contrast` does.
    """
    values, wanted = speckle_pattern(luminance, region).values, np.asarray(target, dtype=np.float64)
    if wanted.shape != luminance.shape:
        return speckle_pattern(luminance, region, wanted).contrast  # which says so
    return speckle_pattern(values, None, _resolved(values, wanted, region)[1]).contrast


def shown_target(target: NDArray[np.floating], region: Region, blur_px: float) -> Floats:
    """A region (y, x, 3) of a target (y, x, 3), blurred as a picture shows it; none of it negative."""
    around = _around(np.asarray(target, dtype=np.float64), region, _radius(blur_px))
    return _blurred(np.clip(around, 0.0, None), blur_px)


def displaced(target: NDArray[Any], by_px: tuple[int, int]) -> NDArray[Any]:
    """A target (y, x, …), displaced by whole samples (y, x); its border goes on beyond it."""
    rows, columns = target.shape[:2]
    return _around(target, (-by_px[1], -by_px[0], columns, rows), 0)


def _resolved(values: Floats, target: Floats, region: Region) -> tuple[float, Floats]:
    """The blur by which a region's values (y, x) show a target (y, x) of the image, and the region of it, blurred."""
    best: tuple[float, float, Floats] | None = None
    for width in WIDTHS:
        shown = _blurred(_around(target, region, _radius(width)), width)
        left = _left_by_slope(values, shown)
        if best is not None and left >= best[0] - _LEAST_BETTER:  # of a pure wave all are alike
            break
        best = left, width, shown
    assert best is not None
    return best[1], best[2]


def _left_by_slope(values: Floats, shown: Floats) -> float:
    """Σ(y − b·x)² over Σy² of values and what they show, over their means."""
    if not (shown.mean() > 0 and values.mean() > 0):
        return 1.0
    x, y = shown / shown.mean() - 1, values / values.mean() - 1
    squares = float((x * x).sum() * (y * y).sum())
    return 1.0 - float((x * y).sum()) ** 2 / squares if squares > 0 else 1.0


def _around(target: NDArray[Any], region: Region, margin: int) -> NDArray[Any]:
    """A region of a target (y, x, …) with a margin around it; the border of the target goes on beyond it."""
    x, y, width, height = region
    spans = (np.arange(first - margin, first + n + margin) for first, n in ((y, height), (x, width)))
    return target[np.ix_(*(np.clip(span, 0, n - 1) for span, n in zip(spans, target.shape[:2], strict=True)))]


def _radius(blur_px: float) -> int:
    return int(_REACH * blur_px + 0.5)


def _blurred(around: Floats, blur_px: float) -> Floats:
    """An image (y, x, …) behind a Gaussian of a standard deviation in samples, without the margin that it reaches."""
    if blur_px == 0:
        return around
    radius = _radius(blur_px)
    kernel = np.exp(-0.5 * np.square(np.arange(-radius, radius + 1) / blur_px))
    kernel /= kernel.sum()
    for axis in (0, 1):
        n = around.shape[axis] - 2 * radius
        around = sum(weight * np.take(around, np.arange(k, k + n), axis=axis) for k, weight in enumerate(kernel))
    return around


# --- what is shown, and what is left ----------------------------------------------------------------------------------


def likeness(luminance: NDArray[np.floating], target: NDArray[np.floating]) -> Likeness:
    """How much of the structure of a target's luminance (y, x) that of a picture (y, x) has; both of one region."""
    x, y = (np.asarray(of, dtype=np.float64) for of in (target, luminance))
    if not (x.mean() > 0 and y.mean() > 0):
        return Likeness(0.0, math.inf)
    x, y = x / x.mean() - 1, y / y.mean() - 1
    products, squares = block_sums(x * y), block_sums(x * x)
    total = float(squares.sum())
    if total <= 1e-12 * x.size:
        return Likeness(0.0, math.inf)
    share = float(products.sum()) / total
    return Likeness(share, float(np.linalg.norm(products - share * squares)) / total)


def structure_left(pattern: SpecklePattern, shown: Floats) -> StructureLeft:
    """What isn't speckle in the ratio of a picture to what it shows of a target (y, x), as shares of its variance."""
    usable = pattern.usable
    rest = np.where(usable, pattern.values / pattern.contrast.mean - 1, 0.0)
    rank = np.full(usable.shape, -1)
    order = np.argsort(shown[usable], kind="stable")
    ranks = np.empty(order.size, dtype=np.int64)
    ranks[order] = np.arange(order.size) * _LEVELS // order.size
    rank[usable] = ranks
    levels = _together([_explained(rest, (rank == level).astype(np.float64)) for level in range(_LEVELS)])
    logarithm = np.log(np.maximum(shown, 1e-6 * shown.mean()))
    slopes = [np.gradient(logarithm, axis=axis) if logarithm.shape[axis] > 1 else 0 * rest for axis in (0, 1)]
    edges = _together([_explained(rest, np.where(usable, slope, 0.0)) for slope in slopes])
    return StructureLeft(levels, edges, _places(rest, usable))


def _explained(rest: Floats, feature: Floats) -> Likeness:
    """The share of the variance of what is left (y, x) that a feature (y, x) explains."""
    scale = float(np.square(feature).sum() * np.square(rest).sum())
    if scale <= 0:
        return Likeness(0.0, 0.0)
    sums = block_sums(rest * feature)
    squares = float(np.square(sums).sum())
    return Likeness((float(sums.sum()) ** 2 - squares) / scale, math.sqrt(2) * squares / scale)


def _together(shares: list[Likeness]) -> Likeness:
    return Likeness(sum(of.share for of in shares), math.hypot(*(of.standard_error for of in shares)))


def _places(rest: Floats, usable: NDArray[np.bool_]) -> Likeness:
    """The share of the variance of what is left (y, x) that is in blocks whose mean no speckle makes."""
    counts, sums = block_sums(usable.astype(np.float64)), block_sums(rest)
    means = (sums / np.sqrt(np.maximum(counts, 1)))[counts > 0]
    middle = float(np.median(means))
    spread = _MAD * float(np.median(np.abs(means - middle)))
    beyond = means[np.abs(means - middle) > _OUTLIER * spread]
    whole = max(float(np.square(rest).sum()), np.finfo(float).tiny)
    share = float((np.square(beyond) - spread**2).sum()) / whole
    return Likeness(share, 2 * spread * float(np.linalg.norm(beyond)) / whole)


# --- other targets ----------------------------------------------------------------------------------------------------


def _better_target(
    values: Floats,
    target: Floats,
    region: Region,
    blur_px: float,
    shown: Floats,
    others: OtherPlanes,
) -> BetterTarget | None:
    """The target that fits a region's values (y, x) best, if clearly better than the given one.

    target: (y, x), luminance of the image. shown: of it in the region, blurred by `blur_px`.
    """
    by_px, fits = _displacement(values, target, region), list[BetterTarget]()
    moved = {} if by_px == (0, 0) else {_displacement_in_words(by_px): np.asarray(displaced(target, by_px))}
    light, known = np.clip(target, 0.0, None), {k: target_luminance(of, region) for k, of in others.targets.items()}
    common = {
        "read as a signal, not as light,": light**_SIGNAL,
        "read as light, not as a signal,": light ** (1 / _SIGNAL),
        **{name: of for name, of in known.items() if of is not None},
    }
    turned = {"mirrored": target[:, ::-1], "upside down": target[::-1], "turned by 180°": target[::-1, ::-1]}
    most = _MOST_WORSE * _contrast_left(values, shown)
    for what, of in (moved | turned | common).items():
        rival = np.asarray(of, dtype=np.float64)
        if _contrast_left(values, _blurred(_around(rival, region, _radius(blur_px)), blur_px)) > most:
            continue
        _, fitted = _resolved(values, rival, region)
        if (contrasts := _contrasts_if_better(values, shown, fitted)) is not None:
            is_known_wrong = what in known and not others.are_mistakable
            by = by_px if what in moved else (0, 0)
            fits.append(BetterTarget(what, *contrasts, by, what in common, is_known_wrong))
    return min(fits, key=lambda of: of.contrast / of.given, default=None)


def _displacement_in_words(by_px: tuple[int, int]) -> str:
    sides = (("down", "up"), ("to the right", "to the left"))
    parts = [f"{abs(by)} px {names[by < 0]}" for by, names in zip(by_px, sides, strict=True) if by]
    return f"displaced by {' and '.join(reversed(parts))}"


def _displacement(values: Floats, target: Floats, region: Region) -> tuple[int, int]:
    """Samples (y, x) by which a target (y, x) of the image fits a region's values (y, x) best when it is displaced."""
    reach = min(_FARTHEST, *(n // 4 for n in values.shape))
    if reach == 0:
        return 0, 0
    around, n = _around(target, region, reach), values.size
    logarithms = (np.log(np.maximum(of, _FLOOR * of.mean())) for of in (values, around))
    y, x = (of - of.mean() for of in logarithms)
    spectra = [np.fft.rfft2(of, x.shape) for of in (y, x, np.ones_like(y))]
    shifts = tuple(slice(0, 2 * reach + 1) for _ in range(2))

    def sums(of: NDArray[np.complex128], weight: NDArray[np.complex128]) -> Floats:
        return np.asarray(np.fft.irfft2(of * weight.conj(), x.shape)[shifts])

    variance = sums(np.fft.rfft2(x * x), spectra[2]) - np.square(sums(spectra[1], spectra[2])) / n
    correlation = sums(spectra[1], spectra[0]) / np.sqrt(np.maximum(variance, 1e-9 * n))
    row, column = (int(k) for k in np.unravel_index(int(np.argmax(correlation)), correlation.shape))
    peak, tried = (reach - row, reach - column), dict[tuple[int, int], float]()
    width, _ = _resolved(values, displaced(target, peak), region)
    blurred = _blurred(_around(target, region, reach + _radius(width)), width)

    def contrast(by_px: tuple[int, int]) -> float:
        if by_px not in tried:
            y0, x0 = (reach - by for by in by_px)
            shown = blurred[y0 : y0 + values.shape[0], x0 : x0 + values.shape[1]]
            is_inside = shown.shape == values.shape and min(y0, x0) >= 0
            tried[by_px] = _contrast_left(values, shown) if is_inside else math.inf
        return tried[by_px]

    for at in ((0, 0), peak):
        for _ in range(_MOST_STEPS):
            best = min(((at[0] + j, at[1] + i) for j, i in itertools.product((0, -1, 1), repeat=2)), key=contrast)
            if best == at:
                break
            at = best
    return min(tried, key=tried.__getitem__)


def _contrast_left(values: Floats, shown: Floats) -> float:
    """The contrast that division of values (y, x) by what they show leaves; infinite where that can't be told."""
    counted = speckle_pattern(values, None, shown).counted
    return float(counted.std() / counted.mean()) if counted.size > 1 and counted.mean() > 0 else math.inf


def _contrasts_if_better(values: Floats, shown: Floats, rival: Floats) -> tuple[float, float] | None:
    """The contrasts that a rival and what is `shown` leave, where a picture (y, x) fits the rival better; else None."""
    usable = (shown >= _FLOOR * shown.mean()) & (rival >= _FLOOR * rival.mean())
    is_dark = 2 * int(usable.sum()) < usable.size or not (values[usable] > 0).any()
    if is_dark or not likeness(values, rival).at_least > LEAST_SHARE:
        return None

    def ratio(of: Floats, to: Floats) -> Floats:
        found = np.divide(of, to, out=np.ones_like(of), where=usable)
        return np.where(usable, found / found[usable].mean(), 1.0)

    given, left, difference = ratio(values, shown), ratio(values, rival), ratio(rival, shown)
    squares = block_sums(np.square(difference - 1))
    if not float(squares.sum()) ** 2 >= _LEAST_BLOCKS * float(np.square(squares).sum()) > 0:
        return None
    is_rival = likeness(given, difference).at_least > LEAST_SHARE
    if not is_rival or likeness(left, ratio(shown, rival)).at_least > LEAST_SHARE:
        return None
    return float(left[usable].std()), float(given[usable].std())


def _error_of_blocks(pattern: SpecklePattern) -> float:
    """Standard error of a contrast by the scatter of its square between blocks."""
    rest = np.where(pattern.usable, pattern.values / pattern.contrast.mean - 1, 0.0)
    squares, counts = block_sums(np.square(rest)), block_sums(pattern.usable.astype(np.float64))
    contrast = pattern.contrast.contrast
    scatter = float(np.linalg.norm(squares - contrast**2 * counts))
    return scatter / (2 * contrast * float(counts.sum())) if contrast > 0 else 0.0
