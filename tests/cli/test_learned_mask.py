"""`holoview optimise --learn`: a mask for a folder of pictures, and what is refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import holoview as hv
from holoview.light.model import preset
from tests.cli.conftest import Outcome
from tests.optimise.test_learned_mask import shared_mask


def test_the_command_writes_a_mask_that_a_preset_takes(holoview: Callable[..., Outcome], tmp_path: Path) -> None:
    bench, pictures = tmp_path / "bench.toml", tmp_path / "pictures"
    bench.write_text(preset.dumps(shared_mask()), encoding="utf-8")
    pictures.mkdir()
    for number in range(2):
        Image.new("RGB", (40, 32), (60 * number + 40, 120, 90)).save(pictures / f"{number}.png")
    mask = tmp_path / "mask.npy"
    options = ["--learn", "mask", "--iterations", "2", "-o", str(mask), "--json"]
    done = holoview("optimise", str(bench), str(pictures), *options)
    assert done.code == 0, done.err
    assert json.loads(done.out)["pictures"] == 2
    assert "fewer than 24" in done.err
    values = np.load(mask, allow_pickle=False)
    elements = bench.read_text(encoding="utf-8")
    before, _, after = elements.rpartition('kind = "phase"')
    held = after.replace("shared = true\nheld = false\n", f'file = "{mask}"\n')
    held_bench = tmp_path / "held.toml"
    held_bench.write_text(f'{before}kind = "mask"{held}', encoding="utf-8")
    system = hv.load(str(held_bench))
    assert list(system.drive_shapes) == ["slm"]
    drive = hv.random_drive(system, seed=1)
    own, shown = hv.simulate(system, drive), hv.simulate(shared_mask(), {**drive, "mask": values})
    np.testing.assert_allclose(own.xyz, shown.xyz, rtol=1e-5, atol=1e-6 * float(shown.xyz.max()))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--learn", "mask"], "-o: is missing"),
        (["--learn", "mask", "-o", "m.png"], "expected .npy"),
        (["--learn", "mask", "-o", "m.npy", "--film"], "--film: with --learn mask"),
        (["--learn", "mask", "-o", "m.npy"], "isn't a folder"),
    ],
)
def test_options_that_dont_fit_are_sentences(
    options: list[str], words: str, holoview: Callable[..., Outcome], tmp_path: Path
) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(preset.dumps(shared_mask()), encoding="utf-8")
    Image.new("RGB", (40, 32)).save(tmp_path / "p.png")
    done = holoview("optimise", str(bench), str(tmp_path / "p.png"), *options)
    assert done.code != 0
    assert words in done.err and done.err.count("\n") == 1
