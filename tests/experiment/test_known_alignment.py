"""Effects that lie within an alignment's uncertainties."""

from __future__ import annotations

from typing import Any

import pytest

from holoview.bench.experiment.rig_bench import within_alignment
from holoview.bench.rig.registration import UncertainValue
from tests.rig.test_registration import REGISTRATION, VALUES

# Of PLACEMENT: the stage's zero is known to 1 µm, its scale to 1e-4 (1 µm at 10 mm), the shift in y to 0.1 µm.
Z = 10.2e-3 + 0.25e-3  # the stage at 10 mm


@pytest.mark.parametrize(
    ("effect", "values", "is_within"),
    [
        ("distance", {"distance_error": -2.9e-6}, True),
        ("distance", {"distance_error": 3.1e-6}, False),
        ("stage", {"scale": 2.9e-4, "walk_y": 0.0}, True),
        ("stage", {"scale": 2.9e-4, "walk_y": 4e-5}, False),
        ("plane_errors", {"distances": (Z,), "errors": (4.2e-6,)}, True),  # 3·√2 µm
        ("plane_errors", {"distances": (Z,), "errors": (4.3e-6,)}, False),
        ("plane_errors", {"distances": (0.25e-3, Z), "errors": (3.1e-6, 0.0)}, False),
        ("camera_alignment", {"shift_y": 2e-7, "shift_x": -2e-7}, True),
        ("camera_alignment", {"magnification": 7e-4}, True),  # the pitch is known to 1 nm of 3.9 µm
        ("camera_alignment", {"magnification": 8e-4}, False),
        ("gap", {"gap_error": 1e-9}, False),  # one modulator: no gap was aligned
        ("camera_blur", {"sigma": 1e-9}, False),
    ],
)
def test_only_what_an_alignment_leaves_open_is_within_it(effect: str, values: dict[str, Any], is_within: bool) -> None:
    assert within_alignment(REGISTRATION, {effect: values}) == [effect] * is_within


def test_values_are_those_of_the_comments() -> None:
    assert VALUES["stage_offset"] == UncertainValue(0.25e-3, 1e-6) and VALUES["stage_scale"].uncertainty == 1e-4
    assert REGISTRATION.setting_m(Z) == pytest.approx(10e-3)
