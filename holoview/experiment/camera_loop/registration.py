"""How counts follow from the model's intensities, and where the camera is, from pictures of probe patterns.

The gain of a camera and the power of a laser aren't known, so that counts have an unknown factor for each wavelength.
Probe patterns are smooth, so that their light stays alike however wrong the model is: of each wavelength the factor is
the median over planes and probes of Σ seen / Σ predicted, to which differences of speckle add nothing on average. The
camera's displacement in a plane is that of the seen light from the predicted one, by their correlation. It moves the
prediction; pictures stay as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.captures.patterns import random_levels
from holoview.diagnose.starts.picture import measure_displacement
from holoview.experiment.camera_loop.bench_camera import Picture
from holoview.experiment.camera_loop.camera_view import camera_view
from holoview.rig.description import RigDescription
from holoview.util import units
from holoview.util.errors import UserError

Floats = NDArray[np.float64]
Tensor = torch.Tensor

PROBE_SIGMAS_PX = (6.0, 3.0)
"""Blur of the probe patterns, modulator pixels."""

_ROUNDS = 2  # of finding the displacement, each from what the last one found
_MAX_SHIFT = 0.25  # of the picture's shorter side
_LEAST_SHIFT_PX = 0.05  # less is as much as noise; a camera that is centred then stays so
_MIN_CORRELATION = 0.3  # of seen and predicted light, below which a displacement isn't believed


@dataclass(frozen=True)
class Registration:
    """scale (wavelength,): counts per second and unit power for unit intensity. shift_m (plane, 2): of the camera.

    correlation (plane,): of seen and predicted light there. A displacement that can't be found is 0.
    """

    scale: Floats
    shift_m: Floats
    correlation: Floats

    def notes(self, planes_m: Floats) -> list[str]:
        """What couldn't be found."""
        return [
            f"at {units.format_rounded(float(z), 'mm')} pictures and prediction don't resemble each other (correlation "
            f"{c:.2f}); the camera counts as centred"
            for z, c in zip(planes_m, self.correlation, strict=True)
            if c < _MIN_CORRELATION
        ]


def probe_levels(rig: RigDescription, seed: int, sigmas_px: Sequence[float] = PROBE_SIGMAS_PX) -> NDArray[np.uint16]:
    """Grey levels (probe, modulator, y, x) of random patterns with these blurs, those of the probes by default."""
    rng = np.random.default_rng(seed)
    return np.array(
        [
            [random_levels(rng, rig.slm_shape, slm.num_levels, sigma_px) for slm in rig.bench.slms]
            for sigma_px in sigmas_px
        ],
        np.uint16,
    )


def register(
    rig: RigDescription, predicted: Tensor, pitch_m: float, pictures: Sequence[Sequence[Sequence[Picture]]]
) -> Registration:
    """What the probes show. predicted: intensities (plane, wavelength, probe, y, x); pictures: of the same, nested.

    pitch_m: of the predicted samples. Raises UserError where a laser's light doesn't reach the camera.
    """
    shifts, correlations, ratios = [], [], []
    for samples, of_plane in zip(predicted, pictures, strict=True):
        seen = np.array([[picture.light for picture in of_laser] for of_laser in of_plane])
        saturated = np.array([[picture.saturated for picture in of_laser] for of_laser in of_plane])
        found = _find_shift(rig, samples, pitch_m, seen)
        shifts.append(found.shift_m)
        correlations.append(found.correlation)
        usable = found.covered & ~saturated
        totals = [np.where(usable, values, 0.0).sum(axis=(2, 3)) for values in (seen, found.model)]
        ratios.append(totals[0] / np.maximum(totals[1], 1e-30))
    scale = np.median(np.concatenate(ratios, axis=1), axis=1)
    if not (scale > 0).all():
        dark = pictures[0][int(np.argmin(scale))][0].capture.wavelength_m[0]
        text = f"no light of {units.format_rounded(float(dark), 'nm')} in the pictures"
        raise UserError("camera", text, remedy="check the laser, its shutter and the longest exposure allowed")
    return Registration(scale, np.array(shifts), np.array(correlations))


@dataclass(frozen=True)
class _Placed:
    """A prediction on the camera's pixels. covered: which of them it covers. model: 0 elsewhere."""

    shift_m: Floats
    correlation: float
    model: Floats
    covered: NDArray[np.bool_]


def _find_shift(rig: RigDescription, samples: Tensor, pitch_m: float, seen: Floats) -> _Placed:
    """The prediction where it resembles the seen light most. samples, seen: (wavelength, probe, y, x)."""
    camera_pitch_m = rig.bench.camera.pitch_m
    centred = best = _place(rig, samples, pitch_m, seen, np.zeros(2))
    tried = centred
    for _ in range(_ROUNDS):
        images = (values.reshape(-1, *rig.camera_shape).astype(np.float32) for values in (seen, tried.model))
        shift = tried.shift_m + measure_displacement(*images) * camera_pitch_m
        if np.abs(shift).max() > camera_pitch_m * min(rig.camera_shape) * _MAX_SHIFT:
            break  # the correlation has no peak that means anything
        tried = _place(rig, samples, pitch_m, seen, shift)
        best = max(best, tried, key=lambda placed: placed.correlation)
    is_moved = np.abs(best.shift_m).max() >= _LEAST_SHIFT_PX * camera_pitch_m
    return best if is_moved and best.correlation >= _MIN_CORRELATION else centred


def _place(rig: RigDescription, samples: Tensor, pitch_m: float, seen: Floats, shift_m: Floats) -> _Placed:
    shape = (samples.shape[-2], samples.shape[-1])
    view = camera_view(rig, shape, pitch_m, (float(shift_m[0]), float(shift_m[1])))
    covered = view.covers(None)
    model = view.picture(samples).double().numpy() * covered
    return _Placed(shift_m, _correlation(seen, model, covered), model, covered)


def _correlation(first: Floats, second: Floats, covered: NDArray[np.bool_]) -> float:
    """The mean correlation coefficient of pairs of images (…, y, x) over the pixels that are covered; 0 without any."""
    if not covered.any():
        return 0.0
    a, b = (values[..., covered] - values[..., covered].mean(axis=-1, keepdims=True) for values in (first, second))
    power = np.sqrt((a**2).sum(-1) * (b**2).sum(-1))
    return float(np.mean((a * b).sum(-1) / np.maximum(power, 1e-30)))
