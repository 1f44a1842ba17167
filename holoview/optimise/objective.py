"""What a hologram is optimised for: a focal stack in a colour space, compared at fixed brightness."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.colour import SRGB_TO_XYZ, XYZ_TO_SRGB
from holoview.errors import UserError
from holoview.plan import Plan

Tensor = torch.Tensor


@dataclass(frozen=True)
class Objective:
    """Mean squared error of linear channels: three of sRGB for a colour observer, one (luminance) for a mono camera.

    colours (wavelength, channel): channels of unit intensity. target (plane, channel, y, x). Brightness is fixed: 1 is
    the display's white, and no free factor is fitted.
    """

    colours: Tensor
    target: Tensor

    @cached_property
    def shown(self) -> Tensor:
        """The target as a display can show it, clipped to 0…1."""
        return self.target.clamp(0, 1)

    def residual(self, image: Tensor) -> Tensor:
        """Overwrites `image` (plane, channel, y, x) with its difference from the target."""
        return image.sub_(self.target)

    def loss(self, residual: Tensor) -> float:
        """Mean squared residual."""
        return float(torch.linalg.vector_norm(residual).double().square()) / residual.numel()

    def slope(self, residual: Tensor, wavelength: int, weight: float) -> Tensor:
        """weight × ½·∂(Σ residual²)/∂(intensity of a laser), (plane, y, x): its colour's share of the residual."""
        slope = torch.zeros_like(residual[:, 0])
        for channel, colour in enumerate(self.colours[wavelength].tolist()):
            slope.add_(residual[:, channel], alpha=weight * colour)
        return slope

    def psnr_db(self, image: Tensor) -> float:
        """PSNR (dB) of the image clipped to 0…1, the mean over planes."""
        errors = image.clamp(0, 1).sub_(self.shown).square_().mean(dim=(1, 2, 3))
        return float((-10 * torch.log10(errors.clamp_min(1e-20))).mean())


def make_objective(plan: Plan, stack: NDArray[np.floating], *, device: str = "cpu", double: bool = False) -> Objective:
    """The objective for a focal stack (plane, y, x, 3) in linear sRGB, on the plan's planes and simulation grid.

    Raises UserError when the stack's shape doesn't fit the plan.
    """
    expected = (len(plan.planes_m), *plan.grid.shape, 3)
    if stack.shape != expected:
        raise UserError("target", f"a stack of shape {stack.shape}", expected=f"(plane, y, x, 3) = {expected}")
    if not np.isfinite(stack).all() or not np.any(stack > 0):
        raise UserError("target", "no light, or not a number somewhere", expected="finite values, some above 0")
    if plan.system.observer == "mono":
        colours = plan.colour_weights[:, 1:2]
        channels = stack @ SRGB_TO_XYZ[1][:, None]
    else:
        colours, channels = plan.colour_weights @ XYZ_TO_SRGB.T, stack
    dtype = torch.float64 if double else torch.float32
    target = torch.as_tensor(np.ascontiguousarray(np.moveaxis(channels, -1, 1)), dtype=dtype, device=device)
    return Objective(torch.as_tensor(colours.copy(), dtype=dtype, device=device), target)
