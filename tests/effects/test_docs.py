"""What docs/effects.md shows works as it stands there, and it names every effect."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import torch

from holoview.light.model.effects.effect import BENCH_HOOKS, CAMERA_HOOKS, MODULATOR_HOOKS
from holoview.light.model.effects.hook_contexts import CameraContext
from holoview.light.model.effects.registry import element_effects, listed_effects, load_user_effects
from holoview.light.model.preset import loads
from holoview.light.optics.torch_effects import TorchEffects

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "effects.md").read_text(encoding="utf-8")


def _blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", TEXT, re.DOTALL)


@pytest.mark.usefixtures("no_user_effects")
def test_the_complete_example_is_complete(tmp_path: Path) -> None:
    (tmp_path / "haze.py").write_text(_blocks("python")[0], encoding="utf-8")
    (haze,) = load_user_effects(tmp_path / "haze.py")
    image = torch.tensor([[0.0, 4.0]])
    found = TorchEffects({"haze": {"share": 0.2}}).image(image, CameraContext(4e-6, (1, 2)))
    assert found.tolist()[0] == pytest.approx([0.4, 3.6])
    assert haze.finding.format(share="0.2") == "A share 0.2 of the light is scattered over the whole picture."
    assert len(list(haze.parameters[0].scan_values())) == 8


def test_the_preset_can_be_read() -> None:

    base = 'wavelengths = ["520 nm"]\namplitudes = [[1]]\ngap = "1 mm"\n' + (
        '[[modulators]]\npitch = "8 um"\nshape = [4, 4]\nstroke = "800 nm"\n' * 2
    )
    effects = _blocks("toml")[0].split("\n", 1)[1]
    assert loads(base + effects).effect_values == {"gap": {"gap_error": 1e-4}, "crosstalk": {"sigma": 0.4}}


def test_every_effect_and_hook_is_named() -> None:
    missing = [name for name in (*listed_effects(), *element_effects()) if f"`{name}`" not in TEXT]
    assert not missing
    assert all(f"`{hook}(" in TEXT for hook in (*BENCH_HOOKS, *MODULATOR_HOOKS, "pupil", *CAMERA_HOOKS))
