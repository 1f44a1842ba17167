"""From the geometry that was found to the registration of the devices and to sentences; a check with a few captures."""

from __future__ import annotations

import math

import numpy as np

from holoview.captures.dataset import join_captures
from holoview.captures.patterns import BLUR_SIGMAS_PX
from holoview.captures.records import RecordFindings, find_record_errors
from holoview.captures.records.corrections import ORIENTATION_WORDS
from holoview.rig.align.alignment import FoundGeometry
from holoview.rig.align.geometry import Geometry
from holoview.rig.description import RigDescription
from holoview.rig.devices import DeviceError, Devices
from holoview.rig.measure.capture_plan import CapturePlan, default_plan
from holoview.rig.measure.measurement import Measurement
from holoview.rig.registration import Measured, Registration
from holoview.util.progress import ProgressCallback
from holoview.util.units import format_rounded

_LEAST_SHARE = 0.5  # of the modulator's height and width that the camera has to see
_COMMON_ERROR_PX = 0.03  # of all dots: pixels of unequal sensitivity, sampling of the picture
_SECOND = {
    "slm2_shift_y": "shift2_y",
    "slm2_shift_x": "shift2_x",
    "slm2_rotation": "rotation2",
    "slm2_magnification": "magnification2",
}


def registration_of(rig: RigDescription, found: FoundGeometry) -> Registration:
    """The registration of a rig's devices. Raises DeviceError where the camera sees too little of the modulator."""
    g, rig = found.geometry, rig.as_described
    pitch = math.exp(g["log_pitch"])
    offset, scale = (_unless_nominal(g, name) for name in ("offset", "scale"))
    middle_m = offset.value + (1 + scale.value) * sum(rig.stage_m) / 2
    first, shape, shift = [], [], []
    for axis, name in enumerate("yx"):
        centre = g[f"centre_{name}"]
        wanted = found.picture_shape[axis]
        if rig.bench.focal_length_m is None:
            wanted = round(rig.slm_shape[axis] * rig.bench.slms[0].pitch_m / pitch)
        begin, count = _crop(centre + g[f"walk_{name}"] * middle_m / pitch, found.picture_shape[axis], wanted)
        first.append(begin)
        shape.append(count)
        shift.append((centre - begin - (count - 1) / 2) * pitch)
    values = {
        "pitch": Measured(pitch, pitch * g.uncertainty("log_pitch")),
        "rotation": _measured(g, "rotation"),
        **{f"shift_{n}": Measured(own, _centre_error(g, n) * pitch) for n, own in zip("yx", shift, strict=True)},
        **{name: _measured(g, name) for name in ("walk_y", "walk_x")},
        "stage_offset": offset,
        "stage_scale": scale,
    }
    if found.slm2_turn is not None:
        values |= {name: _measured(g, own) for name, own in _SECOND.items()}
        values["gap_error"] = Measured(g["gap"] - (rig.bench.gap_m or 0.0), g.uncertainty("gap"))
    return Registration(
        found.camera_turn,
        found.slm2_turn,
        (first[0], first[1]),
        (shape[0], shape[1]),
        rig.slm_shape,
        rig.camera_shape,
        values,
    )


def _crop(centre: float, whole: int, wanted: int) -> tuple[int, int]:
    """First pixel and number of pixels of the part around a centre, as much of the wanted ones as there are."""
    count = min(wanted, math.floor(2 * min(centre + 0.5, whole - 0.5 - centre)))
    if count < _LEAST_SHARE * min(wanted, whole):
        found = f"has the middle of the modulators at pixel {centre:.0f} of {whole}"
        raise DeviceError("camera", found, remedy="move the camera until it sees the whole modulator")
    return int(np.clip(round(centre - (count - 1) / 2), 0, whole - count)), count


def _measured(g: Geometry, name: str) -> Measured:
    return Measured(g[name], g.uncertainty(name))


def _unless_nominal(g: Geometry, name: str) -> Measured:
    """A value that is measured; the nominal zero, as uncertain, where that is as likely."""
    found = _measured(g, name)
    return found if found.is_significant else Measured(0.0, found.uncertainty)


