"""Chains of elements at the command line: what takes them, and one sentence from what doesn't yet."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import holoview as hv
from holoview.bench.captures.gratings import signal_pattern
from holoview.holograms.targets.picture import read_picture
from holoview.holograms.targets.target import target_for
from holoview.holograms.view import random_drive
from holoview.light.model import preset
from holoview.light.model.chain_numbers import flattered_by

PRESET = """
wavelengths = ["532 nm"]
amplitudes = [[1]]
planes = ["3 mm"]

[[elements]]
kind = "phase"
pitch = "8 um"
shape = [24, 32]
stroke = "825 nm"

[[elements]]
kind = "space"
distance = "1 mm"

[[elements]]
kind = "amplitude"
pitch = "32 um"
shape = [6, 8]
range = [0.1, 0.9]
name = "coarse"
"""


@pytest.fixture
def chain(holoview: Callable[..., Any], tmp_path: Path) -> Path:
    """A folder with a chain's preset, chain.toml, a hologram, chain.safetensors, and a picture, picture.png."""
    (tmp_path / "chain.toml").write_text(PRESET)
    system = preset.load(tmp_path / "chain.toml")
    hv.Hologram(random_drive(system), system).save(tmp_path / "chain.safetensors")
    Image.fromarray(np.full((48, 64, 3), 90, np.uint8)).save(tmp_path / "picture.png")
    return tmp_path


def test_a_chain_is_explained_in_the_order_of_its_light(holoview: Callable[..., Any], chain: Path) -> None:
    told = json.loads(holoview("info", "chain.toml", "--json").out)["elements, in the order of the light"]
    assert list(told) == ["1. phase", "2. space", "3. coarse"]
    assert "sideways" in told["2. space"] and "amplitude 0.1 to 0.9" in told["3. coarse"]
    left = json.loads(holoview("info", "chain.safetensors", "--json").out)["light_behind"]
    assert left["phase"] == pytest.approx(1.0, rel=1e-6)
    assert left["phase"] > left["before coarse"] > left["coarse"] > 0


def test_a_chain_is_optimised_saved_and_rendered(holoview: Callable[..., Any], chain: Path) -> None:
    options = ("picture.png", "--iterations", 2, "-o", "found.safetensors", "--json")
    found = json.loads(holoview("optimise", "chain.toml", *options).out)
    assert 0 < found["light_that_passes"] < 1
    assert {"psnr_db", "eyebox_variation"} <= found.keys()
    for arguments in (("found.safetensors",), ("--hologram", "found.safetensors"), ("chain.toml", "--random", 3)):
        assert holoview("render", *arguments, "-o", "seen.png", "--backend", "torch").code == 0
    assert holoview("render", "chain.toml", "--show", "phase", "--stage", "coarse", "-o", "field.png").code == 0


@pytest.mark.parametrize("form", ["png", "bmp"])
def test_patterns_are_exported_by_the_names_of_the_elements(
    holoview: Callable[..., Any], chain: Path, form: str
) -> None:
    assert holoview("export", "chain.safetensors", f"--{form}", "patterns").code == 0
    made, folder = hv.load_hologram(chain / "chain.safetensors"), chain / "patterns"
    table = json.loads((folder / "patterns.json").read_text(encoding="utf-8"))
    said = {of["element"]: of for of in table["modulators"]}
    assert list(said) == ["phase", "coarse"] and [of["kind"] for of in said.values()] == ["phase", "amplitude"]
    files = table["frames"][0]["files"]
    assert [file["element"] for file in files] == list(said)
    for file in files:
        pixels = np.asarray(Image.open(folder / file["file"]))
        drive, of = made.drive[file["element"]][0], said[file["element"]]
        assert file["file"] == f"{file['element']}.{form}" and pixels.shape == (file["rows"], file["columns"])
        assert hashlib.sha256((folder / file["file"]).read_bytes()).hexdigest() == file["sha256"]
        assert np.array_equal(pixels, np.rint(drive * 255).astype(np.uint8))
        assert of["grey"] == [0, 255] and of.get("amplitude", of.get("path_m"))[1] == of.get("stroke_m", 0.9)
    assert said["coarse"]["amplitude"] == [0.1, 0.9]
    shown = np.asarray(Image.open(folder / table["test_pattern"]["file"]))
    assert np.array_equal(shown, signal_pattern(made.drive["phase"][0].shape, 8))


