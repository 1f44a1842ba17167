"""`holoview focus` finds distances of fields and recordings, and refuses what it can't search in one line."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter

from holoview.commands.cli import main
from holoview.holograms.fields.propagation import propagate_field
from holoview.holograms.fields.reading import ReadRequest
from holoview.holograms.fields.wavefield import Wavefield
from holoview.holograms.load_field import open_hologram

SIDE, PITCH_M, WAVELENGTH = 200, 4e-6, 633e-9
KNOWN = ["--pitch", "4um", "--wavelength", "633nm"]


def _object_wave() -> np.ndarray:
    """Dark bars in bright light, 8 mm before the camera."""
    screen = np.ones((SIDE, SIDE), np.complex64)
    screen[60:140, 60:140] -= 0.8 * (np.arange(80) // 8 % 2)[None] * (np.arange(80) // 20 % 2)[:, None]
    field = Wavefield(screen[None, None], (PITCH_M, PITCH_M), np.array([WAVELENGTH]))
    return propagate_field(field, 0.008, "asm").values[0, 0].numpy()


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Path]:
    wave = _object_wave()
    y, x = np.mgrid[:SIDE, :SIDE]
    fringes = np.abs(wave + 3 * np.exp(2j * math.pi * (0.17 * x - 0.13 * y))) ** 2
    np.save(tmp_path / "field.npy", wave)
    Image.fromarray((fringes / fringes.max() * 255).astype(np.uint8)).save(tmp_path / "fringes.png")
    return {name: tmp_path / name for name in ("field.npy", "fringes.png")}


# The depth of focus of all directions that the samples hold is λ/(λ/2dx)² = 0.1 mm; of those that the filter of an
# off-axis recording lets pass, half the carrier of 0.214 cycles a sample, (dx/0.107)²/λ = 2.2 mm, of which half is
# allowed.
@pytest.mark.parametrize("name", ["field.npy", "fringes.png"])
def test_the_distance_is_printed_as_json_with_its_curves(files, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    kind = ["--recording", "off-axis"] if name == "fringes.png" else []
    assert main(["focus", str(files[name]), *KNOWN, *kind, "--range", "2,20mm", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    side = (
        1 if name == "fringes.png" else -1
    )  # the order with f_x > 0 holds O*·R: the conjugate, sharp on the other side
    assert found["distance_m"] == pytest.approx(side * 8e-3, abs=1.1e-3 if kind else 2e-4)
    assert len(found["curves"][0]["distance_m"]) == len(found["curves"][0]["edge_sparsity"])
    assert set(found["measures"]) == {"edge_sparsity", "normalised_variance"}


def test_without_json_it_is_a_sentence_and_bars(files, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["focus", str(files["field.npy"]), *KNOWN, "--range=-20,-2mm"]) == 0
    seen = capsys.readouterr()
    assert "sharpest at -8" in seen.out.splitlines()[0]
    assert "#" in seen.out
    assert "--plane -8" in seen.err


def test_where_nothing_is_sharp_no_distance_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Photons alone, in an in-line recording."""
    counts = np.random.default_rng(4).poisson(100, (SIDE, SIDE)).astype(np.uint8)
    Image.fromarray(counts).save(tmp_path / "noise.png")
    line = ["focus", str(tmp_path / "noise.png"), *KNOWN, "--recording", "in-line", "--range", "1,4mm"]
    assert main(line) == 0
    seen = capsys.readouterr()
    assert seen.out.splitlines()[0] == "no clear focus between 1 mm and 4 mm on either side"
    assert "--plane" not in seen.err
    assert main([*line, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["focus"] == {"clear": False, "range_m": [0.001, 0.004], "objects": [], "unclear": []}
    assert found["distance_m"] is None


@pytest.mark.long
def test_the_object_of_an_in_line_recording_is_told_with_its_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Dark bars 8 mm before the camera, around its middle; from N·pitch²/λ = 5 mm on all fringes are sampled."""
    intensity = np.abs(_object_wave()) ** 2
    Image.fromarray((intensity / intensity.max() * 255).astype(np.uint8)).save(tmp_path / "bars.png")
    line = ["focus", str(tmp_path / "bars.png"), *KNOWN, "--recording", "in-line", "--range", "4,16mm"]
    assert main(line) == 0
    seen = capsys.readouterr()
    assert "around x" in seen.out.splitlines()[0]
    assert "undersampled" not in seen.err
    assert main([*line, "--json"]) == 0
    focus = json.loads(capsys.readouterr().out)["focus"]
    first = focus["objects"][0]
    assert focus["clear"]
    depth_m = 633e-9 / (SIDE * PITCH_M / (2 * 8e-3)) ** 2  # the side of the camera limits the aperture: 0.25 mm
    assert abs(first["distance_m"] - 8e-3) < depth_m
    assert np.hypot(*first["centre_m"]) < 80 * PITCH_M


@pytest.mark.long
def test_much_structure_without_a_focus_is_said_with_its_share(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The beam has a pattern of its own beside nine dark spots; without it nothing is said."""
    screen = np.ones((2 * SIDE, 2 * SIDE))  # of endless light; the camera sees the middle
    for row, column in np.ndindex(3, 3):
        y, x = 143 + 50 * row + 7 * column, 148 + 47 * column - 5 * row  # no two at the same height
        screen[y : y + 5, x : x + 5] = 0
    f = np.fft.fftfreq(2 * SIDE, PITCH_M)
    transfer = np.exp(2j * np.pi * 0.008 * np.sqrt(WAVELENGTH**-2 - f[:, None] ** 2 - f[None, :] ** 2))
    middle = slice(SIDE // 2, 3 * SIDE // 2)
    intensity = np.abs(np.fft.ifft2(np.fft.fft2(screen) * transfer)[middle, middle]) ** 2
    pattern = gaussian_filter(np.random.default_rng(5).normal(size=intensity.shape), 2.0)
    pattern *= intensity.std() / pattern.std()
    for extra in (0 * pattern, pattern):
        counts = np.clip(100 * (intensity + extra), 0, 255).astype(np.uint8)
        Image.fromarray(counts).save(tmp_path / "spots.png")
        line = ["focus", str(tmp_path / "spots.png"), *KNOWN, "--recording", "in-line", "--range", "4,16mm"]
        assert main(line) == 0
        text = capsys.readouterr().out
        assert main([*line, "--json"]) == 0
        focus = json.loads(capsys.readouterr().out)["focus"]
        share = f"{focus['unexplained']:.0%} of the structure is in focus at"
        assert (share in text) == ("aren't told apart" in text) == (extra is pattern)


def test_a_recording_is_opened_as_its_field(files) -> None:
    request = ReadRequest(pitch_m=(PITCH_M, PITCH_M), wavelengths_m=(WAVELENGTH,), recording="off-axis")
    opened = open_hologram([files["fringes.png"]], request)
    assert opened.hologram.system.is_field
    assert any("order at 0.17" in note for note in opened.notes)


@pytest.mark.parametrize("text", ["3mm", "5,3mm", "near,far", "1,2,3mm"])
def test_an_impossible_range_is_one_line(files, text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["focus", str(files["field.npy"]), *KNOWN, "--range", text]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