def _centre_error(g: Geometry, axis: str) -> float:
    """Pixels."""
    return math.hypot(g.uncertainty(f"centre_{axis}"), _COMMON_ERROR_PX)


def doubt(found: FoundGeometry) -> str | None:
    """A sentence where dots show that modulators or camera aren't as described."""
    if found.excess_px == 0:
        return None
    return (
        f"Dots lie {found.geometry.residual_px:.2g} pixels from where they should (r.m.s.), more than noise makes: "
        "modulators or camera aren't what rig.toml says, which makes distances less certain. A diagnosis tells more."
    )


def sentences(registration: Registration) -> list[str]:
    """A registration in sentences."""
    p, second = registration, registration.slm2_turn
    row, column = p.first
    result = [
        f"The camera's picture is {_turned(p.camera_turn)}.",
        f"Turned back, rows {row} … {row + p.shape[0] - 1} and columns {column} … {column + p.shape[1] - 1} of it are "
        f"centred on modulator 1, up to {_pm(p, 'shift_y', 'um')} (y) and {_pm(p, 'shift_x', 'um')} (x).",
        f"A pixel of the camera is {_pm(p, 'pitch', 'um')} wide in the modulator's plane; the picture is turned by "
        f"{_pm(p, 'rotation', 'mrad')}.",
        f"Where the stage says 0, the camera is {_pm(p, 'stage_offset', 'mm')} behind the last modulator, and it moves "
        f"by {1 + p['stage_scale']:.5f} ± {p.values['stage_scale'].uncertainty:.1g} of what is set.",
        f"Its rail is {_pm(p, 'walk_y', 'mrad')} (y) and {_pm(p, 'walk_x', 'mrad')} (x) from the axis.",
    ]
    if second is not None:
        result += [
            f"What modulator 2 displays is {_turned(second)}, against modulator 1.",
            f"It is shifted by {_pm(p, 'slm2_shift_y', 'um')} (y) and {_pm(p, 'slm2_shift_x', 'um')} (x), turned by "
            f"{_pm(p, 'slm2_rotation', 'mrad')} and magnified by {100 * p['slm2_magnification']:.3g} ± "
            f"{100 * p.values['slm2_magnification'].uncertainty:.1g} %.",
            f"The gap between the modulators is {_pm(p, 'gap_error', 'mm')} longer than stated.",
        ]
    return result


def _turned(turn: str) -> str:
    return ORIENTATION_WORDS.get(turn, "the right way up")


def _pm(registration: Registration, name: str, unit: str) -> str:
    found = registration.values[name]
    number, _ = format_rounded(found.value, unit, 5).split()
    return f"{number} ± {format_rounded(found.uncertainty, unit, 2)}"


_OF_EACH = 2  # captures of each laser and plane


def check_plan(rig: RigDescription) -> CapturePlan:
    """The smoothest captures of each laser and plane of the default plan."""
    smoothest = np.sort(BLUR_SIGMAS_PX)[-_OF_EACH:]
    count: dict[tuple[float, float], int] = {}
    requests = []
    for request in default_plan(rig).requests:
        condition = request.wavelength_m, request.distance_m
        if request.sigma_px in smoothest and count.get(condition, 0) < _OF_EACH:
            count[condition] = count.get(condition, 0) + 1
            requests.append(request)
    return CapturePlan(tuple(requests))


def check_rig_records(
    rig: RigDescription,
    devices: Devices,
    progress: ProgressCallback = lambda done, total, note: None,
) -> RecordFindings:
    """Takes two captures of every laser and plane, and checks their records.

    rig: with its registration. devices: its open ones, registered.
    """
    measurement, requests, taken = Measurement(rig, devices), check_plan(rig).requests, []
    for done, request in enumerate(requests):
        progress(done, len(requests), f"{request.wavelength_m * 1e9:.0f} nm, {request.distance_m * 1e3:.3g} mm")
        taken.append(measurement.take(request, request.levels(rig)))
    progress(len(requests), len(requests), "")
    known = {} if rig.registration is None else rig.registration.known_effects()
    return find_record_errors(join_captures(taken), known)