@pytest.mark.parametrize("frames", [1, 2])
def test_exported_patterns_are_rendered_from_their_folder(
    holoview: Callable[..., Any], chain: Path, frames: int
) -> None:
    system = preset.load(chain / "chain.toml").edit({"frames": frames})
    drive = {name: np.round(own * 255) / 255 for name, own in random_drive(system, 4).items()}
    hv.Hologram(drive, system).save(chain / "made.safetensors")
    assert holoview("export", "made.safetensors", "--png", "patterns").code == 0
    (chain / "bench.toml").write_text(preset.dumps(system))
    for command, name in ((("bench.toml", "--patterns", "patterns"), "folder"), (("made.safetensors",), "file")):
        assert holoview("render", *command, "--backend", "torch", "-o", f"{name}.npy").code == 0
    shown, expected = (np.load(chain / f"{name}.npy") for name in ("folder", "file"))
    np.testing.assert_allclose(shown, expected, atol=1e-5 * expected.max())  # of f32
    (chain / "patterns" / f"coarse{'-frame1' if frames == 2 else ''}.png").unlink()
    told = holoview("render", "bench.toml", "--patterns", "patterns", "-o", "again.png")
    assert told.code == 2 and "coarse" in told.err


def test_patterns_of_a_short_form_are_rendered_from_their_folder(holoview: Callable[..., Any], tmp_path: Path) -> None:
    system = hv.load("holochrome-8").with_(shape=[12, 16])
    hv.Hologram(np.round(random_drive(system) * 255) / 255, system).save(tmp_path / "made.safetensors")
    (tmp_path / "bench.toml").write_text(preset.dumps(system))
    assert holoview("export", "made.safetensors", "--png", "patterns").code == 0
    for command, name in ((("bench.toml", "--patterns", "patterns"), "folder"), (("made.safetensors",), "file")):
        assert holoview("render", *command, "--backend", "torch", "-o", f"{name}.npy").code == 0
    shown, expected = (np.load(tmp_path / f"{name}.npy") for name in ("folder", "file"))
    np.testing.assert_allclose(shown, expected, atol=1e-5 * expected.max())


@pytest.mark.parametrize("other", ["holochrome-8", "high-contrast"])
def test_a_hologram_of_another_chain_is_refused_with_the_shapes(
    holoview: Callable[..., Any], chain: Path, other: str
) -> None:
    told = holoview("render", other, "--hologram", "chain.safetensors", "-o", "seen.png")
    assert told.code == 2 and "patterns of shape (1, 24, 32) of phase, (1, 6, 8) of coarse" in told.err


def test_complex_patterns_are_in_no_picture(holoview: Callable[..., Any], tmp_path: Path) -> None:
    element = {"kind": "complex", "pitch": "8 um", "shape": [12, 16]}
    system = hv.System(["532 nm"], [[1.0]], elements=[element], planes_m=["2 mm"])
    (tmp_path / "bench.toml").write_text(preset.dumps(system))
    (tmp_path / "patterns").mkdir()
    told = holoview("render", "bench.toml", "--patterns", "patterns", "-o", "seen.png")
    assert told.code == 2 and 'complex patterns, of "complex"' in told.err


def test_the_light_of_a_point_of_a_chain_is_explained(holoview: Callable[..., Any], chain: Path) -> None:
    found = json.loads(holoview("point", "chain.safetensors", "--json", "-o", "point.png").out)
    assert sum(order["share"] for order in found["orders"]) == pytest.approx(1.0)
    assert [Path(name).name for name in found["files"][3:]] == ["point-areas-1.png", "point-areas-2.png"]


