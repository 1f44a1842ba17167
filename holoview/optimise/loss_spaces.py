"""The colour spaces in which image and target are compared, by squared errors and perhaps by structure too."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.colour import LMS_TO_XYZ, SRGB_TO_XYZ, XYZ_TO_SRGB
from holoview.util.errors import UserError, suggest_matches

Floats = NDArray[np.float64]

_XYZ_TO_LMS: Floats = np.asarray(np.linalg.inv(LMS_TO_XYZ), dtype=np.float64)

# Measured in docs/optimiser.md. MS-SSIM alone lets a picture go dark, because its speckle then fades more than its
# structure.
_STRUCTURE_WEIGHT = 0.03


@dataclass(frozen=True)
class LossSpace:
    """The channels that are compared.

    matrix (channel, XYZ): linear channels of CIE XYZ. description: for the command line's help.
    ignores_wavelength: a monochrome camera, for which all lasers are equally bright. is_encoded: the channels pass
    through sRGB's curve before they are compared. structure_weight: of 1 − MS-SSIM (multi-scale structural similarity,
    the mean of the channels), which is added to the mean squared error.
    """

    matrix: Floats
    description: str
    ignores_wavelength: bool = False
    is_encoded: bool = False
    structure_weight: float = 0.0

    @property
    def to_rgb(self) -> Floats | None:
        """The matrix (3, channel) back to linear sRGB; None for fewer than three channels."""
        return XYZ_TO_SRGB @ np.linalg.inv(self.matrix) if len(self.matrix) == 3 else None

    def channels_of_xyz(self, xyz: Floats) -> Floats:
        """Channels (laser, channel) of lasers whose XYZ at unit intensity are given, (laser, 3)."""
        return np.ones((len(xyz), 1)) if self.ignores_wavelength else xyz @ self.matrix.T

    def channels_of_rgb(self, rgb: NDArray[np.floating]) -> NDArray[np.floating]:
        """Channels (…, channel) of a target in linear sRGB (…, 3)."""
        to_channels = (self.matrix @ SRGB_TO_XYZ).T
        return rgb @ to_channels.astype(rgb.dtype if rgb.dtype.kind == "f" else np.float64)


LOSS_SPACES = {
    "linear-srgb": LossSpace(XYZ_TO_SRGB, "linear sRGB: what the PSNR is defined on"),
    "srgb": LossSpace(XYZ_TO_SRGB, "encoded sRGB: errors as large as they look, dark ones count more", is_encoded=True),
    "xyz": LossSpace(np.eye(3), "CIE XYZ: colours outside sRGB count as what they are"),
    "lms": LossSpace(_XYZ_TO_LMS, "responses of the eye's cones"),
    "luminance": LossSpace(np.eye(3)[1:2], "luminance only: colours are free"),
    "mono": LossSpace(
        np.eye(3)[1:2],
        "a mono camera that sees all lasers alike, against the target's luminance",
        ignores_wavelength=True,
    ),
    "ms-ssim": LossSpace(
        XYZ_TO_SRGB,
        "errors of encoded sRGB, and of its structure on five scales; slower",
        is_encoded=True,
        structure_weight=_STRUCTURE_WEIGHT,
    ),
}


def find_loss_space(name: str) -> LossSpace:
    """The loss space of a name. Raises UserError for an unknown one."""
    if name not in LOSS_SPACES:
        raise UserError("loss", f'"{name}"', expected=", ".join(LOSS_SPACES), remedy=suggest_matches(name, LOSS_SPACES))
    return LOSS_SPACES[name]
