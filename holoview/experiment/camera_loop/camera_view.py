"""From intensities on the model's samples to means over the camera's pixels, and the transpose of this operator.

    picture = A_y·I·A_xᵀ,   ∂L/∂I = A_yᵀ·(∂L/∂picture)·A_x

Along each axis A interpolates between samples, by a windowed sinc that keeps detail as fine as speckle
(`numerics.subpixel_shift`), at points of the camera's pixels, and takes the mean of a pixel's points, one for each
sample that fits on the pixel. If pixels coincide with samples, A is the identity. Rows of pixels are parallel to rows
of samples: a camera that is turned has to be turned back first.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.numerics.subpixel_shift import interpolation_weights
from holoview.numerics.tensors import Region, region_slices
from holoview.rig.description import RigDescription

Tensor = torch.Tensor

_SAME = 1e-6  # relative difference of lengths that are meant to be equal
_EDGE = 1e-3  # samples by which a point may lie outside and still count as inside


class CameraView:
    """How a camera sees the samples of a focal plane.

    shape, pitch_m: rows and columns of samples, and their distance. camera_shape, camera_pitch_m: of the pixels, the
    pitch referred to the modulators. shift_m (y, x): what should be at r in the picture is at r + shift; both are
    centred on the axis otherwise.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        pitch_m: float,
        camera_shape: tuple[int, int],
        camera_pitch_m: float,
        shift_m: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self.shape, self.camera_shape = shape, camera_shape
        self.points = max(1, round(camera_pitch_m / pitch_m))
        same_pitch = abs(camera_pitch_m / pitch_m - 1) < _SAME
        self.is_identity = same_pitch and shape == camera_shape and not any(shift_m)
        step = camera_pitch_m / self.points / pitch_m
        self._positions: list[NDArray[np.float64]] = []
        for samples, pixels, shift in zip(shape, camera_shape, shift_m, strict=True):
            count = pixels * self.points
            centred = (np.arange(count, dtype=np.float64) - (count - 1) / 2) * step - shift / pitch_m
            self._positions.append(centred + (samples - 1) / 2)
        self._matrices = [
            _interpolation(position, samples, self.points)
            for position, samples in zip(self._positions, shape, strict=True)
        ]

    def picture(self, samples: Tensor) -> Tensor:
        """What the camera sees of real samples (…, y, x), (…, row, column)."""
        if self.is_identity:
            return samples.clone()
        y, x = (matrix.to(samples) for matrix in self._matrices)
        return _apply(y, _apply(x, samples.mT).mT)

    def transposed(self, slopes: Tensor) -> Tensor:
        """The transpose of `picture`: from (…, row, column) to (…, y, x)."""
        if self.is_identity:
            return slopes.clone()
        y, x = (matrix.t().to(slopes) for matrix in self._matrices)
        return _apply(y, _apply(x, slopes.mT).mT)

    def covers(self, region: Region | None) -> NDArray[np.bool_]:
        """Which camera pixels (row, column) lie wholly inside a region of samples; inside all samples when None."""
        inside = []
        for position, part in zip(
            self._positions, region_slices(region or (0, 0, self.shape[1], self.shape[0])), strict=True
        ):
            points = (position >= part.start - 0.5 - _EDGE) & (position <= part.stop - 0.5 + _EDGE)
            inside.append(points.reshape(-1, self.points).all(axis=1))
        return np.logical_and.outer(*inside)


def camera_view(
    rig: RigDescription, shape: tuple[int, int], pitch_m: float, shift_m: tuple[float, float] = (0.0, 0.0)
) -> CameraView:
    """The view of a rig's camera that is displaced by a shift (y, x). shape, pitch_m: of the model's samples."""
    return CameraView(shape, pitch_m, rig.camera_shape, rig.bench.camera.pitch_m, shift_m)


def _interpolation(position: NDArray[np.float64], samples: int, points: int) -> Tensor:
    """A of an axis, sparse (pixel, sample), for the positions of all points; edges are continued outwards."""
    indices, weights = interpolation_weights(position)
    pixel = np.broadcast_to(np.arange(len(position))[:, None] // points, indices.shape)
    places = np.stack([pixel.ravel(), np.clip(indices, 0, samples - 1).ravel()])
    shape = (len(position) // points, samples)
    values = torch.from_numpy(weights.ravel() / points)
    return torch.sparse_coo_tensor(torch.from_numpy(places), values, shape, check_invariants=True).coalesce()


def _apply(matrix: Tensor, values: Tensor) -> Tensor:
    """A sparse matrix (row, y) times values (…, y, x)."""
    columns = values.movedim(-2, 0)
    product = torch.sparse.mm(matrix, columns.reshape(len(columns), -1))
    return product.view(-1, *columns.shape[1:]).movedim(0, -2)
