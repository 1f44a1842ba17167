"""From what was read to the field that is looked at: recordings are demodulated, far images brought near.

A bench propagates by the angular spectrum in the field's own window. Where the image lies so far away that it leaves
this window, the field is brought to it by one Fresnel or Fourier transform, and looked at around there.
"""

from __future__ import annotations

import numpy as np

from holoview.optics.free_space import Window
from holoview.util import units
from holoview.util.errors import UserError
from holoview.wavefield.demodulation import Demodulated, in_line_field, off_axis_field, phase_shifting_field
from holoview.wavefield.propagation import choose_method, propagate_field
from holoview.wavefield.reading import Reading, Recording
from holoview.wavefield.request import ReadRequest
from holoview.wavefield.wavefield import Wavefield

_MOST_SAMPLES = 16384  # along a side of the window of a far image


def field_of_reading(reading: Reading, request: ReadRequest) -> tuple[Wavefield, tuple[str, ...]]:
    """The field of what was read, and what was done for it, each a sentence.

    Raises UserError for a recording of unknown kind, unless `request.accept_guesses`, and as demodulation does.
    """
    if reading.wavefield is not None:
        return reading.wavefield, ()
    assert reading.recording is not None
    found = _demodulated(reading.recording, request)
    return found.field, tuple(f"recording: {line}" for line in found.report)


def _demodulated(recording: Recording, request: ReadRequest) -> Demodulated:
    kinds = {"off-axis": off_axis_field, "in-line": in_line_field, "phase-shifting": phase_shifting_field}
    if recording.kind in kinds:
        return kinds[recording.kind](recording)  # type: ignore[operator]
    if not request.accept_guesses:
        raise UserError(
            recording.name,
            "a recording of a camera, by its real numbers",
            expected="--recording off-axis, in-line or phase-shifting",
            remedy="--quantity says what its numbers are if they are a field: amplitude, phase or intensity",
        )
    try:
        return off_axis_field(recording)
    except UserError:
        return in_line_field(recording)


def image_field(field: Wavefield, request: ReadRequest) -> tuple[Wavefield, str]:
    """The field as a bench can show it, and what was done for it, a sentence; empty where nothing was.

    `request.propagation`: "auto" takes what `choose_method` takes; "asm" leaves the field in its plane; the others
    bring it to its distance, from which planes then count.
    """
    choice = choose_method(field, field.distance_m, request.propagation)
    if choice.method == "asm":
        return field, ""
    pitch_m = min(choice.window.pitch_m)
    rows, columns = (min(max(round(side / pitch_m), 2), _MOST_SAMPLES) for side in choice.window.side_m)
    seen = propagate_field(field, field.distance_m, choice.method, Window((rows, columns), (pitch_m, pitch_m)))
    there = Wavefield(
        seen.values.numpy().astype(np.complex64), (pitch_m, pitch_m), field.wavelengths_m, name=field.name
    )
    how = "Fresnel" if choice.method == "fresnel" else "Fourier"
    distance = units.format_rounded(field.distance_m, "mm")
    return there, f"brought {distance} to its image by one {how} transform ({choice.reason}); planes count from there"
