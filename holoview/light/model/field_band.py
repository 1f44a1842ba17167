"""The band of a complex field's samples: the share of its power at each frequency, and at the band's edge."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

EDGE_BAND = 0.45
"""Cycles a sample: beyond it lies the outer tenth of the samples' band."""
EQUAL_AMPLITUDES = 1e-5  # amplitudes of exp(iφ) in float32 differ by less
_LINES = 64


def edge_power(values: Any) -> float | None:
    """The share of a field's power in the outer tenth of its samples' band, along the axis that has more; 0…1.

    values: (frame, wavelength, y, x) complex, an array or a tensor. None for a field without light, and for one of
    phases alone: a pattern of a modulator, whose pixels fill the band, wasn't sampled from finer light.
    """
    host = values.detach().cpu().numpy() if hasattr(values, "detach") else np.asarray(values)
    amplitude = np.abs(host[..., :: max(1, host.shape[-2] // _LINES), :])
    if not amplitude.max() > 0 or amplitude.max() - amplitude.min() <= EQUAL_AMPLITUDES * amplitude.max():
        return None
    shares, fields = [], host.reshape(-1, *host.shape[-2:])
    squares = (np.square(fields.real) + np.square(fields.imag)).sum(axis=0)
    for axis in (0, 1):
        frequencies, power = line_spectrum(fields, axis, squares)
        shares.append(float(power[np.abs(frequencies) > EDGE_BAND].sum()))
    return max(shares)


def line_spectrum(
    values: NDArray[np.complexfloating], axis: int, squares: NDArray[np.floating]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies (cycles a sample, rising) along y (0) or x (1), and the share of the power of fields (k, y, x) there.

    squares: the power (y, x) of the fields together. Of more than `_LINES` lines along the axis, as many are taken as
    an even sample of the power: a line at each 64th of it, so that each of them counts alike.
    """
    lines = values if axis == 1 else values.swapaxes(1, 2)
    count, n = lines.shape[1:]
    of_line = squares.sum(axis=axis, dtype=np.float64)
    summed = of_line.cumsum()
    chosen, times = np.arange(count), np.ones(count)
    if count > _LINES and summed[-1] > 0:
        places = np.searchsorted(summed, (np.arange(_LINES) + 0.5) / _LINES * summed[-1])
        chosen, repeats = np.unique(places, return_counts=True)
        times = repeats / of_line[chosen]
    spectra = np.fft.fft(lines[:, chosen], axis=-1)
    power = np.einsum("kyx,y->x", np.square(spectra.real) + np.square(spectra.imag), times)
    return np.fft.fftshift(np.fft.fftfreq(n)), np.fft.fftshift(power / max(float(power.sum()), np.finfo(float).tiny))
