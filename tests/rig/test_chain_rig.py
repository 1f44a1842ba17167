"""A rig of a chain of elements: its description, its virtual bench, its captures, and what doesn't know it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from holoview.bench.captures import read_captures
from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Predictor
from holoview.bench.rig import open_rig, read_rig
from holoview.bench.rig.capture_folder import read_bench_record
from holoview.bench.rig.signal_check import check_signals
from holoview.commands.cli import main
from holoview.light.model import preset
from holoview.light.model.system import System
from holoview.util.errors import UserError

PHASE = {"kind": "phase", "pitch": "8 um", "shape": [24, 32], "stroke": "825 nm"}
SPACE = {"kind": "space", "distance": "1 mm", "iris_na": 0.03}
COARSE = {"kind": "amplitude", "name": "coarse", "pitch": "16 um", "shape": [12, 16], "levels": 64}
CAMERA = {"shape": [48, 64], "pitch": "4 um", "bit_depth": 12, "electrons_per_count": 4.0, "read_noise": 3.0}
TABLES: dict[str, Any] = {
    "name": "a chain on the table",
    "chain": "chain.toml",
    "phase": {"device": "virtual", "settle": 0.2},
    "coarse": {"device": "virtual", "settle": 0.1},
    "camera": {"device": "virtual", "black_level": 64, **CAMERA},
    "lasers": {"device": "virtual", "wavelengths": ["450 nm", "638 nm"]},
    "stage": {"device": "virtual", "range": ["0 mm", "10 mm"]},
    "limits": {"power": 1.0, "exposure": [1e-5, 0.5], "stage": ["2 mm", "6 mm"]},
    "virtual": {"seed": 3, "settle": 0.02},
}


def chain_of(*elements: dict[str, Any], **changes: Any) -> System:
    built = System(["532 nm"], [[1.0]], elements=elements or (PHASE, SPACE, COARSE), planes_m=["3 mm"], name="table")
    return built.edit(changes)


def write_chain_rig(folder: Path, changes: dict[str, Any] | None = None, chain: System | None = None) -> Path:
    """rig.toml and chain.toml; a change to None removes a table."""
    (folder / "chain.toml").write_text(preset.dumps(chain or chain_of()), encoding="utf-8")
    tables = {key: value for key, value in (TABLES | (changes or {})).items() if value is not None}
    (folder / "rig.toml").write_text(tomli_w.dumps(tables), encoding="utf-8")
    return folder / "rig.toml"


def _left(captures: Captures, effects: dict[str, dict[str, float]] | None = None) -> float:
    """Variance of what a prediction leaves of the pictures over that of the camera's noise."""
    ratios = []
    for k, signal in enumerate(Predictor(captures)(range(len(captures)), effects or {}).signal.double().numpy()):
        light = captures.images[k] - captures.camera.black_level
        used = captures.images[k] < captures.camera.saturation
        expected = signal * float((signal * light)[used].sum() / (signal * signal)[used].sum())
        ratios.append(np.mean(((light - expected) ** 2 / captures.camera.noise_variance(expected))[used]))
    return float(np.mean(ratios))


def test_a_description_tells_each_element_by_its_name(tmp_path: Path) -> None:
    rig = read_rig(write_chain_rig(tmp_path))
    assert rig.modulator_names == ("phase", "coarse") and rig.slm_shapes == ((24, 32), (12, 16))
    assert [slm.num_levels for slm in rig.bench.slms] == [256, 64] and rig.bench.chain == chain_of()
    assert [own.shape for own in rig.clear_levels] == [(24, 32), (12, 16)]
    assert [int(own.max()) for own in rig.clear_levels] == [0, 63]
    drawn = rig.random_levels(np.random.default_rng(1), 1.0)
    assert drawn.shape == (2, 24, 32) and drawn[1, :12, :16].max() == 63
    assert not drawn[1, 12:].any() and not drawn[1, :, 16:].any()


