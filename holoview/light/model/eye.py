"""The eye of a viewer behind an eyepiece, published formulas of the human eye, and angles at which lengths are seen."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.light.model.fields import (
    Array,
    Choice,
    Coefficients,
    Description,
    Nested,
    Number,
    Truth,
    described_field,
    validate,
)
from holoview.util import units
from holoview.util.errors import UserError

_SLOPE, _POLE_NM = 633.46, 214.102  # dioptres · nm, nm


def chromatic_refraction(wavelength_m: Any) -> Floats:
    """Refraction Rx of the chromatic eye in dioptres, zero near 590 nm: use differences only.

    wavelength_m: a number or an array.

    >>> import holoview as hv
    >>> round(float(hv.chromatic_refraction(400e-9) - hv.chromatic_refraction(589e-9)), 2)
    -1.72
    """
    return np.asarray(1.68524 - _SLOPE / (np.asarray(wavelength_m, dtype=np.float64) * 1e9 - _POLE_NM))


def refraction_slope(wavelength_m: float) -> float:
    """Derivative of `chromatic_refraction` with respect to the wavelength, dioptres a metre."""
    return _SLOPE * 1e9 / (wavelength_m * 1e9 - _POLE_NM) ** 2


def natural_pupil_diameter(luminance: float, area_deg2: float, age: float = 30.0) -> float:
    """Diameter (m) of the pupils of a viewer who adapts to a uniform field with both eyes.

    luminance: cd/m². area_deg2: of the field, square degrees. age: years, 20 to 83.

    Watson & Yellott, J. Vis. 12(10), 12 (2012), eq. 21: the unified formula, from that of Stanley & Davies.

    >>> import holoview as hv
    >>> [round(hv.natural_pupil_diameter(L, 3600.0, 28.58) * 1e3, 2) for L in (0.01, 1.0, 100.0)]
    [7.06, 5.02, 2.82]
    """
    flux = (luminance * area_deg2 / 846) ** 0.41
    young_mm = 7.75 - 5.75 * flux / (flux + 2)
    return 1e-3 * float(young_mm + (age - 28.58) * (0.02132 - 0.009562 * young_mm))


# --- the eye of a bench -----------------------------------------------------------------------------------------------

# The eyepiece, of focal length f, has its front focal plane at z = `infinity`; the eye's pupil lies in its back focal
# plane. A plane z then appears at the vergence V = (z − infinity)/f² dioptres (Newton's equation), exactly: larger z is
# nearer to the viewer. Light of direction sine s passes the pupil plane at f·s, at every wavelength, and a sample of
# the plane is seen at an angle of pitch/f, whichever plane is in focus.
#
# An eye that is focused at A dioptres at the wavelength λ₀ is focused at A − (Rx(λ) − Rx(λ₀)) at λ. The refraction Rx
# is that of the chromatic eye of Thibos, Ye, Zhang & Bradley, Appl. Opt. 31, 3594 (1992), eq. 5 with their fit: Rx(λ) =
# 1.68524 − 633.46/(λ − 214.102 nm).


Floats = NDArray[np.float64]

AUTO = "auto"
VERGENCE = Number("D", low=-30.0, high=30.0)
"""Field type of an accommodation."""

PUPIL = Number("mm", low=0.5e-3, high=12e-3)
PUPIL_PLACE = Number("mm", low=-0.1, high=0.1)
"""Field types of a pupil's diameter and of its place in the eyebox."""

_WIDEST_M = 8e-3  # of natural pupils


@dataclass(frozen=True)
class PupilField:
    """Field type of the pupil's diameter: a length, or "auto" for one that follows from the luminance."""

    def parse(self, value: Any, where: str) -> float | str:
        if isinstance(value, str) and value == AUTO:
            return AUTO
        try:
            diameter = PUPIL.parse(value, where)
        except UserError as error:
            raise UserError(where, error.found, expected=f'{error.expected}, or "{AUTO}"') from error
        assert diameter is not None
        return diameter

    def to_toml(self, value: float | str) -> Any:
        return value if isinstance(value, str) else PUPIL.to_toml(value)


