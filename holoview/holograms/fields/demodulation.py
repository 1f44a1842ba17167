"""The complex field of a camera's recording: off-axis, in-line, and sets of shifted reference phases.

A camera records I = |O + R|² of an object wave O and a reference R, a plane wave or that of a point source. Each
function returns O·R*, the object wave times the reference's amplitude, in the plane of the camera, with the findings
that led to it; of a point source it has to be lit by its spherical wave (`Wavefield.reference_radius_m`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.fft
import scipy.ndimage
from numpy.typing import NDArray

from holoview.holograms.fields.focus import is_sharper_on_other_side
from holoview.holograms.fields.reading import Recording
from holoview.holograms.fields.wavefield import Wavefield
from holoview.holograms.files.request import Order, Steps
from holoview.light.numerics.fourier import dft_matrix
from holoview.light.numerics.sampling import positions, taper
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.packages import import_optional

Floats = NDArray[np.floating[Any]]
Complexes = NDArray[np.complexfloating[Any, Any]]

_CENTRAL = 0.04  # cycles a sample around the zero frequency, where no order is looked for
_RISING = 1.6  # times the least value between the middle and an order; 2.07 where one touches the object's own halo
_DEEP = 3.0  # times the least value: beyond it the order's light is its own as far as this valley
_SHARP = 4.0  # times the mean of its order: a peak above is the unscattered wave
_BEYOND_NOISE = 0.98  # of an order's light lies within its radius
_PEAK_BINS = 3  # around a peak, which the fading of the picture's edges widens
_MOST_STEPS = 40  # towards the middle of an order; 16 of one that fills three quarters of its half of the spectrum
_SOFT = 0.1  # of the radius, over which the filter falls
_FAINT = 0.1  # of a picture's variance: an order with less may be no order; public recordings have 0.06 to 0.49
_MOST_JUDGED = 1024  # rows and columns of the middle by which steps of the reference are recognised
_ONE_MEAN = 0.1  # of the mean of three phase-shifted pictures, within which the means of each lie
# |Σd²|/Σ|d|² with d = Σₙ Iₙ·exp(2πi·n/3) in each pixel: 1 if all d have one direction in the complex plane (pictures
# that differ in their brightness alone), 0.5 for pictures a quarter turn apart.
_ONE_WAY = 0.7
_MOST_UNEXPLAINED = 0.08  # 0.003 in the median of drawn sets, at most 0.055; 0.16 of speckles that drift
_MOST_BESIDE_LINE = 1 / 3  # 0.03 in the median of drawn sets; 0.75 of speckles that drift
_HIDING = 0.5  # of the standard deviation of an in-line picture: fringes of its frame beyond it hide the objects
_DOUBTED = 0.01  # of what equal steps leave: beyond it other steps are tried; right ones leave 0.003 in the median
_FAINT_UNLESS_COUNTED = 0.15  # the same of numbers that no camera counted: of 288 speckle patterns at most 0.11


_DOUBT = (
    "the order holds only {:.0%} of the picture's variance: if this is no off-axis recording, say --recording in-line, "
    "or --recording none and --quantity"
)


@dataclass(frozen=True, eq=False)
class Demodulated:
    """A field from a recording, and how it was found.

    recording: of its kind, with the orders, the steps and the side that were taken, so that it gives this field again.
    steps_rad: (wavelength, picture) phases of the reference, of a
    phase-shifting set; the first is 0. report: the findings, in words.
    """

    field: Wavefield
    recording: Recording
    steps_rad: NDArray[np.float64] | None = None
    report: tuple[str, ...] = ()

    @property
    def orders(self) -> tuple[Order, ...]:
        """Of each wavelength, of an off-axis recording; else none."""
        return self.recording.orders

    def conjugate(self, reason: str) -> Demodulated:
        """The conjugate field, from the other orders, or from phase steps in the other direction.

        reason: why it is taken, a sentence of the report.
        """
        orders = tuple(order.conjugate() for order in self.orders)
        kept = self.report[: len(self.report) - len(orders)]
        return Demodulated(
            replace(self.field, values=np.conj(self.field.values)),
            replace(self.recording, orders=orders, conjugated=not orders),
            None if self.steps_rad is None else -self.steps_rad,
            (*kept, *(order.describe() for order in orders), reason),
        )


def field_of_recording(recording: Recording) -> Demodulated:
    """The field of a recording of any kind, by the function for its kind.

    An in-line recording of two pictures has the background as the second. Where the kind isn't known, it is taken for
    phase-shifting if its pictures fit to steps of the reference (`shifted_steps`), for off-axis if an order is found in
    its spectrum, else for in-line.

    A recording holds its field and the conjugate field, focused on the other side of the camera: two orders, or phase
    steps in one of two directions. If the recording doesn't say which is wanted, the field is taken whose image is
    clearly sharper at the recording's distance (`is_sharper_on_other_side`).

    Raises UserError as these functions do.
    """
    found = _field_of_kind(recording)
    if recording.conjugated:
        return found.conjugate("conjugated, as asked for")
    if recording.conjugated is None and not recording.orders and is_sharper_on_other_side(found.field):
        distance = units.format_rounded(recording.distance_m, "mm")
        return found.conjugate(f"conjugated, as the image at {distance} is sharper then")
    return found


def _field_of_kind(recording: Recording) -> Demodulated:
    if recording.kind == "phase-shifting":
        return phase_shifting_field(recording, recording.steps)
    if recording.kind == "in-line":
        return _in_line_with_background(recording)
    if recording.kind == "off-axis":
        return off_axis_field(recording, recording.orders)
    shifts = shifted_steps(recording.pictures)
    if shifts is not None:
        found = phase_shifting_field(recording, shifts.steps)
        return replace(found, report=(f"the recording was {shifts.describe()}", *found.report))
    try:
        found, guess = off_axis_field(recording), "taken for off-axis, as an order stands out of its spectrum"
    except UserError:
        found = _in_line_with_background(recording)
        guess = "taken for in-line, as no order stands out of its spectrum"
    else:
        share, whole = _share(recording.pictures, found.field.values), recording.pictures[0, 0] % 1 == 0
        if share < _FAINT_UNLESS_COUNTED and not whole.all():
            found = _in_line_with_background(recording)
            guess = f"taken for in-line, as its order holds only {share:.0%} of its variance and no camera counted it"
    remedy = "--recording says it"
    if len(recording.pictures) > 2:
        remedy += "; of a phase-shifting set --steps its phases, or --steps unknown, which finds them"
    return replace(found, report=(f"the recording was {guess} ({remedy})", *found.report))


def _in_line_with_background(recording: Recording) -> Demodulated:
    """The field of the first picture, divided by the second if there are two."""
    if len(recording.pictures) != 2:
        return in_line_field(recording)
    found = in_line_field(replace(recording, pictures=recording.pictures[:1]), recording.pictures[1])
    return replace(found, recording=replace(found.recording, pictures=recording.pictures))


# --- off-axis ---------------------------------------------------------------------------------------------------------


def recording_spectrum(picture: Floats) -> Floats:
    """The power spectrum of a picture (y, x), zero frequency in the middle, of which an off-axis order is chosen.

    The mean is taken off and the edges are faded out, so that they draw no cross.
    """
    rows, columns = picture.shape
    window = taper(rows, 0.5)[:, None] * taper(columns, 0.5)[None, :]
    values = (picture - picture.mean()) * window.astype(picture.dtype)
    return np.abs(scipy.fft.fftshift(scipy.fft.fft2(values))) ** 2


def find_order(picture: Floats) -> Order:
    """The first order of an off-axis recording (y, x), in the half of the spectrum with f_x > 0.

    The light around the middle, of the object wave with itself, falls towards every side. The order is where the
    blurred spectrum rises most above its least value on the way from the middle, with all light above the noise around
    this place, as far as this valley, or half the way to the middle where that is farther. If its brightest frequency
    stands out, this is the reference's tilt, measured to a thousandth of a bin; else the centre of gravity is. Its
    radius holds 98 % of its light, and reaches at most as far (a third of the way to the middle is free of |O|²
    whatever the object: Cuche, Marquet & Depeursinge, Appl. Opt. 39, 4070 (2000)).

    Raises UserError where no order stands out of the noise.
    """
    power = recording_spectrum(picture)
    fy, fx = (scipy.fft.fftshift(scipy.fft.fftfreq(n)) for n in picture.shape)
    blurred = scipy.ndimage.gaussian_filter(power, [max(1.0, n / 256) for n in power.shape], mode="wrap")
    noise = float(np.median(blurred))
    where, rise, valley = _rising_most(
        scipy.ndimage.gaussian_filter(power, [max(1.0, n / 64) for n in power.shape], mode="wrap")
    )
    no_order = UserError(
        "recording",
        "no order in its spectrum outside the middle",
        expected="an off-axis hologram with fringes",
        remedy="say in-line, or give the order's carrier",
    )
    if rise < _RISING or blurred[where] < 20 * noise or noise == 0 == blurred[where]:
        raise no_order
    excess = np.maximum(power - 2 * noise, 0)
    centre = _centre_of_light(excess, (float(fy[where[0]]), float(fx[where[1]])), math.inf)
    if math.hypot(*centre) <= _CENTRAL:  # the light belongs to the middle, as that of a usual picture does
        raise no_order
    centre = _centre_of_light(excess, centre, valley)
    is_of_order = _is_of_order(fy, fx, centre, valley) & (np.hypot(fy[:, None], fx[None, :]) > _CENTRAL)
    order_power = np.where(is_of_order, power, 0)
    peak = np.unravel_index(np.argmax(order_power), power.shape)
    near = power[max(0, peak[0] - 1) : peak[0] + 2, max(0, peak[1] - 1) : peak[1] + 2].sum()
    is_sharp = bool(near > order_power.sum() / _SHARP)
    if is_sharp:
        centre = _refined_peak(picture, (float(fy[peak[0]]), float(fx[peak[1]])))
    if math.hypot(*centre) <= _CENTRAL:
        raise no_order
    if centre[::-1] < (0.0, 0.0):  # across the rim of the spectrum, where the conjugate order begins
        centre = -centre[0], -centre[1]
    return Order(centre, _radius(power, noise, fy, fx, centre, valley), "peak" if is_sharp else "gravity")


def _centre_of_light(light: Floats, centre: tuple[float, float], valley: float) -> tuple[float, float]:
    """The centre of gravity of an order's light (y, x), from a place in it: the farther out, the more belongs to it."""
    fy, fx = (scipy.fft.fftshift(scipy.fft.fftfreq(n)) for n in light.shape)
    for _ in range(_MOST_STEPS):
        weight = np.where(_is_of_order(fy, fx, centre, valley), light, 0)
        whole = max(float(weight.sum()), 1e-300)
        y = float(weight.sum(axis=1) @ _offsets(fy, centre[0])) / whole
        x = float(weight.sum(axis=0) @ _offsets(fx, centre[1])) / whole
        centre = float(_offsets(centre[0], -y)), float(_offsets(centre[1], -x))
        if math.hypot(y, x) < 0.25 / max(light.shape):
            break
    return centre


