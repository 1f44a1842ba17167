"""Angles at which a viewer sees lengths of a focal plane through an eyepiece, whichever plane is in focus."""

from __future__ import annotations

import math


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
