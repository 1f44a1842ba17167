"""One measurement session of a display as data, SI units, and the nominal bench that it implies."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.model.effects.effect import DataProperties
from holoview.model.system import Modulator, Relay, Sampling, System

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SlmSpec:
    """A modulator: level 0 … num_levels − 1 adds, nominally in equal steps, 0 … opd_range_m of optical path."""

    pitch_m: float
    num_levels: int
    opd_range_m: float


@dataclass(frozen=True)
class Camera:
    """pitch_m is referred to the modulator's plane; a pixel saturates at 2^bit_depth − 1 counts."""

    pitch_m: float
    bit_depth: int
    electrons_per_count: float
    read_noise: float
    black_level: float

    @property
    def saturation(self) -> int:
        """Counts of a saturated pixel."""
        return int(2**self.bit_depth) - 1

    def noise_variance(self, signal: NDArray[np.floating]) -> NDArray[np.floating]:
        """Variance in counts² of an expected signal (counts above black): shot and read noise, quantisation."""
        electrons = np.maximum(signal, 0.0) * self.electrons_per_count
        return (electrons + self.read_noise**2) / self.electrons_per_count**2 + 1 / 12


@dataclass(frozen=True)
class Captures:
    """levels (capture, modulator, y, x), images (capture, y, x) in counts; one value a capture of the rest.

    distance_m is nominal: from the last modulator, or from the focal plane of a Fourier bench (with focal_length_m).
    """

    levels: NDArray[np.unsignedinteger]
    images: NDArray[np.uint16]
    wavelength_m: Floats
    distance_m: Floats
    power: Floats
    exposure_s: Floats
    slms: tuple[SlmSpec, ...]
    camera: Camera
    gap_m: float | None = None
    iris1_na: float | None = None
    iris2_na: float | None = None
    focal_length_m: float | None = None

    def __len__(self) -> int:
        return len(self.levels)

    @property
    def is_fourier(self) -> bool:
        """Whether the camera is in the focal plane of a lens."""
        return self.focal_length_m is not None

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of an image."""
        return self.images.shape[1], self.images.shape[2]

    @property
    def wavelengths_m(self) -> Floats:
        """The different wavelengths, rising."""
        return np.unique(self.wavelength_m)

    @property
    def upsample(self) -> int:
        """Simulation samples a modulator pixel and axis: those of the camera where they fit, never fewer than two."""
        return max(2, min(16, round(self.slms[0].pitch_m / self.camera.pitch_m)))

    def data_properties(self) -> DataProperties:
        """What these data can tell about."""
        irises = (self.iris1_na is not None, self.iris2_na is not None)
        wavelengths, planes, powers = (
            len(np.unique(values)) for values in (self.wavelength_m, self.distance_m, self.power)
        )
        return DataProperties(wavelengths, planes, powers, len(self.slms), irises, self.is_fourier)

    def subset(self, indices: Sequence[int] | NDArray[np.integer]) -> Captures:
        """Some of the captures, in that order."""
        chosen = np.asarray(indices)
        names = ("levels", "images", "wavelength_m", "distance_m", "power", "exposure_s")
        return dataclasses.replace(self, **{name: getattr(self, name)[chosen] for name in names})

    def drive(self, capture: int) -> Floats:
        """Share of the stroke that was sent, (modulator, y, x)."""
        most = np.array([panel.num_levels - 1 for panel in self.slms], dtype=np.float64)
        return self.levels[capture] / most[:, None, None]

    def nominal_system(
        self, wavelengths_m: Sequence[float] | None = None, planes_m: Sequence[float] | None = None
    ) -> System:
        """The nominal bench at these wavelengths and planes (all that occur when None), seen by a mono camera.

        A Fourier bench has its planes at focal_length_m + distance from the lens.
        """
        wavelengths = self.wavelengths_m if wavelengths_m is None else np.asarray(wavelengths_m, dtype=np.float64)
        own = np.unique(self.distance_m) + (self.focal_length_m or 0.0)
        planes = own if planes_m is None else np.asarray(planes_m, dtype=np.float64)
        shape = (self.levels.shape[2], self.levels.shape[3])
        return System(
            wavelengths_m=wavelengths,
            amplitudes=np.ones((1, len(wavelengths))),
            modulators=tuple(
                Modulator(
                    pitch_m=p.pitch_m, shape=shape, stroke_m=p.opd_range_m, levels=np.linspace(0.0, 1.0, p.num_levels)
                )
                for p in self.slms
            ),
            gap_m=self.gap_m,
            planes_m=planes,
            relay1=Relay(iris_na=self.iris1_na),
            relay2=Relay(iris_na=None if self.is_fourier else self.iris2_na),
            observer="mono",
            sampling=Sampling(upsample=self.upsample),
        )
