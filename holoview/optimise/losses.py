"""In which colour space an image is compared with its target: names, channels, and the curve of encoded sRGB."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.colour import LMS_TO_XYZ, SRGB_TO_XYZ, XYZ_TO_SRGB
from holoview.errors import UserError, near_matches

Tensor = torch.Tensor
Floats = NDArray[np.float64]

_XYZ_TO_LMS: Floats = np.asarray(np.linalg.inv(LMS_TO_XYZ), dtype=np.float64)
_KNEE, _SLOPE = 0.0031308, 12.92  # IEC 61966-2-1


@dataclass(frozen=True)
class Loss:
    """Channels as a matrix (channel, XYZ); `flat`: a mono camera that sees every laser alike; `encoded`: sRGB's curve.

    rgb: the matrix (3, channel) back to linear sRGB, None where channels are fewer than three.
    """

    matrix: Floats
    meaning: str
    flat: bool = False
    encoded: bool = False

    @property
    def rgb(self) -> Floats | None:
        return XYZ_TO_SRGB @ np.linalg.inv(self.matrix) if len(self.matrix) == 3 else None

    def colours(self, xyz: Floats) -> Floats:
        """Channels (laser, channel) of lasers whose unit intensity makes XYZ (laser, 3)."""
        return np.ones((len(xyz), 1)) if self.flat else xyz @ self.matrix.T

    def channels(self, rgb: NDArray[np.floating]) -> NDArray[np.floating]:
        """Channels (…, channel) of a target in linear sRGB (…, 3)."""
        to_channels = (self.matrix @ SRGB_TO_XYZ).T
        return rgb @ to_channels.astype(rgb.dtype if rgb.dtype.kind == "f" else np.float64)


LOSSES = {
    "linear-srgb": Loss(XYZ_TO_SRGB, "linear sRGB: what the PSNR is defined on"),
    "srgb": Loss(XYZ_TO_SRGB, "encoded sRGB: errors as large as they look, dark ones count more", encoded=True),
    "xyz": Loss(np.eye(3), "CIE XYZ: colours outside sRGB count as what they are"),
    "lms": Loss(_XYZ_TO_LMS, "responses of the eye's cones"),
    "luminance": Loss(np.eye(3)[1:2], "luminance only: colours are free"),
    "mono": Loss(np.eye(3)[1:2], "a mono camera that sees all lasers alike, against the target's luminance", flat=True),
}


def find_loss(name: str) -> Loss:
    """The loss of that name. Raises UserError for another."""
    if name not in LOSSES:
        raise UserError("loss", f'"{name}"', expected=", ".join(LOSSES), remedy=near_matches(name, LOSSES))
    return LOSSES[name]


def encoded(light: Tensor) -> Tensor:
    """Linear light to the sRGB signal, odd-symmetric, any shape; the power is kept away from 0, where it is steep."""
    size = light.abs()
    curve = 1.055 * size.clamp_min(_KNEE) ** (1 / 2.4) - 0.055
    return torch.where(size <= _KNEE, _SLOPE * light, torch.copysign(curve, light))


def encoded_slope(light: Tensor) -> Tensor:
    """Derivative of `encoded`: finite everywhere, 12.92 at most."""
    size = light.abs().clamp_min(_KNEE)
    return torch.where(size <= _KNEE, _SLOPE, (1.055 / 2.4) * size ** (1 / 2.4 - 1))
