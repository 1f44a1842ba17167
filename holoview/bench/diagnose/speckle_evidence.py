"""When the light on the modulator is sought by speckle, and in which part of the pictures."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Predictor
from holoview.bench.captures.prepared_captures import PreparedCaptures, neighbour_variance, prepare_captures
from holoview.bench.captures.speckle_measure import window_of
from holoview.bench.diagnose.config import RegionConfig
from holoview.bench.diagnose.crop import middle_captures
from holoview.bench.diagnose.parts import cut_parts
from holoview.bench.diagnose.speckle_light import NO_VALUES, NOMINAL, NearBeam, Pictures, SpeckleSearch
from holoview.bench.diagnose.speckle_search import FoundLight, find_light
from holoview.util.progress import ProgressCallback, TextCallback

_MOST_PICTURES = 4
"""[captures] Predicted together in a search by speckle; of more, derivatives find most causes. Evidence: the cost."""
_MOST_NEAR_PX = 250_000
"""[pixels] Of the modulators, in a near field, in whose whole pictures light is sought; in five parts of larger ones.
Evidence: measured: one modulator of 384 × 288 pixels and three pictures take 60 to 100 s of a core, and others in
proportion."""
FAR_CHI2 = 4.0
"""[χ²/n] Predictions that leave less are near enough for derivatives, whatever noise does to the grains. Evidence: none
recorded."""
_MOST_PART_PX = 350_000
"""[pixels] Of all modulators in all pictures, of a near field in which light is sought. Evidence: the cost."""
_STANDING = 0.85
"""[1] Correlation of held-out speckle above which the nominal bench needs no such search. Evidence: none recorded."""
_GAIN = 0.1  # [1] Of that correlation, below which nothing was found. Evidence: ten times what chance gives.
_MISSING_GAIN = 1 / 3
"""[1] Of what that correlation lacks of 1, the same where speckle nearly stands. Evidence: a reason: least squares
judge what is found."""
_LEAST = 0.3  # [1] Of it, below which nothing is handed on. Evidence: none recorded.
_WINDOW_PX = 320, 640
"""[px] Rows and columns of the brightest window, in which light is sought and causes are judged. Evidence: the cost."""
_PART_PX = 192, 384  # [px] Of the brightest part of that window, where the search begins. Evidence: the cost.
NEAR_CORRELATION = 0.9
"""[1] Of held-out speckle with the light that was found, above which further causes are searched beside it."""
_MOST_THREADS = 4  # each of which holds the fields of an ascent. Evidence: the memory.
_REGION = RegionConfig()
_OF_TWO = "gap", "slm_alignment"
_CAUSES = ("beam", "slm_flatness", "stroke", "undiffracted", "camera_black", "camera_alignment")


@dataclass(frozen=True)
class LightWindow:
    """The window of a few pictures in which light may be sought by speckle and causes judged.

    beam: what brightness tells on the nominal bench; None on a Fourier bench. is_first: whether several causes are so
    large that single ones would mislead, so that light is sought before these.
    """

    captures: Captures
    beam: NearBeam | None
    is_first: bool


def window_for_light(captures: Captures, effects: Collection[str]) -> LightWindow | None:
    """The window in which light may be sought by speckle.

    effects: ids of the candidates. None where there are many pictures or the nominal bench is near, and where a cause
    that this search may name isn't a candidate: then a search by derivatives does better, or has to say so.
    """
    is_alike = not captures.is_fourier or len(np.unique(captures.distance_m)) == len(captures.wavelengths_m) == 1
    causes = {*_CAUSES, *([] if captures.is_fourier else ["distance"])}
    causes |= {*_OF_TWO} if captures.gap_m is not None else set()
    if not (is_alike and len(captures) <= _MOST_PICTURES and causes <= {*effects}):
        return None
    window = window_of(captures, _WINDOW_PX)
    data = prepare_captures(window)
    if _nominal_chi2(data) < FAR_CHI2:
        return None
    beam, stands = near_beam(window), SpeckleSearch(Pictures(data)).held_out(None) > _STANDING
    has_beam = beam is not None and beam.explained > 0
    return LightWindow(window, beam, is_first=not stands and (beam is None or has_beam))


def near_beam(window: Captures) -> NearBeam | None:
    """What the brightness of near fields tells of the beam on the nominal bench; None on a Fourier bench."""
    return None if window.is_fourier else NearBeam.beside(NOMINAL, _brightest(window))


def light_by_speckle(
    window: LightWindow,
    progress: ProgressCallback,
    tell: TextCallback,
    config: RegionConfig = _REGION,
    earlier: Mapping[str, Mapping[str, float]] = NO_VALUES,
    threads: int = 1,
) -> FoundLight | None:
    """The light that makes the speckle of a window stand; None where none does.

    tell: is told why it wasn't sought. config: how large parts are. earlier: values of causes that another search has
    found, from which this one goes on. threads: in which independent parts of the search run, at most.
    """
    captures, beam, threads = window.captures, window.beam, min(threads, _MOST_THREADS)
    if beam is None:
        whole, part = (Pictures(prepare_captures(one)) for one in (captures, window_of(captures, _PART_PX)))
        found = find_light(whole, part, progress, earlier=earlier, threads=threads)
    else:
        is_small = captures.levels[0].size <= _MOST_NEAR_PX
        pictures = beam.pictures if is_small else _parts(beam, config)
        if pictures is None:
            tell("The light wasn't sought by speckle: the pictures show too little around their middle for five parts")
            return None
        found = find_light(pictures, pictures, progress, beam, earlier, threads)
    gain = min(_GAIN, _MISSING_GAIN * (1 - found.before))
    gain = 0.0 if beam is not None and beam.explained > 0 else gain  # where brightness gains, speckle may stand before
    return found if found.after > max(found.before + gain, _LEAST) else None


def _parts(beam: NearBeam, config: RegionConfig) -> Pictures | None:
    """Parts of whole pictures where a beam lights them; None where no part fits."""
    data = beam.pictures.data
    lit = {"size": math.exp(beam.shape["log_size"]), **beam.shape} if beam.explained > 0 else None
    parts = cut_parts(data, middle_captures(data.captures, config), lit)
    return None if parts is None else Pictures(parts.data, parts.captures)


def _brightest(captures: Captures) -> Pictures:
    """As many pictures as can be predicted together in a search, the brightest ones, in the plane of the brightest."""
    count = max(1, _MOST_PART_PX // min(captures.levels[0].size, _MOST_NEAR_PX))
    brightest = np.argsort(-captures.images.mean(axis=(1, 2), dtype=np.float64), kind="stable")
    in_plane = brightest[captures.distance_m[brightest] == captures.distance_m[brightest[0]]][:count]
    chosen = captures if len(captures) == len(in_plane) else captures.subset(np.sort(in_plane))
    return Pictures(prepare_captures(chosen))


def describe_light(light: FoundLight) -> str:
    """In words, how well the speckle stands with the light that was found, and what it loses without each part."""
    parts = ", ".join(f"{part} {lost:.3f} ({sigmas:.1f} σ)" for part, (lost, sigmas) in light.losses.items())
    where = "five parts of the pictures" if light.is_of_parts else "the brightest window, which was judged"
    told = (
        f"The light on the modulator was sought by speckle in {where}. On held-out "
        f"pixels the correlation of local contrasts went from {light.before:.2f} to {light.after:.2f}."
    )
    if light.was_ended:
        told += " This search was ended early: with more time it may find better light."
    else:
        told += f" Without each part it is lower by: {parts}."
    if light.explained is None:
        return told
    return f"{told} A beam explains {max(light.explained, 0.0):.0%} of the brightness that even light leaves."


def _nominal_chi2(data: PreparedCaptures) -> float:
    """χ²/n of the nominal bench, each picture with its own gain."""
    indices = np.arange(len(data.captures))
    predicted = Predictor(data.captures, cache_mb=1)(indices, {}).signal.numpy()
    variance = neighbour_variance(data, indices)
    shares = zip(predicted, data.light, variance, data.usable, strict=True)
    gains = [float((p * i / v)[u].sum() / (p * p / v)[u].sum()) for p, i, v, u in shares]
    chi2 = (data.light - np.array(gains, np.float32)[:, None, None] * predicted) ** 2 / variance
    return float(chi2[data.usable].mean())
