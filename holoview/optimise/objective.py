"""The loss of a focal stack in a colour space, inside a region, weighted by plane: by squared errors or structure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.model.plan import Plan
from holoview.numerics.image_region import Region, region_slices, zero_outside
from holoview.numerics.structural_similarity import WINDOW, multi_scale_similarity, scale_count
from holoview.optimise.loss_spaces import LossSpace, find_loss_space
from holoview.optimise.settings import Settings
from holoview.optimise.srgb_curve import torch_srgb_encode, torch_srgb_encode_derivative
from holoview.util.errors import UserError

Tensor = torch.Tensor
Cut = tuple[slice, slice, slice]


@dataclass(frozen=True)
class PlaneLoss:
    """A plane's part of the loss, and its PSNR (dB) clipped to 0…1: of linear sRGB, or of the only channel."""

    loss: float
    psnr_db: float


@dataclass(frozen=True)
class ResidualSums:
    """Norms over some rows, numbers on the device: of the residuals, and of the errors that the PSNR is made of.

    Of a structural loss, the squared residuals include its weight times 1 − MS-SSIM for each number of the image.
    """

    residual_norm: Tensor
    error_norm: Tensor


class Objective:
    """L = Σ_k weight_k·[mean(residual_k²) + structure_weight·(1 − MS-SSIM_k)]/K over K planes, inside the region.

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
        self.loss, self.wavelength_channels = loss, wavelength_channels
        self.plane_weights = plane_weights
        rows, columns = target.shape[-2:]
        self.region_slices = region_slices(region or (0, 0, columns, rows))
        matrix = loss.to_rgb
        self._is_linear_srgb = matrix is not None and np.allclose(matrix, np.eye(3))
        self._to_rgb = None if matrix is None or self._is_linear_srgb else torch.as_tensor(matrix).to(target)
        self._set_target(target)

    def set_stack(self, stack: NDArray[np.floating]) -> None:
        """Changes to another focal stack (plane, y, x, 3) in linear sRGB, of the same shape.

        Raises UserError for another shape, and for numbers that aren't finite.
        """
        planes, _, rows, columns = self.target.shape
        _check_stack(stack, (planes, rows, columns, 3))
        self._set_target(_target_channels(self.loss, stack).to(self.target))

    def _set_target(self, target: Tensor) -> None:
        self.target = target
        low, high = torch.aminmax(target)
        self._target_needs_no_clipping = bool(low >= 0 and high <= 1) and self._is_linear_srgb

    def evaluate_rows(self, plane: int, rows: slice, image: Tensor) -> ResidualSums:
        """Sums over rows of a plane's image (channel, row, x), which is overwritten with ∂L/∂image.

        A structural loss takes all rows at once (`needs_whole_planes`).
        """
        cut = self.cut_region(rows)
        if cut is None:
            image.zero_()
            return ResidualSums(image.new_zeros(()), image.new_zeros(()))
        inside, inside_target = cut
        cropped, target = image[inside], self.target[plane][inside_target]
        error_norm = self._error_norm(cropped, target)
        derivative = torch_srgb_encode_derivative(cropped) if self.loss.is_encoded else None
        if self.loss.is_encoded:
            cropped.copy_(torch_srgb_encode(cropped))
            target = torch_srgb_encode(target)
        structure = _structural_part(cropped, target, self.loss.structure_weight)
        residual_norm = torch.linalg.vector_norm(cropped.sub_(target))
        cropped.mul_(2 * self._sample_weight(plane))
        if structure is not None:
            residual_norm = torch.hypot(residual_norm, structure.norm)
            cropped.add_(structure.slopes, alpha=self._sample_weight(plane))
        if derivative is not None:
            cropped.mul_(derivative)
        zero_outside(image, *inside[1:])
        return ResidualSums(residual_norm, error_norm)

    @property
    def needs_whole_planes(self) -> bool:
        """Whether `evaluate_rows` has to be given all rows of a plane at once."""
        return self.loss.structure_weight > 0

    def plane_loss(self, plane: int, parts: Sequence[ResidualSums]) -> PlaneLoss:
        """The loss of a plane from the sums over all its rows."""
        norms = torch.stack([torch.stack((part.residual_norm, part.error_norm)) for part in parts]).cpu().double()
        residual, error = norms.square().sum(dim=0).tolist()
        rows, columns = self.region_slices
        samples = (rows.stop - rows.start) * (columns.stop - columns.start)
        mean_square = error / (samples * (1 if len(self.target[0]) == 1 else 3))
        return PlaneLoss(self._sample_weight(plane) * residual, -10 * math.log10(max(mean_square, 1e-20)))

    def cut_region(self, rows: slice) -> tuple[Cut, Cut] | None:
        """Slices (channel, y, x) of the region in a block of rows, and in a whole plane; None if it lies elsewhere."""
        region_rows, columns = self.region_slices
        start, stop = max(rows.start, region_rows.start), min(rows.stop, region_rows.stop)
        if start >= stop:
            return None
        channels = slice(None)
        return (channels, slice(start - rows.start, stop - rows.start), columns), (
            channels,
            slice(start, stop),
            columns,
        )

    def picture(self, image: Tensor) -> NDArray[np.floating]:
        """An image (channel, y, x) as linear sRGB (y, x, 3); grey where there is only one channel."""
        if len(image) == 1:
            image = image.expand(3, -1, -1)
        elif self._to_rgb is not None:
            image = torch.einsum("rc,cyx->ryx", self._to_rgb, image)
        return image.movedim(0, -1).cpu().numpy().copy()

    def _sample_weight(self, plane: int) -> float:
        """What a squared residual of one channel of one sample adds to the loss."""
        rows, columns = self.region_slices
        samples = (rows.stop - rows.start) * (columns.stop - columns.start)
        return float(self.plane_weights[plane]) / (len(self.target) * self.target.shape[1] * samples)

    def _error_norm(self, image: Tensor, target: Tensor) -> Tensor:
        """The norm of the difference of images in linear sRGB, or of the only channel, clipped to 0…1."""
        if self._to_rgb is not None:
            image, target = (torch.einsum("rc,cyx->ryx", self._to_rgb, t) for t in (image, target))
        error = image.clamp(0, 1).sub_(target if self._target_needs_no_clipping else target.clamp(0, 1))
        return torch.linalg.vector_norm(error)


@dataclass(frozen=True)
class _StructuralPart:
    """s·n·(1 − MS-SSIM) of an image of n numbers: its root, and its slopes (channel, y, x)."""

    norm: Tensor
    slopes: Tensor


def _structural_part(image: Tensor, target: Tensor, weight: float) -> _StructuralPart | None:
    """The structural part of a loss of images (channel, y, x) with the weight s; None where that is 0.

    Channel by channel, because what a slope needs takes some hundred images of memory.
    """
    if weight == 0:
        return None
    total, slopes = image.new_zeros(()), torch.empty_like(image)
    for channel in range(len(image)):
        with torch.enable_grad():
            variable = image[channel : channel + 1].detach().clone().requires_grad_()
            similarity = multi_scale_similarity(variable, target[channel : channel + 1]).sum()
            part = weight * variable.numel() * (1 - similarity)
            (slopes[channel : channel + 1],) = torch.autograd.grad(part, variable)
        total += part.detach()
    return _StructuralPart(total.clamp_min(0).sqrt(), slopes)


def make_objective(
    plan: Plan, stack: NDArray[np.floating], settings: Settings, *, device: str = "cpu", double: bool = False
) -> Objective:
    """The objective for a focal stack (plane, y, x, 3) in linear sRGB, on the plan's planes and simulation grid.

    double: compute in float64. Raises UserError when the stack, the region or the planes' weights don't fit the plan.
    """
    planes, shape = len(plan.planes_m), plan.grid.shape
    _check_stack(stack, (planes, *shape, 3))
    loss = find_loss_space(settings.loss_for(plan.system.observer))
    target = _target_channels(loss, stack).to(torch.float64 if double else torch.float32).to(device)
    return Objective(
        loss,
        channels_of_wavelengths(loss, plan, target),
        target,
        _plane_weights(settings, planes),
        _checked_region(settings, shape, loss),
    )


def _check_stack(stack: NDArray[np.floating], expected: tuple[int, ...]) -> None:
    """Raises UserError for a stack of another shape, without light, or with values that aren't finite."""
    if stack.shape != expected:
        raise UserError("target", f"a stack of shape {stack.shape}", expected=f"(plane, y, x, 3) = {expected}")
    if not np.isfinite(stack).all() or not np.any(stack > 0):
        raise UserError("target", "no light, or not a number somewhere", expected="finite values, some above 0")


def _target_channels(loss: LossSpace, stack: NDArray[np.floating]) -> Tensor:
    """The channels (plane, channel, y, x) of a stack (plane, y, x, 3)."""
    return torch.as_tensor(np.ascontiguousarray(np.moveaxis(loss.channels_of_rgb(stack), -1, 1)))


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


def _checked_region(settings: Settings, shape: tuple[int, int], loss: LossSpace) -> Region | None:
    x, y, width, height = settings.region or (0, 0, shape[1], shape[0])
    if settings.region is not None and (x + width > shape[1] or y + height > shape[0]):
        found = f"x, y, w, h = {x}, {y}, {width}, {height}"
        raise UserError("region", found, expected=f"inside the simulated {shape[1]} x {shape[0]} samples")
    if loss.structure_weight and scale_count((height, width)) == 0:
        expected = f"at least {WINDOW} rows and columns for this loss, {WINDOW * 16} for all of its scales"
        raise UserError("loss", f"images of {width} x {height} samples", expected=expected)
    return settings.region