def off_axis_field(recording: Recording, orders: Sequence[Order] = ()) -> Demodulated:
    """The field of an off-axis recording: the order is filtered, brought to the middle, its tilt removed.

    orders: one for each wavelength, or one for all, in place of the orders found in the first picture;
    `Order.conjugate` of a found order gives the field with the other sign of phase and of distance. If a found order
    holds little of the picture's variance, the report doubts it.

    Raises UserError where no order is found, and for a carrier beyond the samples.
    """
    pictures, is_found = recording.pictures, not orders
    if not orders:
        orders = [find_order(picture.astype(np.float64)) for picture in pictures[0]]
    chosen = tuple(orders) * (pictures.shape[1] if len(orders) == 1 else 1)
    if len(chosen) != pictures.shape[1]:
        raise UserError("orders", f"{len(chosen)}", expected=f"{pictures.shape[1]}, one for each wavelength")
    for order in chosen:
        if not (max(map(abs, order.carrier)) <= 0.5 and 0 < order.radius <= 1):
            raise UserError("order", f"carrier {order.carrier}, radius {order.radius:g}", expected="cycles a sample")
    values = np.empty(pictures.shape, np.complex64)
    for frame, index in np.ndindex(*pictures.shape[:2]):
        values[frame, index] = demodulate_picture(pictures[frame, index], chosen[index])
    doubts = _doubts(pictures, values) if is_found else ()
    return Demodulated(
        _wavefield(recording, values),
        replace(recording, kind="off-axis", orders=chosen, conjugated=False),
        report=(*doubts, *(order.describe() for order in chosen)),
    )


