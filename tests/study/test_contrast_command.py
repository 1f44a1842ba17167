"""`holoview contrast` on pictures whose contrast is known; `holoview study` as people mistype it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image

from holoview.commands import cli
from holoview.evidence.study.studies import studies_by_name
from holoview.holograms.hologram import Hologram
from holoview.holograms.view import random_drive
from holoview.light.model import preset

SIDE = 256
SIGMAS = 5.0


def _speckle(patterns: int, seed: int = 0) -> NDArray[np.float64]:
    """The mean of independent, fully developed patterns of mean 1: a gamma law of that shape."""
    return np.random.default_rng(seed).exponential(size=(patterns, SIDE, SIDE)).mean(axis=0)


def _scatter(patterns: int) -> float:
    """Standard deviation of the contrast measured in n independent samples of a gamma law of shape N.

    Var C ≈ (κ − 1 + 4C² − 4γC)·C²/4n with skewness γ = 2/√N, kurtosis κ = 3 + 6/N and C = 1/√N, which is
    C²·(2 + 2/N)/4n.
    """
    return float(np.sqrt((2 + 2 / patterns) / (4 * patterns * SIDE**2)))


def _tiff(path: Path, values: NDArray[np.float64]) -> Path:
    tifffile.imwrite(path, values.astype(np.float32))
    return path


def _measured(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, object]:
    assert cli.main(["contrast", *arguments, "--json"]) == 0
    return dict(json.loads(capsys.readouterr().out))


def _whole() -> tuple[str, str]:
    return "--region", f"0,0,{SIDE},{SIDE}"


Refused = Callable[..., str]


@pytest.fixture
def refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Refused:
    """Gives the program arguments that it refuses, in a folder of the test, and returns what it says."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> str:
        assert cli.main(list(arguments)) == 2
        return capsys.readouterr().err

    return run


@pytest.mark.parametrize("patterns", [1, 2, 8])
def test_n_patterns_have_contrast_one_over_root_n(
    patterns: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = _measured(capsys, str(_tiff(tmp_path / "a.tiff", _speckle(patterns))), *_whole())
    assert found["contrast"] == pytest.approx(patterns**-0.5, abs=SIGMAS * _scatter(patterns))
    assert found["independent_patterns"] == pytest.approx(patterns, rel=2 * SIGMAS * _scatter(patterns) * patterns**0.5)
    assert found["pixels"] == SIDE**2
    assert found["mean"] == pytest.approx(1, abs=SIGMAS / SIDE)


def test_a_png_holds_a_signal_unless_it_is_said_to_hold_intensity(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """16 bits, the brightest 1e-4 of an exponential law cut off at 9.2 means, which lowers the contrast by 0.2 %."""
    linear = np.clip(_speckle(1) / -np.log(1e-4), 0, 1)
    signal = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    for name, values, options in (("linear", linear, ("--linear",)), ("signal", signal, ())):
        Image.fromarray(np.round(values * 65535).astype(np.uint16)).save(tmp_path / f"{name}.png")
        found = _measured(capsys, str(tmp_path / f"{name}.png"), *_whole(), *options)
        assert found["contrast"] == pytest.approx(1, abs=SIGMAS * _scatter(1) + 0.003)
        assert 0 < float(str(found["clipped"])) < 3e-4
        assert ("which was decoded" in str(found["notes"])) == (not options)


def test_saturation_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    values = np.clip(np.round(_speckle(1) * 100), 0, 255).astype(np.uint8)
    Image.fromarray(values).save(tmp_path / "a.png")
    assert cli.main(["contrast", str(tmp_path / "a.png"), "--linear"]) == 0
    share = np.mean(values == 255)
    assert f"{share:.2%} of the picture is saturated: its contrast comes out too low" in capsys.readouterr().out


def test_a_flat_picture_has_no_speckle(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Image.fromarray(np.full((16, 16, 3), 128, np.uint8)).save(tmp_path / "flat.png")
    plot = tmp_path / "plot.png"
    assert cli.main(["contrast", str(tmp_path / "flat.png"), "--plot", str(plot)]) == 0
    assert "speckle contrast 0.0000 (no speckle at all)" in capsys.readouterr().out
    with Image.open(plot) as drawn:
        assert drawn.size == (960, 600)


def test_a_preset_s_random_speckle(capsys: pytest.CaptureFixture[str]) -> None:
    changes = ("--set", "shape=[48,64]", "--set", "propagation=periodic", "--set", "wavelengths=550 nm")
    found = _measured(capsys, "simultaneous", *changes, "--set", "amplitudes=white", "--plane", "10 mm")
    assert 0.7 < float(str(found["contrast"])) < 1.3
    assert "random patterns of seed 0" in str(found["what"])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["missing.png"], "missing.png"),
        (["bad.png"], "bad.png"),
        (["a.tiff", "--region", "0,0,10"], '--region: "0,0,10"; expected x,y,width,height'),
        (["a.tiff", "--region", "250,0,10,10"], "inside the image of 256 × 256 pixels"),
        (["a.tiff", "--plane", "1 mm"], "with a picture"),
        (["a.tiff", "--plot", "a.jpg"], ".png"),
        (["dark.png"], "larger or brighter region"),
        (["no-such-preset"], "no-such-preset"),
    ],
)
def test_mistakes_are_named(arguments: list[str], said: str, tmp_path: Path, refused: Refused) -> None:
    _tiff(tmp_path / "a.tiff", _speckle(1))
    (tmp_path / "bad.png").write_bytes(b"no picture")
    Image.fromarray(np.zeros((16, 16), np.uint8)).save(tmp_path / "dark.png")
    err = refused("contrast", *arguments)
    assert said in err
    assert err.count("\n") == 1


