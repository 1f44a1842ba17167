"""Whether patterns arrive at the modulators as they were sent: unscaled, with the full range and all levels.

Gratings are shown and compared with one another in the camera's picture, near its axis, so that neither places nor a
model of the bench need be known. In the picture of a weak phase grating divided by that of a flat modulator, the
modulation is linear in the step of the phase:

    I/I₀ − 1 = 2·δ·sin(πλz/p²)·g(x)     Talbot effect; step δ, period p, distance z, fundamental g of the bars

A grating of a sixteenth of the levels, in their middle, is the reference R; r = ⟨M, R⟩/⟨R, R⟩ is the step of another
grating M of the same period in units of the reference's. It is 1 at both ends of the range unless they are clipped, and
the same for all neighbouring levels unless some have merged. The spatial frequency of R says the scale.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.gratings import CLIPPED_LEVELS, grating
from holoview.bench.rig.align import laser_for_alignment
from holoview.bench.rig.camera_pictures import take_exposed
from holoview.bench.rig.description import RigDescription
from holoview.bench.rig.devices import Devices
from holoview.bench.rig.rays import way_to_camera
from holoview.light.model.elements import AmplitudeModulator, PhaseModulator, Space
from holoview.util.progress import ProgressCallback, no_progress

Floats = NDArray[np.float64]

LEAST_LEVELS = 128
"""Levels of a modulator below which its signal isn't a picture of grey levels, and isn't checked."""
_PERIODS_PX = (4, 6, 8, 12, 16, 24, 32)
_LEAST_PERIODS, _LEAST_CAMERA_PX = 4, 4.0
_GOOD_SINE = 0.8
_PLACES = 33  # of the stage that are considered
_UNIT_STEPS = 8  # neighbouring levels: with 219 levels of 255 one of 7.1 merges
_SCALE_ERROR = 0.05  # of what rig.toml says of the camera's magnification
_CLIPPED, _MERGED = 0.35, 0.35  # of the step that is expected
_SIGMAS = 6.0
_FLAT_PICTURES = 4
_HEADROOM = 0.4  # of the exposure of a flat modulator: bright fringes are twice as bright and more
_LIT = 0.3  # of the bright part's light: what counts


@dataclass(frozen=True)
class SignalCheck:
    """What was found of a modulator's signal. name: its table in rig.toml.

    scale: of the pattern on the modulator; None if no grating was seen. low, high: steps of a sixteenth of the range at
    its ends, in units of that in its middle. merged: of eight neighbouring levels those that can't be told from the
    next; None where the noise hides a step. faults: as sentences; none if all is well. notes: what wasn't checked.
    """

    modulator: int
    name: str
    scale: float | None = None
    low: float | None = None
    high: float | None = None
    merged: int | None = None
    faults: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def check_signals(
    rig: RigDescription, devices: Devices, progress: ProgressCallback = no_progress
) -> tuple[SignalCheck, ...]:
    """Shows gratings on each modulator and says what arrived. It leaves the lasers on.

    Raises UserError as the devices do.
    """
    found = []
    for number, slm in enumerate(rig.bench.slms):
        name = rig.modulator_names[number]
        if why := _hidden_in_chain(rig, name):
            found.append(SignalCheck(number, name, notes=(f"{name}: its signal isn't checked {why}",)))
        elif rig.bench.focal_length_m is not None:
            found.append(SignalCheck(number, name, notes=(f"{name}: its signal isn't checked on a Fourier bench",)))
        elif slm.num_levels < LEAST_LEVELS:
            note = f"{name}: a signal of {slm.num_levels} levels isn't checked, {LEAST_LEVELS} or more are"
            found.append(SignalCheck(number, name, notes=(note,)))
        else:
            found.append(_Check(rig, devices, number, progress).run())
    return tuple(found)


def signal_lines(check: SignalCheck) -> tuple[str, ...]:
    """What was found in words: the faults, or that there are none; and what wasn't checked."""
    if check.faults or check.scale is None:
        return (*check.faults, *check.notes)
    bits = "" if check.merged is None else f", no two of {_UNIT_STEPS + 1} neighbouring levels alike"
    found = f"{check.name}: patterns arrive at {check.scale:.1%} of their size, with both ends of the range"
    return (f"{found}{bits}", *check.notes)