@pytest.mark.long
@pytest.mark.parametrize(
    ("changes", "chain", "said"),
    [
        ({"coarse": None}, {}, r"a table \[coarse\]"),
        ({"geometry": {"gap": "1 mm"}}, {}, "geometry: unknown table"),
        ({"slm1": {"device": "virtual"}}, {}, "slm1: unknown table"),
        ({"coarse": {"device": "virtual", "num_levels": 16}}, {}, "coarse.num_levels: 16; expected 64"),
        ({"chain": 3}, {}, "chain: 3"),
        ({"chain": "nowhere.toml"}, {}, "chain: "),
        ({"chain": "holochrome-8"}, {}, "one or two equal phase modulators; expected a chain"),
        ({}, {"source.directions": [[0.0, 0.01]]}, "isn't a single wave on the axis"),
        ({"virtual": {"placement": {"slm1": "flip_x"}}}, {}, "placement.slm1: unknown device"),
        ({"virtual": {"placement": {"coarse": "rotate_90"}}}, {}, "rotate_90; expected a turn that leaves"),
    ],
)
def test_a_wrong_description_is_refused_in_a_sentence(
    tmp_path: Path, changes: dict[str, Any], chain: dict[str, Any], said: str
) -> None:
    path = write_chain_rig(tmp_path, changes, chain_of(**chain))
    with pytest.raises(UserError, match=said) as caught, open_rig(read_rig(path)):
        pass
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("elements", "said"),
    [
        ([PHASE | {"name": "camera"}, SPACE, COARSE], '"camera", a table of its own'),
        ([PHASE, SPACE, COARSE | {"kind": "complex", "levels": None}], "a complex modulator"),
    ],
)
def test_a_chain_that_captures_cannot_hold_is_refused(
    tmp_path: Path, elements: list[dict[str, Any]], said: str
) -> None:
    stated = [{key: value for key, value in element.items() if value is not None} for element in elements]
    path = write_chain_rig(tmp_path, {}, chain_of(*stated))
    with pytest.raises(UserError, match=said):
        read_rig(path)


@pytest.mark.long
def test_captures_of_a_chain_are_measured_and_what_is_hidden_explains_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    hidden = {"effects": {"leakage": {"element": "coarse", "amplitude": 0.2}}}
    write_chain_rig(tmp_path, {"virtual": {"seed": 3, **hidden}})
    (tmp_path / "plan.toml").write_text('each = 2\ndistances = ["3 mm"]\n')
    command = ["measure", "rig.toml", "--plan", "plan.toml", "-o", "seen.h5"]
    assert main([*command, "--dry-run"]) == 0
    assert "phase: virtual\ncoarse: virtual\n" in capsys.readouterr().out
    assert main(command) == 0, capsys.readouterr().err
    captures = read_captures(tmp_path / "seen.h5")
    assert captures.chain is not None and captures.chain.elements == chain_of().elements
    assert len(captures) == 4 and captures.levels.shape == (4, 2, 24, 32)
    # the mean of 4 · 3072 squares of noise is 1 ± √(2/12288): five deviations; the gain takes one number a picture
    assert _left(captures, {"leakage@coarse": {"amplitude": 0.2}}) == pytest.approx(1.0, abs=5 * (2 / 12288) ** 0.5)
    assert _left(captures) > 2
    assert main(["captures", "check", "seen.h5", "--quick"]) == 0


@pytest.mark.usefixtures("bench_here")
def test_the_picture_is_that_of_the_patterns_that_are_shown(tmp_path: Path) -> None:
    rig = read_rig(write_chain_rig(tmp_path, {"virtual": {"seed": 3}}))
    levels = rig.random_levels(np.random.default_rng(2), 1.5)
    with open_rig(rig) as devices:
        assert [modulator.shape for modulator in devices.modulators] == [(24, 32), (12, 16)]
        devices.stage.move_to(4e-3)
        devices.lasers.switch_on(638e-9, 1.0)
        devices.camera.set_exposure(1 / 60)
        pictures = []
        for own in (levels, rig.together(rig.clear_levels), levels):
            devices.show(own)
            devices.clock.wait(1.0)
            pictures.append(devices.camera.take())
        with pytest.raises(UserError, match="a pattern of shape"):
            devices.modulators[1].show(levels[1])
        with pytest.raises(UserError, match="level 64"):
            devices.modulators[1].show(np.full((12, 16), 64, np.uint8))
    taken = [
        rig.capture(own, picture, wavelength_m=638e-9, distance_m=4e-3, power=1.0, exposure_s=1 / 60)
        for own, picture in zip((levels, levels), (pictures[0], pictures[2]), strict=True)
    ]
    for one in taken:  # of 3072 squares
        assert _left(one) == pytest.approx(1.0, abs=5 * (2 / 3072) ** 0.5)
    other = rig.capture(levels, pictures[1], wavelength_m=638e-9, distance_m=4e-3, power=1.0, exposure_s=1 / 60)
    assert _left(other) > 2


@pytest.mark.usefixtures("bench_here")
def test_a_modulator_that_has_not_settled_shows_the_pattern_before(tmp_path: Path) -> None:
    rig = read_rig(write_chain_rig(tmp_path, {"virtual": {"seed": 3, "settle": 0.1}}))
    rng = np.random.default_rng(2)
    first, then = rig.random_levels(rng, 1.5), rig.random_levels(rng, 1.5)
    with open_rig(rig) as devices:
        devices.stage.move_to(4e-3)
        devices.lasers.switch_on(638e-9, 1.0)
        devices.camera.set_exposure(1 / 60)
        for levels, wait_s in ((first, 5.0), (then, 0.1)):
            devices.show(levels)
            devices.clock.wait(wait_s)
        picture = devices.camera.take()
    facts = {"wavelength_m": 638e-9, "distance_m": 4e-3, "power": 1.0, "exposure_s": 1 / 60}
    capture = rig.capture(then, picture, **facts, levels_before=first[None])
    share = {"share": float(np.exp(-1.0))}
    assert _left(capture) > 2
    settling = {"settling@phase": share, "settling@coarse": share}
    assert _left(capture, settling) == pytest.approx(1.0, abs=5 * (2 / 3072) ** 0.5)


