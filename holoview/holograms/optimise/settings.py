"""Options of the optimiser, and the colour spaces in which image and target are compared."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from holoview.light.colour import LMS_TO_XYZ, SRGB_TO_XYZ, XYZ_TO_SRGB
from holoview.light.numerics.sampling import Region
from holoview.util.errors import UserError, suggest_matches

Floats = NDArray[np.float64]

VARIABLES = ("patterns", "amplitudes", "wavelengths")
_MOST_WEIGHT = 1e9  # of a plane, or of the eyebox: further apart, sums lose all but one of their terms
INITIAL_PATTERNS = ("random", "smooth")


@dataclass(frozen=True)
class Settings:
    """Options of the optimiser, for `iterate`.

    iterations: number of gradient steps, at least 1.
    seed: of random initial patterns.
    step_rad: Adam's first step, as phase at the middle wavelength; it falls as √(fraction of iterations left).
    betas: Adam's decay rates of the mean gradient and of its mean square, each from 0 to below 1.
    amplitudes_every: iterations between two solutions for the laser amplitudes, and between two wavelength steps.
    free: the variables that are optimised, of "patterns", "amplitudes" and "wavelengths"; the others keep the values of
    the system and of the initial patterns.
    loss: a name in `settings.LOSS_SPACES`; None: linear sRGB, or "mono" for a monochrome observer.
    region: (x, y, width, height), samples of the simulated image that count; all when None.
    plane_weights: one weight for each plane, of 0 or more; equal when None.
    eyebox: weight of the squared variation of light in the eyebox, which is added to the loss; 0 for no penalty.
    begin: initial patterns, "random" over the stroke or "smooth" (higher PSNR, an almost empty eyebox).
    wavelength_range_m: least and greatest wavelength of lasers whose wavelength is free, m.
    wavelength_spacing_m: least distance between two of them, m.
    wavelength_step_m: Adam's first step of wavelengths, m.
    pupil_places_m: places (y, x) of the pupil of the system's eye in the eyebox, m, from each of which the target is
    given and counts; that of the system alone when empty. Not with free wavelengths.
    drawn_pupils: number of places of the pupil that are drawn anew in each iteration, from the seed, in place of
    `pupil_places_m`; 0 for none. Not with free wavelengths.
    drawn_planes: number of planes that an iteration takes before the last 30 %, or the last 40 iterations where these
    are more, but in the first half at least; they come in turn, in an order drawn from the seed. 0, or as many as there
    are, for all planes. None for one plane in runs of 80 iterations or more, where there are four planes or more of
    equal weight, seen from one place; for all elsewhere.
    Each tenth iteration, those that solve for amplitudes or move wavelengths, and those of modulators with levels take
    all.
    drawn_radius_m: of the disc about the pupil of the system's eye in which they are drawn, m.

    Raises UserError for values out of range.

    >>> import holoview as hv
    >>> settings = hv.Settings(iterations=30, free=("patterns",), region=(8, 8, 32, 32))
    >>> settings.iterations, settings.begin
    (30, 'random')
    """

    iterations: int = 60
    step_rad: float = 0.5
    betas: tuple[float, float] = (0.5, 0.5)
    amplitudes_every: int = 5
    seed: int = 0
    free: tuple[str, ...] = ("patterns", "amplitudes")
    loss: str | None = None
    region: Region | None = None
    plane_weights: tuple[float, ...] | None = None
    eyebox: float = 0.0
    begin: str = "random"
    wavelength_range_m: tuple[float, float] = (440e-9, 660e-9)
    wavelength_spacing_m: float = 4e-9
    wavelength_step_m: float = 3e-9
    pupil_places_m: tuple[tuple[float, float], ...] = ()
    drawn_pupils: int = 0
    drawn_radius_m: float = 0.0
    drawn_planes: int | None = None

    def __post_init__(self) -> None:
        for key, count in (("iterations", self.iterations), ("amplitudes_every", self.amplitudes_every)):
            if not isinstance(count, int) or count < 1:
                raise UserError(key, str(count), expected="at least 1")
        if not 1e-9 <= self.step_rad <= 1e9:
            raise UserError("step", str(self.step_rad), expected="a positive phase step from 1e-9 to 1e9")
        if not all(0 <= beta < 1 for beta in self.betas):
            raise UserError("betas", str(self.betas), expected="numbers from 0 to below 1")
        if not 0 <= self.eyebox <= _MOST_WEIGHT:
            raise UserError("eyebox", str(self.eyebox), expected=f"a weight of 0 or more, at most {_MOST_WEIGHT:g}")
        for name in self.free:
            if name not in VARIABLES:
                raise UserError(
                    "free", f'"{name}"', expected=", ".join(VARIABLES), remedy=suggest_matches(name, VARIABLES)
                )
        if not self.free:
            raise UserError("free", "nothing", expected=f"at least one of {', '.join(VARIABLES)}")
        if self.begin not in INITIAL_PATTERNS:
            raise UserError("begin", f'"{self.begin}"', expected=" or ".join(INITIAL_PATTERNS))
        self._check_region_and_weights()
        self._check_wavelengths()
        self._check_pupils()

    def loss_for(self, observer: str) -> str:
        """The name of the loss.

        observer: `System.observer`, which chooses the loss where `loss` is None.

        >>> import holoview as hv
        >>> hv.Settings().loss_for("eye"), hv.Settings().loss_for("mono"), hv.Settings(loss="xyz").loss_for("eye")
        ('linear-srgb', 'mono', 'xyz')
        """
        return self.loss or ("mono" if observer == "mono" else "linear-srgb")

    def _check_region_and_weights(self) -> None:
        if self.region is not None and (min(self.region[:2]) < 0 or min(self.region[2:]) < 1):
            raise UserError("region", str(self.region), expected="x, y ≥ 0 and a width and height ≥ 1")
        weights = self.plane_weights
        if weights is not None and not (all(0 <= w <= _MOST_WEIGHT for w in weights) and max(weights, default=0) > 0):
            raise UserError("plane weights", str(weights), expected="numbers of 0 or more, one of them positive")
        if weights is not None and max(weights) < 1 / _MOST_WEIGHT:
            expected = f"the largest from {1 / _MOST_WEIGHT:g} to {_MOST_WEIGHT:g}"
            raise UserError("plane weights", str(weights), expected=expected)

    def _check_pupils(self) -> None:
        places = tuple((float(y), float(x)) for y, x in self.pupil_places_m)
        object.__setattr__(self, "pupil_places_m", places)
        if not isinstance(self.drawn_pupils, int) or self.drawn_pupils < 0:
            raise UserError("drawn pupils", str(self.drawn_pupils), expected="0 or more")
        if self.drawn_planes is not None and not (isinstance(self.drawn_planes, int) and self.drawn_planes >= 0):
            raise UserError("drawn planes", str(self.drawn_planes), expected="0 or more")
        if self.drawn_pupils and not 0 < self.drawn_radius_m < math.inf:
            raise UserError("drawn pupils", f"a radius of {self.drawn_radius_m:g} m", expected="a radius above 0")
        if self.drawn_pupils and places:
            raise UserError("drawn pupils", "with fixed places", expected="one of them")
        if (places or self.drawn_pupils) and "wavelengths" in self.free:
            raise UserError("free", "wavelengths with several places of the pupil", expected="patterns and amplitudes")

    def _check_wavelengths(self) -> None:
        low, high = self.wavelength_range_m
        if not (0 < low < high < 1e-5 and self.wavelength_spacing_m >= 0 and 0 < self.wavelength_step_m < math.inf):
            found = f"{low * 1e9:g} to {high * 1e9:g} nm, spacing {self.wavelength_spacing_m * 1e9:g} nm"
            raise UserError("wavelength range", found, expected="a rising range, a spacing ≥ 0, a positive step")


FIRST_ITERATIONS, NEXT_ITERATIONS = 200, 10
"""Default of the iterations for the first picture of a film, and for each later one, which then is as good."""
_NEXT_STEP = 0.4  # of the first picture's step: a full step would undo much of the hologram before


def next_settings(settings: Settings, iterations: int) -> Settings:
    """Settings for a picture that is like the picture before, from whose hologram it begins: with smaller steps."""
    return replace(settings, iterations=iterations, step_rad=_NEXT_STEP * settings.step_rad)


# --- colour spaces of the loss ---------------------------------------------------------------------------------------

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


FIELD_LOSS = "field"
"""The choice of a loss that compares complex fields (`optimise.field_loss`), of a target that is one."""

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
