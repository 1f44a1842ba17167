"""How near a complex field, such as a compressed hologram, is to another, and a view of it to that of the other.

In the plane of the hologram JPEG Pleno's test conditions take SNR and SSIM, in views PSNR and SSIM; none of them agrees
well with what people see (Ahar et al., arXiv 2010.11306).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.metrics.fidelity import psnr
from holoview.numerics.structural_similarity import WINDOW, similarity
from holoview.util.errors import UserError


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


def view_scores(view: NDArray[np.uint8], reference: NDArray[np.uint8]) -> dict[str, float]:
    """PSNR (dB) and SSIM of 8-bit views (y, x) or (y, x, colour), of all colours together.

    Raises UserError for other shapes and for views smaller than 11 × 11 samples.
    """
    _check(view, reference)
    seen, expected = (np.moveaxis(np.atleast_3d(values), -1, 0) / 255.0 for values in (view, reference))
    return {"psnr_db": psnr(seen, expected), "ssim": _ssim(seen, expected, 1.0)}


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
