"""The curve of encoded sRGB and its derivative in torch."""

from __future__ import annotations

import torch

Tensor = torch.Tensor

_SRGB_KNEE, _SRGB_SLOPE = 0.0031308, 12.92  # IEC 61966-2-1


def torch_srgb_encode(light: Tensor) -> Tensor:
    """sRGB's curve (IEC 61966-2-1) of linear light of any shape, continued to negative values as an odd function."""
    magnitude = light.abs()
    curve = 1.055 * magnitude.clamp_min(_SRGB_KNEE) ** (1 / 2.4) - 0.055
    return torch.where(magnitude <= _SRGB_KNEE, _SRGB_SLOPE * light, torch.copysign(curve, light))


def torch_srgb_encode_derivative(light: Tensor) -> Tensor:
    """Derivative of `torch_srgb_encode`: at most 12.92."""
    magnitude = light.abs().clamp_min(_SRGB_KNEE)
    return torch.where(magnitude <= _SRGB_KNEE, _SRGB_SLOPE, (1.055 / 2.4) * magnitude ** (1 / 2.4 - 1))
