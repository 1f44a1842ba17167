"""Intensity on a camera behind one or two modulators, in the near field and on a Fourier bench.

CameraModel         the common part: fields whose intensities add up, modulators, a cache of tensors
NearFieldModel      modulators, gap, relays and free space, for the frequencies that the relays pass
FourierBenchModel   the camera in the back focal plane of a lens behind one modulator

The near field chains the elements of `optics.bench` in the order of `engine.frame`. Each stage gives its light with a
key that names all values it depends on, so that light is computed only if its key isn't in the cache.

On a Fourier bench

    E(x) = Σ_j t_j · exp(−2πi·(x/(λf) − s)·r_j) · sinc(p·(x/(λf) − s)),  I = |E|²

t_j is the transmission of the modulator at r_j, p the pitch of these points, f the focal length, s = sin θ/λ the
illumination's slope. The sum over the modulator's pixels is evaluated directly at the camera's pixels. A modulator
pixel is a uniform square, across which the illumination's phase goes on: hence the sinc around the illumination's
direction (Goodman, Introduction to Fourier Optics, 3rd ed., section 5.2). A defocus d adds the optical path
−d·|r|²/(2f²), in the paraxial approximation.

`sample_intensity` takes a field that is known by its spectrum to the camera's pixels, for any position of the camera.

If the camera's pixels coincide with the simulation's samples, the samples are used directly. A camera with another
pitch, shift or magnification gets the field at its pixels exactly, as a Fourier sum over the spectrum. For a rotated
camera the sum is taken where columns of a fine grid cross its rows, and the intensity is interpolated along each row,
with an error of 1e-4 (`numerics.turned_grid`). A pixel larger than a sample averages the intensity at several points;
one that integrates averages it at Gauss–Legendre places across its area, as many as the finest structure of the light
needs (`pixel_quadrature`). A camera that moves during an exposure averages it over positions.

`FrequencyBand` has the FFTs between a field and the frequencies that a relay passes. With an iris most frequencies of a
padded grid are zero, and columns outside the band are never transformed. The field occupies the first samples of the
padded grid, wherever the plan puts it: propagation is a convolution, so that a shift of the field within the grid only
shifts the result.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import torch

from holoview.light.engine.frame import relay_behind, spectrum_behind_modulators
from holoview.light.model.bench_parts import Relay
from holoview.light.model.effects.effect import MODULATOR_HOOKS
from holoview.light.model.effects.hook_contexts import ModulatorContext, Pose, RelayContext
from holoview.light.model.passband import Transfer
from holoview.light.model.plan import Grid, Plan
from holoview.light.numerics.fourier import chirp_z_transform, phasor_of_turns
from holoview.light.numerics.resample import affine_warp, centred_indices
from holoview.light.numerics.sampling import AREA, frequency_indices
from holoview.light.numerics.turned_grid import Nodes, turned_power
from holoview.light.optics.bench import PixelAxis, illuminated, plane_wave, spectrum_of_pixels
from holoview.light.optics.propagate import nominal_pupil, transfer_function_at
from holoview.light.optics.slm import phasor
from holoview.light.optics.torch_effects import TorchEffects, modulator_context

Tensor = torch.Tensor
_PITCH_TOLERANCE = 1e-6  # relative difference of pitches that are meant to be equal
_FOURIER_SUMS = 16  # matrices kept: both axes at some wavelengths, 20 MB each for pictures of 1600 × 1200 pixels
POSE_HOOKS = ("camera_pose", "camera_pose_at", "camera_motion")
"""The hooks on which a picture of the same light depends."""


_AREA_ERROR = 0.005
_MOST_NODES = 8  # a pixel that holds three grains a side
_MIDDLE: Nodes = ((0.0, 1.0),)


@lru_cache(maxsize=256)
def pixel_quadrature(grains: float) -> Nodes:
    """Places along a side of a pixel, in pixels from its middle, and their weights: the mean over its area.

    grains: periods of the finest structure of the intensity along the side. Gauss–Legendre: the fewest places with
    which the mean of every wave of at most so many periods, sin(πx)/(πx) of its contrast, is right to 0.005 of it; at
    most 8.
    """
    periods = np.linspace(0.0, max(grains, 1e-3), 65)
    for count in range(1, _MOST_NODES + 1):
        places, weights = (values / 2 for values in np.polynomial.legendre.leggauss(count))
        means = weights @ np.cos(2 * np.pi * places[:, None] * periods)
        if np.abs(means - np.sinc(periods)).max() <= _AREA_ERROR:
            break
    return tuple(zip(places.tolist(), weights.tolist(), strict=True))


@dataclass(frozen=True)
class PixelGrid:
    """The camera's pixels, referred to the modulator's plane and centred on the axis: pitch, (rows, columns).

    points_per_axis: a pixel averages the intensity over this number of points along each axis; None: one point for
    each simulation sample that fits on the pixel; `AREA`: it averages over its area.
    axis_m: (y, x), where the axis is from the centre of the picture.
    """

    pitch_m: float
    shape: tuple[int, int]
    points_per_axis: int | None = None
    axis_m: tuple[float, float] = (0.0, 0.0)


def sample_intensity(spectrum: Tensor, band: FrequencyBand, grid: Grid, pixel_grid: PixelGrid, pose: Pose) -> Tensor:
    """|field|² on the camera, (y, x).

    spectrum: of the field on the padded simulation `grid`, in a band. pose: how the camera is shifted, rotated and
    magnified; its `softness` is the fraction of the image that is interpolated linearly between samples, which blurs,
    and acts only if the camera has the simulation's pitch.
    """
    same_pitch = abs(pixel_grid.pitch_m / grid.pitch_m - 1) < _PITCH_TOLERANCE
    points, nodes = pixel_grid.points_per_axis, _MIDDLE
    if points == AREA:
        highest = max(min(k / n, 0.5) for k, n in zip(band.max_indices, band.padded, strict=True))
        nodes = pixel_quadrature(round(2 * highest * pixel_grid.pitch_m / grid.pitch_m, 6))
    points = points or (1 if points == AREA else max(1, round(pixel_grid.pitch_m / grid.pitch_m)))
    if len(nodes) == 1 and same_pitch and points == 1 and pixel_grid.shape == grid.shape and pose.is_identity:
        return squared_magnitude(band.inverse(spectrum, grid.shape))
    point_grid = PixelGrid(pixel_grid.pitch_m / points, (pixel_grid.shape[0] * points, pixel_grid.shape[1] * points))
    intensity = _intensity_by_fourier_sum if pose.rotation_rad == 0 else _intensity_at_turned_points
    image = mean_over_pixels(intensity(spectrum, band, grid, point_grid, pose, nodes), points)
    if pose.softness and same_pitch:
        unshifted = squared_magnitude(band.inverse(spectrum, grid.shape))
        soft = affine_warp(unshifted, pose.inverse_affine(grid.pitch_m), shape=pixel_grid.shape)
        image = (1 - pose.softness) * image + pose.softness * soft
    return image


def squared_magnitude(field: Tensor) -> Tensor:
    """|field|² of a complex field of any shape."""
    return field.real.square() + field.imag.square()


def _intensity_by_fourier_sum(
    spectrum: Tensor, band: FrequencyBand, grid: Grid, points: PixelGrid, pose: Pose, nodes: Nodes
) -> Tensor:
    """The intensity at points whose rows and columns are parallel to the grid's: a Fourier sum along each axis.

    nodes: places across a point, of which the intensity is the weighted mean.

    Zero beyond half the padded grid, where the periodic field would repeat itself.
    """
    affine, ratio = pose.inverse_affine(points.pitch_m), points.pitch_m / grid.pitch_m

    def sums(axis: int, node: float) -> Tensor:
        scale, offset = affine[axis][axis], affine[axis][2]
        place = (points.shape[axis], scale, offset + node * scale, ratio)
        return _fourier_sum(place, (grid.shape[axis], grid.padded[axis], band.max_indices[axis]), spectrum.dtype)

    total: Tensor | float = 0.0
    for node_x, weight_x in nodes:
        lines = spectrum @ sums(1, node_x).T
        for node_y, weight_y in nodes:
            total = total + weight_y * weight_x * squared_magnitude(sums(0, node_y) @ lines)
    assert isinstance(total, Tensor)
    return total


@lru_cache(maxsize=_FOURIER_SUMS)
def _fourier_sum(points: tuple[int, float, float, float], grid: tuple[int, int, int], dtype: torch.dtype) -> Tensor:
    """The matrix (point, frequency) of the Fourier sum along an axis.

    points: their number, scale and offset from the pose, and their pitch in samples. grid: samples, padded samples, and
    the highest frequency index.
    """
    (count, scale, offset, ratio), (size, padded, max_index) = points, grid
    k = _indices_within(padded, max_index)
    position = centred_indices(count, torch.float64, k.device) * scale + offset
    from_centre = position * ratio
    turns = torch.remainder((from_centre + (size - 1) / 2)[:, None] * (k.double() / padded)[None, :], 1.0)
    within_period = (from_centre.abs() < padded / 2).double()
    amplitude = (within_period / padded)[:, None].expand_as(turns)
    return torch.polar(amplitude, 2 * math.pi * turns).to(dtype)


def _intensity_at_turned_points(
    spectrum: Tensor, band: FrequencyBand, grid: Grid, points: PixelGrid, pose: Pose, nodes: Nodes
) -> Tensor:
    """As `_intensity_by_fourier_sum`, of any orientation."""
    ratio = points.pitch_m / grid.pitch_m
    half_y, half_x = (padded / 2 / ratio for padded in band.padded)  # of the period, in points

    def factor(y: Tensor, x: Tensor) -> Tensor:
        within = (y.abs() < half_y) & (x.abs() < half_x)
        return within.to(spectrum.real.dtype) / (band.padded[0] * band.padded[1]) ** 2

    turns_y, turns_x = (
        (-(size - 1) / 2 / padded, -ratio / padded) for size, padded in zip(grid.shape, band.padded, strict=True)
    )
    ordered = torch.fft.fftshift(spectrum)  # by frequency; which of them is in the middle changes phases only
    affine = pose.inverse_affine(points.pitch_m)
    return turned_power(ordered, affine, points.shape, (turns_y, turns_x), factor, nodes)


def mean_over_pixels(image: Tensor, points: int) -> Tensor:
    """The mean of each square of `points` × `points` values."""
    if points == 1:
        return image
    rows, columns = (n // points for n in image.shape)
    return image.reshape(rows, points, columns, points).mean(dim=(1, 3))


# --- frequencies that a relay passes ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class FrequencyBand:
    """Frequencies |k_y| ≤ max_indices[0], |k_x| ≤ max_indices[1] of a grid of `padded` (y, x) samples.

    A spectrum in the band is (rows, columns) in FFT order, without the frequencies outside. A maximum of half the grid
    or more stands for all frequencies of that axis.
    """

    padded: tuple[int, int]
    max_indices: tuple[int, int]

    @staticmethod
    def from_transfer(transfer: Transfer, grid: Grid) -> FrequencyBand:
        """The smallest such band that holds all frequencies that a transfer function passes."""
        lowest, highest = transfer.band.lowest, transfer.band.highest
        max_y, max_x = (max(0, -low, high) for low, high in zip(lowest, highest, strict=True))
        return FrequencyBand(grid.padded, (max_y, max_x))

    @property
    def frequency_indices(self) -> tuple[Tensor, Tensor]:
        """Signed frequency indices of the rows and of the columns of a spectrum."""
        (rows, columns), (max_y, max_x) = self.padded, self.max_indices
        return _indices_within(rows, max_y), _indices_within(columns, max_x)

    def displaced(self, spectrum: Tensor, samples: tuple[float, float]) -> Tensor:
        """The spectrum (rows, columns) of the field displaced by (y, x) samples, within the period of the grid."""
        y, x = (
            phasor_of_turns(-k.double() * (distance / padded)).to(spectrum.dtype)
            for k, distance, padded in zip(self.frequency_indices, samples, self.padded, strict=True)
        )
        return spectrum * y[:, None] * x[None, :]

    def forward(self, field: Tensor) -> Tensor:
        """Spectrum (rows, columns) of a field (y, x) that is zero on the rest of the padded grid."""
        lines = _crop_spectrum(torch.fft.fft(field, n=self.padded[1], dim=1), self.padded[1], self.max_indices[1], 1)
        return _crop_spectrum(torch.fft.fft(lines, n=self.padded[0], dim=0), self.padded[0], self.max_indices[0], 0)

    def inverse(self, spectrum: Tensor, shape: tuple[int, int]) -> Tensor:
        """The first `shape` samples (y, x) of the field whose spectrum (rows, columns) is zero outside the band."""
        lines = torch.fft.ifft(_zero_pad_spectrum(spectrum, self.padded[0], self.max_indices[0], 0), dim=0)[: shape[0]]
        return torch.fft.ifft(_zero_pad_spectrum(lines, self.padded[1], self.max_indices[1], 1), dim=1)[:, : shape[1]]


@lru_cache(maxsize=256)
def _indices_within(padded: int, max_index: int) -> Tensor:
    k = torch.from_numpy(frequency_indices(padded))
    return k if 2 * max_index + 1 >= padded else k[k.abs() <= max_index]


def _crop_spectrum(spectrum: Tensor, padded: int, max_index: int, dim: int) -> Tensor:
    if 2 * max_index + 1 >= padded:
        return spectrum
    parts = (spectrum.narrow(dim, 0, max_index + 1), spectrum.narrow(dim, padded - max_index, max_index))
    return torch.cat(parts, dim=dim)


def _zero_pad_spectrum(spectrum: Tensor, padded: int, max_index: int, dim: int) -> Tensor:
    if 2 * max_index + 1 >= padded:
        return spectrum
    shape = list(spectrum.shape)
    shape[dim] = padded
    padded_spectrum = spectrum.new_empty(shape)
    padded_spectrum.narrow(dim, max_index + 1, padded - 2 * max_index - 1).zero_()
    padded_spectrum.narrow(dim, 0, max_index + 1).copy_(spectrum.narrow(dim, 0, max_index + 1))
    padded_spectrum.narrow(dim, padded - max_index, max_index).copy_(spectrum.narrow(dim, max_index + 1, max_index))
    return padded_spectrum


# --- models of the camera ---------------------------------------------------------------------------------------------


Key = tuple[Hashable, ...]


@dataclass(frozen=True)
class IncoherentComponent:
    """A field that is coherent in itself: one wavelength and source direction of a plan, at one moment of an exposure.

    path_factor: factor of all optical paths at that moment (flicker of a modulator).
    laser: number of the laser among those of the captures, 0 for the shortest wavelength.
    slm_frame: (rows, columns) of the whole modulators, if the modulators of the plan are cut out of larger ones; None
    if the plan holds whole modulators.
    centre_m: (y, x) of the cut-out part on the whole modulators, and of the camera's picture.
    """

    wavelength: int
    source: int
    path_factor: float
    laser: int = 0
    slm_frame: tuple[int, int] | None = None
    centre_m: tuple[float, float] = (0.0, 0.0)


class CameraModel:
    """Intensities on the camera at the first plane of a plan: the part that doesn't depend on the geometry.

    plan: of the bench with its effects on distances, angles, wavelengths and apertures. effects: their other hooks.
    relays: the nominal relays 1 and 2, whose stops normalise pupil coordinates.
    cache: keeps intermediate results; a key names all values that its result depends on.
    earlier: the drives that were sent before a pattern, and first of all; None where no effect asks for them.
    focal_length_m: of the lens of a Fourier bench; 0 in the near field.
    """

    def __init__(
        self,
        plan: Plan,
        effects: TorchEffects,
        relays: tuple[Relay, Relay],
        pixel_grid: PixelGrid,
        dtype: torch.dtype,
        cache: TensorCache,
        earlier: tuple[Tensor, Tensor] | None = None,
        focal_length_m: float = 0.0,
    ) -> None:
        self.plan, self.effects, self.relays, self.pixel_grid = plan, effects, relays, pixel_grid
        self.focal_length_m = focal_length_m
        self.dtype, self.cache, self.earlier = dtype, cache, earlier
        self.real_dtype = torch.float64 if dtype == torch.complex128 else torch.float32

    def wavelength_m(self, component: IncoherentComponent) -> float:
        """The wavelength of a component."""
        return float(self.plan.system.wavelengths_m[component.wavelength])

    def slopes(self, component: IncoherentComponent) -> tuple[float, float]:
        """Phase slopes (y, x) of the illumination in turns per sample; (0, 0) for normal incidence."""
        slope_y, slope_x = self.plan.slopes[component.source, component.wavelength].tolist()
        return slope_y, slope_x

    def context(self, number: int, component: IncoherentComponent) -> ModulatorContext:
        """The context of the hooks on modulator `number` (0 or 1)."""
        frame, centre_m = component.slm_frame, component.centre_m
        return modulator_context(self.plan, number, component.wavelength, component.laser, frame, centre_m)

    def transmission(self, drive: Tensor, number: int, component: IncoherentComponent) -> Tensor:
        """Complex transmission of a modulator, of pixels, or of samples where an effect needs them.

        It doesn't depend on the direction of the source. drive: of the capture, (modulator, y, x).
        """
        earlier = [patterns[number].to(self.real_dtype) for patterns in self.earlier or ()]
        return self.effects.modulator_transmission(
            drive[number].to(self.real_dtype),
            self.context(number, component),
            self.dtype,
            component.path_factor,
            *earlier,
        )

    def modulator_key(self, number: int, component: IncoherentComponent) -> Key:
        """Names all values that the light behind a modulator depends on, beside its pattern and the incoming light."""
        hooks = self.effects.cache_key(*MODULATOR_HOOKS, acts_on=f"modulator {number + 1}", laser=component.laser)
        source = self.effects.cache_key("transmission", acts_on="source") if number == 0 else ()
        stroke_m = self.plan.system.modulators[number].stroke_m
        return number, component.path_factor, self.wavelength_m(component), stroke_m, hooks, source

    def mean_over_motion(
        self, pose: Pose, cycles_per_m: float, intensity: Callable[[tuple[float, float]], Tensor]
    ) -> Tensor:
        """`mean_over_motion` of the camera's own motion."""
        return mean_over_motion(self.pixel_grid, self.effects.camera_motion(), pose, cycles_per_m, intensity)


