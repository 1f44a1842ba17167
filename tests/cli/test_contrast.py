"""`holoview contrast` of holograms and captures: its JSON, its text, and what it refuses."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image

import holoview as hv
from holoview.bench.captures.capture_file import write_captures
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.commands import cli
from holoview.holograms.view import simulate
from holoview.light.colour import srgb_encode
from holoview.light.model import preset
from holoview.viewer.document.measurements import measure_region
from holoview.viewer.page.page import read_page
from tests.document.test_chain_optimisation import CHAINS

BENCH = {"shape": [48, 64], "propagation": "periodic"}
SETS = ("--set", "shape=[48,64]", "--set", "propagation=periodic")


@pytest.fixture
def hologram(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> hv.Hologram:
    """A hologram of random patterns as h.safetensors, and a picture as target.png."""
    monkeypatch.chdir(tmp_path)
    system = preset.load("holochrome-8").edit(BENCH)
    hologram = hv.Hologram(hv.random_drive(system), system)
    hologram.save("h.safetensors")
    y, x = np.mgrid[:96, :128]
    tones = np.stack([80 + 100 * (x // 16 % 2), 60 + y, np.full(x.shape, 120)], axis=-1)
    Image.fromarray(tones.astype(np.uint8)).save("target.png")
    return hologram


def _json(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert cli.main(["contrast", *arguments, "--json"]) == 0, capsys.readouterr().err
    return dict(json.loads(capsys.readouterr().out))


def test_every_number_has_its_error_and_method(hologram: hv.Hologram, capsys: pytest.CaptureFixture[str]) -> None:
    found = _json(capsys, "h.safetensors")
    assert found["standard_error"] > 0 and found["independent_grains"] > 100 and len(found["grain_px"]) == 2
    assert len(found["lasers"]) == 8 == len(found["correlation"])
    assert all(laser["standard_error"] > 0 for laser in found["lasers"])
    assert set(found["groups"]) == {"blue", "green", "red"}
    assert found["n_eff_correlation"] < found["n_eff_powers"] < 8
    assert found["one_by_one_contrast"] < found["contrast"]  # lasers share modulators
    for colour in ("colour_speckle", "colour_speckle_one_by_one"):
        assert found[colour]["ellipse_95_area"] > 0 and len(found[colour]["covariance_jzazbz"]) == 3
    assert [row["threshold"] for row in found["visibility"]] == [0.03, 0.048, 0.06, 0.069]
    assert cli.main(["contrast", "h.safetensors", "--scatter", "s.png"]) == 0
    said = capsys.readouterr().out
    assert "in the manner of IEC 62906-5-4" in said and "conform" not in said
    assert "(a) one by one" in said and "95 % ellipse" in said and "Roelandt" in said
    with Image.open("s.png") as drawn:
        assert drawn.size == (960, 600)


def test_with_a_target_it_is_the_number_of_the_viewer(
    hologram: hv.Hologram, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a hologram that shows the target, after some iterations."""
    stack = hv.target_for(hologram.system, "target.png").stack
    *_, last = hv.iterate(hologram.system, stack, hv.Settings(iterations=30))
    last.best.save("shown.safetensors")
    found = _json(capsys, "shown.safetensors", "--target", "target.png", "--region", "20,10,60,50")
    view = simulate(last.best, planes=[10e-3], backend="torch")
    target = hv.target_for(last.best.system, "target.png", planes=[10e-3]).stack[0]
    shown = measure_region(view.xyz[0], (20, 10, 60, 50), target)
    assert shown.contrast is not None and found["withheld"] is None
    assert found["likeness"]["share"] > 0.5
    assert found["contrast"] == pytest.approx(shown.contrast, rel=1e-12)
    assert found["standard_error"] == pytest.approx(shown.standard_error, rel=1e-12)
    assert found["raw_contrast"] == pytest.approx(shown.raw_contrast, rel=1e-12)
    assert found["structure_removed"]


