"""Photographs of speckle as a camera writes them, whose contrast is known: black, noise, saturation, encoding."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image

from holoview.commands import cli
from holoview.holograms.metrics.photograph import censored_estimate
from holoview.holograms.metrics.speckle import speckle_pattern
from holoview.light.colour import observer_weights, srgb_encode
from holoview.util.errors import UserError

SIDE, GAIN, READ, BLACK = 200, 4.0, 8.0, 64.0
Floats = NDArray[np.float64]
WHOLE = ("--region", f"0,0,{SIDE},{SIDE}")


def _light(patterns: int, grain: int = 5, seed: int = 0) -> Floats:
    """The mean of independent patterns of mean 1 with grains of some samples: contrast 1/√N, about."""
    rng = np.random.default_rng(seed)
    f = np.fft.fftfreq(SIDE)
    pupil = np.hypot(f[:, None], f[None, :]) < 0.5 / grain
    total = np.zeros((SIDE, SIDE))
    for _ in range(patterns):
        noise = rng.normal(size=(2, SIDE, SIDE))
        intensity = np.abs(np.fft.ifft2(np.fft.fft2(noise[0] + 1j * noise[1]) * pupil)) ** 2
        total += intensity / intensity.mean()
    return total / patterns


def _counts(light: Floats, mean: float, seed: int = 0) -> NDArray[np.uint16]:
    """What a camera of 12 bits counts of light with this mean."""
    rng = np.random.default_rng(100 + seed)
    electrons = rng.poisson(mean * light * GAIN) + READ * rng.standard_normal(light.shape)
    return np.clip(np.rint(electrons / GAIN + BLACK), 0, 4095).astype(np.uint16)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    tifffile.imwrite("dark.tiff", _counts(np.zeros((SIDE, SIDE)), 0.0, 9))
    return tmp_path


def _measured(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert cli.main(["contrast", *arguments, "--json"]) == 0, capsys.readouterr().err
    return dict(json.loads(capsys.readouterr().out))


def _refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert cli.main(["contrast", *arguments]) == 2
    err = capsys.readouterr().err
    assert sum(not line.startswith("note: ") for line in err.splitlines()) == 1
    return err


def _contrast(values: Floats) -> float:
    return float(values.std() / values.mean())


def _scatter(mean: float, contrast: float) -> float:
    """Deviation of a contrast by noise that was taken off; see test_grains."""
    share = (mean / GAIN + (READ / GAIN) ** 2 + 1 / 12) / mean**2
    c2 = contrast**2
    return float(np.sqrt(2 * share**2 + 4 * share * c2 * (1 + 2 * c2) + 4 * c2**2 * share) / SIDE / (2 * contrast))


@pytest.mark.parametrize(
    "how", [("--gain", "4"), ("--gain", "4", "--read-noise", "8"), ()], ids=["gain", "both", "none"]
)
def test_black_and_noise_are_taken_off(folder: Path, capsys: pytest.CaptureFixture[str], how: tuple[str, ...]) -> None:
    """At 40 counts of light noise lifts C from 0.5 to 0.53; an estimate of the gain adds its own error."""
    light = _light(4)
    tifffile.imwrite("photo.tiff", _counts(light, 40.0))
    found = _measured(capsys, "photo.tiff", "--dark", "dark.tiff", *how, *WHOLE)
    tolerance = 5 * _scatter(40.0, _contrast(light))
    if not how:
        assert any("electrons a count" in note for note in found["notes"])
        tolerance += 5 * 0.3 * 0.036 / (2 * 0.5)  # a gain that is told is known to 30 %, of a share of 3.6 %
    assert found["contrast"] == pytest.approx(_contrast(light), abs=tolerance)
    assert found["mean"] == pytest.approx(40.0, abs=0.5)


def test_the_gain_is_found_from_a_second_picture(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    light = _light(4)
    tifffile.imwrite("photo.tiff", _counts(light, 200.0))
    tifffile.imwrite("again.tiff", _counts(light, 200.0, 1))
    found = _measured(capsys, "photo.tiff", "--dark", "dark.tiff", "--repeat", "again.tiff", *WHOLE)
    note = next(note for note in found["notes"] if "electrons a count" in note)
    assert float(note.split()[0]) == pytest.approx(GAIN, rel=0.15)


@pytest.mark.long
def test_several_dark_pictures_tell_each_pixel(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A fixed pattern of black levels of 10 counts would add (10/40)² to C²; 8 dark pictures take it off."""
    pattern = np.random.default_rng(3).normal(0, 10, (SIDE, SIDE))
    light = _light(4)
    tifffile.imwrite("photo.tiff", np.rint(_counts(light, 40.0) + pattern).clip(0).astype(np.uint16))
    names = []
    for number in range(8):
        dark = np.rint(_counts(np.zeros((SIDE, SIDE)), 0.0, 20 + number) + pattern)
        names.append(f"dark-{number}.tiff")
        tifffile.imwrite(names[-1], dark.clip(0).astype(np.uint16))
    found = _measured(capsys, "photo.tiff", "--dark", *names, "--gain", "4", *WHOLE)
    assert found["contrast"] == pytest.approx(_contrast(light), abs=6 * _scatter(40.0, 0.5))


