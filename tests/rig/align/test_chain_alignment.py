"""Where the modulators and the camera of a chain of elements are, found by dots through whatever stands between."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import tomli_w

from holoview.bench.captures.dataset import oriented_shape
from holoview.bench.rig import RigDescription, read_rig
from holoview.bench.rig.align import find_geometry, registration_of, sentences
from holoview.bench.rig.registration import read_registration, registration_path, write_registration
from holoview.commands.cli import main
from holoview.light.model import preset
from holoview.light.model.effects.registry import EffectTable
from holoview.light.model.system import System
from holoview.util.errors import UserError
from tests.rig.align.hidden_bench import devices_of, found_values
from tests.rig.align.test_alignment import DEVIATIONS

FINE = {"kind": "phase", "pitch": "8 um", "shape": [48, 48], "stroke": "825 nm"}
WIDE = {"kind": "phase", "name": "second", "pitch": "16 um", "shape": [24, 24], "stroke": "700 nm"}
COARSE = {"kind": "amplitude", "name": "coarse", "pitch": "48 um", "shape": [8, 8]}
SHOWN = {"kind": "amplitude", "pitch": "8 um", "shape": [48, 48]}
MASK = {"kind": "mask", "name": "glass", "pitch": "8 um", "shape": [48, 48], "pattern": "random", "stroke": "300 nm"}
LENS = {"kind": "lens", "focal_length": "30 mm"}


def space(mm: float, **stops: Any) -> dict[str, Any]:
    return {"kind": "space", "distance": f"{mm} mm", **stops}


def fourier(name: str) -> dict[str, Any]:
    return {"kind": "fourier", "name": name, "focal_length": "4 mm"}


CHAINS: dict[str, list[dict[str, Any]]] = {
    "behind each other": [FINE, space(1, iris_na=0.03), COARSE, space(0.5), WIDE],
    "side by side": [FINE, FINE | {"name": "second", "beside": "phase1"}],
    "before amplitude": [FINE, space(1), COARSE],
    "amplitude": [SHOWN],
    "binary": [SHOWN | {"levels": 2}],
    "imaged": [FINE, fourier("there"), SHOWN, fourier("back")],
    "before a Fourier plane": [FINE, fourier("there")],
}
CAMERA = {"shift_y": 14e-6, "shift_x": -9e-6, "rotation": 8e-3, "magnification": 0.02}
MOVED = {"shift_y": 6e-6, "shift_x": -11e-6, "rotation": 4e-3}
OFFSET_M, SCALE, GAP_ERROR_M = 0.12e-3, 0.015, 0.08e-3


def write(folder: Path, elements: list[dict[str, Any]], hidden: dict[str, Any] | None = None) -> RigDescription:
    """rig.toml of a chain with what is hidden, and its description."""
    chain = System(["532 nm"], [[1.0]], elements=elements, planes_m=["4 mm"], name="table")
    (folder / "chain.toml").write_text(preset.dumps(chain), encoding="utf-8")
    tables = {
        "chain": "chain.toml",
        **{name: {"device": "virtual"} for name in chain.drive_shapes},
        "camera": {
            "device": "virtual",
            "shape": list(oriented_shape((148, 140), "rotate_90")),
            "pitch": "4 um",
            "bit_depth": 12,
            "electrons_per_count": 4.0,
            "read_noise": 3.0,
            "black_level": 64,
        },
        "lasers": {"device": "virtual", "wavelengths": ["520 nm", "638 nm"]},
        "stage": {"device": "virtual", "range": ["0 mm", "10 mm"]},
        "limits": {"power": 1.0, "exposure": [1e-7, 0.5]},
        "virtual": {"seed": 1, "prnu": 0.01, **(hidden or {})},
    }
    (folder / "rig.toml").write_text(tomli_w.dumps(tables), encoding="utf-8")
    return read_rig(folder / "rig.toml", is_registered=False)


def hidden_in(name: str) -> tuple[dict[str, Any], dict[str, float]]:
    """What a bench hides, and what an alignment should find of it."""
    effects: dict[str, Any] = {
        "camera_alignment": CAMERA,
        "distance": {"distance_error": OFFSET_M},
        "stage": {"scale": SCALE},
    }
    expected = {
        "pitch": 4e-6 / (1 + CAMERA["magnification"]),
        "rotation": CAMERA["rotation"],
        "centre_y": CAMERA["shift_y"] / 4e-6,
        "centre_x": CAMERA["shift_x"] / 4e-6,
        "stage_offset": OFFSET_M,
        "stage_scale": SCALE,
        "walk_y": 0.0,
        "walk_x": 0.0,
    }
    placement = {"camera": "rotate_90"}
    if name in ("behind each other", "side by side"):
        effects |= EffectTable().to_toml(EffectTable().parse({"misplaced@second": MOVED}, "hidden"))
        expected |= {f"slm2_{key}": value for key, value in MOVED.items()}
        placement["second"] = "flip_x"
    if name == "behind each other":
        effects |= EffectTable().to_toml(EffectTable().parse({"gap@space1": {"gap_error": GAP_ERROR_M}}, "hidden"))
        expected["gap_error"] = GAP_ERROR_M
    return {"effects": effects, "placement": placement}, expected


@pytest.mark.long
@pytest.mark.parametrize("name", CHAINS)
def test_a_hidden_placement_is_found_through_the_other_elements(name: str, tmp_path: Path) -> None:
    hidden, expected = hidden_in(name)
    rig = write(tmp_path, CHAINS[name], hidden)
    registration = registration_of(rig, find_geometry(rig, devices_of(rig)[0]))
    assert registration.camera_turn == "rotate_90"
    assert registration.slm2_turn == ("flip_x" if "slm2_shift_y" in expected else None)
    found = found_values(registration)
    assert found.keys() == expected.keys()
    for key, (value, uncertainty) in found.items():
        assert abs(value - expected[key]) < DEVIATIONS * uncertainty, (key, value, expected[key], uncertainty)
    told = " ".join(sentences(registration))
    assert "modulator 1" not in told and registration.elements[0] in told


@pytest.mark.long
def test_the_command_writes_what_the_next_commands_take(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The known effects are told by the elements' names; the file survives being written again."""
    hidden, _ = hidden_in("side by side")
    elements = [FINE | {"name": "arm 1"}, FINE | {"name": "second", "beside": "arm 1"}]
    write(tmp_path, elements, hidden)
    monkeypatch.chdir(tmp_path)
    assert main(["rig", "align", "rig.toml", "--no-check"]) == 0
    told = capsys.readouterr().out
    assert "What second displays is" in told and "misplaced.element=second" in told
    file = registration_path(tmp_path / "rig.toml")
    registration = read_registration(file)
    assert registration.elements == ("arm 1", "second")
    assert {"camera_alignment", "misplaced@second"} <= registration.known_effects().keys()
    assert "misplaced@second" in registration.uncertain_effects()
    write_registration(tmp_path / "again.toml", registration)
    assert (tmp_path / "again.toml").read_bytes() == file.read_bytes()
    rig = read_rig(tmp_path / "rig.toml")
    assert rig.registration == registration and rig.camera_shape == registration.shape
    text = file.read_text(encoding="utf-8")
    for wrong in ("3", '["arm 1"]', "[1, 2]", '["a", "b", "c", "d"]'):
        (tmp_path / "wrong.toml").write_text(text.replace('["arm 1", "second"]', wrong), encoding="utf-8")
        with pytest.raises(UserError, match=r"wrong.toml: found_for.elements: .*expected names of elements"):
            read_registration(tmp_path / "wrong.toml")
    write(tmp_path, [elements[0], elements[1] | {"name": "third"}])
    with pytest.raises(UserError, match=r"found_for.elements: .*run `holoview rig align` again"):
        read_rig(tmp_path / "rig.toml")


