"""A calibration of a chain of elements: a table for each element that shows patterns, its light, and its spaces."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import holoview as hv
from holoview.bench.calibrate.calibration_result import plan_calibration, starting_bench
from holoview.bench.calibrate.train import CalibrationModel, captures_digest, map_layout_for
from holoview.bench.captures import write_captures
from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.commands.cli import main
from holoview.light.model import preset
from holoview.light.model.effects.hook_contexts import ModulatorContext
from holoview.light.model.effects.learned_maps import (
    LearnedMaps,
    MapLayout,
    map_kind,
    read_calibration,
    read_layout,
    write_calibration,
)
from holoview.light.model.system import System
from holoview.util.errors import UserError

PHASE = {"kind": "phase", "pitch": "8 um", "shape": [24, 32], "stroke": "825 nm", "levels": 16}
SPACE = {"kind": "space", "distance": "1 mm", "iris_na": 0.03}
COARSE = {"kind": "amplitude", "name": "coarse", "pitch": "16 um", "shape": [12, 16], "levels": 16}
FLAT = {"kind": "lens", "focal_length": "1000 m"}
LAST = {"kind": "space", "iris_na": 0.03, "name": "to the planes"}
HIDDEN: dict[str, dict[str, float]] = {
    "lut@phase": {"gamma": 1.25},
    "amplitude_gamma@coarse": {"gamma": 1.4},
    "source_profile": {"fall": 0.3, "slope_x": 0.15},
}


def _chain(*elements: dict[str, Any]) -> System:
    return System(["460 nm", "532 nm", "638 nm"], [[1.0] * 3], elements=elements, planes_m=["3 mm"], observer="mono")


@pytest.fixture(scope="module")
def captures() -> Captures:
    """18 captures of a chain with hidden faults on each element."""
    return make_captures(_chain(PHASE, SPACE, COARSE, LAST), HIDDEN, AcquisitionSettings(captures_per_condition=6))


@pytest.fixture(scope="module")
def file(captures: Captures, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("chain") / "captures.h5"
    write_captures(path, captures)
    return path


def _drawn(layout: MapLayout) -> dict[str, torch.Tensor]:
    """Maps that change the light clearly, without a source."""
    sizes = {"lut_steps": 0.4, "fringing_px2": 0.3, "zernike_m": 30e-9}
    random, tensors = torch.Generator().manual_seed(3), {}
    for name, zeros in LearnedMaps.nominal(layout).tensors.items():
        size = 0.0 if name.startswith(("source", "warp")) else sizes.get(map_kind(name), 0.2)
        tensors[name] = size * torch.rand(zeros.shape, generator=random)
    return tensors


def test_maps_of_a_chain_act_as_those_of_the_short_form() -> None:
    """A lens that changes next to nothing, 2e-4 rad at the corners, makes a chain of one modulator."""
    settings = AcquisitionSettings(captures_per_condition=1)
    short, chain = (make_captures(_chain(*e, LAST), {}, settings) for e in ([PHASE], [PHASE, FLAT]))
    assert short.chain is None and chain.chain is not None and np.array_equal(short.levels, chain.levels)
    every = np.arange(3)
    found = []
    for one in (short, chain):
        layout = map_layout_for(one, every)
        assert layout.pupil_nodes == (17, 17) and layout.relay_maps[-1].sine == pytest.approx(0.03)
        model = CalibrationModel(one, layout, {}, double_precision=True)
        model.set_maps(_drawn(layout))
        # exposures, which follow from what the bench shows, may differ
        seconds = torch.from_numpy(one.exposure_s)[:, None, None]
        found += [light / seconds for light in (model.predict([0, 1, 2]), model.predict_nominal([0, 1, 2]))]
    assert float((found[0] - found[1]).norm() / found[1].norm()) > 0.05  # they change the light
    for a, b in zip(found[:2], found[2:], strict=True):
        assert float((a - b).norm() / a.norm()) < 5e-4


@pytest.mark.parametrize("element", ["phase", "coarse"])
def test_each_table_and_space_changes_the_light_alone(captures: Captures, element: str) -> None:
    layout = map_layout_for(captures, np.arange(len(captures)))
    assert layout.elements == ("phase", "coarse") and layout.relays == ("space1", "to the planes")
    model, zeros = CalibrationModel(captures, layout, {}, double_precision=True), LearnedMaps.nominal(layout).tensors
    steps = zeros["lut_steps"].clone()
    steps[layout.elements.index(element)] = torch.linspace(-0.3, 0.3, 15)
    model.set_maps(zeros | {"lut_steps": steps})
    changed, nominal = model.predict([0]), model.predict_nominal([0])
    assert float((changed - nominal).norm() / nominal.norm()) > 1e-3
    # and so it does in an effect that states the same table for this element
    context = ModulatorContext(0, 532e-9, 825e-9, 8e-6, (1, 3), 1, element=element)
    other = dataclasses.replace(context, element=next(name for name in layout.elements if name != element))
    share, learned = torch.tensor([[0.0, 0.5, 1.0]]), LearnedMaps(layout, zeros | {"lut_steps": steps})
    assert not torch.allclose(learned.stroke_response(share, context), share)
    assert torch.allclose(learned.stroke_response(share, other), share)


@pytest.mark.parametrize(
    "name",
    ["lut_steps", "source_opd_m", "zernike_m/space1", "zernike_m/to the planes", "pupil_log_amplitude/to the planes"],
)
def test_gradients_are_what_differences_approach(captures: Captures, name: str) -> None:
    layout = map_layout_for(captures, np.arange(len(captures)))
    model = CalibrationModel(captures, layout, {}, double_precision=True)
    zeros = LearnedMaps.nominal(layout, torch.float64).tensors
    random = torch.Generator().manual_seed(1)
    size = 1e-9 if map_kind(name).endswith("_m") else 1e-2
    way = size * torch.randn(zeros[name].shape, generator=random, dtype=torch.float64)

    def light(step: torch.Tensor) -> torch.Tensor:
        model.set_maps(zeros | {name: zeros[name] + step * way})
        signal = model.predict([0, 5], grad=True)
        return (signal * torch.linspace(0, 1, signal.numel(), dtype=signal.dtype).reshape(signal.shape)).sum()

    step = torch.zeros((), dtype=torch.float64, requires_grad=True)
    (slope,) = torch.autograd.grad(light(step), step)
    ahead, behind = (float(light(torch.tensor(own, dtype=torch.float64))) for own in (1e-3, -1e-3))
    assert float(slope) == pytest.approx((ahead - behind) / 2e-3, rel=1e-4)


@pytest.mark.long
def test_a_calibration_learns_tables_and_light_and_its_preset_shows_them(
    captures: Captures,
    file: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    options = ("--epochs", "60", "--batch", "2", "--pictures", "seen", "--json")
    assert main(["calibrate", str(file), "-o", "c.toml", *options]) == 0
    told = capsys.readouterr()
    assert "to the planes and the camera can't be told apart" in told.err
    assert "what black pixels of coarse let through is for a diagnosis" in told.err
    scores = {row["group"]: row for row in json.loads(told.out)["scores"] if row["wavelength_nm"] is None}
    before, after = (scores["captures"][when]["chi2_per_pixel"] for when in ("before", "after"))
    assert after < before / 5
    assert {path.name for path in (tmp_path / "seen").iterdir()} == {
        "source.png",
        "lut.png",
        "residual.png",
        "pupils.png",
    }
    learned = read_calibration(tmp_path / "c.safetensors").maps
    share = torch.linspace(0, 1, 16)
    for index, gamma in ((0, 1.25), (1, 1.4)):
        error = (
            (learned.response_table(index) / learned.response_table(index)[-1] - share**gamma).square().mean().sqrt()
        )
        assert float(error) < 0.5 * float((share - share**gamma).square().mean().sqrt())
    system = preset.load(tmp_path / "c.toml")
    assert system.is_chain and system.effect_values["calibrated"]["file"] == str(tmp_path / "c.safetensors")
    assert main(["render", "c.toml", "--random", "1", "--backend", "torch", "-o", "c.png"]) == 0
    assert main(["info", "c.toml"]) == 0


def test_the_calibrated_bench_is_the_same_for_the_simulation_and_the_predictor(
    captures: Captures, tmp_path: Path
) -> None:
    layout = map_layout_for(captures, np.arange(len(captures)))
    tensors = _drawn(layout) | {"source_log_amplitude": 0.3 * torch.rand(layout.shapes()["source_log_amplitude"])}
    write_calibration(tmp_path / "maps.safetensors", LearnedMaps(layout, tensors), {})
    model = CalibrationModel(captures, layout, {}, double_precision=True)
    model.set_maps(tensors)
    chain = captures.chain
    assert chain is not None
    number = int(np.flatnonzero(captures.wavelength_m == chain.wavelengths_m[1])[0])
    bench = chain.edit({"amplitudes": [[0.0, 1.0, 0.0]], "effects.calibrated.file": str(tmp_path / "maps.safetensors")})
    drive = {name: own[None] for name, own in captures.patterns(captures.drive(number)).items()}
    seen = hv.simulate(bench, drive, planes=["3 mm"], backend="torch64").intensity
    found = model.predict([number])[0].numpy()
    shown = np.asarray(seen).reshape(-1, *found.shape).sum(axis=0)  # the other lasers are off
    # a camera pixel of the sample's size that has the light at its middle: the samples themselves
    assert np.linalg.norm(found / found.sum() - shown / shown.sum()) < 1e-6 * np.linalg.norm(shown / shown.sum())


@pytest.mark.parametrize(
    ("edits", "said"),
    [
        ({"elements.space1.distance": "2 mm"}, "elements.space1.distance"),
        ({"elements.coarse.shape": [10, 16]}, "elements.coarse.shape"),
        ({"elements.space1.iris_na": 0.02}, "elements.space1.iris_na"),
    ],
)
def test_a_preset_of_another_chain_is_refused_by_the_element(
    captures: Captures, edits: dict[str, Any], said: str
) -> None:
    chain = captures.chain
    assert chain is not None and starting_bench(captures, chain, "") == chain
    with pytest.raises(UserError, match=said):
        starting_bench(captures, chain.edit(edits), "")
    with pytest.raises(UserError, match="a chain of elements, as the captures' file tells"):
        starting_bench(captures, hv.load("holochrome-8"), "")
    with pytest.raises(UserError, match="number of elements"):
        starting_bench(captures, _chain(PHASE, SPACE, COARSE), "")


def test_maps_of_other_elements_are_refused(captures: Captures, tmp_path: Path) -> None:
    layout = map_layout_for(captures, np.arange(len(captures)))
    path = tmp_path / "maps.safetensors"
    write_calibration(path, LearnedMaps.nominal(layout), {})
    other = _chain(PHASE | {"name": "panel"}, SPACE, COARSE)
    for bench in (other, hv.load("holochrome-8").with_(shape=[24, 32])):
        with pytest.raises(UserError, match="maps of phase, coarse"):
            hv.make_plan(bench.edit({"effects.calibrated.file": str(path)}))


def test_captures_of_other_distances_have_another_digest(captures: Captures) -> None:
    chain = captures.chain
    assert chain is not None
    other = dataclasses.replace(captures, chain=chain.edit({"elements.space1.distance": "2 mm"}))
    assert captures_digest(captures) != captures_digest(other)


@pytest.mark.parametrize(
    ("edits", "said"),
    [
        ({"elements": ("phase", "phase")}, "elements"),
        ({"modulators": 3}, "elements"),
        ({"relays": ("space1",)}, "relays"),
        ({"relays": ("space1", "space1")}, "relays"),
        ({"relays": ("space1", "")}, "relays"),
        ({"elements": (), "modulators": 2}, "relays"),
        ({"sines": (0.03, 2.0)}, "sines"),
        ({"sines": (), "relays": ("space1", "")}, "relays"),
    ],
)
def test_a_layout_with_wrong_names_is_refused(captures: Captures, edits: dict[str, Any], said: str) -> None:
    layout = map_layout_for(captures, np.arange(len(captures)))
    assert read_layout(layout.to_json(), "layout") == layout
    with pytest.raises(UserError, match=f"layout: {said}"):
        read_layout(dataclasses.replace(layout, **edits).to_json(), "layout")


def test_a_file_of_a_former_version_acts_on_its_two_spaces(captures: Captures, tmp_path: Path) -> None:
    """Its layout has no sines, and its tensors the numbers of the relays."""
    layout = map_layout_for(captures, np.arange(len(captures)))
    first, last = layout.sines
    former = dataclasses.replace(layout, sines=(), sine1=first, sine2=last)
    assert "zernike1_m" in former.shapes() and "sines" not in json.loads(former.to_json())
    tensors = _drawn(former)
    write_calibration(tmp_path / "maps.safetensors", LearnedMaps(former, tensors), {})
    read = read_calibration(tmp_path / "maps.safetensors").maps
    assert read.layout == former
    pairs = zip(former.relay_maps, layout.relay_maps, strict=True)
    renamed = {old: new for a, b in pairs for old, new in ((a.zernike, b.zernike), (a.pupil, b.pupil))}
    signals = []
    for own, values in ((former, read.tensors), (layout, {renamed.get(n, n): t for n, t in read.tensors.items()})):
        model = CalibrationModel(captures, own, {}, double_precision=True)
        model.set_maps(values)
        signals.append(model.predict([0]))
    assert torch.equal(*signals)


@pytest.mark.long
def test_the_space_before_the_third_element_is_learned() -> None:
    """An aberration between the second and the third of three elements: neither the first space nor the last one."""
    third = COARSE | {"name": "third"}
    chain = _chain(PHASE, SPACE, COARSE, SPACE | {"distance": "2 mm"}, third, LAST)
    hidden = {"aberration@space2": {"z6": 40e-9, "z7": 32e-9}}
    captures = make_captures(chain, hidden, AcquisitionSettings(captures_per_condition=5))
    task = plan_calibration(captures, None, "three", {"epochs": 25, "batch": 2}, None)
    layout = task.layout
    assert layout.elements == ("phase", "coarse", "third")
    assert layout.relays == ("space1", "space2", "to the planes") and layout.sines == pytest.approx((0.03,) * 3)
    states = list(task.train(None))
    assert states[-1].best_chi2 < states[0].validation_chi2 / 10
    learned = states[-1].best_maps.tensors
    sizes = {own.name: float(learned[own.zernike].norm()) for own in layout.relay_maps}
    assert sizes.pop("space2") > 2 * max(sizes.values())
    truth = torch.tensor([hidden["aberration@space2"].get(f"z{noll}", 0.0) for noll in layout.noll1])
    found = learned["zernike_m/space2"][:, 0]
    assert float(found @ truth / (found.norm() * truth.norm())) > 0.9
    assert 0.5 < float(found.norm() / truth.norm()) < 1.5