@pytest.mark.long
def test_saturation_is_refused_and_undone_on_request(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One laser clipped at twice its mean: 0.77 as it is, 1 by the law that fits the rest."""
    light = _light(1, grain=3)
    tifffile.imwrite("photo.tiff", _counts(light, 2015.0))  # full scale is 2 means above black
    arguments = ("photo.tiff", "--dark", "dark.tiff", "--gain", "4", *WHOLE)
    assert "of the region is saturated" in _refused(capsys, *arguments)
    kept = _measured(capsys, *arguments, "--saturation", "keep")
    undone = _measured(capsys, *arguments, "--saturation", "undo")
    known = np.sqrt(1 - 4 * np.exp(-2) - np.exp(-4)) / (1 - np.exp(-2))  # of a clipped exponential law
    assert kept["contrast"] == pytest.approx(known, abs=5 * kept["standard_error"])
    assert undone["contrast"] == pytest.approx(1.0, abs=5 * undone["standard_error"])
    assert 0 < undone["standard_error"] < 0.06
    assert cli.main(["contrast", *arguments, "--saturation", "undo"]) == 0
    said = capsys.readouterr().out
    assert "of the picture is saturated (clipped at" in said and "too low" not in said


@pytest.mark.parametrize("patterns", [1, 3])
def test_clipped_gamma_laws_are_found_again(patterns: int) -> None:
    drawn = np.random.default_rng(patterns).gamma(patterns, 1 / patterns, (200, 200))
    found = censored_estimate(speckle_pattern(np.minimum(drawn, 1.5)), 1.5)
    assert found.contrast == pytest.approx(patterns**-0.5, abs=5 * found.standard_error)
    assert found.standard_error < 0.01


def test_an_encoded_picture_is_refused_or_undone(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """8 bits of a curve of 8 bits: steps of up to 1/100 of the mean add 1e-5 to C²."""
    light = np.clip(_light(4) / 4, 0, 1)
    Image.fromarray(np.rint(255 * srgb_encode(light)).astype(np.uint8)).save("photo.png")
    assert "likely encoded" in _refused(capsys, "photo.png", "--black", "0", *WHOLE)
    found = _measured(capsys, "photo.png", "--black", "0", "--encoded", *WHOLE)
    assert found["contrast"] == pytest.approx(_contrast(light), abs=0.002)
    raw = _measured(capsys, "photo.png", "--black", "0", "--linear", "--gain", "1000", *WHOLE)
    assert raw["contrast"] < 0.4
    assert "with --encoded" in _refused(capsys, "photo.png", "--black", "0", "--encoded", "--gain", "4")


def test_jpeg_is_refused_unless_insisted_on(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Image.fromarray(np.rint(80 * _light(8).clip(0, 3)).astype(np.uint8)).save("photo.jpg", quality=95)
    for more in ((), ("--black", "0")):
        assert "blocks of 8 × 8 pixels" in _refused(capsys, "photo.jpg", *more)
    assert _measured(capsys, "photo.jpg", "--jpeg")["contrast"] > 0


@pytest.mark.long
def test_photographs_of_each_laser_and_of_all_together(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lights = [_light(1, seed=n) for n in range(3)]
    for name, light in zip("rgb", lights, strict=True):
        tifffile.imwrite(f"{name}.tiff", _counts(light, 250.0, ord(name)))
    tifffile.imwrite("all.tiff", _counts(sum(lights, np.zeros((SIDE, SIDE))), 250.0))
    arguments = ("r.tiff", "g.tiff", "b.tiff", "--dark", "dark.tiff", "--gain", "4", "--lasers", "638,532,450nm")
    found = _measured(capsys, *arguments, "--together", "all.tiff", *WHOLE)
    assert [laser["wavelength_nm"] for laser in found["lasers"]] == [638, 532, 450]
    for laser, light in zip(found["lasers"], lights, strict=True):
        assert laser["contrast"] == pytest.approx(_contrast(light), abs=5 * _scatter(250.0, 1.0))
    assert found["contrast"] == pytest.approx(
        _contrast(sum(lights, np.zeros((SIDE, SIDE)))), abs=5 * _scatter(750.0, 0.58)
    )
    assert found["colour_speckle"]["ellipse_95_area"] > 0 and set(found["groups"]) == {"red", "green", "blue"}
    apart = _measured(capsys, *arguments, *WHOLE)
    assert any("added pixel by pixel" in note for note in apart["notes"])


def test_a_photograph_in_colour_has_channels(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    light = np.stack([_light(1, seed=n) for n in range(3)], axis=-1)
    tifffile.imwrite("photo.tiff", (light * 300).astype(np.float32), photometric="rgb")
    found = _measured(capsys, "photo.tiff", "--black", "0", "--gain", "1000", *WHOLE)
    assert [laser["name"] for laser in found["lasers"]] == ["red", "green", "blue"]
    assert found["groups"]["green"]["contrast"] == pytest.approx(_contrast(light[..., 1]), abs=0.005)


def test_structure_of_a_target_is_taken_out_pixel_on_pixel(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    y, x = np.mgrid[:SIDE, :SIDE]
    target = 0.3 + 0.6 * (x // 20 % 2) * (y / SIDE)
    light = _light(4)
    tifffile.imwrite("target.tiff", np.repeat(target[..., None], 3, axis=-1).astype(np.float32), photometric="rgb")
    tifffile.imwrite("photo.tiff", _counts(light * target, 500.0))
    arguments = ("photo.tiff", "--dark", "dark.tiff", "--gain", "4", *WHOLE)
    found = _measured(capsys, *arguments, "--target", "target.tiff")
    assert found["structure_removed"] and found["raw_contrast"] > found["contrast"] + 0.05
    assert found["contrast"] == pytest.approx(_contrast(light), abs=3 * found["standard_error"])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["photo.tiff", "--gain", "4"], "a black level that nothing tells"),
        (["photo.tiff", "--dark", "small.tiff"], "a dark picture of 20 × 20 pixels; expected 200 × 200 pixels"),
        (["photo.tiff", "--dark", "missing.tiff"], "missing.tiff"),
        (["photo.tiff", "--dark", "dark.tiff", "--black", "64"], "--dark: with --black"),
        (["photo.tiff", "--black", "64", "--read-noise", "3"], "without --gain"),
        (["photo.tiff", "photo.tiff", "--black", "64"], "--lasers 638,532,450nm says which"),
        (["photo.tiff", "small.tiff", "--black", "64", "--lasers", "638,532nm"], "20 × 20 pixels"),
        (["photo.tiff", "--black", "64", "--lasers", "638,532nm"], "one for each"),
        (["photo.tiff", "--black", "64", "--together", "dark.tiff"], "without --lasers"),
        (["photo.tiff", "--black", "64", "--target", "small.tiff"], "pixel on pixel"),
        (["photo.tiff", "--black", "64", "--region", "0,0,1,1"], "two or more pixels"),
        (["black.tiff", "--dark", "black.tiff"], "larger or brighter region"),
        (["photo.tiff", "--black", "64", "--meter", "iec"], "a picture has its instrument"),
        (["holochrome-8", "--set", "shape=[16,16]", "--pixel", "4um"], "without --meter camera"),
        (["holochrome-8", "--set", "shape=[16,16]", "--meter", "camera"], "without --f-number and --pixel"),
        (["holochrome-8", "--depth", "photo.tiff"], "--depth: without --target"),
        (["photo.tiff", "--black", "64", "--scatter", "s.png"], "without colours"),
    ],
)
def test_mistakes_are_named(folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str) -> None:
    tifffile.imwrite("photo.tiff", _counts(_light(2), 300.0))
    tifffile.imwrite("small.tiff", np.full((20, 20), 70, np.uint16))
    tifffile.imwrite("black.tiff", np.full((SIDE, SIDE), 64, np.uint16))
    assert said in _refused(capsys, *arguments)


def test_the_camera_s_noise_is_taken_off_groups_and_of_lasers_added(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Drawn photographs of few electrons: three independent lasers, two of them red, gamma laws of known contrast.

    The red group's light has the luminance weights w: C² = Σ(w·m·C)²/(Σw·m)², and so has the sum of all.
    """
    rng, side, gain, read, black = np.random.default_rng(3), 192, 2.0, 6.0, 100.0
    lasers_nm, counts, contrasts = (638, 610, 532), np.array([40.0, 30.0, 50.0]), np.array([0.5, 0.4, 0.6])
    for nm, mean, c in zip(lasers_nm, counts, contrasts, strict=True):
        light = mean * rng.gamma(c**-2, c**2, (side, side))
        electrons = rng.poisson(gain * light) + rng.normal(0, read, (side, side))
        Image.fromarray(np.rint(electrons / gain + black).astype(np.uint16)).save(f"{nm}.png")
    known = ("--black", f"{black:g}", "--gain", f"{gain:g}", "--read-noise", f"{read:g}", "--linear")
    names = [f"{nm}.png" for nm in lasers_nm]
    region = ("--region", f"0,0,{side},{side}")
    lasers = ("--lasers", ",".join(map(str, lasers_nm)) + "nm")
    found = _measured(capsys, *names, *lasers, *known, *region)
    weights = counts * observer_weights("eye", np.array(lasers_nm) * 1e-9)[:, 1]

    def expected(of: slice) -> float:
        return float(np.linalg.norm(weights[of] * contrasts[of]) / weights[of].sum())

    for name, stated, known_contrast in (
        ("red", found["groups"]["red"], expected(slice(0, 2))),
        ("green", found["groups"]["green"], 0.6),
        ("all", found, expected(slice(0, 3))),
    ):
        assert abs(stated["contrast"] - known_contrast) < 5 * stated["standard_error"], name
        assert stated["standard_error"] < 0.02 * known_contrast, "so that the noise would show"


def test_without_a_known_gain_read_noise_alone_is_taken_off(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Light that isn't whole counts tells no gain: of one picture, of one beside a target, and of two lasers."""
    for name, seed in (("one", 0), ("two", 1)):
        tifffile.imwrite(f"{name}.tiff", (100 * _light(4, seed=seed)).astype(np.float32))
    known = _contrast(_light(4))
    for more in ((), ("two.tiff", "--lasers", "638,450nm")):
        found = _measured(capsys, "one.tiff", *more, "--black", "0", "--linear", *WHOLE)
        assert found["contrast"] == pytest.approx(known / np.sqrt(1 + bool(more)), rel=0.2)


def test_pictures_in_which_nothing_can_be_measured_are_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Black in colour beside its own dark picture; a pixel; saturated throughout; numbers that have no squares."""
    Image.new("RGB", (16, 12)).save("black.png")
    assert "usable pixels of mean 0" in _refused(capsys, "black.png", "--dark", "black.png", "--linear", "--gain", "2")
    tifffile.imwrite("pixel.tiff", np.full((1, 1), 9, np.uint16))
    assert "a single usable pixel" in _refused(capsys, "pixel.tiff", "--black", "1", "--linear")
    tifffile.imwrite("even.tiff", np.full((12, 16), 4095, np.uint16))
    undo = ("--black", "1", "--gain", "3", "--linear", "--saturation", "undo")
    assert "no two levels" in _refused(capsys, "even.tiff", *undo)
    with pytest.raises(UserError, match="numbers up to 1e"):
        speckle_pattern(np.full((4, 4), 1e200))