@dataclass(frozen=True, eq=False)
class Prescription(Description):
    """The errors of an eye that wears no glasses: sphere, cylinder and axis of its glasses, and Zernike terms.

    sphere_dpt, cylinder_dpt: of the glasses that the eye would need, dioptres. In a meridian at an angle θ to the axis
    they have the power sphere + cylinder·sin²θ, and the eye is focused so much further away (Thibos, Wheeler & Horner,
    Optom. Vis. Sci. 74, 367 (1997)).
    axis_deg: direction of the cylinder's axis as opticians count it, anticlockwise for somebody who looks at the eye;
    in the picture that the viewer sees, clockwise from the right.
    aberration_m: further Zernike terms over the pupil, {"Z8": "100 nm"}: Noll's index, r.m.s. optical path in metres.

    >>> import holoview as hv
    >>> hv.Prescription(sphere_dpt="-2 D", cylinder_dpt="0.5 D").mean_sphere_dpt
    -1.75
    """

    sphere_dpt: float = described_field(
        Number("D", low=-20.0, high=20.0), "Sphere of the glasses it needs.", default=0.0
    )
    cylinder_dpt: float = described_field(
        Number("D", low=-10.0, high=10.0), "Cylinder of the glasses it needs.", default=0.0
    )
    axis_deg: float = described_field(
        Number(low=0.0, high=180.0),
        "Axis of the cylinder in degrees, clockwise from the right of the picture.",
        default=0.0,
    )
    aberration_m: tuple[tuple[int, float], ...] = described_field(
        Coefficients("Z", Number("nm", low=-1e-4, high=1e-4), highest=37),
        "Zernike terms (Noll index, r.m.s. optical path) over the eye's pupil.",
        default=(),
    )

    def __post_init__(self) -> None:
        validate(self)

    @property
    def mean_sphere_dpt(self) -> float:
        """The refraction's mean over all meridians, sphere + cylinder/2, dioptres.

        >>> import holoview as hv
        >>> hv.Prescription(cylinder_dpt=-1.0).mean_sphere_dpt
        -0.5
        """
        return self.sphere_dpt + self.cylinder_dpt / 2


