"""A Fourier bench by plain numpy: every pixel of the camera is a sum over the modulator's pixels in float64.

    E(x) = sinc(p·x/(λf)) · Σ_r exp(2πi·(path(r) − z·r²/(2f²))/λ) · exp(−2πi·x·r/(λf))

Nothing of holoview is used but the file format. Captures have random patterns from smooth to rough, exposures that suit
their light, shot noise, read noise and rounding.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class FourierLaboratory:
    """The bench as the file describes it, and what went wrong with single captures, by index.

    smoothness_px: of successive patterns. full_well: electrons at full scale. iris: radius as a direction sine.
    dimmed: to a share of the light, 0 by a shutter. exchanged: pictures that were stored under each other's name.
    overexposed: so many times too long. defocused: the camera by so many metres.
    """

    shape: tuple[int, int] = (32, 40)
    pitch_m: float = 8e-6
    levels: int = 256
    opd_m: float = 650e-9
    focal_length_m: float = 0.1
    wavelengths_m: tuple[float, ...] = (520e-9, 640e-9)
    each: int = 8
    smoothness_px: tuple[float, ...] = (6.0, 3.0, 1.5, 0.0)
    camera_shape: tuple[int, int] = (60, 72)
    camera_pitch_m: float = 4e-6
    bits: int = 12
    full_well: float = 16000.0
    read_noise: float = 3.0
    black: float = 64.0
    iris: float | None = None
    seed: int = 0
    dimmed: Mapping[int, float] = field(default_factory=dict)
    exchanged: tuple[tuple[int, int], ...] = ()
    overexposed: Mapping[int, float] = field(default_factory=dict)
    defocused: Mapping[int, float] = field(default_factory=dict)


def write_session(path: Path, lab: FourierLaboratory) -> Path:
    """Measures the bench and writes the capture file."""
    rng = np.random.default_rng(lab.seed)
    wavelength = np.repeat(lab.wavelengths_m, lab.each)
    count, full = len(wavelength), 2.0**lab.bits - 1
    a_count = lab.full_well / (full - lab.black)
    levels = np.stack([_pattern(rng, lab, k) for k in range(count)])
    power, laser = rng.choice([0.5, 0.7, 1.0], count), {λ: rng.uniform(0.6, 1.4) for λ in lab.wavelengths_m}
    images, exposure = [], np.empty(count)
    for k, λ in enumerate(wavelength):
        light = laser[λ] * power[k] * far_field(lab, levels[k], float(λ), lab.defocused.get(k, 0.0))
        exposure[k] = float(f"{0.8 / np.quantile(light, 0.999):.3g}")
        light = light * exposure[k] * lab.dimmed.get(k, 1.0) * lab.overexposed.get(k, 1.0)
        electrons = rng.poisson(lab.full_well * light) + lab.read_noise * rng.standard_normal(light.shape)
        images.append(np.clip(np.rint(electrons / a_count + lab.black), 0, full).astype(np.uint16))
    for a, b in lab.exchanged:
        images[a], images[b] = images[b], images[a]
    with h5py.File(path, "w") as h5:
        h5.attrs.update(format="holoview-captures", version=1)
        h5["slm1/levels"] = levels
        h5["slm1"].attrs.update(pitch=lab.pitch_m, num_levels=lab.levels, opd_range=lab.opd_m)
        h5["camera/images"] = np.stack(images)
        h5["camera"].attrs.update(pitch=lab.camera_pitch_m, bit_depth=lab.bits, electrons_per_count=a_count)
        h5["camera"].attrs.update(read_noise=lab.read_noise, black_level=lab.black)
        h5["wavelength"], h5["distance"] = wavelength, np.zeros(count)
        h5["power"], h5["exposure"] = power, exposure
        h5.create_group("geometry").attrs.update(focal_length=lab.focal_length_m)
        h5["geometry"].attrs.update({} if lab.iris is None else {"iris2_na": lab.iris})
    return path


def far_field(lab: FourierLaboratory, levels: NDArray[np.uint16], wavelength_m: float, defocus_m: float) -> Floats:
    """The light at the camera's pixels; its mean over one order is 1, but for the sinc."""
    x, r = (
        [(np.arange(n) - (n - 1) / 2) * pitch_m for n in shape]
        for shape, pitch_m in ((lab.camera_shape, lab.camera_pitch_m), (lab.shape, lab.pitch_m))
    )
    path = levels * lab.opd_m / (lab.levels - 1)
    path = path - defocus_m * (r[0][:, None] ** 2 + r[1] ** 2) / (2 * lab.focal_length_m**2)
    rows, columns = (
        np.exp(-2j * np.pi * np.outer(at, there) / (wavelength_m * lab.focal_length_m))
        * np.sinc(lab.pitch_m * at / (wavelength_m * lab.focal_length_m))[:, None]
        for at, there in zip(x, r, strict=True)
    )
    light = np.abs(rows @ np.exp(2j * np.pi * path / wavelength_m) @ columns.T) ** 2 / levels.size
    sine = np.hypot(x[0][:, None], x[1]) / lab.focal_length_m
    return light * (sine <= (np.inf if lab.iris is None else lab.iris))


def _pattern(rng: np.random.Generator, lab: FourierLaboratory, k: int) -> NDArray[np.uint16]:
    """Random levels of equal frequency, smooth over some pixels."""
    smooth = rng.standard_normal(lab.shape)
    if width := lab.smoothness_px[k % len(lab.smoothness_px)]:
        smooth = gaussian_filter(smooth, width)
    rank = smooth.ravel().argsort().argsort().reshape(lab.shape)
    return (rank * lab.levels // rank.size).astype(np.uint16)
