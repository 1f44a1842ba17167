"""How near a complex field, such as a compressed hologram, is to another one, and its views to those of the other.

In the plane of the hologram JPEG Pleno's test conditions take SNR and SSIM, in views PSNR, SSIM and VIFp; none agrees
well with what people see (Ahar et al., arXiv 2010.11306).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from holoview.holograms.fields.propagation import Method, choose_method
from holoview.holograms.fields.synthetic_aperture import SyntheticAperture, published_picture, seen_through
from holoview.holograms.fields.wavefield import Wavefield
from holoview.holograms.metrics.fidelity import psnr
from holoview.light.numerics.structural_similarity import WINDOW, similarity
from holoview.util.errors import UserError


def hologram_scores(field: Wavefield, reference: Wavefield) -> dict[str, float]:
    """SNR (dB) and SSIM of a field in its own plane. Raises UserError as `field_snr` and `field_ssim` do."""
    return {
        "snr_db": field_snr(field.values, reference.values),
        "ssim": field_ssim(field.values, reference.values),
    }


def scores_at(
    field: Wavefield,
    reference: Wavefield,
    distance_m: float,
    aperture: SyntheticAperture | None = None,
    *,
    method: Method = "auto",
    shape: tuple[int, int] | None = None,
    percentiles: Sequence[float] = (0.0, 100.0),
) -> dict[str, float]:
    """`view_scores` of the amplitude at a distance, of the light that passes an aperture; of the whole if None.

    method, shape, percentiles: as of `choose_method` and `published_picture`. The reference decides the method, the
    window, and which amplitudes are black and white.

    Raises UserError for fields of other wavelengths, pitch or shape, and as the functions named above do.
    """
    check_alike(field, reference)
    choice = choose_method(reference, distance_m, method)
    seen, expected = (
        _amplitude(each, aperture or SyntheticAperture((0, 0), each.shape), distance_m, choice.method, choice.window)
        for each in (field, reference)
    )
    return view_scores(
        published_picture(seen, shape, percentiles, like=expected), published_picture(expected, shape, percentiles)
    )


def check_alike(field: Wavefield, reference: Wavefield) -> None:
    """Raises UserError unless two fields have the same samples and wavelengths."""
    is_alike = (
        field.values.shape == reference.values.shape
        and np.allclose(field.pitch_m, reference.pitch_m, rtol=1e-6)
        and np.allclose(field.wavelengths_m, reference.wavelengths_m, rtol=1e-6)
        and field.reference_radius_m == reference.reference_radius_m
    )
    if not is_alike:
        raise UserError(field.name or "field", field.describe(), expected=f"as the reference: {reference.describe()}")


def _amplitude(
    field: Wavefield, aperture: SyntheticAperture, distance_m: float, method: Method, window: Any
) -> NDArray[np.floating]:
    """|u| (y, x, colour) at a distance, the r.m.s. over frames."""
    intensity = seen_through(field, aperture, distance_m, method, window).intensity
    return np.moveaxis(np.sqrt(intensity.numpy()), 0, -1)


# --- in the plane of the hologram -------------------------------------------------------------------------------------


def field_snr(field: NDArray[Any], reference: NDArray[Any]) -> float:
    """10·log10(Σ|r|²/Σ|u − r|²), dB, of complex fields of equal shape; infinite for equal ones.

    Raises UserError for other shapes and for a dark reference.
    """
    _check(field, reference)
    signal = float(np.sum(np.abs(reference, dtype=np.float64) ** 2))
    if signal == 0:
        raise UserError("reference", "a dark field", expected="light")
    noise = float(np.sum(np.abs(np.asarray(field, np.complex128) - reference) ** 2))
    return 10 * math.log10(signal / noise) if noise > 0 else math.inf


def field_ssim(field: NDArray[Any], reference: NDArray[Any]) -> float:
    """The mean of the SSIM of real and of imaginary parts of complex fields (…, y, x).

    The range of values is that of the reference's real and imaginary parts together. Raises UserError for other shapes,
    for fields smaller than 11 × 11 samples, and for a reference that is the same everywhere.
    """
    _check(field, reference)
    parts = [np.stack([values.real, values.imag]) for values in (np.asarray(field), np.asarray(reference))]
    return _ssim(parts[0], parts[1], float(np.ptp(parts[1])))


# --- of views ---------------------------------------------------------------------------------------------------------


def view_scores(view: NDArray[np.uint8], reference: NDArray[np.uint8]) -> dict[str, float]:
    """PSNR (dB), SSIM and VIFp of 8-bit views (y, x) or (y, x, colour), of all colours together.

    Without VIFp for views smaller than 41 × 41 samples and of an even reference. Raises UserError for other shapes and
    for views smaller than 11 × 11 samples.
    """
    _check(view, reference)
    seen, expected = (np.moveaxis(np.atleast_3d(values), -1, 0) / 255.0 for values in (view, reference))
    scores = {"psnr_db": psnr(seen, expected), "ssim": _ssim(seen, expected, 1.0)}
    if min(seen.shape[1:]) >= _VIF_SIDE and all(np.ptp(colour) > 0 for colour in expected):
        scores["vifp"] = float(np.mean([vifp(*pair) for pair in zip(255 * seen, 255 * expected, strict=True)]))
    return scores


_VIF_SIDE = 41  # samples that leave some for the window of the coarsest scale
_VIF_NOISE = 2.0  # variance of the visual noise, of values from 0 to 255
_VIF_LEAST = 1e-10  # a variance below is none


def vifp(view: ArrayLike, reference: ArrayLike) -> float:
    """The visual information fidelity, in the pixel domain, of a view (y, x) of values 0 … 255; 1 for equal views.

    Over four scales, each half the size of the one before, and over Gaussian windows of 17, 9, 5 and 3 samples with
    σ = N/5, Σ log(1 + g²·σ_r²/(σ_v² + σ_n²)) / Σ log(1 + σ_r²/σ_n²), with the gain g = cov/σ_r² of the view on the
    reference, the variance σ_v² that g leaves, and σ_n² = 2 (Sheikh & Bovik, IEEE Trans. Image Process. 15, 430 (2006),
    with single pixels in place of wavelet coefficients, as in the authors' own version).

    Raises UserError for other shapes, for views smaller than 41 × 41 samples and for an even reference.
    """
    seen, expected = np.asarray(view, np.float64), np.asarray(reference, np.float64)
    _check(seen, expected)
    if seen.ndim != 2 or min(seen.shape) < _VIF_SIDE:
        raise UserError("view", f"shape {seen.shape}", expected=f"(y, x) of at least {_VIF_SIDE} samples each")
    kept = total = 0.0
    for scale in range(4):
        size = 2 ** (4 - scale) + 1
        if scale > 0:
            seen, expected = (_windowed(values, size)[::2, ::2] for values in (seen, expected))
        mean, mean_r = _windowed(seen, size), _windowed(expected, size)
        variance = np.maximum(_windowed(seen * seen, size) - mean * mean, 0)
        variance_r = np.maximum(_windowed(expected * expected, size) - mean_r * mean_r, 0)
        covariance = _windowed(seen * expected, size) - mean * mean_r
        variance_r[variance_r < _VIF_LEAST] = 0
        has_both = (variance_r >= _VIF_LEAST) & (variance >= _VIF_LEAST)
        gain = np.where(has_both, np.maximum(covariance, 0) / (variance_r + _VIF_LEAST), 0)
        left = np.maximum(variance - gain * covariance, _VIF_LEAST)
        kept += float(np.log10(1 + gain**2 * variance_r / (left + _VIF_NOISE)).sum())
        total += float(np.log10(1 + variance_r / _VIF_NOISE).sum())
    if total == 0:
        raise UserError("reference", "the same value everywhere", expected="a picture")
    return kept / total


def _windowed(values: NDArray[np.float64], size: int) -> NDArray[np.float64]:
    """Means over a Gaussian window of so many samples, σ = size/5, where it lies inside."""
    weights = np.exp(-0.5 * ((np.arange(size) - size // 2) / (size / 5)) ** 2)
    weights /= weights.sum()
    rows = np.lib.stride_tricks.sliding_window_view(values, size, axis=0) @ weights
    return np.asarray(np.lib.stride_tricks.sliding_window_view(rows, size, axis=1) @ weights)


def _ssim(values: NDArray[Any], expected: NDArray[Any], data_range: float) -> float:
    """SSIM of images (…, y, x)."""
    if min(values.shape[-2:]) < WINDOW or not data_range > 0:
        found = f"{values.shape[-1]} × {values.shape[-2]} samples with a range of {data_range:g}"
        raise UserError("image", found, expected=f"at least {WINDOW} × {WINDOW} samples that differ")
    image, target = (
        torch.from_numpy(np.array(part, dtype=np.float64)).reshape(-1, *part.shape[-2:]) for part in (values, expected)
    )
    return float(similarity(image, target, data_range).mean())


def _check(field: NDArray[Any], reference: NDArray[Any]) -> None:
    if np.shape(field) != np.shape(reference) or np.size(field) == 0:
        raise UserError("field", f"shape {np.shape(field)}", expected=f"that of the reference, {np.shape(reference)}")