def _doubts(pictures: NDArray[Any], values: Complexes) -> tuple[str, ...]:
    """A sentence that doubts found orders which hold little of the pictures' variance."""
    share = _share(pictures, values)
    return (_DOUBT.format(share),) if share < _FAINT else ()


def _share(pictures: NDArray[Any], values: Complexes) -> float:
    """The part of the pictures' variance that the fields of their orders hold."""
    return float(np.square(np.abs(values)).mean()) / max(float(pictures.var(axis=(-2, -1)).mean()), 1e-300)


def demodulate_picture(picture: Floats, order: Order) -> Complexes:
    """O·R* of one picture (y, x), complex64: times exp(−2πi·carrier·n), then a soft disc in the spectrum."""
    rows, columns = picture.shape
    y, x = (
        np.exp(-2j * math.pi * carrier * positions(n, 1.0))
        for n, carrier in zip((rows, columns), order.carrier, strict=True)
    )
    centred = (picture - picture.mean()).astype(np.float32)
    moved = centred * y.astype(np.complex64)[:, None] * x.astype(np.complex64)[None, :]
    ways = _ways(scipy.fft.fftfreq(rows), scipy.fft.fftfreq(columns), (0.0, 0.0))
    edge = _SOFT * order.radius
    disc = np.clip((order.radius + edge / 2 - ways) / edge, 0, 1).astype(np.float32)
    return scipy.fft.ifft2(scipy.fft.fft2(moved) * disc)


