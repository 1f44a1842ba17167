"""All limits of the model: reads them from a plan, and refuses a plan that leaves nothing to see."""

from __future__ import annotations

import numpy as np

from holoview.model.passband import Integers
from holoview.model.plan import Plan
from holoview.model.validity.eye_limits import EYEBOX, PUPIL_SAMPLES
from holoview.model.validity.limit import Limit, Measured, Reading
from holoview.model.validity.sampling_limits import (
    BAND_LEFT,
    BAND_LIMIT,
    OBLIQUE_LIGHT,
    SAMPLES_A_PIXEL,
    SINGLE_PRECISION,
    STOPS,
    WRAP_AROUND,
    paths,
)
from holoview.model.validity.scalar_limits import EVANESCENT, NEAR_FIELD, PIXELS
from holoview.model.validity.source_limits import CONTINUUM, OBSERVER
from holoview.util.errors import UserError


def _light_left(plan: Plan) -> Measured:
    """The frequencies that pass a relay at the wavelength that passes best, of the relay that passes fewer."""
    lit = [i for i in range(len(plan.system.wavelengths_m)) if plan.lit(i)]
    fewest, relay = min(
        (max(_count_passing(plan.stop_rows(relay, i)) for i in lit), relay) for _, relay, _ in paths(plan)
    )
    return Measured(
        float(fewest),
        "no light passes its stops" if fewest == 0 else "a single frequency of the samples passes its stops",
        f"relay{relay + 1}",
        "widen them, move them to light that the samples hold, or raise padding or upsample",
    )


def _count_passing(support: Integers) -> int:
    """How many frequencies a support passes (`Transfer.support`)."""
    smallest, low, high = support.astype(np.int64).T
    blocked = np.minimum(high, smallest - 1) - np.maximum(low, 1 - smallest) + 1
    return int((high - low + 1 - np.maximum(blocked, 0)).sum())  # an empty row has the bounds (1, 0)


LIGHT_LEFT = Limit(
    name="light left",
    quantity="frequencies that the stops of a relay pass, at the wavelength that passes best",
    reason="no frequency is darkness",
    measure=_light_left,
    at_least=1.0,
    refuses=True,
)

STOPS_RESOLVED = Limit(
    name="stops on the grid",
    quantity="frequencies that the stops of a relay pass, at the wavelength that passes best",
    reason="a single one is a uniform picture whatever the patterns, and its brightness depends on the grid",
    measure=_light_left,
    at_least=2.0,
)

LIMITS: tuple[Limit, ...] = (
    BAND_LEFT,
    LIGHT_LEFT,
    BAND_LIMIT,
    WRAP_AROUND,
    SAMPLES_A_PIXEL,
    STOPS_RESOLVED,
    STOPS,
    OBLIQUE_LIGHT,
    SINGLE_PRECISION,
    PIXELS,
    EVANESCENT,
    NEAR_FIELD,
    OBSERVER,
    CONTINUUM,
    EYEBOX,
    PUPIL_SAMPLES,
)
"""All limits, those that refuse first."""


def read_limits(plan: Plan) -> tuple[Reading, ...]:
    """What each limit that applies to a plan says of it, in the order of `LIMITS`."""
    measured = ((limit, limit.measure(plan)) for limit in LIMITS)
    return tuple(Reading(limit, found) for limit, found in measured if found is not None)


def exceeded_limits(plan: Plan) -> tuple[str, ...]:
    """The limits beyond which the model isn't true of a plan, each as a sentence."""
    return tuple(reading.text for reading in read_limits(plan) if reading.is_exceeded)


def check_plan(plan: Plan) -> Plan:
    """The plan. Raises UserError where its sampling or its stops leave nothing of the patterns to see."""
    for limit in LIMITS:
        found = limit.measure(plan) if limit.refuses else None
        if found is not None and not limit.is_kept_by(found.value):
            expected = f"{limit.quantity}: {limit.threshold}"
            raise UserError(found.where, found.found, expected=expected, remedy=found.remedy)
    return plan
