"""Benches with effects: the shaders agree with torch in complex128, whichever input of the frame an effect changes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from holoview.holograms.view import random_drive
from holoview.light.engine.frame import compute_focal_stack
from holoview.light.engine.incremental import IncrementalRenderer
from holoview.light.engine.torch_executor import TorchExecutor
from holoview.light.model.plan import make_plan
from holoview.light.optics.frame_inputs import FrameInputs
from tests.explored import explored

pytestmark = pytest.mark.gpu

Opened = Callable[..., Any]

TOLERANCE = 2e-6
"""Relative L2 of the intensities, as for whole frames without effects."""

EFFECTS: dict[str, dict[str, dict[str, Any]]] = {
    "modulators": {"crosstalk": {"sigma": 0.5}, "undiffracted": {"share": 0.2}, "dispersion": {"slope": 0.2}},
    "modulator 2": {"slm_alignment": {"shift_y": 3e-6, "rotation": 0.01, "magnification": 0.02}},
    "source": {"source_profile": {"fall": 0.5, "slope_x": 0.2}, "tilt": {"tilt_y": 2e-3}},
    "look-up table": {"lut": {"gamma1": 1.3, "level2_05": 0.1}, "stroke": {"stroke_error": -0.1}},
    "stroke over area and wavelength": {"stroke_map": {"z2_1": 0.1, "z4_2": 0.1}, "lut_dispersion": {"slope1": 0.4}},
    "distances": {"gap": {"gap_error": 1e-4}, "distance": {"distance_error": -2e-4}},
    "relays": {"aberration1": {"z5": 1e-7}, "aberration2": {"z7": 1e-7}, "iris1": {"decentre_y": 0.2}},
    "incoherent": {"bandwidth": {"sigma": 1e-9}, "flicker": {"depth": 0.1}, "crosstalk": {"sigma": 0.3}},
    "cover glasses": {"slm1_fringes": {"path_y": 2e-6, "cos1": 0.1}, "slm2_fringes": {"path_x": -3e-6, "sin1": 0.2}},
    "dead lines and pixels": {
        "slm1_stuck": {"columns": [2, 9], "column_levels": [0.3, 0.8], "pixel_rows": [1], "pixel_columns": [4]},
        "slm2_stuck": {"rows": [3, 4], "row_levels": [0.6]},
    },
    "two lines, two polarisations": {
        "second_line": {"share": 0.4, "offset": 3e-9},
        "polarisation": {"share": 0.2},
    },
    "several frames that don't settle": {"settling": {"share1": 0.3, "share2": 0.1}, "lut": {"gamma2": 1.2}},
    "several frames": {"flicker": {"depth": 0.1}, "lut": {"gamma1": 1.2}},
}


@pytest.mark.parametrize("name", explored(EFFECTS, 4))
def test_a_frame_with_effects_is_that_of_torch(name: str, both: Opened, bench: Opened) -> None:
    frames = {"frames": 2} if name.startswith("several frames") else {}
    system = bench(**{"relay1.iris_na": 0.03, "relay2.iris_na": 0.03}, effects=EFFECTS[name], **frames)
    pair = both(system)
    (expected, expected_xyz), (found, xyz) = compute_focal_stack(pair.reference), compute_focal_stack(pair.shaders)
    assert found.shape == expected.shape
    for of_torch, of_shaders in ((expected, found), (expected_xyz, xyz)):
        assert np.linalg.norm(of_shaders - of_torch) <= TOLERANCE * np.linalg.norm(of_torch)
    plain = compute_focal_stack(both(bench(**{"relay1.iris_na": 0.03, "relay2.iris_na": 0.03}, **frames)).reference)[1]
    assert np.linalg.norm(expected_xyz - plain) > 0.02 * np.linalg.norm(plain)


@pytest.mark.long
def test_a_renderer_continues_when_effects_are_edited(bench: Opened, device: Any) -> None:
    """Effects are switched on, changed and switched off; XYZ is that of torch, and `system` is the nominal bench."""
    plain = bench(**{"relay1.iris_na": 0.03, "relay2.iris_na": 0.03})
    drive = random_drive(plain, 1)
    renderer = IncrementalRenderer(plain, drive, device, plane_m=3e-3, strategy="passes")
    for effects in ({}, *EFFECTS.values(), EFFECTS["modulators"], {"crosstalk": {"sigma": 0.8}}, {}):
        system = plain.edit({"effects": effects})
        renderer.edit(system=system)
        assert renderer.system == system
        renderer.update()
        plan = make_plan(system, [3e-3])
        expected = compute_focal_stack(TorchExecutor(plan, FrameInputs(plan, drive), double=True))[1][0]
        found = renderer.xyz()
        assert np.linalg.norm(found - expected) <= TOLERANCE * np.linalg.norm(expected), effects