def mean_over_motion(
    pixel_grid: PixelGrid,
    motion_px: tuple[float, float],
    pose: Pose,
    cycles_per_m: float,
    intensity: Callable[[tuple[float, float]], Tensor],
) -> Tensor:
    """The mean intensity (y, x) over the positions of the camera in an exposure.

    pose: in the middle of the exposure. cycles_per_m: highest spatial frequency of the intensity along y and x.
    intensity: of the picture displaced by (y, x) m from that pose.

    A Gauss–Legendre sum of N positions along the line. Of a wave whose phase turns by ±κ from its middle to its
    ends the mean is sin κ/κ, to 1e-6 where N ≥ κ/2 + 2·κ^(1/3) + 2.
    """
    length_m = [px * pixel_grid.pitch_m for px in motion_px]
    if not any(length_m):
        return intensity((0.0, 0.0))
    kappa = math.pi * cycles_per_m / pose.magnification * sum(map(abs, length_m))
    nodes, weights = np.polynomial.legendre.leggauss(math.ceil(kappa / 2 + 2 * kappa ** (1 / 3) + 2))
    total: Tensor | float = 0.0
    for node, weight in zip(nodes.tolist(), (weights / 2).tolist(), strict=True):
        total = total + weight * intensity((node / 2 * length_m[0], node / 2 * length_m[1]))
    assert isinstance(total, Tensor)
    return total


