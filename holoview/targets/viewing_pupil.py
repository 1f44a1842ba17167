"""A target as it is seen through a round pupil: perhaps off the axis, and in focus elsewhere at each wavelength.

A pupil passes the directions |s − c| ≤ NA, where s is a direction's sine in y and x. Its blur is a disc of diameter
2·NA·Δz, moved by c·Δz. An eye with longitudinal chromatic aberration focuses each wavelength at a distance of its own.
A target holds three colours, so that its light is spread over the display's lasers first: linear sRGB C becomes

    C = Σ_λ M_λ·C,    M_λ = w_λ·P_λ + (1 − W·P)/n

with the n lasers' colours at unit intensity w_λ, the columns of W (3, wavelength), and its pseudo-inverse P: of all
mixtures of the colour, the one with the least sum of squared intensities. What fewer than three lasers can't mix is
spread evenly. M_λ·C is blurred for the focus of λ, and the results are added. Blur and occlusion act on all colours of
a wavelength alike, so that M_λ is applied to what they give: all wavelengths share the layers of the scene.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.targets.defocus import LightCone
from holoview.targets.focal_stack import render_focal_stack

_MOST_BYTES = 2**28  # of the pictures that are computed at a time


@dataclass(frozen=True, eq=False)
class ViewingPupil:
    """The pupil through which a target is seen.

    na: sine of the half angle that it takes up, above 0 and below 1. centre: sines (y, x) of the direction of its
    middle; x > 0 is passed by light that goes towards larger x.
    focus_m: distances z (plane, wavelength) where each wavelength is in focus while the eye looks at a plane, m; the
    plane itself when None.

    offsets_m: displacement of each wavelength's picture, (wavelength, 2) y and x, m; none when None.

    Raises ValueError for numbers that make no sense.

    >>> ViewingPupil(0.02, centre=(0.0, 0.01)).cone().centre
    (0.0, 0.01)
    """

    na: float
    centre: tuple[float, float] = (0.0, 0.0)
    focus_m: NDArray[np.float64] | None = None
    offsets_m: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        if not (0 < self.na < 1 and all(-1 < sine < 1 for sine in self.centre)):
            raise ValueError(f"pupil of NA {self.na} about {self.centre}: expected sines, and an NA above 0")
        if self.focus_m is not None and not (np.ndim(self.focus_m) == 2 and np.isfinite(self.focus_m).all()):
            raise ValueError("focus_m: expected finite distances (plane, wavelength)")

    def cone(self, wavelength: int = 0) -> LightCone:
        """The light cone that reaches the retina from an image point, at the wavelength of an index."""
        offset = (0.0, 0.0) if self.offsets_m is None else tuple(self.offsets_m[wavelength].tolist())
        return LightCone(self.na, "disc", self.centre, (offset[0], offset[1]))


def render_through_pupil(
    rgb_linear: NDArray[np.float32],
    depth_m: float | NDArray[np.floating],
    planes_m: Sequence[float] | NDArray[np.floating],
    pitch_m: float,
    pupil: ViewingPupil,
    laser_rgb: NDArray[np.float64],
) -> NDArray[np.float32]:
    """The focal stack (plane, y, x, 3) of a picture as an eye sees it through a pupil, float32.

    laser_rgb: (wavelength, 3) linear sRGB of each laser at unit intensity, which matter if `pupil.focus_m` is given.
    The other arguments are those of `render_focal_stack`.

    Raises ValueError as that does, and if `pupil.focus_m` isn't (plane, wavelength).
    """
    if pupil.focus_m is None:
        return render_focal_stack(rgb_linear, depth_m, planes_m, pitch_m, pupil.cone())
    return sum_over_wavelengths(
        lambda focus_m, cones: render_focal_stack(rgb_linear, depth_m, focus_m, pitch_m, cones),
        (len(planes_m), *rgb_linear.shape),
        pupil,
        laser_rgb,
    )


def sum_over_wavelengths(
    render: Callable[[Sequence[float], Sequence[LightCone]], NDArray[np.float32]],
    shape: tuple[int, ...],
    pupil: ViewingPupil,
    laser_rgb: NDArray[np.float64],
) -> NDArray[np.float32]:
    """The focal stack of shape (plane, y, x, 3) that a pupil sees with its own focus for each wavelength, float32.

    render: from distances (n,) in focus, and as many cones, to what is seen there in all colours, (n, y, x, 3).

    Raises ValueError if `pupil.focus_m` isn't (plane, wavelength).
    """
    expected = (shape[0], len(laser_rgb))
    if pupil.focus_m is None or pupil.focus_m.shape != expected:
        found = None if pupil.focus_m is None else pupil.focus_m.shape
        raise ValueError(f"focus_m {found}: expected (plane, wavelength) = {expected}")
    total = np.zeros(shape, dtype=np.float32)
    shares = colour_shares(laser_rgb).astype(np.float32)
    pairs = list(np.ndindex(*expected))
    at_a_time = max(_MOST_BYTES // (16 * shape[1] * shape[2]), 1)
    for start in range(0, len(pairs), at_a_time):
        some = pairs[start : start + at_a_time]
        seen = render([float(pupil.focus_m[pair]) for pair in some], [pupil.cone(wavelength) for _, wavelength in some])
        for (plane, wavelength), light in zip(some, seen, strict=True):
            total[plane] += light @ shares[wavelength].T
    return total


def colour_shares(laser_rgb: NDArray[np.float64]) -> NDArray[np.float64]:
    """The matrices M_λ (wavelength, 3, 3) that give each laser's part of a colour; their sum is the unit matrix.

    laser_rgb: (wavelength, 3) linear sRGB of each laser at unit intensity.
    """
    mixture = np.linalg.pinv(laser_rgb.T)
    own = laser_rgb[:, :, None] * mixture[:, None, :]
    return np.asarray(own + (np.eye(3) - own.sum(axis=0)) / len(laser_rgb))