@pytest.mark.long
def test_commands_of_a_rig_tell_its_elements(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_chain_rig(tmp_path)
    assert main(["rig", "show", "rig.toml"]) == 0
    told = capsys.readouterr().out
    assert "chain of elements, table" in told and "coarse of 12 × 16 pixels of 16 µm" in told.replace("um", "µm")
    assert main(["rig", "test", "rig.toml"]) == 0
    told = capsys.readouterr().out
    found = re.search(r"phase: patterns arrive at ([\d.]+)% of their size", told)
    assert found is not None and abs(float(found[1]) - 100) < 5  # more would be called a fault
    assert "coarse: its signal isn't checked as that of a phase modulator" in told
    assert main(["rig", "settling", "rig.toml", "--write"]) == 0
    told = capsys.readouterr().out
    assert "phase: settles with a time constant" in told and "coarse: settles with a time constant" in told
    written = read_rig(tmp_path / "rig.toml")
    assert all(float(written.devices[name].options["settle"]) < 0.2 for name in written.modulator_names)


@pytest.mark.long
def test_settling_that_is_measured_stands_in_the_record_by_the_elements_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_chain_rig(tmp_path, {"coarse": {"device": "virtual", "settle": "auto"}})
    (tmp_path / "plan.toml").write_text('each = 1\ndistances = ["3 mm"]\nwavelengths = ["638 nm"]\n')
    assert main(["measure", "rig.toml", "--plan", "plan.toml", "-o", "seen.h5"]) == 0
    record = read_bench_record(tmp_path / "seen.h5")
    assert list(record.settling) == ["coarse"]
    found = record.settling["coarse"]
    assert found.constant_s == pytest.approx(0.02, abs=max(5 * found.deviation_s, 1e-4))


@pytest.mark.long
@pytest.mark.parametrize("fault", [{"scale": 1.25}, {"range": "clipped"}, {"bits": 6}])
def test_a_wrong_signal_of_an_element_is_found(tmp_path: Path, fault: dict[str, Any]) -> None:
    rig = read_rig(write_chain_rig(tmp_path, {"virtual": {"seed": 3, "signal": fault}}))
    with open_rig(rig) as devices:
        checks = {check.name: check for check in check_signals(rig, devices)}
    assert checks["phase"].faults and checks["phase"].faults[0].startswith("phase: ")
    assert not checks["coarse"].faults and checks["coarse"].notes


@pytest.mark.usefixtures("bench_here")
def test_gratings_behind_a_mask_are_not_judged(tmp_path: Path) -> None:
    mask = {
        "kind": "mask",
        "name": "glass",
        "pitch": "8 um",
        "shape": [24, 32],
        "pattern": "random",
        "stroke": "300 nm",
    }
    rig = read_rig(write_chain_rig(tmp_path, {"coarse": None}, chain_of(PHASE, SPACE, mask)))
    with open_rig(rig) as devices:
        (check,) = check_signals(rig, devices)
    assert check.notes == ("phase: its signal isn't checked with glass, of kind mask, in the light",)


@pytest.mark.usefixtures("bench_here")
@pytest.mark.parametrize("name", ["high-contrast", "holochrome-8-static", "dynamic-fourier"])
def test_a_new_rig_of_a_preset_answers(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["rig", "new", "table", "--preset", name]) == 0, capsys.readouterr().err
    rig = read_rig(tmp_path / "table" / "rig.toml")
    assert rig.modulator_names == tuple(preset.load(name).drive_shapes)
    with open_rig(rig) as devices:
        devices.stage.move_to(rig.stage_m[1])
        devices.lasers.switch_on(rig.wavelengths_m[0], 1.0)
        devices.show(rig.clear_levels)
        devices.clock.wait(1.0)
        lit = devices.camera.take()
        devices.lasers.switch_off()
        assert lit.mean() > devices.camera.take().mean() + 10
    assert main(["rig", "new", "table", "--preset", name]) == 2
    assert "is there already" in capsys.readouterr().err


@pytest.mark.parametrize(("name", "said"), [("holochrome-8", "expected a chain"), ("nowhere", "nowhere")])
def test_a_new_rig_of_another_bench_is_refused_before_a_folder_is_made(
    name: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["rig", "new", "table", "--preset", name]) == 2
    assert said in capsys.readouterr().err and not (tmp_path / "table").exists()