def camera_picture(
    spectrum: Tensor,
    band: FrequencyBand,
    grid: Grid,
    pixel_grid: PixelGrid,
    pose: Pose,
    motion_px: tuple[float, float],
) -> Tensor:
    """|field|² (y, x) on a camera of some pose that moves by `motion_px` during the exposure.

    spectrum: of the field on the padded `grid`, in a band.
    """
    highest = max(min(k / n, 0.5) for k, n in zip(band.max_indices, band.padded, strict=True))
    (a, b, _), (c, d, _) = pose.inverse_affine(grid.pitch_m)

    def displaced(by_m: tuple[float, float]) -> Tensor:
        y, x = ((p * by_m[0] + q * by_m[1]) / grid.pitch_m for p, q in ((a, b), (c, d)))
        moved = band.displaced(spectrum, (y, x)) if any(by_m) else spectrum
        return sample_intensity(moved, band, grid, pixel_grid, pose)

    return mean_over_motion(pixel_grid, motion_px, pose, 2 * highest / grid.pitch_m, displaced)


class TensorCache:
    """Tensors by a key that names everything they were computed from.

    Beyond `max_bytes` in all, the least recently used tensors are dropped; the latest one always stays.
    """

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes, self._bytes = max_bytes, 0
        self._tensors: OrderedDict[Hashable, torch.Tensor] = OrderedDict()

    def get(self, key: Hashable, compute: Callable[[], torch.Tensor]) -> torch.Tensor:
        """The tensor of that key, computed if it isn't in the cache."""
        cached = self._tensors.get(key)
        if cached is not None:
            self._tensors.move_to_end(key)
            return cached
        computed = compute()
        self._tensors[key] = computed
        self._bytes += computed.nbytes
        while self._bytes > self._max_bytes and len(self._tensors) > 1:
            self._bytes -= self._tensors.popitem(last=False)[1].nbytes
        return computed

    def get_invariant(self, key: Hashable, compute: Callable[[], torch.Tensor]) -> torch.Tensor:
        """As `get`, for a tensor that no effect changes and through which no gradient flows."""
        return self.get(key, compute)