def _hidden_in_chain(rig: RigDescription, name: str) -> str:
    """Why gratings on an element of a chain aren't seen as this check needs it, in words; empty where they are."""
    chain = rig.bench.chain
    if chain is None:
        return ""
    for own, element in zip(chain.element_names, chain.elements, strict=True):
        is_plain = isinstance(element, PhaseModulator | AmplitudeModulator) and not element.beside
        if own == name and not isinstance(element, PhaseModulator):
            return "as that of a phase modulator"
        if not (is_plain or isinstance(element, Space)):
            return f"with {own}, of kind {element.kind}, in the light"
    return ""


class _Check:
    """The check of one modulator; the others are flat and transparent."""

    def __init__(self, rig: RigDescription, devices: Devices, number: int, progress: ProgressCallback) -> None:
        self._rig, self._devices, self._number, self._progress = rig, devices, number, progress
        self._slm, self._done, self._name = rig.bench.slms[number], 0, rig.modulator_names[number]
        self._black = rig.bench.camera.black_level
        self._wavelength_m = laser_for_alignment(rig)
        self._period, self._place_m = self._geometry()

    def run(self) -> SignalCheck:
        """Takes the pictures, and judges them."""
        name, devices, top = self._name, self._devices, self._slm.num_levels - 1
        devices.stage.move_to(self._place_m)
        devices.lasers.switch_on(self._wavelength_m, min(self._rig.limits.power, 1.0))
        self._show(0, 0)
        _, exposure_s = take_exposed(devices.camera, self._rig.bench.camera, 1e-2)
        devices.camera.set_exposure(max(_HEADROOM * exposure_s, devices.camera.exposures_s[0]))
        flats = np.stack([self._take() for _ in range(_FLAT_PICTURES)])
        flat = flats.mean(axis=0)
        lit = flat > _LIT * float(np.quantile(flat, 0.9))
        middle, step = (top + 1) // 2, (top + 1) * CLIPPED_LEVELS // 256
        reference = self._modulation(flat, lit, middle, middle + step)
        noise = (flats[0] / np.where(lit, flat, 1.0) - 1)[lit]
        power = float(np.mean(reference[lit] ** 2))
        if power < _SIGMAS**2 * float(np.mean(noise**2)) / math.sqrt(lit.sum()):
            return SignalCheck(self._number, name, faults=(f"{name}: no grating that it shows is seen by the camera",))

        def steps(low: int, high: int) -> float:
            return float(np.mean(self._modulation(flat, lit, low, high)[lit] * reference[lit])) / power

        scale = self._scale(reference)
        low, high = steps(0, step), steps(top - step, top)
        units = [steps(level, level + 1) for level in range(middle, middle + _UNIT_STEPS)]
        error = math.sqrt(float(np.mean(noise**2)) / power / lit.sum())
        is_seen = max(units) > _SIGMAS * error
        merged = sum(unit < _MERGED * max(units) for unit in units) if is_seen else None
        notes = () if is_seen else (f"{name}: the noise hides a step of one level, so that bits aren't checked",)
        faults = (*_scale_faults(name, scale), *_range_faults(name, low, high, merged))
        return SignalCheck(self._number, name, scale, low, high, merged, faults, notes)

    def _geometry(self) -> tuple[int, float]:
        """The period (pixels) and the place of the stage (m) at which a grating is seen best."""
        rig = self._rig
        near, far = self._devices.stage.range_m
        places = np.linspace(near, far, _PLACES)
        before = way_to_camera(rig, self._number, self._wavelength_m).matrix(0.0)[1]  # spaces alone stand behind it
        columns = rig.slm_shapes[self._number][1]
        best = (-1.0, _PERIODS_PX[0], float(near))
        for period in _PERIODS_PX:
            width_m = period * self._slm.pitch_m
            fits = columns >= _LEAST_PERIODS * period
            if not fits or width_m < _LEAST_CAMERA_PX * rig.bench.camera.pitch_m:
                continue
            sines = np.abs(np.sin(np.pi * self._wavelength_m * (places + before) / width_m**2))
            walk_off = self._wavelength_m * (places + before) / width_m / (columns * self._slm.pitch_m)
            scores = np.where(walk_off < 0.25, sines, 0.0)  # its orders overlap over most of the picture
            place = int(np.argmax(scores))
            if scores[place] > best[0]:
                best = (float(scores[place]), period, float(places[place]))
            if best[0] > _GOOD_SINE:
                break
        return best[1], best[2]

    def _show(self, low: int, high: int) -> None:
        """A grating on this modulator, and nothing on the others."""
        levels, shape = self._rig.clear_levels, self._rig.slm_shapes[self._number]
        levels[self._number] = grating(shape, self._period, low, high, dtype=self._rig.levels_type)
        self._devices.show(levels)
        self._devices.clock.wait(self._devices.settle_s)

    def _take(self) -> Floats:
        """A picture without its black level."""
        self._done += 1
        self._progress(self._done, _FLAT_PICTURES + 3 + _UNIT_STEPS, self._name)
        return self._devices.camera.take().astype(np.float64) - self._black

    def _modulation(self, flat: Floats, lit: NDArray[np.bool_], low: int, high: int) -> Floats:
        """I/I₀ − 1 of a grating, without its mean; 0 where it isn't lit."""
        self._show(low, high)
        found = np.where(lit, self._take() / np.where(lit, flat, 1.0), 0.0)
        return np.where(lit, found - found[lit].mean(), 0.0)

    def _scale(self, reference: Floats) -> float:
        """The period that the camera sees over that which it should see."""
        expected = self._rig.bench.camera.pitch_m / (self._period * self._slm.pitch_m)
        shape = tuple(4 * n for n in reference.shape)
        window = np.outer(*(np.hanning(n) for n in reference.shape))
        power = np.abs(np.fft.fft2(window * reference, shape)) ** 2
        y, x = (np.fft.fftfreq(n) for n in shape)
        radius = np.hypot(y[:, None], x[None, :])
        near = (radius > 0.4 * expected) & (radius < 1.9 * expected)
        peak = np.unravel_index(int(np.argmax(np.where(near, power, 0.0))), power.shape)
        around = [np.arange(p - 3, p + 4) % n for p, n in zip(peak, shape, strict=True)]
        weights = power[np.ix_(*around)]
        return float(expected * weights.sum() / (weights * radius[np.ix_(*around)]).sum())


