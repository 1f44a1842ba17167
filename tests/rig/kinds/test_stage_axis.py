"""A stage's own coordinate and the distance of the camera."""

from __future__ import annotations

import pytest

from holoview.rig.devices import DeviceError
from holoview.rig.kinds.checks import StageAxis


@pytest.mark.parametrize(
    ("options", "position_m"), [({"zero": 12e-3}, 17e-3), ({"zero": 12e-3, "reversed": True}, 7e-3)]
)
def test_positions_and_distances_are_each_others_inverse(options: dict[str, float], position_m: float) -> None:
    axis = StageAxis.of(options)
    assert axis.position_m(5e-3) == pytest.approx(position_m, rel=1e-12)
    assert axis.distance_m(position_m) == pytest.approx(5e-3, rel=1e-12)


def test_a_stage_may_stop_within_the_tolerance() -> None:
    StageAxis.of({}).require_arrived(5.009e-3, 5e-3)
    with pytest.raises(DeviceError, match=r"stage: stopped at 5\.011 mm; expected 5 mm; .* raise stage.tolerance"):
        StageAxis.of({}).require_arrived(5.011e-3, 5e-3)