class InvariantCache(TensorCache):
    """Caches, in another cache, only the tensors that no effect changes; all others are computed anew.

    For calls with gradients: a cached tensor would belong to the computation graph of an earlier call.
    """

    def __init__(self, store: TensorCache) -> None:
        super().__init__(0)
        self._store = store

    def get(self, key: Hashable, compute: Callable[[], torch.Tensor]) -> torch.Tensor:
        """The tensor, computed anew."""
        return compute()

    def get_invariant(self, key: Hashable, compute: Callable[[], torch.Tensor]) -> torch.Tensor:
        """The tensor of that key, computed if it isn't in the other cache."""
        return self._store.get(key, compute)


# --- near field ---


class NearFieldModel(CameraModel):
    """Intensities on the camera behind relays and free space."""

    def intensity(self, drive: Tensor, component: IncoherentComponent, capture: int) -> Tensor:
        """|E|² (y, x) on the camera for unit power in one component.

        drive: patterns of the capture as fractions of the stroke, (modulator, y, x). capture: its index, for the cache.
        """
        stages = _Stages(self, drive, component, capture)
        last = spectrum_behind_modulators(stages, component.wavelength, 0, component.source)
        seen = stages.transmit(last, 1, component.wavelength)
        pose_key = self.effects.cache_key(*POSE_HOOKS)

        def compute() -> Tensor:
            pose = self.effects.camera_pose(float(self.plan.planes_m[0])).about(component.centre_m)
            y, x = (shift + axis for shift, axis in zip(pose.shift_m, self.pixel_grid.axis_m, strict=True))
            pose = replace(pose, shift_m=(y, x))
            seen_at = (self.band(1, component), self.plan.grid, self.pixel_grid, pose)
            return camera_picture(seen.values(), *seen_at, self.effects.camera_motion())

        return self.cache.get((*seen.key, "intensity", pose_key), compute)

    # --- relays -----------------------------------------------------------------------------------------------------

    def band(self, relay: int, component: IncoherentComponent) -> FrequencyBand:
        """The frequencies that pass a relay."""
        return FrequencyBand.from_transfer(self._transfer(relay, component), self.plan.grid)

    def relay_key(self, relay: int, component: IncoherentComponent) -> Hashable:
        """Names all values that the factor of a relay depends on."""
        hooks = self.effects.cache_key("pupil", acts_on=f"relay {relay + 1}")
        return (
            relay,
            self.wavelength_m(component),
            self._transfer(relay, component).distance_m,
            self.plan.relays[relay],
            hooks,
        )

    def relay_factor(self, relay: int, component: IncoherentComponent) -> Tensor:
        """Transfer function × pupil in the band of a relay, (rows, columns)."""
        transfer, band = self._transfer(relay, component), self.band(relay, component)
        ky, kx = band.frequency_indices

        stops = (transfer.wavelength_m, self.plan.relays[relay], band)

        def pupil_without_effects() -> Tensor:
            device, nominal = torch.device("cpu"), self.relays[relay]
            whole = nominal_pupil(self.plan, relay, component.wavelength, self.dtype, device, nominal)
            return torch.ones((), dtype=self.dtype) if whole is None else whole[ky][:, kx]

        def without_effects() -> Tensor:
            free = transfer_function_at(transfer, ky, kx, torch.complex128)
            return free * self.cache.get_invariant(("pupil", *stops), pupil_without_effects)

        def compute() -> Tensor:
            response = self.cache.get_invariant(("nominal", relay, transfer.distance_m, *stops), without_effects)
            sine_y, sine_x = (k.double() * s for k, s in zip((ky, kx), transfer.sine_step, strict=True))
            λ, nominal = transfer.wavelength_m, self.relays[relay]
            radius = nominal.pupil_radius_sine(λ, self.plan.nominal.modulators[0].pitch_m)
            context = RelayContext(relay, λ, sine_y[:, None], sine_x[None], radius, nominal.centre_na)
            pupil = self.effects.pupil(context, torch.complex128)
            return (response if pupil is None else response * pupil).to(self.dtype)

        return self.cache.get(("relay", self.relay_key(relay, component), band), compute)

    def _transfer(self, relay: int, component: IncoherentComponent) -> Transfer:
        return self.plan.transfer(relay, component.wavelength)


