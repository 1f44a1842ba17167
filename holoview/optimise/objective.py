"""What a hologram is optimised for: a focal stack in a colour space, compared at fixed brightness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.model.plan import Plan
from holoview.optimise.losses import LossSpace, find_loss_space, torch_srgb_encode, torch_srgb_encode_derivative
from holoview.optimise.settings import Region, Settings
from holoview.util.errors import UserError

Tensor = torch.Tensor


@dataclass(frozen=True)
class PlaneLoss:
    """What a plane adds to the loss, and its PSNR (dB) clipped to 0…1: of linear sRGB, or of the only channel."""

    loss: float
    psnr_db: float


class Objective:
    """L = Σ_k weight_k·mean(residual_k²)/K over K planes, in the region. Brightness is fixed: 1 is the display's white.

    target (plane, channel, y, x): linear, before any encoding. colours (wavelength, channel): of unit intensity.
    """

    def __init__(
        self,
        loss: LossSpace,
        wavelength_channels: Tensor,
        target: Tensor,
        weights: NDArray[np.float64],
        region: Region | None,
    ):
        self.loss, self.wavelength_channels, self.target = loss, wavelength_channels, target
        self.plane_weights = weights
        rows, columns = target.shape[-2:]
        x, y, width, height = region or (0, 0, columns, rows)
        self.region_slices = (slice(y, y + height), slice(x, x + width))
        low, high = torch.aminmax(target)
        matrix = loss.to_rgb
        self._target_in_srgb_range = (
            bool(low >= 0 and high <= 1) and matrix is not None and np.allclose(matrix, np.eye(3))
        )
        self._to_rgb = None if matrix is None or np.allclose(matrix, np.eye(3)) else torch.as_tensor(matrix).to(target)

    def evaluate_plane(self, plane: int, image: Tensor) -> PlaneLoss:
        """Judges a plane's image (channel, y, x), and overwrites it with ∂L/∂image."""
        part, wanted = (t[(..., *self.region_slices)] for t in (image, self.target[plane]))
        psnr_db = self._psnr_db(part, wanted)
        share = float(self.plane_weights[plane]) / (len(self.target) * part.numel())
        if self.loss.is_encoded:
            slope = torch_srgb_encode_derivative(part)
            part.copy_(torch_srgb_encode(part)).sub_(torch_srgb_encode(wanted))
        else:
            slope = None
            part.sub_(wanted)
        loss = share * float(torch.linalg.vector_norm(part)) ** 2
        part.mul_(2 * share)
        if slope is not None:
            part.mul_(slope)
        self._zero_outside_region(image)
        return PlaneLoss(loss, psnr_db)

    def picture(self, image: Tensor) -> NDArray[np.floating]:
        """An image (channel, y, x) as linear sRGB (y, x, 3); grey where there is only one channel."""
        if len(image) == 1:
            image = image.expand(3, -1, -1)
        elif self._to_rgb is not None:
            image = torch.einsum("rc,cyx->ryx", self._to_rgb, image)
        return image.movedim(0, -1).cpu().numpy().copy()

    def _psnr_db(self, part: Tensor, wanted: Tensor) -> float:
        shown, known = part, wanted
        if self._to_rgb is not None:
            shown, known = (torch.einsum("rc,cyx->ryx", self._to_rgb, t) for t in (part, wanted))
        error = shown.clamp(0, 1).sub_(known if self._target_in_srgb_range else known.clamp(0, 1))
        mean = float(torch.linalg.vector_norm(error)) ** 2 / error.numel()
        return float(-10 * np.log10(max(mean, 1e-20)))

    def _zero_outside_region(self, image: Tensor) -> None:
        rows, columns = self.region_slices
        image[:, : rows.start].zero_()
        image[:, rows.stop :].zero_()
        image[:, rows, : columns.start].zero_()
        image[:, rows, columns.stop :].zero_()


def make_objective(
    plan: Plan, stack: NDArray[np.floating], settings: Settings, *, device: str = "cpu", double: bool = False
) -> Objective:
    """The objective for a focal stack (plane, y, x, 3) in linear sRGB, on the plan's planes and simulation grid.

    Raises UserError when the stack, the region or the planes' weights don't fit the plan.
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
        _region(settings, shape),
    )


def channels_of_wavelengths(loss: LossSpace, plan: Plan, like: Tensor) -> Tensor:
    """Channels (wavelength, channel) of unit intensity at each wavelength."""
    return torch.as_tensor(loss.channels_of_xyz(plan.colour_weights).copy()).to(like.dtype).to(like.device)


def _plane_weights(settings: Settings, planes: int) -> NDArray[np.float64]:
    if settings.plane_weights is None:
        return np.ones(planes)
    weights = np.asarray(settings.plane_weights, dtype=np.float64)
    if len(weights) != planes:
        raise UserError("plane weights", f"{len(weights)} of them", expected=f"one for each of {planes} planes")
    return weights * (planes / weights.sum())


def _region(settings: Settings, shape: tuple[int, int]) -> Region | None:
    if settings.region is not None:
        x, y, width, height = settings.region
        if x + width > shape[1] or y + height > shape[0]:
            found = f"x, y, w, h = {x}, {y}, {width}, {height}"
            raise UserError("region", found, expected=f"inside the simulated {shape[1]} x {shape[0]} samples")
    return settings.region
