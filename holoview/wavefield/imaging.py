"""Far images brought near, so that a bench can show them.

A bench propagates by the angular spectrum in the field's own window. Where the image lies so far away that it leaves
this window, the field is brought to it by one Fresnel or Fourier transform, and looked at around there.
"""

from __future__ import annotations

import numpy as np

from holoview.optics.free_space import Window
from holoview.util import units
from holoview.wavefield.propagation import choose_method, propagate_field
from holoview.wavefield.request import Propagation
from holoview.wavefield.wavefield import Wavefield

_MOST_SAMPLES = 16384  # along a side of the window of a far image


def image_field(field: Wavefield, propagation: Propagation = "auto") -> tuple[Wavefield, str]:
    """The field as a bench can show it, and what was done for it, a sentence; empty where nothing was.

    propagation: "auto" takes what `choose_method` takes; "asm" leaves the field in its plane; the others
    bring it to its distance, from which planes then count.
    """
    choice = choose_method(field, field.distance_m, propagation)
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