@dataclass(frozen=True)
class _Light:
    """A field (y, x) or a spectrum in a relay's band. key: names all values that it depends on."""

    key: Key
    values: Callable[[], Tensor]


class _Stages:
    """The stages of `engine.frame` for one component of a capture. Arguments as of `NearFieldModel.intensity`."""

    def __init__(self, model: NearFieldModel, drive: Tensor, component: IncoherentComponent, capture: int) -> None:
        self.plan, self._model, self._drive = model.plan, model, drive
        self._component, self._capture = component, capture

    def illuminate(self, wavelength: int, source: int) -> _Light:
        """The plane wave that illuminates the first modulator."""
        key, dtype = (self._capture, self._model.slopes(self._component)), self._model.dtype
        return _Light(key, lambda: plane_wave(self.plan, wavelength, source, dtype, torch.device("cpu")))

    def modulate(self, field: _Light, frame: int, modulator: int, wavelength: int) -> _Light:
        """field × the modulator's transmission: samples, or for the first modulator pixels if effects leave them."""
        key = (*field.key, self._model.modulator_key(modulator, self._component))
        if modulator == 0:  # the wave is needed at pixels or at samples, as the transmission is
            source = self._component.source
            return _Light(key, lambda: illuminated(self.plan, wavelength, source, self._transmission(0)))
        return _Light(key, lambda: field.values() * self._transmission(1))

    def spectrum(self, field: _Light, modulator: int) -> _Light:
        """The spectrum in the band of the next relay."""
        band = self._model.band(relay_behind(self.plan, modulator), self._component)
        key = (*field.key, "spectrum", band)

        def compute() -> Tensor:
            light, grid = field.values(), self.plan.grid
            if modulator or tuple(light.shape) != self.plan.system.modulators[0].shape:
                return band.forward(light)
            slopes = self._model.slopes(self._component)
            return spectrum_of_pixels(light, [_pixel_axis(grid, i, slopes[i], band, light.dtype) for i in (0, 1)])

        return _Light(key, lambda: self._model.cache.get(key, compute))

    def transmit(self, spectrum: _Light, relay: int, wavelength: int, plane: int = 0) -> _Light:
        """spectrum × transfer function × pupil."""
        key = (*spectrum.key, self._model.relay_key(relay, self._component))
        return _Light(key, lambda: spectrum.values() * self._model.relay_factor(relay, self._component))

    def field(self, spectrum: _Light, relay: int) -> _Light:
        """The field at the second modulator."""
        key, band = (*spectrum.key, "field"), self._model.band(relay, self._component)
        return _Light(
            key, lambda: self._model.cache.get(key, lambda: band.inverse(spectrum.values(), self.plan.grid.shape))
        )

    def _transmission(self, number: int) -> Tensor:
        """Complex transmission of a modulator: of samples for the second, of pixels if possible for the first."""
        model, component = self._model, self._component

        def compute() -> Tensor:
            found = model.transmission(self._drive, number, component)
            return model.context(number, component).sampled(found) if number else found

        return model.cache.get(("transmission", self._capture, model.modulator_key(number, component)), compute)


