"""Estimate of the memory that a simulation takes, from its plan."""

from __future__ import annotations

import math

from holoview.model.plan import Plan

_COMPLEX64 = 8
_FIELDS_AT_A_TIME = 8  # of a padded grid or band: transforms, tables in double precision, and their products
_IMAGE_BYTES = 240  # a sample of a plane while it becomes a picture: XYZ, linear and encoded colours in float64
_DRIVE_BYTES = 32  # a pixel of a pattern: drive, levels and optical path


def simulation_bytes(plan: Plan, *, double: bool = False) -> int:
    """Memory that simulating a plan and making pictures of all its planes takes, an upper estimate.

    double: in complex128. Of 22 simulations of 0.8 and 3.1 million samples, 1 to 10 planes, 3 or 8 lasers and 1 or 3
    frames, measured on the CPU with one thread, each took 47 to 90 % of it.
    """
    numbers = 2 if double else 1
    samples, planes = math.prod(plan.grid.shape), len(plan.planes_m)
    band = max(min(math.prod(plan.band(relay).shape), math.prod(plan.grid.padded)) for relay in (0, 1))
    fields = numbers * _COMPLEX64 * ((planes + _FIELDS_AT_A_TIME) * band + _FIELDS_AT_A_TIME * samples)
    spectra = planes * samples * numbers * 12 * len(plan.system.wavelengths_m)
    images = planes * samples * (_IMAGE_BYTES + 60 * (numbers - 1))
    drive = math.prod(plan.system.drive_shape) * _DRIVE_BYTES * numbers
    return drive + spectra + max(fields, images)
