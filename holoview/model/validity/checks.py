"""All limits of the model: reads them from a plan, and refuses a plan that leaves nothing to see."""

from __future__ import annotations

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
    """The frequencies along the narrower axis that pass a relay at the wavelength that passes best."""
    lit = [i for i in range(len(plan.system.wavelengths_m)) if plan.lit(i)]
    fewest, relay = min(
        (max(_narrower_side(plan.stop_rows(relay, i)) for i in lit), relay) for _, relay, _ in paths(plan)
    )
    left = "nothing that the samples hold" if fewest == 0 else "one frequency of the samples along an axis"
    return Measured(
        float(fewest),
        f"the stops pass {left}",
        f"relay{relay + 1}",
        "widen the stop, move it to light that the samples hold, or raise padding or upsample",
    )


def _narrower_side(support: Integers) -> int:
    """Rows or columns of frequencies between the outermost ones that pass, whichever are fewer."""
    is_lit = support[:, 1] <= support[:, 2]
    if not is_lit.any():
        return 0
    lit = support[is_lit]
    return min(int(is_lit.sum()), int(lit[:, 2].max() - lit[:, 1].min()) + 1)


LIGHT_LEFT = Limit(
    name="light left",
    quantity="frequencies along an axis that the stops of a relay pass, at the wavelength that passes best",
    reason="no frequency is darkness, and one a uniform picture whatever the patterns",
    measure=_light_left,
    at_least=2.0,
    refuses=True,
)

LIMITS: tuple[Limit, ...] = (
    BAND_LEFT,
    LIGHT_LEFT,
    BAND_LIMIT,
    WRAP_AROUND,
    SAMPLES_A_PIXEL,
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