def test_the_list_of_studies(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["study", "--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == sorted(studies_by_name())


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "which one?"),
        (["shemes"], 'study "shemes": unknown'),
        (["schemes", "--workers", "x"], "--workers: 'x'; expected a whole number of at least 1"),
        (["schemes", "--workers", "0"], "--workers: '0'"),
        (["schemes", "--workers", "2", "--scheduler", "tcp://a:1"], "contradict each other"),
        (["schemes", "--quick", "--full"], "not allowed with"),
    ],
)
def test_mistakes_in_study_are_named(arguments: list[str], said: str, tmp_path: Path, refused: Refused) -> None:
    assert said in refused("study", *arguments)
    assert not list(tmp_path.iterdir())


# --- on the retina --------------------------------------------------------------------------------------------------

EYE = ("holochrome-8", "--set", "shape=[16, 24]", "--set", "eye={}")


def test_contrast_by_pupil_is_a_table_whose_rows_are_those_of_each_pupil(capsys: pytest.CaptureFixture[str]) -> None:
    found: Any = _measured(capsys, *EYE, "--pupils", "4,2.5mm")
    assert [row["pupil_mm"] for row in found["pupils"]] == [2.5, 4.0]
    for row in found["pupils"]:
        alone = _measured(capsys, *EYE, "--set", f'eye.pupil="{row["pupil_mm"]} mm"')
        assert alone["contrast"] == pytest.approx(row["contrast"], rel=1e-5)
    assert found["independent_contrast"] == pytest.approx(0.4059, abs=1e-4)
    assert cli.main(["contrast", *EYE, "--pupils", "3mm"]) == 0
    assert "independent patterns" in capsys.readouterr().out


def test_contrast_by_pupil_is_drawn_and_a_hologram_may_get_an_eye(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    system = preset.load("holochrome-8").edit({"shape": [16, 24]})
    Hologram(random_drive(system), system).save(tmp_path / "a.safetensors")
    plot = tmp_path / "plot.png"
    arguments = (str(tmp_path / "a.safetensors"), "--set", "eye={}", "--plane", "1D", "--pupils", "3mm")
    found: Any = _measured(capsys, *arguments, "--plot", str(plot))
    assert "10.6 mm (1 D), on the retina" in found["what"]
    assert np.asarray(Image.open(plot)).std() > 5


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("holochrome-8", "--pupils", "2,3mm"), "there is no eye"),
        ((*EYE, "--pupils", "2,3"), "has no unit"),
        ((*EYE, "--pupils", ""), "not a length"),
        ((*EYE, "--pupils", "wide"), "not a length"),
        ((*EYE, "--pupils", "0,3mm"), "0 mm is out of range"),
        ((*EYE, "--pupils", "3kg"), 'has the unit "kg"'),
        (("picture.png", "--pupils", "3mm"), "with a picture"),
    ],
)
def test_wrong_pupils_are_refused(refused: Refused, arguments: tuple[str, ...], complaint: str) -> None:
    Image.new("L", (16, 16)).save("picture.png")
    assert complaint in refused("contrast", *arguments)


@pytest.mark.parametrize("layout", ["plain", "left-justified", "float"])
def test_a_camera_of_12_bits_in_16_is_told_to_be_saturated(
    layout: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Speckle of the mean 2000 counts, of which e^(−4095/2000) = 12.9 % exceed 12 bits."""
    counts = np.clip(_speckle(1) * 2000, 0, 4095).astype(np.uint16)
    stored = {"plain": counts, "left-justified": counts << np.uint16(4), "float": counts / np.float32(4095)}[layout]
    tifffile.imwrite(tmp_path / "a.tiff", stored)
    found = _measured(capsys, str(tmp_path / "a.tiff"), *_whole(), "--linear")
    assert found["clipped"] == pytest.approx(np.mean(counts == 4095), rel=1e-9)
    assert cli.main(["contrast", str(tmp_path / "a.tiff"), "--linear"]) == 0
    said = capsys.readouterr().out
    assert f"its contrast comes out too low (clipped at {stored.max():g})" in said
    assert found["mean"] == pytest.approx(counts.mean() / 4095, rel=1e-6)


def test_a_clip_at_any_count_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    counts = np.clip(_speckle(1) * 1000, 0, 2777).astype(np.uint16)
    Image.fromarray(counts).save(tmp_path / "a.png")
    found = _measured(capsys, str(tmp_path / "a.png"), *_whole(), "--linear")
    assert found["clipped"] == pytest.approx(np.mean(counts == 2777))
    assert found["clipped_at"] == "2777"
