"""The nominal bench of a rig as a system; what another system may and may not be."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.bench.experiment.rig_bench import levels_of_drive, on_rig, system_of_rig
from holoview.light.model.system import System
from holoview.util.errors import UserError
from tests.experiment.camera_loop.conftest import MakeRig

THREE = '["450 nm", "520 nm", "638 nm"]'


def test_the_rigs_own_bench_is_its_geometry(make_rig: MakeRig) -> None:
    system = on_rig(system_of_rig(make_rig(lasers=THREE)), make_rig(lasers=THREE))
    assert (system.gap_m, system.relay1.iris_na, system.modulators[1].stroke_m) == (1e-3, 0.03, 825e-9)
    assert system.observer == "eye" and system.wavelengths_m == pytest.approx([450e-9, 520e-9, 638e-9])
    assert system.planes_m == pytest.approx([1e-3, 5e-3, 9e-3])


def test_fewer_lasers_are_seen_by_a_mono_camera(make_rig: MakeRig) -> None:
    assert system_of_rig(make_rig()).observer == "mono"


def test_modulators_without_levels_get_the_rigs(make_rig: MakeRig) -> None:
    rig = make_rig()
    system = on_rig(system_of_rig(rig).edit({"levels": None}), rig)
    assert [len(m.levels) for m in system.modulators if m.levels is not None] == [256, 256]


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        ({"gap": "2 mm"}, "gap: is 2 mm; expected 1 mm"),
        ({"shape": [48, 64]}, "modulators.0.shape"),
        ({"pitch": "6 um"}, "modulators.0.pitch: is 6 um; expected 8 um"),
        ({"stroke": "700 nm"}, "modulators.0.stroke: is 700 nm; expected 825 nm"),
        ({"levels": 16}, "16 levels; expected 256"),
        ({"relay1.iris_na": 0.02}, "relay1: is iris_na 0.02; expected iris_na 0.03"),
        ({"relay2.iris_na": None}, "relay2: is without stops"),
        ({"wavelengths": ["532 nm"]}, "wavelengths: 532 nm; expected one of the rig's lasers: 520 nm"),
        ({"planes": ["20 mm"]}, "20 mm"),
        ({"source": {"directions": [[0, 0], [0.01, 0]]}}, "source"),
        ({"eye": {}}, "eye"),
        ({"modulators": [{"pitch": "8 um", "shape": [24, 32], "stroke": "825 nm"}], "gap": None}, "modulators: is 1"),
    ],
)
def test_what_differs_is_named(make_rig: MakeRig, changes: dict[str, object], names: str) -> None:
    rig = make_rig()
    with pytest.raises(UserError) as caught:
        on_rig(system_of_rig(rig).edit(changes), rig)
    assert names in str(caught.value)


def test_effects_and_sampling_may_differ(make_rig: MakeRig) -> None:
    rig = make_rig()
    changed: System = system_of_rig(rig).edit({"effects.gap.gap_error": 1e-4, "upsample": 3})
    assert on_rig(changed, rig) == changed


def test_a_laser_that_is_never_on_is_refused(make_rig: MakeRig) -> None:
    rig = make_rig(lasers=THREE)
    with pytest.raises(UserError, match="off in every frame"):
        on_rig(system_of_rig(rig).edit({"amplitudes": [[1.0, 0.0, 1.0]]}), rig)


def test_levels_are_the_nearest_ones_also_if_their_steps_differ(make_rig: MakeRig) -> None:
    uneven = [0.0, 0.1, 0.7, 1.0]
    system = system_of_rig(make_rig()).edit({"levels": uneven})
    drive = np.random.default_rng(0).random(system.drive_shape).astype(np.float32)
    found = levels_of_drive(drive, system)
    np.testing.assert_array_equal(found, np.abs(drive[..., None] - np.array(uneven)).argmin(axis=-1))
