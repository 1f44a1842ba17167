"""The loss: mean squared error of a focal stack in a colour space, inside a region, weighted by plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.model.plan import Plan
from holoview.numerics.image_region import Region, region_slices, zero_outside
from holoview.optimise.loss_spaces import LossSpace, find_loss_space
from holoview.optimise.settings import Settings
from holoview.optimise.srgb_curve import torch_srgb_encode, torch_srgb_encode_derivative
from holoview.util.errors import UserError

Tensor = torch.Tensor


@dataclass(frozen=True)
class PlaneLoss:
    """A plane's part of the loss, and its PSNR (dB) clipped to 0…1: of linear sRGB, or of the only channel."""

    loss: float
    psnr_db: float


class Objective:
    """L = Σ_k weight_k·mean(residual_k²)/K over K planes, inside the region.

    Brightness is fixed: 1 is the display's white, and no scale factor is fitted. target (plane, channel, y, x): linear,
    before any encoding. wavelength_channels (wavelength, channel): of unit intensity. region_slices: of (y, x).
    """

    def __init__(
        self,
        loss: LossSpace,
        wavelength_channels: Tensor,
        target: Tensor,
        plane_weights: NDArray[np.float64],
        region: Region | None,
    ):
        self.loss, self.wavelength_channels, self.target = loss, wavelength_channels, target
        self.plane_weights = plane_weights
        rows, columns = target.shape[-2:]
        self.region_slices = region_slices(region or (0, 0, columns, rows))
        low, high = torch.aminmax(target)
        matrix = loss.to_rgb
        is_linear_srgb = matrix is not None and np.allclose(matrix, np.eye(3))
        self._target_needs_no_clipping = bool(low >= 0 and high <= 1) and is_linear_srgb
        self._to_rgb = None if matrix is None or is_linear_srgb else torch.as_tensor(matrix).to(target)

    def evaluate_plane(self, plane: int, image: Tensor) -> PlaneLoss:
        """The loss of a plane's image (channel, y, x), which is overwritten with ∂L/∂image."""
        cropped, target = (t[(..., *self.region_slices)] for t in (image, self.target[plane]))
        psnr_db = self._psnr_db(cropped, target)
        sample_weight = float(self.plane_weights[plane]) / (len(self.target) * cropped.numel())
        if self.loss.is_encoded:
            derivative = torch_srgb_encode_derivative(cropped)
            cropped.copy_(torch_srgb_encode(cropped)).sub_(torch_srgb_encode(target))
        else:
            derivative = None
            cropped.sub_(target)
        loss = sample_weight * float(torch.linalg.vector_norm(cropped)) ** 2
        cropped.mul_(2 * sample_weight)
        if derivative is not None:
            cropped.mul_(derivative)
        zero_outside(image, *self.region_slices)
        return PlaneLoss(loss, psnr_db)

    def picture(self, image: Tensor) -> NDArray[np.floating]:
        """An image (channel, y, x) as linear sRGB (y, x, 3); grey where there is only one channel."""
        if len(image) == 1:
            image = image.expand(3, -1, -1)
        elif self._to_rgb is not None:
            image = torch.einsum("rc,cyx->ryx", self._to_rgb, image)
        return image.movedim(0, -1).cpu().numpy().copy()

    def _psnr_db(self, image: Tensor, target: Tensor) -> float:
        if self._to_rgb is not None:
            image, target = (torch.einsum("rc,cyx->ryx", self._to_rgb, t) for t in (image, target))
        error = image.clamp(0, 1).sub_(target if self._target_needs_no_clipping else target.clamp(0, 1))
        mean_square = float(torch.linalg.vector_norm(error)) ** 2 / error.numel()
        return float(-10 * np.log10(max(mean_square, 1e-20)))


def make_objective(
    plan: Plan, stack: NDArray[np.floating], settings: Settings, *, device: str = "cpu", double: bool = False
) -> Objective:
    """The objective for a focal stack (plane, y, x, 3) in linear sRGB, on the plan's planes and simulation grid.

    double: compute in float64. Raises UserError when the stack, the region or the planes' weights don't fit the plan.
    """
    planes, shape = len(plan.planes_m), plan.grid.shape
    expected = (planes, *shape, 3)
    if stack.shape != expected:
        raise UserError("target", f"a stack of shape {stack.shape}", expected=f"(plane, y, x, 3) = {expected}")
    if not np.isfinite(stack).all() or not np.any(stack > 0):
        raise UserError("target", "no light, or not a number somewhere", expected="finite values, some above 0")
    loss = find_loss_space(settings.loss_for(plan.system.observer))
    dtype = torch.float64 if double else torch.float32
    channels = np.ascontiguousarray(np.moveaxis(loss.channels_of_rgb(stack), -1, 1))
    target = torch.as_tensor(channels, dtype=dtype).to(device)
    return Objective(
        loss,
        channels_of_wavelengths(loss, plan, target),
        target,
        _plane_weights(settings, planes),
        _checked_region(settings, shape),
    )


def channels_of_wavelengths(loss: LossSpace, plan: Plan, like: Tensor) -> Tensor:
    """Channels (wavelength, channel) of unit intensity at each wavelength."""
    return torch.as_tensor(loss.channels_of_xyz(plan.colour_weights).copy()).to(like.dtype).to(like.device)


def _plane_weights(settings: Settings, planes: int) -> NDArray[np.float64]:
    """The settings' weights, scaled to a mean of 1."""
    if settings.plane_weights is None:
        return np.ones(planes)
    weights = np.asarray(settings.plane_weights, dtype=np.float64)
    if len(weights) != planes:
        raise UserError("plane weights", f"{len(weights)} of them", expected=f"one for each of {planes} planes")
    return weights * (planes / weights.sum())


def _checked_region(settings: Settings, shape: tuple[int, int]) -> Region | None:
    if settings.region is not None:
        x, y, width, height = settings.region
        if x + width > shape[1] or y + height > shape[0]:
            found = f"x, y, w, h = {x}, {y}, {width}, {height}"
            raise UserError("region", found, expected=f"inside the simulated {shape[1]} x {shape[0]} samples")
    return settings.region