def _reach(centre: tuple[float, float], valley: float) -> float:
    """How far the light of an order can lie from its centre: to the valley before the light of the middle, if that is
    known (else infinite), or half the way to the middle where that is farther."""
    distance = math.hypot(*centre)
    return max(distance / 2, distance - valley)


def _is_of_order(fy: Floats, fx: Floats, centre: tuple[float, float], valley: float) -> NDArray[np.bool_]:
    """The frequencies (y, x) within an order's reach that are nearer to it than to the conjugate order."""
    ways = _ways(fy, fx, centre)
    return (ways < _reach(centre, valley)) & (ways < _ways(fy, fx, (-centre[0], -centre[1])))


def _rising_most(blurred: Floats) -> tuple[tuple[int, int], float, float]:
    """The index (y, x) where a spectrum rises most above its least value on the straight way from its middle, the ratio
    of the two values, and how far from the middle (cycles a sample) it has first fallen to twice the least; infinite
    where it doesn't fall to less than a third of what it rises to, as beside the light of a bright object.
    """
    rows, columns = blurred.shape
    angles = np.linspace(-math.pi / 2, math.pi / 2, 2 * max(rows, columns))[1:]  # f_x > 0, and f_x = 0 < f_y
    radii = np.arange(_CENTRAL, math.sqrt(0.5), 0.5 / max(rows, columns))
    y, x = (
        np.rint(n // 2 + n * direction[:, None] * radii).astype(int)
        for n, direction in zip((rows, columns), (np.sin(angles), np.cos(angles)), strict=True)
    )
    inside = (y >= 0) & (y < rows) & (x >= 0) & (x < columns)
    along = np.where(inside, blurred[y.clip(0, rows - 1), x.clip(0, columns - 1)], 0)
    least = np.minimum.accumulate(np.where(inside, along, np.inf), axis=1)
    best = np.unravel_index(np.argmax(np.where(inside, along - least, -1)), along.shape)
    way, lowest = along[best[0], : best[1] + 1], float(least[best])
    rise = float(along[best]) / max(lowest, 1e-300)
    valley = float(radii[np.argmax(way <= 2 * lowest)]) if rise > _DEEP else math.inf
    return (int(y[best]), int(x[best])), rise, valley


def _offsets(frequencies: Any, centre: float) -> Any:
    """Frequencies as seen from another one, of a periodic spectrum: −0.5 … 0.5 cycles a sample."""
    return (frequencies - centre + 0.5) % 1.0 - 0.5


def _ways(fy: Floats, fx: Floats, centre: tuple[float, float]) -> Floats:
    """Distance of each frequency from a centre."""
    return np.hypot(_offsets(fy, centre[0])[:, None], _offsets(fx, centre[1])[None, :])


def _radius(power: Floats, noise: float, fy: Floats, fx: Floats, centre: tuple[float, float], valley: float) -> float:
    """The radius of the light around a carrier that stands above the noise, at most half way to its conjugate."""
    most = min(_reach(centre, valley), math.hypot(*(_offsets(c, -c) for c in centre)) / 2)
    ways, bin_width = _ways(fy, fx, centre), 1 / max(len(fy), len(fx))
    rings = np.bincount((ways / bin_width).astype(int).ravel(), weights=(power - noise).ravel())
    rings = rings[: max(_PEAK_BINS + 1, int(most / bin_width))]
    rings[:_PEAK_BINS] = 0  # unscattered light says nothing of the object's band
    light = np.cumsum(np.maximum(rings, 0))
    radius = (np.searchsorted(light, _BEYOND_NOISE * light[-1]) + 1) * bin_width
    return float(min(max(1.1 * radius, 8 * bin_width), most))


def _refined_peak(picture: Floats, peak: tuple[float, float]) -> tuple[float, float]:
    """The frequency (y, x) of the largest value of the spectrum near one of its bins, by sums between the bins."""
    rows, columns = picture.shape
    windowed = (picture - picture.mean()) * taper(rows, 0.5)[:, None] * taper(columns, 0.5)[None, :]
    y, x = peak
    for width in (1.0, 0.1, 0.01):
        steps = [width * 0.1 / n for n in (rows, columns)]
        along = [
            dft_matrix(n, f - 10 * step, step, 21).numpy()
            for n, f, step in zip((rows, columns), (y, x), steps, strict=True)
        ]
        k, j = np.unravel_index(np.argmax(np.abs(along[0] @ windowed @ along[1].T)), (21, 21))
        y, x = y + (int(k) - 10) * steps[0], x + (int(j) - 10) * steps[1]
    return y, x


# --- in-line ----------------------------------------------------------------------------------------------------------


def in_line_field(recording: Recording, background: Floats | None = None) -> Demodulated:
    """The field of an in-line recording: I/B, which holds the reference, the object wave and its twin.

    background: B, the picture without the object, (wavelength, y, x) or (y, x). Without it each picture's own mean. A
    picture with negative values has lost its background already, and is only scaled to a largest value of 1.

    For |O| ≪ |R| the field is 1 + o + o* with o = O·R*/|R|² (Gabor; as normalised by Latychevskaia & Fink, Opt. Express
    17, 10697 (2009)): at the object's distance the object stands before the blurred twin. Nothing is known beyond the
    frame, at which the beam ends there: it draws fringes (`frame_fringes`). Without the beam, in a dark field o + o*,
    objects that change little stand out. This is so where the recording wants it, or doesn't say and fringes hide them.

    Raises UserError for a background of another shape and for one that isn't above 0.
    """
    pictures = np.asarray(recording.pictures, np.float32)
    if background is not None:
        if background.shape not in (pictures.shape[1:], pictures.shape[2:]):
            raise UserError(
                "background", f"shape {background.shape}", expected=f"{pictures.shape[1:]}, as the recording"
            )
        if not float(background.min()) > 0:
            raise UserError("background", f"a least value of {float(background.min()):g}", expected="values above 0")
        values, words = pictures / background, "divided by the background picture"
    elif float(pictures.min()) < 0:
        values, words = pictures / np.abs(pictures).max(), "negative values: its background was taken off already"
    else:
        mean = pictures.mean(axis=(-2, -1), keepdims=True)
        if not (mean > 0).all():
            raise UserError("recording", "a black picture", expected="an in-line hologram")
        values, words = pictures / mean, "divided by its own mean"
    mean, spread = values.mean(axis=(-2, -1), keepdims=True), float(values.std(axis=(-2, -1)).mean())
    fringes = frame_fringes(recording) if background is not None or float(pictures.min()) >= 0 else 0.0
    is_dark = recording.dark_field
    report = [words]
    if is_dark is None and (is_dark := fringes > _HIDING * spread):
        report.append(
            f"in a dark field, without the beam, as fringes of its frame ({fringes:.1%} of it) hide what the objects "
            f"change ({spread:.1%}); --no-dark-field keeps the beam"
        )
    values = values - mean if is_dark else values
    settled = replace(recording, kind="in-line", conjugated=False, dark_field=is_dark)
    return Demodulated(_wavefield(recording, values.astype(np.complex64)), settled, report=tuple(report))


def frame_fringes(recording: Recording) -> float:
    """The r.m.s. fringes, over the intensity, of a beam that ends at the picture's frame, at the recording's distance.

    A half plane's edge adds an amplitude √(λz)/(2π·x) at x inside (Born & Wolf, Principles of Optics, 8.7, asymptotic),
    which changes the intensity by √2 of it r.m.s.; of the nearest edge, at a quarter of the shorter side. The longest
    wavelength counts.
    """
    rows, columns = recording.pictures.shape[-2:]
    side_m = min(rows * recording.pitch_m[0], columns * recording.pitch_m[1])
    grain_m = math.sqrt(float(max(recording.wavelengths_m)) * abs(recording.distance_m))
    return math.sqrt(2) * grain_m / (2 * math.pi * side_m / 4)


# --- phase shifting ---------------------------------------------------------------------------------------------------


def phase_shifting_field(recording: Recording, steps_rad: Steps = "equal") -> Demodulated:
    """The field of a set of pictures whose reference's phase was shifted, without zero order and twin.

    steps_rad: phase of the reference in each picture; "equal" for 2π/N apart, in the order of the pictures; "unknown"
    to find them by principal components (`unknown_steps`).

    I_n = a + Re(2·O·R*·exp(−iδ_n)) is solved for each pixel by least squares (Greivenkamp, Opt. Eng. 23, 350 (1984)).

    Raises UserError for fewer than three pictures, another number of steps, and steps that don't tell the three
    unknowns apart.
    """
    pictures = np.asarray(recording.pictures, np.float64)
    count = len(pictures)
    if count < 3:
        raise UserError("recording", f"{count} pictures", expected="three or more with shifted reference phases")
    if isinstance(steps_rad, str):
        equal = np.arange(count) * (2 * math.pi / count)
        steps = np.stack(
            [equal if steps_rad == "equal" else unknown_steps(pictures[:, i]) for i in range(pictures.shape[1])]
        )
    else:
        if len(steps_rad) != count:
            raise UserError("steps", f"{len(steps_rad)}", expected=f"{count}, one for each picture")
        steps = np.tile(np.asarray(steps_rad, np.float64), (pictures.shape[1], 1))
    values = np.empty((1, *pictures.shape[1:]), np.complex64)
    for index, shifts in enumerate(steps):
        model = _shift_model(shifts)
        if np.linalg.cond(model) > 100:
            raise UserError("steps", f"{np.round(shifts, 3).tolist()} rad", expected="three phases well apart")
        _, cosine, sine = np.tensordot(np.linalg.pinv(model), pictures[:, index], axes=1)
        values[0, index] = (cosine + 1j * sine) / 2
    words = [f"reference phases {', '.join(f'{step:.3f}' for step in shifts)} rad" for shifts in steps]
    settled = replace(recording, kind="phase-shifting", steps=steps_rad, conjugated=False)
    return Demodulated(_wavefield(recording, values), settled, steps, tuple(words))


@dataclass(frozen=True)
class Shifted:
    """Steps of the reference that explain how the pictures of a set differ.

    steps: rad. left: of the variance of their differences, for each degree of freedom, the part that no shift explains.
    """

    steps: tuple[float, ...]
    left: float

    def describe(self) -> str:
        """The guess and its reason in words."""
        reason = f"a shift of the reference explains how its {len(self.steps)} pictures differ, to {self.left:.1%}"
        if np.ptp(np.diff(self.steps)) < 1e-9:
            return f"taken for phase-shifting in steps of {round(math.degrees(self.steps[1]))}°, as {reason}"
        found = ", ".join(f"{math.degrees(step):.0f}°" for step in self.steps)
        return f"taken for phase-shifting to {found}, which were found from the pictures, as {reason}"


def shifted_steps(pictures: NDArray[np.floating[Any]]) -> Shifted | None:
    """The steps of a phase-shifting set of 3 to 5 pictures (picture, wavelength, y, x); None for other pictures.

    Steps of 2π/N are tried, and of a quarter turn, in I_n = a + c·cos δ_n + s·sin δ_n. Four or five pictures have to
    differ in two independent ways, of which the weaker has more than twelve times the power of what the steps don't
    explain (of four pictures I₀ + I₂ − I₁ − I₃); pictures that differ at random have the same power in all.

    Three pictures always fit. Theirs have the same mean within a tenth, and don't differ in one direction, as where the
    light's power changes (by noise beside it, d in `_ONE_WAY` is z + n, z constant and of a part a of the power: |d|²
    varies around its mean by 1 − a² of its square, 0.51 where a = `_ONE_WAY`). Beside a strong reference
    a = |O|² + |R|² varies little: four times its variance is at most a third of c² + s², where pictures that differ at
    random have as much. Beside an even reference c² + s² = 4|R|²(a − |R|²) follows a straight line of a: it varies
    around it by at most a third of its squared mean, where pictures that differ at random have the whole or more.

    Of one wavelength, steps that are found from the pictures (`unknown_steps`) are taken where equal ones leave much
    and these less than half of it.
    """
    count = len(pictures)
    if not 3 <= count <= 5:
        return None
    parts = [slice((n - min(n, _MOST_JUDGED)) // 2, (n + min(n, _MOST_JUDGED)) // 2) for n in pictures.shape[-2:]]
    rows = pictures[..., parts[0], parts[1]].reshape(count, -1).astype(np.float64)
    left = _unexplained_of_three if count == 3 else _unexplained
    found = [left(rows, np.arange(count) * step) for step in dict.fromkeys((2 * math.pi / count, math.pi / 2))]
    best = min(found, key=lambda shifts: shifts.left)
    if not best.left < (_MOST_BESIDE_LINE if count == 3 else _MOST_UNEXPLAINED):
        return None
    if best.left > _DOUBTED and pictures.shape[1] == 1:
        other = left(rows, unknown_steps(rows))
        best = other if other.left < best.left / 2 else best
    return best


def _unexplained(rows: Floats, steps: Floats) -> Shifted:
    """What given steps leave of four or five pictures (picture, pixel)."""
    model = _shift_model(steps)
    fitted = model @ (np.linalg.pinv(model) @ rows)
    differences = fitted - fitted.mean(axis=0)
    weaker = float(np.linalg.eigvalsh(differences @ differences.T)[-2])
    rest = float(np.square(rows - fitted).sum()) / (len(rows) - 3)
    return Shifted(tuple(map(float, steps)), rest / weaker if weaker > 0 else math.inf)


def _unexplained_of_three(rows: Floats, steps: Floats) -> Shifted:
    """How far three pictures (picture, pixel) are from an object wave beside one reference; infinite where c ∝ s."""
    mean, cosine, sine = np.linalg.pinv(_shift_model(steps)) @ rows
    squared = cosine**2 + sine**2
    signal, means = float(squared.mean()), rows.mean(axis=1)
    differences = np.exp(2j * math.pi / 3 * np.arange(3)) @ rows
    along = abs(np.square(differences).mean())
    if not (np.ptp(means) < _ONE_MEAN * abs(means.mean()) and along < _ONE_WAY * np.square(np.abs(differences)).mean()):
        return Shifted(tuple(map(float, steps)), math.inf)
    line = np.polyfit(mean, squared, 1) if np.ptp(mean) > 0 else np.array([0.0, signal])
    beside_line = float((squared - np.polyval(line, mean)).var()) / signal**2
    return Shifted(tuple(map(float, steps)), min(beside_line, 4 * float(mean.var()) / signal))


def _shift_model(steps: Floats) -> NDArray[np.float64]:
    """(picture, 3): the weights of a, c and s in pictures with these phases of the reference."""
    return np.stack([np.ones(len(steps)), np.cos(steps), np.sin(steps)], axis=1)


def unknown_steps(pictures: Floats) -> NDArray[np.float64]:
    """The phases of the reference in three or more pictures (picture, y, x), from the pictures alone; the first is 0.

    The two largest principal components of the pictures are the object's cosine and sine, if these are uncorrelated and
    of equal power over the picture, as they are of many fringes or speckles (Vargas, Quiroga & Belenguer, Opt. Lett.
    36, 1326 (2011)). Each picture's weights of them lie on a circle, at its phase. The sign is that which makes the
    second phase less than half a turn.

    Raises UserError for pictures in which nothing is shifted.
    """
    rows = pictures.reshape(len(pictures), -1).astype(np.float64)
    centred = rows - rows.mean(axis=0)
    powers, vectors = np.linalg.eigh(centred @ centred.T / rows.shape[1])
    if not powers[-2] > 1e-6 * powers[-1] or powers[-1] <= 0:
        raise UserError("recording", "pictures without a shift of phase between them", expected="a phase-shifting set")
    weights = vectors[:, -2:] * np.sqrt(powers[-2:])
    # the circle 2·c·w + (r² − |c|²) = |w|² through the points w
    model = np.concatenate([2 * weights, np.ones((len(weights), 1))], axis=1)
    centre = np.linalg.lstsq(model, np.square(weights).sum(axis=1), rcond=None)[0][:2]
    phases = np.arctan2(*(weights - centre).T)
    phases = (phases - phases[0]) % (2 * math.pi)
    return phases if phases[1] <= math.pi else (-phases) % (2 * math.pi)


# --- what all share ---------------------------------------------------------------------------------------------------


def unwrapped_phase(values: Complexes) -> NDArray[np.float64]:
    """The phase (y, x) of a field without jumps of 2π, rad, by scikit-image.

    Its method is that of Herráez et al., Appl. Opt. 41, 7437 (2002).

    Raises UserError if scikit-image isn't installed.
    """
    restoration = import_optional("skimage.restoration", "unwrapping of phases")
    return np.asarray(restoration.unwrap_phase(np.angle(values).astype(np.float64)))


def _wavefield(recording: Recording, values: Complexes) -> Wavefield:
    return Wavefield(
        values,
        recording.pitch_m,
        recording.wavelengths_m,
        recording.distance_m,
        recording.reference_radius_m,
        recording.name,
    )