@pytest.mark.long
def test_the_records_of_an_aligned_chain_are_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path, CHAINS["before amplitude"], hidden_in("before amplitude")[0])
    monkeypatch.chdir(tmp_path)
    assert main(["rig", "align", "rig.toml"]) == 0
    told = capsys.readouterr()
    assert "records: " in told.out and "would be wrong" not in told.err


@pytest.mark.parametrize(
    ("elements", "said"),
    [
        ([FINE, space(1), MASK], "glass, of kind mask; expected dots that no speckle hides"),
        ([FINE, space(1), LENS, space(1), COARSE], "a lens behind phase; expected spaces and Fourier elements"),
        ([FINE, space(1), FINE, space(1), WIDE], "make dots; expected at most two modulators"),
        ([FINE, fourier("there"), WIDE], "before and behind a Fourier element; expected modulators that the camera"),
        ([FINE | {"shape": [16, 48]}, space(1), COARSE], "phase of 16 pixels; expected 24 or more"),
    ],
)
def test_what_makes_no_dots_is_refused_with_its_reason(
    elements: list[dict[str, Any]],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    write(tmp_path, elements)
    monkeypatch.chdir(tmp_path)
    assert main(["rig", "align", "rig.toml"]) == 2
    told = capsys.readouterr().err
    assert said in told and len(told.strip().splitlines()) == 1
    assert not registration_path(tmp_path / "rig.toml").exists()
