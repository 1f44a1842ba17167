"""`holoview diagnose --known`: what is known stays beside what is found."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from holoview.bench.captures import write_captures
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.light.model import preset
from tests.diagnose.conftest import small_system

Run = Callable[..., Any]
GAP_ERROR_M = 1.08e-4


@pytest.mark.long
def test_a_preset_keeps_what_is_known_beside_what_is_found(holoview: Run, tmp_path: Path) -> None:
    settings = AcquisitionSettings(captures_per_condition=6, seed=3)
    write_captures(tmp_path / "c.h5", make_captures(small_system(), {"gap": {"gap_error": GAP_ERROR_M}}, settings))
    outcome = holoview(
        "diagnose", "c.h5", "--known", f"gap.gap_error={GAP_ERROR_M}", "--workers", 1, "--save-preset", "p.toml"
    )
    assert outcome.code == 0 and ": consistent" in outcome.out, outcome.err
    assert preset.load(str(tmp_path / "p.toml")).effect_values == {"gap": {"gap_error": GAP_ERROR_M}}