def test_the_field_behind_a_chain_is_written_and_shows_the_same(holoview: Callable[..., Any], chain: Path) -> None:
    assert holoview("export", "chain.safetensors", "--field", "field.safetensors").code == 0
    field, whole = (hv.load_hologram(chain / f"{name}.safetensors") for name in ("field", "chain"))
    seen, expected = (hv.simulate(one, backend="torch64").intensity for one in (field, whole))
    # of a field in complex64
    np.testing.assert_allclose(seen, expected, atol=1e-6 * expected.max())


def test_an_optimisation_of_a_chain_goes_on_from_its_checkpoint(holoview: Callable[..., Any], chain: Path) -> None:
    command = ("optimise", "chain.toml", "picture.png", "--iterations", 4, "-o", "found.safetensors")
    system = preset.load(chain / "chain.toml")
    stack = target_for(system, read_picture(chain / "picture.png")).stack
    first = next(iter(hv.iterate(system, stack, hv.Settings(iterations=4))))
    first.checkpoint().save(chain / "begun.safetensors")
    outcome = holoview(*command, "--resume", "begun.safetensors", "--json")
    assert outcome.code == 0 and json.loads(outcome.out)["iterations"] == 4


def test_a_film_of_a_chain_begins_each_picture_with_the_last(holoview: Callable[..., Any], chain: Path) -> None:
    (chain / "film").mkdir()
    for number in range(2):
        Image.fromarray(np.full((48, 64, 3), 60 + 90 * number, np.uint8)).save(chain / "film" / f"{number}.png")
    command = ("optimise", "chain.toml", "film", "--film", "--iterations", 2, "--next-iterations", 1, "-o", "out")
    outcome = holoview(*command, "--json")
    assert outcome.code == 0 and json.loads(outcome.out)["holograms"] == 2
    files = sorted((chain / "out").iterdir())
    whole = [hv.load_hologram(file) for file in files]
    files[1].unlink()
    assert json.loads(holoview(*command, "--json").out)["holograms"] == 1
    again, drive = hv.load_hologram(files[1]), whole[1].drive
    assert again.system == whole[1].system and all(np.array_equal(again.drive[key], drive[key]) for key in drive)
    # one step of Adam: at most 0.5 rad of a phase, and 0.1 of an amplitude
    assert 0 < np.abs(drive["coarse"] - whole[0].drive["coarse"]).max() < 0.1 + 1e-6


REFUSING = {
    "captures of a Fourier bench": ("captures", "make", "chain.toml", "--focal-length", "0.1m", "-o", "captures.h5"),
    "pictures by the modulators' numbers": ("render", "chain.toml", "--slm1", "picture.png"),
    "an effect": ("render", "chain.toml", "--effects", "gap.gap_error=0.1mm"),
    "the short form's keys": ("info", "chain.toml", "--set", "gap=2mm"),
    "a pitch of all": ("info", "chain.toml", "--set", "pitch=8um"),
    "a hologram as a checkpoint": ("optimise", "chain.toml", "picture.png", "--resume", "chain.safetensors"),
}


@pytest.mark.parametrize("name", REFUSING)
def test_what_takes_no_chain_yet_says_so_in_a_sentence(holoview: Callable[..., Any], chain: Path, name: str) -> None:
    outcome = holoview(*REFUSING[name])
    assert outcome.code == 2, outcome
    (sentence,) = [line for line in outcome.err.splitlines() if line.startswith("holoview: ")]
    assert "Traceback" not in outcome.err
    assert len(sentence) > 30


@pytest.mark.parametrize(
    ("edits", "said"),
    [
        ({"planes": ["1 mm"]}, []),
        ({"sampling.upsample": 1, "planes": ["1 mm"]}, ["one sample a pixel"]),
        ({"planes": ["3 mm"]}, ["the field is 0.192 mm wide, and light of a pixel spreads over 0.2661 mm"]),
    ],
)
def test_what_flatters_a_chain_is_told(chain: Path, edits: dict[str, Any], said: list[str]) -> None:
    """Light of 532 nm and 8 µm goes 4 mm·tan(asin(λ/2p)) = 0.133 mm sideways, and 2 mm: 0.067."""
    found = flattered_by(preset.load(chain / "chain.toml").edit(edits))
    assert len(found) == len(said) and all(map(str.startswith, found, said))


