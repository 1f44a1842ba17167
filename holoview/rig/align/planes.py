"""To which settings the stage goes for an alignment."""

from __future__ import annotations

import numpy as np

from holoview.rig.align.probes import DOTS_ACROSS, FEWEST_PX, Optics
from holoview.rig.description import RigDescription
from holoview.util import units
from holoview.util.errors import UserError

COUNT = 3
_NEAREST = 0.35  # of the farthest plane
_DEPTHS_OF_FOCUS = 4.0


def stage_settings(rig: RigDescription, optics: Optics) -> list[float]:
    """Ascending settings, m: where lenslets of the last modulator make small dots, within the safety limits.

    On a Fourier bench they lie within a few depths of focus. One setting where the stage can't move.
    """
    low, high = rig.limits.stage_m
    if optics.focal_length_m is not None:
        extent = min(optics.shape) * optics.slm.pitch_m
        reach = _DEPTHS_OF_FOCUS * optics.wavelength_m * (optics.focal_length_m / extent) ** 2
        near, far = float(np.clip(-reach, low, high)), float(np.clip(reach, low, high))
    else:
        slope = optics.sine
        far = float(np.clip(min(optics.shape) / DOTS_ACROSS * optics.slm.pitch_m / slope, low, high))
        near = max(low, _NEAREST * far)
        least = FEWEST_PX * optics.slm.pitch_m / (2 * slope)
        if far < least:
            found, expected = (units.format_rounded(z, "mm", 3) for z in (far, least))
            raise UserError(
                "stage",
                f"goes no farther than {found}",
                expected=f"a distance of {expected}, at which lenslets of 6 pixels focus",
                remedy="move the stage, or change [limits] in rig.toml",
            )
        near = min(max(near, least), far)
    return sorted({round(float(z), 9) for z in np.linspace(near, far, COUNT)})