def _scale_faults(name: str, scale: float) -> tuple[str, ...]:
    if abs(scale - 1) <= _SCALE_ERROR:
        return ()
    return (
        f"{name}: its pattern is {scale:.3g} times as large as it was sent: the system scales the screen (set it to "
        "100 %), or rig.toml's pitches are wrong",
    )


def _range_faults(name: str, low: float, high: float, merged: int | None) -> tuple[str, ...]:
    """The sentences on levels that are clipped or have merged."""
    ends = [words for words, step in (("darkest", low), ("brightest", high)) if step < _CLIPPED]
    if ends:
        which = " and the ".join(f"{CLIPPED_LEVELS} {end}" for end in ends)
        return (
            f"{name}: the {which} of 256 levels show the same: the signal is taken for one of limited range, 16 to 235 "
            "(set the link to full range), or its table is flat there",
        )
    if merged in (1, 2):
        return (
            f"{name}: of {_UNIT_STEPS} neighbouring levels {merged} can't be told from the next: the signal is "
            "compressed to limited range, 16 to 235 (set the link to full range), or its table has fewer levels",
        )
    if merged:
        return (
            f"{name}: of {_UNIT_STEPS} neighbouring levels {merged} can't be told from the next: lower bits are lost "
            "on the way (set the link to all bits)",
        )
    return ()
