"""Options of the optimiser, and the colour spaces in which image and target are compared.

An option is declared once, as a field of `Settings`: its type with unit and range, the sentence that explains it, and
its default. The flags of the command line with their help, the range check, JSON, the viewer's widgets and the table in
docs/optimiser.md follow from it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from holoview.light.colour import LMS_TO_XYZ, SRGB_TO_XYZ, XYZ_TO_SRGB
from holoview.light.model.fields import (
    Integer,
    Maybe,
    Number,
    Several,
    Word,
    described_field,
    spaced_key,
    validate,
    with_field_docs,
)
from holoview.light.numerics.sampling import Region
from holoview.light.observers import PEOPLE
from holoview.util.errors import UserError

Floats = NDArray[np.float64]

VARIABLES = ("patterns", "amplitudes", "wavelengths")
INITIAL_PATTERNS = ("random", "smooth")

# --- colour spaces of the loss ---------------------------------------------------------------------------------------

_XYZ_TO_LMS: Floats = np.asarray(np.linalg.inv(LMS_TO_XYZ), dtype=np.float64)

# Measured in docs/optimiser-evidence.md. MS-SSIM alone lets a picture go dark, because its speckle then fades more than
# its structure.
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
FIELD_LOSS_DOC = "the complex field of each laser, of a target that is one."

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
    return LOSS_SPACES[Word(tuple(LOSS_SPACES)).parse(name, "loss")]


# --- the options ------------------------------------------------------------------------------------------------------

_MOST = 1_000_000
_COUNT = Integer(1, _MOST, words=f"at least 1, at most {_MOST}")
_COUNT_OR_NONE = Integer(0, _MOST, words=f"0 or more, at most {_MOST}")
_MOST_WEIGHT = 1e9  # of a plane, or of the eyebox: further apart, sums lose all but one of their terms


@with_field_docs
@dataclass(frozen=True)
class Settings:
    """Options of the optimiser, for `iterate`. Raises UserError for values out of range.

    >>> import holoview as hv
    >>> settings = hv.Settings(iterations=30, free=("patterns",), region=(8, 8, 32, 32))
    >>> settings.iterations, settings.begin
    (30, 'random')

    Fields:
    """

    iterations: int = described_field(_COUNT, "Number of gradient steps.", default=60)
    step_rad: float = described_field(
        Number(low=1e-9, high=1e9, words="a positive phase step from 1e-9 to 1e9"),
        "First step of the patterns, as phase at the middle wavelength; it falls as √(fraction of iterations left).",
        default=0.5,
    )
    betas: tuple[float, float] = described_field(
        Several(Number(low=0, high=np.nextafter(1, 0)), 2, words="numbers from 0 to below 1"),
        "Adam's decay rates of the mean gradient and of its mean square.",
        default=(0.5, 0.5),
    )
    amplitudes_every: int = described_field(
        _COUNT,
        "Iterations between two solutions for the laser amplitudes, and two wavelength steps.",
        default=5,
    )
    seed: int = described_field(Integer(0, 2**63 - 1), "Of the random patterns to begin with.", default=0)
    free: tuple[str, ...] = described_field(
        Several(Word(VARIABLES)),
        f"What is optimised, of {', '.join(VARIABLES)}; the others stay as the system and the first patterns have "
        "them.",
        default=("patterns", "amplitudes"),
    )
    loss: str | None = described_field(
        Maybe(Word(tuple(LOSS_SPACES))),
        "; ".join(f"{name}: {loss.description}" for name, loss in LOSS_SPACES.items())
        + ". If absent linear-srgb, or mono for a monochrome observer.",
        default=None,
    )
    region: Region | None = described_field(
        Maybe(Several(Integer(0), 4, words="x, y ≥ 0 and a width and height ≥ 1")),
        "Samples (x, y, width, height) of the simulated picture that count; all if absent.",
        default=None,
    )
    plane_weights: tuple[float, ...] | None = described_field(
        Maybe(Several(Number(low=0, high=_MOST_WEIGHT), words="numbers of 0 or more, one of them positive")),
        "How much each plane counts; equal if absent.",
        default=None,
    )
    eyebox: float = described_field(
        Number(low=0, high=_MOST_WEIGHT, words=f"a weight of 0 or more, at most {_MOST_WEIGHT:g}"),
        "Weight of an evenly filled eyebox in the loss, that is of the squared variation of its light, e.g. 0.01; 0 "
        "leaves it free.",
        default=0.0,
    )
    begin: str = described_field(
        Word(INITIAL_PATTERNS),
        "Patterns to begin with. random: speckle, a filled eyebox; smooth: less speckle, an almost empty eyebox.",
        default="random",
    )
    wavelength_range_m: tuple[float, float] = described_field(
        Several(Number("nm", low=1e-9, high=1e-5), 2),
        "Least and greatest wavelength of lasers whose wavelength is free.",
        default=(440e-9, 660e-9),
    )
    wavelength_spacing_m: float = described_field(
        Number("nm", low=0, high=1e-5), "Least distance between two of them.", default=4e-9
    )
    wavelength_step_m: float = described_field(
        Number("nm", low=1e-15, high=1e-5), "First step of free wavelengths.", default=3e-9
    )
    observers: int = described_field(
        Integer(0, PEOPLE),
        f"Free wavelengths are also chosen so that so many people, the first of {PEOPLE}, agree on the lasers' colour; "
        "0 for none.",
        default=0,
    )
    agreement: float = described_field(
        Number(low=0, high=_MOST_WEIGHT), "Weight of the mean squared difference between these people.", default=10.0
    )
    pupil_places_m: tuple[tuple[float, float], ...] = described_field(
        Several(Several(Number("mm"), 2)),
        "Places (y, x) of the pupil of the system's eye in the eyebox, from each of which the target counts; its own "
        "place alone if there are none. Not with free wavelengths.",
        default=(),
    )
    drawn_pupils: int = described_field(
        _COUNT_OR_NONE,
        "Number of places of the pupil that are drawn anew in each iteration, from the seed, in place of fixed ones; 0 "
        "for none. Not with free wavelengths.",
        default=0,
    )
    drawn_radius_m: float = described_field(
        Number("mm", low=0), "Of the disc about the pupil of the system's eye in which they are drawn.", default=0.0
    )
    drawn_planes: int | None = described_field(
        Maybe(_COUNT_OR_NONE),
        "So many planes count in an iteration, in turn, in an order drawn from the seed, which takes less time; 0, or "
        "as many as there are: all. All count in the last 30 % (40 iterations at least, half at most), in each tenth, "
        "where amplitudes are solved for or wavelengths move, and for modulators with levels. If absent, one of four "
        "or more planes of equal weight seen from one place, in runs of 80 iterations or more; else, and of a chain, "
        "all.",
        default=None,
    )

    def __post_init__(self) -> None:
        validate(self, spaced_key)
        if not self.free:
            raise UserError("free", "nothing", expected=f"at least one of {', '.join(VARIABLES)}")
        if self.region is not None and min(self.region[2:]) < 1:
            raise UserError("region", str(self.region), expected="x, y ≥ 0 and a width and height ≥ 1")
        weights = self.plane_weights
        if weights is not None and not max(weights, default=0) > 0:
            raise UserError("plane weights", str(weights), expected="numbers of 0 or more, one of them positive")
        if weights is not None and max(weights) < 1 / _MOST_WEIGHT:
            expected = f"the largest from {1 / _MOST_WEIGHT:g} to {_MOST_WEIGHT:g}"
            raise UserError("plane weights", str(weights), expected=expected)
        if self.observers == 1:
            raise UserError("observers", "1", expected=f"2 to {PEOPLE} people, or 0")
        if self.observers and "wavelengths" not in self.free:
            raise UserError("observers", "with fixed wavelengths", expected="wavelengths among what is free")
        low, high = self.wavelength_range_m
        if not low < high:
            raise UserError("wavelength range", f"{low * 1e9:g} to {high * 1e9:g} nm", expected="a rising range")
        if self.drawn_pupils and self.drawn_radius_m == 0:
            raise UserError("drawn pupils", f"a radius of {self.drawn_radius_m:g} m", expected="a radius above 0")
        if self.drawn_pupils and self.pupil_places_m:
            raise UserError("drawn pupils", "with fixed places", expected="one of them")
        if (self.pupil_places_m or self.drawn_pupils) and "wavelengths" in self.free:
            raise UserError("free", "wavelengths with several places of the pupil", expected="patterns and amplitudes")

    def loss_for(self, observer: str) -> str:
        """The name of the loss.

        observer: `System.observer`, which chooses the loss where `loss` is None.

        >>> import holoview as hv
        >>> hv.Settings().loss_for("eye"), hv.Settings().loss_for("mono"), hv.Settings(loss="xyz").loss_for("eye")
        ('linear-srgb', 'mono', 'xyz')
        """
        return self.loss or ("mono" if observer == "mono" else "linear-srgb")


FIRST_ITERATIONS, NEXT_ITERATIONS = 200, 10
CAMERA_STEP_RAD = 0.05  # with measured intensities: a hologram that is nearly right isn't thrown away
"""Default of the iterations for the first picture of a film, and for each later one, which then is as good."""
_NEXT_STEP = 0.4  # of the first picture's step: a full step would undo much of the hologram before


def next_settings(settings: Settings, iterations: int) -> Settings:
    """Settings for a picture that is like the picture before, from whose hologram it begins: with smaller steps."""
    return replace(settings, iterations=iterations, step_rad=_NEXT_STEP * settings.step_rad)
