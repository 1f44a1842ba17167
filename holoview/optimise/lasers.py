"""The lasers of a plan that are on: (frame, wavelength) pairs, and plans with only some of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from holoview.model.plan import Plan

Laser = tuple[int, int]
"""Indices of a frame and of a wavelength that is on in this frame."""


def lit_lasers(plan: Plan) -> list[Laser]:
    """The lasers whose power isn't zero, frame by frame."""
    return [(int(frame), int(wavelength)) for frame, wavelength in np.argwhere(plan.weights > 0)]


def with_only_lasers(plan: Plan, lasers: Sequence[Laser]) -> Plan:
    """The plan with all other lasers switched off."""
    weights = np.zeros_like(plan.weights)
    for laser in lasers:
        weights[laser] = plan.weights[laser]
    return replace(plan, weights=weights)