def test_where_the_target_is_not_shown_it_is_withheld(
    hologram: hv.Hologram, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ("h.safetensors", "--target", "target.png", "--region", "20,10,60,50")
    found = _json(capsys, *arguments)
    assert found["contrast"] is None and found["standard_error"] is None and found["independent_patterns"] is None
    assert "doesn't show the target" in found["withheld"] and found["likeness"]["share"] < 0.5
    assert found["visibility"] == [] and "lasers" not in found and not found["structure_removed"]
    plain = _json(capsys, "h.safetensors", "--region", "20,10,60,50")
    assert found["raw_contrast"] == plain["contrast"] == plain["raw_contrast"]
    assert cli.main(["contrast", *arguments]) == 0
    said = capsys.readouterr().out
    assert "speckle contrast withheld: the picture doesn't show the target" in said
    assert f"raw it is {plain['contrast']:.4f}" in said and "visible?" not in said


@pytest.mark.long
def test_the_contrast_by_pupil_is_measured_beside_the_target(
    hologram: hv.Hologram, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of random patterns it is withheld beside a target, as that of the luminance is, and raw without one."""
    eye = ("h.safetensors", "--set", "eye={}", "--pupils", "2mm,3mm")
    plain, beside = _json(capsys, *eye), _json(capsys, *eye, "--target", "target.png")
    assert all(row["contrast"] > row["cone_contrast"] > 0 and row["withheld"] is None for row in plain["pupils"])
    assert [row["contrast"] for row in beside["pupils"]] == [None, None] and beside["contrast"] is None
    assert all("the target" in row["withheld"] and not row["structure_removed"] for row in beside["pupils"])
    assert cli.main(["contrast", *eye, "--target", "target.png", "--plot", "p.png"]) == 0
    assert "\n2     mm   withheld  withheld " in capsys.readouterr().out


@pytest.mark.parametrize("suffix", [".npz", ".npy", ".exr"])
def test_light_in_a_file_has_the_numbers_of_its_hologram(
    hologram: hv.Hologram, capsys: pytest.CaptureFixture[str], suffix: str
) -> None:
    """Luminance and lasers are equal to the last bit; the lasers' colours follow from sums, to rounding."""
    assert cli.main(["render", "h.safetensors", "--backend", "torch", "-o", f"light{suffix}"]) == 0
    capsys.readouterr()
    found, own = _json(capsys, f"light{suffix}"), _json(capsys, "h.safetensors")
    assert found["contrast"] == own["contrast"] and found["standard_error"] == own["standard_error"]
    assert [of["contrast"] for of in found["lasers"]] == [of["contrast"] for of in own["lasers"]]
    assert found["correlation"] == own["correlation"]
    for key in ("n_eff_powers", "n_eff_correlation", "one_by_one_contrast"):
        assert found[key] == pytest.approx(own[key], rel=1e-5)
    for key in ("mean_uv", "ellipse_95_area"):
        assert found["colour_speckle"][key] == pytest.approx(own["colour_speckle"][key], rel=1e-4)
    assert cli.main(["compare", f"light{suffix}", "h.safetensors"]) == 2
    assert "h.safetensors: isn't light that holoview wrote" in capsys.readouterr().err


def test_a_plane_is_that_of_the_hologram_of_its_light_and_of_a_stack(
    hologram: hv.Hologram, capsys: pytest.CaptureFixture[str]
) -> None:
    """--plane chooses one of a hologram's planes, beside a stack with a picture for each of them too."""
    assert cli.main(["render", "h.safetensors", "--plane", "all", "--backend", "torch", "-o", "light.npz"]) == 0
    capsys.readouterr()
    middle = _json(capsys, "h.safetensors", "--plane", "10mm")
    assert middle["contrast"] == _json(capsys, "h.safetensors")["contrast"] == _json(capsys, "light.npz")["contrast"]
    first = ("--plane", "9mm")
    raw = _json(capsys, "h.safetensors", *first)["contrast"]
    assert raw == _json(capsys, "light.npz", *first)["contrast"] != middle["contrast"]
    assert _json(capsys, "h.safetensors", *first, "--target", "light.npz")["contrast"] < 1e-5  # it is its own target
    assert cli.main(["contrast", "light.npz", "--plane", "12mm"]) == 2
    assert "holds no light at 12 mm; expected one at 9, 9.5, 10, 10.5, 11 mm" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["mono", "qe.csv"])
def test_who_sees_no_colours_sees_no_colour_speckle(
    hologram: hv.Hologram, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    rows = [f"{nm};0,{nm - 350}" for nm in range(380, 790, 10)]
    Path("qe.csv").write_text("\n".join(["nm;qe", *rows]), encoding="utf-8")
    found = _json(capsys, "h.safetensors", "--observer", name)
    assert "colour_speckle" not in found and len(found["lasers"]) == 8
    assert "colour_speckle" in _json(capsys, "h.safetensors")


def test_an_observer_looks_at_a_hologram(hologram: hv.Hologram, capsys: pytest.CaptureFixture[str]) -> None:
    eye, old = (_json(capsys, "h.safetensors", "--observer", who) for who in ("eye", "age 70, field 4"))
    assert old["lasers"][0]["luminance_share"] != eye["lasers"][0]["luminance_share"]


def test_instruments_tell_what_they_resolve(hologram: hv.Hologram, capsys: pytest.CaptureFixture[str]) -> None:
    for name, more in (("eye", ()), ("iec", ()), ("camera", ("--f-number", "16", "--pixel", "4um", "--bits", "12"))):
        found = _json(capsys, "h.safetensors", "--meter", name, *more)
        meter = found["meter"]
        assert meter["pixels_a_grain"] > 0 and meter["lambda_over_d"]
        assert (meter["full_scale_sigma"] is not None) == (name == "camera")
        assert cli.main(["contrast", "h.safetensors", "--meter", name, *more]) == 0
        assert f"instrument: {meter['instrument']}" in capsys.readouterr().out


def test_a_field_is_measured(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(0)
    np.save(tmp_path / "f.npy", (rng.normal(size=(64, 64)) + 1j * rng.normal(size=(64, 64))).astype(np.complex64))
    known = ("--pitch", "8um", "--wavelength", "532nm", "--distance", "0mm")
    found = _json(capsys, str(tmp_path / "f.npy"), *known, "--region", "0,0,64,64")
    assert found["contrast"] == pytest.approx(1.0, abs=5 * found["standard_error"])
    assert [laser["name"] for laser in found["lasers"]] == ["532 nm"]


def test_a_capture_file_has_a_contrast_for_each_laser(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Random patterns of single lasers: captures of contrast near 1 without the camera's noise."""
    system = preset.load("simultaneous").edit({"shape": [32, 48], "planes": ["10 mm"]})
    settings = AcquisitionSettings(captures_per_condition=3, blur_sigmas_px=(0.0,))
    path = tmp_path / "c.h5"
    write_captures(path, make_captures(system, settings=settings))
    found = _json(capsys, str(path))
    assert len(found["captures"]) == 9 and [row["captures"] for row in found["lasers"]] == [3, 3, 3]
    for row in found["lasers"]:
        assert 0.5 < row["contrast"] < 1.4 and row["standard_error"] > 0
    assert cli.main(["contrast", str(path)]) == 0
    assert "mean of 3 captures" in capsys.readouterr().out
    assert cli.main(["contrast", str(path), "--region", "90,0,20,20"]) == 2
    assert "--region: 90,0,20,20" in capsys.readouterr().err


@pytest.fixture
def captures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Captures of three lasers that show equal patterns, three sets, as c.h5."""
    monkeypatch.chdir(tmp_path)
    system = preset.load("simultaneous").edit({"shape": [32, 48], "planes": ["10 mm"]})
    settings = AcquisitionSettings(captures_per_condition=3, blur_sigmas_px=(0.0,))
    made = make_captures(system, settings=settings)
    levels = made.levels.copy()
    for wavelength_m in np.unique(made.wavelength_m):
        own = np.flatnonzero(made.wavelength_m == wavelength_m)
        levels[own] = np.arange(len(own)).reshape(-1, *[1] * (levels.ndim - 1))
    write_captures(tmp_path / "c.h5", replace(made, levels=levels))
    return tmp_path


@pytest.mark.long
def test_lasers_of_a_capture_file_are_told_as_of_a_hologram(captures: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = _json(capsys, "c.h5", "--scatter", "s.png")
    together = found["together"]
    assert together["sets"] == 3 and len(together["correlation"]) == 3 == len(together["lasers"])
    for group in together["groups"].values():
        assert group["standard_error"] > 0 and group["independent_grains"] > 1
    assert together["colour_speckle"]["ellipse_95_area_error"] > 0
    assert [row["threshold"] for row in together["visibility"]] == [0.03, 0.048, 0.06, 0.069]
    assert (captures / "s.png").stat().st_size > 1000 and found["scatter"] == "s.png"
    assert cli.main(["contrast", "c.h5", "--observer", "age 70, field 4"]) == 0
    said = capsys.readouterr().out
    for words in ("1/sqrt(N)", "correlation between the lasers' patterns", "(b) colour", "Roelandt", "red  "):
        assert words in said
    other = _json(capsys, "c.h5", "--observer", "age 70, field 4")["together"]
    assert other["contrast"] != together["contrast"]


@pytest.mark.parametrize(
    "option",
    [
        "--plot=p.png",
        "--target=c.h5",
        "--meter=eye",
        "--plane=1mm",
        "--gain=2",
        "--black=0",
        "--set=eye={}",
        "--linear",
    ],
)
def test_what_means_nothing_to_a_capture_file_is_refused(
    captures: Path, capsys: pytest.CaptureFixture[str], option: str
) -> None:
    """An option that changed nothing would leave its user with another number than was asked for."""
    assert cli.main(["contrast", "c.h5", option]) == 2
    err = capsys.readouterr().err
    assert f"{option.split('=')[0]}: with a capture file" in err and err.count("\n") == 1
    assert not (captures / "p.png").exists()


@pytest.mark.parametrize("option", [("--f-number", "4"), ("--bits", "8"), ("--align",), ("--observer", "eye")])
def test_options_without_their_others_are_refused_with_a_picture(
    hologram: hv.Hologram, capsys: pytest.CaptureFixture[str], option: tuple[str, ...]
) -> None:
    assert cli.main(["contrast", "target.png", *option]) == 2
    assert option[0] in capsys.readouterr().err


def test_an_edge_is_measured_in_light(hologram: hv.Hologram, capsys: pytest.CaptureFixture[str]) -> None:
    """A box of three samples across has the MTF sinc(3f), a half at 0.201 cycles a sample, whatever encodes the file.

    Taken for light, the signal's edge is steeper on its dark side.
    """
    y, x = np.mgrid[:64, :64]
    edge = 0.02 + 0.9 * np.clip((x - 32 - 0.1 * (y - 32)) / 3 + 0.5, 0, 1)
    tifffile.imwrite("light.tiff", edge.astype(np.float32))
    Image.fromarray(np.rint(65535 * srgb_encode(edge)).astype(np.uint16)).save("signal.png")
    tifffile.imwrite("counts.tiff", np.rint(60000 * edge).astype(np.uint16))
    arguments = ("--edge", "8,8,48,48")
    light = _json(capsys, "light.tiff", *arguments)["mtf"][0]["half_cycles_a_sample"]
    assert light == pytest.approx(0.201, abs=0.01)
    options = {"signal.png": [()], "counts.tiff": [("--black", "0", "--linear"), ("--linear",)]}
    for name, more in [(name, more) for name, several in options.items() for more in several]:
        found = _json(capsys, name, *arguments, *more)["mtf"][0]
        assert found["half_cycles_a_sample"] == pytest.approx(light, rel=1e-3)  # 16 bits


def test_the_mtf_of_an_edge_is_told_by_plane(hologram: hv.Hologram, capsys: pytest.CaptureFixture[str]) -> None:
    y, x = np.mgrid[:64, :64]
    edge = np.clip(x - 32 - 0.1 * (y - 32) + 0.5, 0, 1).astype(np.float32)
    tifffile.imwrite("edge.tiff", edge)
    found = _json(capsys, "edge.tiff", "--edge", "8,8,48,48")
    assert found["mtf"][0]["angle_deg"] == pytest.approx(np.degrees(np.arctan(0.1)), abs=0.1)
    # a box of one sample across: sinc(f) is a half at 0.603 cycles a sample
    assert found["mtf"][0]["half_cycles_a_sample"] == pytest.approx(0.603, abs=0.03)
    assert cli.main(["contrast", "edge.tiff", "--edge", "40,40,48,48"]) == 2
    assert "--edge: 40,40,48,48" in capsys.readouterr().err
    assert cli.main(["contrast", "h.safetensors", "--edge", "8,8,48,48"]) == 2
    assert "--edge" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--region", "0,0,1,1"], "two or more pixels with light"),
        (["--meter", "camera", "--f-number", "0.2", "--pixel", "4um"], "--f-number: 0.2; expected 0.7 to 300"),
        (["--meter", "camera", "--f-number", "16", "--pixel", "4mm"], "0.1 um to 1 mm"),
        (["--meter", "camera", "--f-number", "16", "--pixel", "900um"], "at least 2 × 2 pixels"),
        (["--pupils", "2mm", "--meter", "iec", "--set", "eye={}"], "--pupils: with --meter iec"),
        (["--target", "missing.png"], "missing.png"),
    ],
)
def test_mistakes_are_named(
    hologram: hv.Hologram, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    assert cli.main(["contrast", "h.safetensors", *arguments]) == 2
    err = capsys.readouterr().err
    assert said in err and err.count("\n") == 1


def test_a_dark_hologram_has_no_contrast(hologram: hv.Hologram, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["contrast", "holochrome-8", *SETS, "--set", "amplitudes=[[0,0,0,0,0,0,0,0]]"]) == 2
    assert "at least one laser that is on" in capsys.readouterr().err


def test_where_the_light_went_is_told(hologram: hv.Hologram, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["info", "h.safetensors"]) == 0
    assert "where the light went" in capsys.readouterr().out
    assert cli.main(["info", "h.safetensors", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["light_budget"]
    assert sum(told.values()) == pytest.approx(1.0, abs=1e-5)
    assert cli.main(["render", "h.safetensors", "--plane", "all", "--backend", "torch", "-o", "o.png", "--json"]) == 0
    planes = json.loads(capsys.readouterr().out)["planes"]
    assert len(planes) == 5 and all(sum(p["light_budget"].values()) == pytest.approx(1, abs=1e-5) for p in planes)


@pytest.mark.parametrize("name", CHAINS)
def test_the_page_of_a_chain_claims_the_contrast_that_is_printed(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    system = CHAINS[name]()
    hologram = hv.Hologram(hv.random_drive(system, seed=4), system)
    hologram.save("chain.safetensors")
    found = _json(capsys, "chain.safetensors", "--region", "3,2,18,20", "--live", "chain.html")
    text = Path("chain.html").read_text(encoding="utf-8")
    page = json.loads(text.split('id="holoview-page">')[1].split("</script>")[0])
    (claim,) = page["claims"]
    assert claim["value"] == f"{found['contrast']:.3f} ± {found['standard_error']:.3f}"
    assert claim["region"] == {"x": 3, "y": 2, "width": 18, "height": 20}
    (stored,) = read_page("chain.html").values()
    assert stored.system == system
    assert all(np.array_equal(stored.drive[key], drive) for key, drive in hologram.drive.items())


@pytest.mark.parametrize("measured", ["h.safetensors", "seen.png"])
def test_an_ignored_colour_profile_of_the_target_is_told_once(
    hologram: hv.Hologram, capsys: pytest.CaptureFixture[str], measured: str
) -> None:
    rows, columns = simulate(hologram, planes=[10e-3], backend="torch").xyz.shape[1:3]
    picture = Image.fromarray(np.random.default_rng(3).integers(40, 200, (rows, columns, 3), dtype=np.uint8))
    picture.save("seen.png")
    picture.save("damaged.png", icc_profile=b"damaged" * 40)
    assert cli.main(["contrast", measured, "--target", "damaged.png"]) == 0
    assert capsys.readouterr().err.count("note: damaged.png: embedded colour profile ignored: taken as sRGB") == 1