def test_an_optimisation_tells_what_flatters_it(holoview: Callable[..., Any], chain: Path) -> None:
    done = holoview("optimise", "chain.toml", "picture.png", "--iterations", "1", "-o", "h.safetensors")
    assert "note: the field is 0.192 mm wide" in done.err


@pytest.mark.long
def test_contrast_and_report_state_what_the_optimiser_states(holoview: Callable[..., Any], chain: Path) -> None:
    """The number of `optimise` is that of `contrast`, of `report` and of a sweep: one method, of a chain too."""
    options = ("picture.png", "--iterations", 12, "-o", "found.safetensors", "--json")
    stated = json.loads(holoview("optimise", "chain.toml", *options).out)["speckle_contrast"]
    target = ("--target", "picture.png")
    measured = json.loads(holoview("contrast", "found.safetensors", *target, "--json").out)
    # the optimiser scores in float64 what the others render in float32
    assert measured["contrast"] == pytest.approx(stated, rel=1e-4)
    claims = ("--claim", "C < 2", "--claim", "picture_light > 0.1")
    holoview("report", "found.safetensors", *target, *claims, "-o", "report.html")
    (told,) = json.loads((chain / "report.json").read_text())["holograms"]
    assert told["contrast"] == pytest.approx(measured["contrast"], rel=1e-12)
    assert [claim["verdict"] for claim in told["claims"]] == ["holds", "holds"]
    left = json.loads(holoview("info", "found.safetensors", "--json").out)
    assert told["light_behind_elements"] == pytest.approx(left["light_behind"])
    assert told["light_budget"] == pytest.approx(left["light_budget"])
    assert sum(told["light_budget"].values()) == pytest.approx(1.0, abs=1e-6)
    assert "lost at coarse" in (chain / "report.html").read_text(encoding="utf-8")
    sweep = ("--set", "elements.space.distance=1mm:2mm:2", "--measure", "contrast", *target, "--json", "-o", "gap.csv")
    points = json.loads(holoview("sweep", "found.safetensors", *sweep).out)["points"]
    assert points[0]["contrast"] == pytest.approx(measured["contrast"], rel=1e-12)


@pytest.mark.long
def test_a_chain_is_swept_optimised_anew_and_has_tolerances(holoview: Callable[..., Any], chain: Path) -> None:
    way = ("--set", "elements.space.distance=0.5mm:1.5mm:3")
    target = ("--target", "picture.png")
    anew = ("--optimise", 2, "--measure", "psnr", "-o", "anew.csv")
    found = holoview("sweep", "chain.toml", *way, *target, *anew)
    assert found.code == 0, found.err
    assert len((chain / "anew.csv").read_text().splitlines()) == 4
    allowed = ("--tolerance", "psnr=20dB", "--json", "-o", "limits.csv")
    limits = json.loads(holoview("sweep", "chain.safetensors", *way, *target, *allowed).out)["tolerance"]["limits"]
    assert limits[0]["own"] == pytest.approx(1e-3)
    wrong = holoview("sweep", "chain.safetensors", "--set", "elements.phase.shape=[24,32],[12,32]", "-o", "wrong.csv")
    assert wrong.code == 2
    assert "needs patterns of shape (1, 12, 32), (1, 6, 8); expected (1, 24, 32), (1, 6, 8)" in wrong.err


def test_checked_captures_of_a_chain_list_each_element(holoview: Callable[..., Any], chain: Path) -> None:
    assert holoview("captures", "make", "chain.toml", "-o", "seen.h5").code == 0
    told = holoview("captures", "check", "seen.h5", "--quick").out
    assert "32 x 24 pixels" in told
    assert "coarse       8 x 6 pixels" in told
