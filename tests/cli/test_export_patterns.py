"""`holoview export --png` and `--bmp`: the manifest says what each file is, and the test pattern stands beside them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from holoview.bench.captures.gratings import signal_pattern
from holoview.holograms.hologram import Hologram
from holoview.holograms.view import random_drive
from holoview.light.model import preset
from tests.cli.conftest import Outcome

Holoview = Callable[..., Outcome]


def hologram(**changes: Any) -> Hologram:
    system = preset.load("simultaneous").with_(shape=[24, 32], **changes)
    made = Hologram(random_drive(system, 1), system)
    made.save("h.safetensors")
    return made


@pytest.mark.parametrize(("form", "bits"), [("png", 8), ("png", 16), ("bmp", 8)])
def test_the_manifest_leads_from_every_grey_level_to_its_path_and_moment(
    holoview: Holoview, form: str, bits: int
) -> None:
    made = hologram(frames=2)
    outcome = holoview("export", "h.safetensors", f"--{form}", "out", "--bits", bits)
    assert outcome.code == 0, outcome.err
    table = json.loads(Path("out/patterns.json").read_text(encoding="utf-8"))
    assert (table["format"], table["version"], table["pixel"]) == ("holoview-patterns", 1, "path")
    assert table["wavelengths_m"] == made.system.wavelengths_m.tolist()
    assert [(frame["begins"], frame["ends"]) for frame in table["frames"]] == [(0.0, 0.5), (0.5, 1.0)]
    for number, frame in enumerate(table["frames"]):
        assert frame["powers"] == made.system.amplitudes[number].tolist()
        for file in frame["files"]:
            path = Path("out") / file["file"]
            assert hashlib.sha256(path.read_bytes()).hexdigest() == file["sha256"]
            pixels = np.asarray(Image.open(path)).astype(np.float64)
            assert pixels.shape == (file["rows"], file["columns"]) == (24, 32)
            slm = table["modulators"][file["modulator"] - 1]
            paths_m = np.interp(pixels, slm["grey"], slm["path_m"])
            wanted_m = made.drive[number, file["modulator"] - 1] * made.system.modulators[0].stroke_m
            # half a grey level of the stroke, and f32's rounding of the drive
            assert np.abs(paths_m - wanted_m).max() <= (0.5 / (2**bits - 1) + 2**-23) * slm["stroke_m"]
    test = Path("out") / table["test_pattern"]["file"]
    assert np.array_equal(np.asarray(Image.open(test)), signal_pattern((24, 32), bits))
    assert outcome.out.split() == [
        *(str(Path("out") / file["file"]) for frame in table["frames"] for file in frame["files"]),
        str(test),
        str(Path("out/patterns.json")),
    ]


def test_level_numbers_lead_to_the_paths_of_levels(holoview: Holoview) -> None:
    made = hologram(levels=4)
    assert holoview("export", "h.safetensors", "--bmp", "out", "--levels").code == 0
    table = json.loads(Path("out/patterns.json").read_text(encoding="utf-8"))
    slm = table["modulators"][0]
    assert table["pixel"] == "level number" and slm["grey"] == [0, 1, 2, 3] and table["test_pattern"] is None
    pixels = np.asarray(Image.open("out/slm1.bmp"))
    stroke_m = made.system.modulators[0].stroke_m
    error_m = np.abs(np.asarray(slm["path_m"])[pixels] - made.drive[0, 0] * stroke_m)
    assert error_m.max() <= stroke_m / 6 * (1 + 2**-20)  # half of a third of the stroke


def test_a_bmp_has_8_bits(holoview: Holoview) -> None:
    hologram()
    refused = holoview("export", "h.safetensors", "--bmp", "out", "--bits", 16)
    assert refused.code == 2 and "--bits 16: with --bmp, which has 8" in refused.err and not Path("out").exists()