@lru_cache(maxsize=256)
def _pixel_axis(grid: Grid, axis: int, slope: float, band: FrequencyBand, dtype: torch.dtype) -> PixelAxis:
    return PixelAxis.at(grid, axis, slope, band.frequency_indices[axis], dtype)


# --- Fourier bench ---


class FourierBenchModel(CameraModel):
    """Intensities on the camera in the focal plane of a lens. The plan has its plane at focal_length_m + defocus."""

    def intensity(self, drive: Tensor, component: IncoherentComponent, capture: int) -> Tensor:
        """|E|² (y, x) on the camera for unit power in one component.

        Without stops and the sinc its mean over one period of the spectrum is 1. drive: the pattern of the capture as
        fractions of the stroke, (1, y, x). capture: its index, for the cache.
        """
        behind = (
            "behind the modulator",
            capture,
            component.path_factor,
            self.wavelength_m(component),
            self.slopes(component),
            self.plan.system.modulators[0].stroke_m,
            self.effects.cache_key(*MODULATOR_HOOKS, laser=component.laser),
        )
        plane_m, relay = float(self.plan.planes_m[0]), self.plan.system.relay2
        pose_key = self.effects.cache_key(*POSE_HOOKS, laser=component.laser)

        def compute() -> Tensor:
            modulator = self.plan.system.modulators[0]
            field = self._defocused(self.cache.get(behind, lambda: self._field(drive, component)), component)
            pose = self.effects.camera_pose(plane_m - self.focal_length_m)
            cycles = max(modulator.shape) * modulator.pitch_m / (self.wavelength_m(component) * self.focal_length_m)

            def displaced(by_m: tuple[float, float]) -> Tensor:
                places = zip(pose.shift_m, by_m, self.pixel_grid.axis_m, strict=True)
                y, x = (shift + by + axis for shift, by, axis in places)
                return self._camera_intensity(field, component, replace(pose, shift_m=(y, x)))

            return self.mean_over_motion(pose, cycles, displaced)

        return self.cache.get(("fourier", *behind, plane_m, relay, pose_key), compute)

    def _camera_intensity(self, field: Tensor, component: IncoherentComponent, pose: Pose) -> Tensor:
        points, nodes = self.pixel_grid.points_per_axis or 1, _MIDDLE
        if self.pixel_grid.points_per_axis == AREA:
            speckle_m = self._speckle_m(component)
            nodes = pixel_quadrature(round(self.pixel_grid.pitch_m / (speckle_m * pose.magnification), 3))
        shape = (self.pixel_grid.shape[0] * points, self.pixel_grid.shape[1] * points)
        point_grid = PixelGrid(self.pixel_grid.pitch_m / points, shape)
        if pose.rotation_rad == 0:
            return mean_over_pixels(self._intensity_at_pixels(field, component, point_grid, pose, nodes), points)
        return mean_over_pixels(self._intensity_at_turned_pixels(field, component, point_grid, pose, nodes), points)

    def _field(self, drive: Tensor, component: IncoherentComponent) -> Tensor:
        """The field behind the modulator, of pixels or samples."""
        transmission = self.transmission(drive, 0, component)
        return illuminated(self.plan, component.wavelength, component.source, transmission)

    def _defocused(self, field: Tensor, component: IncoherentComponent) -> Tensor:
        """The field behind the modulator with the phase of the defocus, a function of y times a function of x."""
        defocus_m = float(self.plan.planes_m[0]) - self.focal_length_m
        if not defocus_m:
            return field
        context = self.context(0, component)
        for position in context.positions(field):
            path_m = -defocus_m * position.square() / (2 * self.focal_length_m**2)
            field = field * phasor(path_m, context.wavelength_m, self.dtype)
        return field

    def _intensity_at_pixels(
        self, field: Tensor, component: IncoherentComponent, pixel_grid: PixelGrid, pose: Pose, nodes: Nodes
    ) -> Tensor:
        """|E|² at pixels whose rows and columns are parallel to the modulator's; zero where a stop blocks the light.

        nodes: along each side of a pixel, whose weighted mean it is.
        """
        λ, modulator, slopes = self.wavelength_m(component), self.plan.system.modulators[0], self.slopes(component)
        pitch_m = modulator.pitch_m * modulator.shape[0] / field.shape[0]
        affine = pose.inverse_affine(pixel_grid.pitch_m)

        def along(light: Tensor, axis: int, node: float) -> tuple[Tensor, Tensor]:
            """The sums along an axis (last of the result), and the direction sines of the pixels."""
            pixels = centred_indices(pixel_grid.shape[axis], torch.float64, field.device) + node
            scale, offset = affine[axis][axis], affine[axis][2]
            sine = (pixels * scale + offset) * (pixel_grid.pitch_m / self.focal_length_m)
            cycles = sine * (pitch_m / λ)  # per point of the field
            step = scale * pixel_grid.pitch_m / self.focal_length_m * pitch_m / λ
            sums = chirp_z_transform(light.transpose(-2, -1), float(cycles[0]), step, pixel_grid.shape[axis])
            slope = slopes[axis] * (pitch_m / self.plan.grid.pitch_m)  # turns per point of the field
            envelope = torch.special.sinc(cycles - slope) / field.shape[axis] ** 0.5
            return sums * envelope.to(self.real_dtype), sine

        total = torch.zeros(pixel_grid.shape, dtype=self.real_dtype)
        for node_y, weight_y in nodes:
            lines, sine_y = along(field, 0, node_y)
            for node_x, weight_x in nodes:
                light, sine_x = along(lines, 1, node_x)
                seen = self._behind_stops(squared_magnitude(light), λ, sine_y[:, None], sine_x)
                total = total + weight_y * weight_x * seen
        return total

    def _intensity_at_turned_pixels(
        self, field: Tensor, component: IncoherentComponent, pixel_grid: PixelGrid, pose: Pose, nodes: Nodes
    ) -> Tensor:
        """|E|² at pixels whose rows are turned against the modulator's, otherwise as `_intensity_at_pixels`."""
        λ, slopes, modulator = self.wavelength_m(component), self.slopes(component), self.plan.system.modulators[0]
        pitch_m = modulator.pitch_m * modulator.shape[0] / field.shape[0]
        sine = pixel_grid.pitch_m / self.focal_length_m  # of a distance of a pixel
        cycles = sine * pitch_m / λ  # of a distance of a pixel, per point of the field
        tilt_y, tilt_x = (slope * (pitch_m / self.plan.grid.pitch_m) for slope in slopes)  # turns per point

        def factor(y: Tensor, x: Tensor) -> Tensor:
            envelope = torch.special.sinc((y * cycles - tilt_y).to(self.real_dtype)).square()
            envelope = envelope * torch.special.sinc(x * cycles - tilt_x).square().to(self.real_dtype)
            return self._behind_stops(envelope, λ, y * sine, x * sine) / field.numel()

        turns = (0.0, cycles), (0.0, cycles)
        return turned_power(field, pose.inverse_affine(pixel_grid.pitch_m), pixel_grid.shape, turns, factor, nodes)

    def _behind_stops(self, light: Tensor, λ: float, sine_y: Tensor, sine_x: Tensor) -> Tensor:
        """A power (rows, columns) where the stops pass light to the camera, 0 elsewhere.

        sine_y: of the rows, (rows, 1), or of each place. sine_x: of the columns.
        """
        stops = (self.relays[1].iris_na, self.relays[1].square, self.plan.system.relay2.dc_block_na)
        if all(stop is None for stop in stops):
            return light
        sine2 = sine_y.square() + sine_x.square()
        passes = torch.ones_like(sine2, dtype=torch.bool)
        y, x = (sine - centre for sine, centre in zip((sine_y, sine_x), self.relays[1].centre_na, strict=True))
        if self.relays[1].iris_na is not None:
            passes &= y.square() + x.square() <= self.relays[1].iris_na ** 2
        if self.relays[1].square is not None:
            half = self.relays[1].square.half_side_sine(λ, self.plan.system.modulators[0].pitch_m)
            passes &= (y.abs() < half) & (x.abs() < half)
        if self.plan.system.relay2.dc_block_na is not None:
            passes &= sine2 > self.plan.system.relay2.dc_block_na**2
        return light * passes.to(self.real_dtype)

    def _speckle_m(self, component: IncoherentComponent) -> float:
        """Period on the camera of the finest structure, by light from both ends of the modulator's longer side."""
        modulator = self.plan.system.modulators[0]
        return self.wavelength_m(component) * self.focal_length_m / (max(modulator.shape) * modulator.pitch_m)
