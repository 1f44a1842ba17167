"""From intensities on the model's samples to means over the camera's pixels, and the transpose of this operator.

    picture = B·S·I,   ∂L/∂I = Sᵀ·Bᵀ·∂L/∂picture

S interpolates linearly between samples at points of the camera's pixels, wherever the camera is, and B takes the mean
of a pixel's points, one for each sample that fits on the pixel along each axis. If pixels coincide with samples, both
are the identity.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.captures.camera_sampling import mean_over_pixels
from holoview.model.effects.hook_contexts import Pose
from holoview.numerics.image_region import Region, region_slices
from holoview.numerics.resample import centred_indices, interpolate_at
from holoview.rig.description import RigDescription

Tensor = torch.Tensor

_SAME = 1e-6  # relative difference of pitches that are meant to be equal
_EDGE = 1e-3  # samples by which a point may lie outside and still count as inside
_IDENTITY = Pose()


class CameraView:
    """How a camera sees the samples of a focal plane, centred on it but for its pose.

    shape, pitch_m: rows and columns of samples, and their distance. camera_shape, camera_pitch_m: of the pixels, the
    pitch referred to the modulators. pose: of the camera, as in `captures.camera_sampling`.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        pitch_m: float,
        camera_shape: tuple[int, int],
        camera_pitch_m: float,
        pose: Pose = _IDENTITY,
    ) -> None:
        self.shape, self.camera_shape = shape, camera_shape
        self.points = max(1, round(camera_pitch_m / pitch_m))
        same_pitch = abs(camera_pitch_m / pitch_m - 1) < _SAME
        self.is_identity = same_pitch and shape == camera_shape and pose.is_identity
        points_y, points_x = (n * self.points for n in camera_shape)
        y = centred_indices(points_y, torch.float64, torch.device("cpu"))[:, None]
        x = centred_indices(points_x, torch.float64, torch.device("cpu"))[None, :]
        scale = camera_pitch_m / self.points / pitch_m
        rows = pose.inverse_affine(camera_pitch_m / self.points)
        self._y, self._x = ((a * y + b * x + c) * scale for a, b, c in rows)

    def picture(self, samples: Tensor) -> Tensor:
        """What the camera sees of real samples (…, y, x), (…, row, column)."""
        if self.is_identity:
            return samples.clone()
        y, x = self._y.to(samples), self._x.to(samples)
        seen = [mean_over_pixels(interpolate_at(one, y, x), self.points) for one in samples.flatten(0, -3)]
        return torch.stack(seen).view(*samples.shape[:-2], *self.camera_shape)

    def transposed(self, slopes: Tensor) -> Tensor:
        """The transpose of `picture`: from (…, row, column) to (…, y, x)."""
        if self.is_identity:
            return slopes.clone()
        with torch.enable_grad():
            samples = slopes.new_zeros((*slopes.shape[:-2], *self.shape), requires_grad=True)
            (result,) = torch.autograd.grad(self.picture(samples), samples, slopes)
        return result

    def covers(self, region: Region | None) -> NDArray[np.bool_]:
        """Which camera pixels (row, column) lie wholly inside a region of samples; inside all samples when None."""
        rows, columns = region_slices(region or (0, 0, self.shape[1], self.shape[0]))
        inside = torch.ones(1, dtype=torch.bool)
        for position, n, part in zip((self._y, self._x), self.shape, (rows, columns), strict=True):
            low, high = part.start - n / 2 - _EDGE, part.stop - n / 2 + _EDGE
            inside = inside & (position >= low) & (position <= high)
        shares = mean_over_pixels(inside.double().expand(*(n * self.points for n in self.camera_shape)), self.points)
        return np.asarray(shares.numpy() > 1 - _SAME)


def camera_view(
    rig: RigDescription, shape: tuple[int, int], pitch_m: float, shift_m: tuple[float, float] = (0.0, 0.0)
) -> CameraView:
    """The view of a rig's camera that is displaced by a shift (y, x). shape, pitch_m: of the model's samples."""
    return CameraView(shape, pitch_m, rig.camera_shape, rig.bench.camera.pitch_m, Pose(shift_m))
