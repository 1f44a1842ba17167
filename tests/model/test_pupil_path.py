"""A pupil's path: straight between its points, checked when it is made, and what is seen along it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from holoview.light.model import preset
from holoview.light.model.focus import MAX_POINTS, PupilPath, PupilState, plane_at, system_at, views_along
from holoview.util.errors import UserError

PATH = PupilPath((0.0, 1.0, 3.0), (0.0, 1e-3, 1e-3), (0.0, 0.0, -2e-3), (3e-3, 2e-3, 2e-3), (0.0, 1.0, 0.5))
SYSTEM = preset.load("holochrome-8").edit({"eye": {}, "shape": [16, 16]})


def test_between_its_points_it_is_straight_and_before_and_after_it_rests() -> None:
    states = [PATH.at(time_s) for time_s in (-1.0, 0.5, 2.0, 9.0)]
    assert [state.y_m for state in states] == pytest.approx([0.0, 0.5e-3, 1e-3, 1e-3])
    assert [state.x_m for state in states] == pytest.approx([0.0, 0.0, -1e-3, -2e-3])
    assert [state.pupil_m for state in states] == pytest.approx([3e-3, 2.5e-3, 2e-3, 2e-3])
    assert [state.accommodation_dpt for state in states] == pytest.approx([0.0, 0.5, 0.75, 0.5])


def test_steps_are_equal_in_time_and_reach_both_ends() -> None:
    assert [time_s for time_s, _ in PATH.states(4)] == pytest.approx([0.0, 1.0, 2.0, 3.0])
    assert PATH.states(1)[0][1] == PATH.at(0.0)
    with pytest.raises(UserError, match="1 or more"):
        PATH.states(0)


def test_what_is_seen_has_the_pupil_and_the_plane_of_each_time() -> None:
    times_s, views = views_along(SYSTEM, PATH, 4, 10e-3)
    assert times_s == pytest.approx([0.0, 1.0, 2.0, 3.0])
    for (system, plane_m), time_s in zip(views, times_s, strict=True):
        eye, state = system.eye, PATH.at(time_s)
        assert eye is not None
        assert (eye.pupil_y_m, eye.pupil_x_m, eye.pupil_m) == (state.y_m, state.x_m, state.pupil_m)
        assert eye.dioptres(plane_m, system.planes_m) == pytest.approx(state.accommodation_dpt)


def test_what_it_does_not_tell_stays_as_it_is() -> None:
    state = PupilPath((0.0,), (1e-3,), (0.0,)).at(0.0)
    assert state == PupilState(1e-3, 0.0)
    eye = system_at(SYSTEM.edit({"eye.pupil": "auto"}), state).eye
    assert eye is not None and eye.pupil_m == "auto"
    assert plane_at(SYSTEM, state, 12e-3) == 12e-3


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"times_s": ()}, "0 points"),
        ({"times_s": tuple(map(float, range(MAX_POINTS + 1)))}, str(MAX_POINTS)),
        ({"times_s": (0.0, 1.0)}, "3 values of y, 2 times"),
        ({"times_s": (0.0, 1.0, 1.0)}, "point 3: time: 1 s follows 1 s"),
        ({"times_s": (0.0, float("nan"), 2.0)}, "point 2: time"),
        ({"times_s": (0.0, 1.0, float("inf"))}, "inf"),
        ({"times_s": (1.0, 2.0, 3.0)}, "from 0 s"),
        ({"y_m": (0.0, 1.0, 0.0)}, "point 2: y: 1000 mm is out of range"),
        ({"x_m": (0.0, float("nan"), 0.0)}, "point 2: x"),
        ({"pupil_m": (3e-3, 3e-3, 0.0)}, "point 3: pupil: 0 mm is out of range"),
        ({"accommodation_dpt": (0.0, 0.0, 31.0)}, "point 3: accommodation"),
    ],
)
def test_what_no_pupil_can_do_is_named(changes: dict[str, Any], complaint: str) -> None:
    columns = {field: getattr(PATH, field) for field in ("times_s", "y_m", "x_m", "pupil_m", "accommodation_dpt")}
    with pytest.raises(UserError, match=complaint):
        PupilPath(**{**columns, **changes})


def test_a_path_needs_an_eye_and_planes_that_can_be_seen() -> None:
    with pytest.raises(UserError, match="no eye"):
        views_along(SYSTEM.with_(eye=None), PATH, 2, 10e-3)
    near = PupilPath((0.0, 1.0), (0.0, 0.0), (0.0, 0.0), None, (0.0, -8.0))  # -8 D are 12.8 mm before the far plane
    with pytest.raises(UserError, match="focused at -8 D"):
        views_along(SYSTEM, near, 2, 10e-3)
    assert len(views_along(SYSTEM, near, 1, 10e-3)[1]) == 1
    assert np.isclose(near.duration_s, 1.0)