@dataclass(frozen=True, eq=False)
class Eye(Description):
    """A viewer's eye behind an eyepiece. See the module's description for the optics.

    eyepiece_m: focal length of the eyepiece.
    infinity_m: distance from the last modulator of the plane that appears at infinity; None: the bench's smallest focal
    plane, which is the farthest one from the viewer.
    pupil_m: diameter of the eye's pupil, 0.5 to 12 mm, or "auto": that of the formula of Watson & Yellott.
    pupil_y_m, pupil_x_m: place of the pupil's centre in the eyebox, downwards and to the right in the picture.
    accommodation_dpt: (accommodation,) dioptres at which the eye is focused at the wavelength `reference`; None: at
    each of the bench's focal planes.
    chromatic: whether the eye has longitudinal chromatic aberration.
    chromatic_axis: the centre of the chromatic aberration. "eyepiece": the eye stays on the axis of the eyepiece,
    and `pupil_y` and `pupil_x` are the place of its pupil alone (an artificial pupil, or one that is decentred in the
    eye); colours then separate at the retina by the pupil's displacement times the difference of focus in dioptres
    (Thibos, Bradley, Still, Zhang & Howarth, Vision Res. 30, 33 (1990)). "pupil": the eye moves as a whole, and colours
    don't.
    reference_m: wavelength at which accommodation is stated.
    stiles_crawford: whether light near the pupil's edge counts less (Stiles–Crawford effect of the first kind).
    prescription: a `Prescription`.
    luminance: mean luminance of the picture in cd/m², on which "auto" depends.
    age: of the viewer in years, on which "auto" depends.

    Lengths are metres or text such as "3 mm", dioptres numbers or text such as "0.5 D". Raises UserError for values out
    of range.

    >>> import holoview as hv
    >>> eye = hv.Eye(pupil_m="4 mm", accommodation_dpt=["0 D", 1.5])
    >>> eye.pupil_m, eye.accommodation_dpt.tolist()
    (0.004, [0.0, 1.5])
    """

    eyepiece_m: float = described_field(
        Number("mm", low=1e-3, high=1.0), "Focal length of the eyepiece.", default=40e-3
    )
    infinity_m: float | None = described_field(
        Number("mm", low=0.0, high=1.0, optional=True),
        "Plane that appears at infinity; the focal plane that is farthest from the viewer when absent.",
        default=None,
    )
    pupil_m: float | str = described_field(PupilField(), 'Diameter of the pupil, or "auto".', default=3e-3)
    pupil_y_m: float = described_field(PUPIL_PLACE, "Place of the pupil in the eyebox, downwards.", default=0.0)
    pupil_x_m: float = described_field(PUPIL_PLACE, "Place of the pupil in the eyebox, to the right.", default=0.0)
    accommodation_dpt: Floats | None = described_field(
        Array(VERGENCE, optional=True),
        "Dioptres at which the eye is focused; at each focal plane when absent.",
        default=None,
    )
    chromatic: bool = described_field(Truth(), "Whether the eye has chromatic aberration.", default=True)
    chromatic_axis: str = described_field(
        Choice(("eyepiece", "pupil")),
        "eyepiece: only the pupil moves in the eyebox; pupil: the eye moves as a whole.",
        default="eyepiece",
    )
    reference_m: float = described_field(
        Number("nm", low=390e-9, high=830e-9), "Wavelength at which accommodation is stated.", default=550e-9
    )
    stiles_crawford: bool = described_field(
        Truth(), "Whether light near the edge of the pupil counts less.", default=False
    )
    prescription: Prescription = described_field(
        Nested(Prescription), "What is wrong with the eye.", default_factory=Prescription
    )
    luminance: float = described_field(
        Number(low=1e-4, high=1e6), 'Mean luminance of the picture in cd/m², for the pupil "auto".', default=100.0
    )
    age: float = described_field(
        Number(low=20.0, high=83.0), 'Age of the viewer in years, for the pupil "auto".', default=30.0
    )

    def __post_init__(self) -> None:
        validate(self)
        if self.accommodation_dpt is not None and len(self.accommodation_dpt) == 0:
            raise UserError("accommodation", "an empty list", expected='at least one, such as "0.5 D"')
        diameter = _WIDEST_M if isinstance(self.pupil_m, str) else self.pupil_m
        reach_m = math.hypot(self.pupil_y_m, self.pupil_x_m) + diameter / 2
        if reach_m >= self.eyepiece_m:
            raise UserError(
                "eyepiece",
                f"{units.format_rounded(self.eyepiece_m, 'mm')} with a pupil that reaches "
                f"{units.format_rounded(reach_m, 'mm')} from its axis",
                expected="a longer focal length: light of such directions doesn't reach the pupil",
                remedy="lengthen it, or move or narrow the pupil",
            )

    # --- where it is focused ----------------------------------------------------------------------------------------

    def far_plane_m(self, planes_m: Floats) -> float:
        """The plane that appears at infinity.

        planes_m: (plane,) the bench's focal planes.

        >>> import holoview as hv
        >>> hv.Eye().far_plane_m(hv.load("holochrome-8").planes_m), hv.Eye(infinity_m="8 mm").far_plane_m([0.01])
        (0.009, 0.008)
        """
        return float(np.min(planes_m)) if self.infinity_m is None else self.infinity_m

    def plane_m(self, dioptres: Any, planes_m: Floats) -> Floats:
        """Distances from the last modulator of the planes that appear at some vergences.

        dioptres: vergences at the pupil, a number or an array. planes_m: (plane,) the bench's focal planes.

        >>> import holoview as hv
        >>> round(float(hv.Eye(eyepiece_m="40 mm").plane_m(0.5, [0.01])), 6)  # 1.6 mm for each dioptre
        0.0108
        """
        return np.asarray(self.far_plane_m(planes_m) + self.eyepiece_m**2 * np.asarray(dioptres, dtype=np.float64))

    def dioptres(self, z_m: Any, planes_m: Floats) -> Floats:
        """Vergences at which planes appear: the inverse of `plane_m`.

        z_m: distances from the last modulator. planes_m: (plane,) the bench's focal planes.

        >>> import holoview as hv
        >>> hv.Eye().dioptres(0.0116, [0.01]).round(6).tolist()
        1.0
        """
        return np.asarray((np.asarray(z_m, dtype=np.float64) - self.far_plane_m(planes_m)) / self.eyepiece_m**2)

    def focus_shift_m(self, wavelengths_m: Floats) -> Floats:
        """How much larger z is on which it is focused at some wavelengths than an eye without faults at `reference`.

        wavelengths_m: (wavelength,). Returns metres.

        >>> import holoview as hv
        >>> shift_m = hv.Eye(reference_m="589 nm").focus_shift_m([400e-9, 589e-9])
        >>> (shift_m / 0.04**2).round(2).tolist()  # an eye focused at infinity in yellow sees violet at 1.72 dioptres
        [1.72, -0.0]
        """
        wavelengths = np.asarray(wavelengths_m, dtype=np.float64)
        error_dpt = np.full(wavelengths.shape, self.prescription.mean_sphere_dpt)
        if self.chromatic:
            error_dpt = error_dpt + chromatic_refraction(wavelengths) - chromatic_refraction(self.reference_m)
        return np.asarray(-(self.eyepiece_m**2) * error_dpt)

    def image_shift_m(self, focus_shift_m: float) -> tuple[float, float]:
        """How far (y, x) the image of a wavelength moves on the retina beyond what its focus alone does, in m.

        focus_shift_m: that of the wavelength, of `focus_shift_m`.

        A plane at a distance Δz from the reference shows light through the pupil, of direction sine s₀, displaced by
        s₀·Δz. An eye that has moved as a whole, its axis with its pupil, doesn't see this.

        >>> import holoview as hv
        >>> moved = hv.Eye(pupil_x_m="1 mm", chromatic_axis="pupil")
        >>> moved.image_shift_m(1e-3), hv.Eye(pupil_x_m="1 mm").image_shift_m(1e-3)
        ((-0.0, -2.5e-05), (0.0, 0.0))
        """
        if self.chromatic_axis == "eyepiece":
            return 0.0, 0.0
        y, x = self.pupil_centre_na
        return -y * focus_shift_m, -x * focus_shift_m

    def focus_slope(self, wavelength_m: float) -> float:
        """Derivative of `focus_shift_m` with respect to the wavelength, metres a metre.

        wavelength_m: at which it is taken.

        >>> import holoview as hv
        >>> hv.Eye(chromatic=False).focus_slope(550e-9)
        0.0
        """
        if not self.chromatic:
            return 0.0
        return -(self.eyepiece_m**2) * refraction_slope(wavelength_m)

    def moved_to(self, place_m: tuple[float, float]) -> Eye:
        """The eye with its pupil at another place of the eyebox.

        place_m: (y, x), m.

        >>> import holoview as hv
        >>> hv.Eye().moved_to((1e-3, 0.0)).pupil_y_m
        0.001
        """
        return replace(self, pupil_y_m=place_m[0], pupil_x_m=place_m[1])

    # --- what its pupil passes --------------------------------------------------------------------------------------

    def pupil_diameter_m(self, field_m: tuple[float, float]) -> float:
        """Diameter of the pupil.

        field_m: (y, x) size of the modulators, on whose visual angle "auto" depends.

        >>> import holoview as hv
        >>> hv.Eye(pupil_m="4 mm").pupil_diameter_m((6e-3, 8e-3))
        0.004
        """
        if not isinstance(self.pupil_m, str):
            return self.pupil_m
        height, width = (field_degrees(side, self.eyepiece_m) for side in field_m)
        return natural_pupil_diameter(self.luminance, height * width, self.age)

    @property
    def pupil_centre_na(self) -> tuple[float, float]:
        """Direction sine (y, x) of the light through the centre of the pupil.

        >>> import holoview as hv
        >>> hv.Eye(pupil_x_m="1 mm").pupil_centre_na
        (0.0, 0.025)
        """
        return self.pupil_y_m / self.eyepiece_m, self.pupil_x_m / self.eyepiece_m

    def pupil_na(self, field_m: tuple[float, float]) -> float:
        """Numerical aperture of the pupil as seen from the focal planes, diameter/(2f).

        field_m: (y, x) size of the modulators.

        >>> import holoview as hv
        >>> hv.Eye().pupil_na((6e-3, 8e-3))
        0.0375
        """
        return self.pupil_diameter_m(field_m) / (2 * self.eyepiece_m)

    @property
    def has_pupil_function(self) -> bool:
        """Whether the pupil does more than stop light: by a cylinder, Zernike terms, or the Stiles–Crawford effect.

        >>> import holoview as hv
        >>> hv.Eye().has_pupil_function, hv.Eye(stiles_crawford=True).has_pupil_function
        (False, True)
        """
        return bool(self.stiles_crawford or self.prescription.cylinder_dpt or self.prescription.aberration_m)


# --- visual angles ----------------------------------------------------------------------------------------------------


def field_degrees(side_m: float, eyepiece_m: float) -> float:
    """Angle under which a side of the picture is seen whose middle is on the axis, degrees.

    side_m: its length. eyepiece_m: focal length of the eyepiece.

    >>> round(field_degrees(8e-3, 4e-3), 9)
    90.0
    """
    return 2 * math.degrees(math.atan(side_m / (2 * eyepiece_m)))


def sample_degrees(pitch_m: float, eyepiece_m: float) -> float:
    """Angle between neighbouring samples on the axis, degrees.

    pitch_m: their distance. eyepiece_m: focal length of the eyepiece.

    >>> round(sample_degrees(4e-6, 40e-3) * 3600, 1)  # seconds of arc
    20.6
    """
    return math.degrees(math.atan(pitch_m / eyepiece_m))
