"""`holoview render`: where patterns come from, which planes, what the PNG carries, and which backend made it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import holoview as hv
from holoview.holograms.hologram import Hologram
from holoview.light.colour import srgb_encode
from holoview.light.gpu.device import Device
from holoview.light.model import preset
from tests.pattern_file import write_pattern

Run = Callable[..., Any]

SHAPE = (24, 32)
SMALL = ("--set", "shape=[24,32]")
TORCH = (*SMALL, "--backend", "torch")
GOLDEN_TOLERANCE = 1
"""Of 255: complex64 may round to the neighbouring level of complex128."""


def _system(name: str = "holochrome-8", **changes: Any) -> hv.System:
    return hv.load(name).edit({"shape": list(SHAPE)} | changes)


def _pixels(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image).astype(int)


def _texts(path: Path) -> dict[Any, Any]:
    with Image.open(path) as image:
        return image.info


def _assert_golden(path: Path, system: hv.System, drive: np.ndarray, plane: str) -> None:
    golden = hv.simulate(system, drive, [plane], "torch64").srgb8[0]
    assert golden.std() > 10, "a flat picture would compare equal to anything flat"
    assert np.abs(_pixels(path) - golden).max() <= GOLDEN_TOLERANCE


def test_the_middle_plane_of_random_patterns_is_the_default(holoview: Run, tmp_path: Path) -> None:
    outcome = holoview("render", "holochrome-8", *TORCH)
    assert outcome.code == 0
    assert outcome.out.startswith("backend: torch, complex64 (")
    assert "10 mm: holochrome-8.png  raw speckle contrast 0." in outcome.out
    system = _system()
    _assert_golden(tmp_path / "holochrome-8.png", system, hv.random_drive(system, 0), "10 mm")


def test_hues_are_kept_on_request_and_numbers_stay(holoview: Run, tmp_path: Path) -> None:
    """Light brighter than the screen's white is divided by its largest channel, and its channels keep their ratios."""
    arguments = ("render", "holochrome-8", *TORCH, "--exposure", "5", "--json")
    clipped = holoview(*arguments, "-o", "clipped.png")
    kept = holoview(*arguments, "--keep-hues", "-o", "kept.png")
    assert clipped.code == kept.code == 0
    numbers = [json.loads(outcome.out)["planes"][0] for outcome in (clipped, kept)]
    for key in ("speckle_contrast", "mean_luminance", "light_budget"):
        assert numbers[0][key] == numbers[1][key]
    system = _system()
    rgb = hv.simulate(system, hv.random_drive(system, 0), ["10 mm"], "torch64").exposed(5.0).rgb[0]
    bright = (rgb.min(axis=-1) > 0) & (rgb.max(axis=-1) > 1.01)
    assert bright.sum() > 50
    expected = 255 * srgb_encode(rgb[bright] / rgb[bright].max(axis=-1, keepdims=True))
    assert np.abs(_pixels(tmp_path / "kept.png")[bright] - expected).max() <= GOLDEN_TOLERANCE + 0.5
    assert np.abs(_pixels(tmp_path / "clipped.png")[bright] - expected).max() > 20
    for other in (("--colour-space", "p3"), ("--show", "phase"), ("-o", "light.npz")):
        refused = holoview(*arguments, "--keep-hues", *other)
        assert refused.code == 2 and "--keep-hues: with" in refused.err and refused.err.count("\n") == 1


def test_numbers_of_light_tell_where_the_light_went_as_pictures_do(holoview: Run) -> None:
    pictures = holoview("render", "holochrome-8", *TORCH, "--plane", "all", "--json")
    numbers = holoview("render", "holochrome-8", *TORCH, "--plane", "all", "--json", "-o", "light.npz")
    told = [[plane["light_budget"] for plane in json.loads(of.out)["planes"]] for of in (pictures, numbers)]
    assert told[0] == told[1] and len(told[0]) == 5
    assert all(sum(budget.values()) == pytest.approx(1.0, abs=1e-5) for budget in told[0])


@pytest.mark.gpu
def test_shaders_render_the_same_picture(holoview: Run, tmp_path: Path, device: Device) -> None:
    outcome = holoview(
        "render", "holochrome-8", *SMALL, "--random", 7, "--plane", "9.3mm", "--backend", "wgpu", "-o", "seen.png"
    )
    assert outcome.code == 0
    system = _system()
    _assert_golden(tmp_path / "seen.png", system, hv.random_drive(system, 7), "9.3 mm")


@pytest.mark.gpu
def test_the_adapter_is_named_and_a_cpu_or_opengl_one_called_so(holoview: Run, device: Device) -> None:
    out = holoview("render", "holochrome-8", *SMALL, "-o", "seen.png").out
    assert f"backend: wgpu: {device.info.label} (" in out
    assert ("a CPU adapter" in out) == device.info.is_cpu
    assert ("through OpenGL only" in out) == device.info.is_opengl


def test_each_plane_is_a_numbered_file_written_once(holoview: Run, tmp_path: Path) -> None:
    holoview("render", "simultaneous", *TORCH, "--plane", "10mm", "9.5 mm", "--plane", "1cm", "-o", "seen.png")
    assert {path.name for path in tmp_path.iterdir()} == {"seen-10mm.png", "seen-9.5mm.png"}


def test_all_stands_for_the_planes_of_the_bench(holoview: Run) -> None:
    out = holoview("render", "simultaneous", *TORCH, "--plane", "all", "12mm", "10mm", "-o", "seen.png", "--json").out
    planes = [entry["plane"] for entry in json.loads(out)["planes"]]
    assert planes == ["9 mm", "9.5 mm", "10 mm", "10.5 mm", "11 mm", "12 mm"]


def test_an_eye_is_focused_in_dioptres(holoview: Run) -> None:
    eye = (*TORCH, "--set", "eye.pupil=2 mm")
    found = holoview("render", "simultaneous", *eye, "--plane", "0.5D", "9mm", "-o", "seen.png", "--json")
    planes = [(entry["plane"], entry["file"]) for entry in json.loads(found.out)["planes"]]
    assert planes == [("9.8 mm (0.5 D)", "seen-9.8mm.png"), ("9 mm (0 D)", "seen-9mm.png")]
    refused = holoview("render", "simultaneous", *TORCH, "--plane", "0.5D")
    assert refused.code == 2 and "--plane: 0.5D without an eye" in refused.err and "--set eye={}" in refused.err


def test_arguments_may_come_in_any_order(holoview: Run, tmp_path: Path) -> None:
    first = holoview("render", "simultaneous", *TORCH, "--plane", "10mm", "-o", "a.png")
    second = holoview("render", "--plane", "10mm", "-o", "b.png", *TORCH, "simultaneous")
    assert (first.code, second.code) == (0, 0)
    assert np.array_equal(_pixels(tmp_path / "a.png"), _pixels(tmp_path / "b.png"))


def test_the_picture_says_how_it_was_made(holoview: Run, tmp_path: Path) -> None:
    holoview("render", "simultaneous", *TORCH, "--exposure", "-1.5", "--set", "gap=3 mm", "-o", "seen.png")
    texts = _texts(tmp_path / "seen.png")
    assert texts["Software"] == f"holoview {hv.__version__}"
    assert texts["holoview.preset"] == "simultaneous"
    assert texts["holoview.plane"] == "10 mm"
    assert texts["holoview.exposure"] == "-1.5 stops"
    assert texts["holoview.backend"] == "torch, complex64"
    assert preset.loads(texts["holoview.system"]) == _system("simultaneous", gap="3 mm")


def test_json_says_what_was_made_and_nothing_else_is_on_stdout(holoview: Run) -> None:
    table = json.loads(holoview("render", "simultaneous", *TORCH, "--json", "-o", "seen.png").out)
    assert (table["preset"], table["backend"]) == ("simultaneous", "torch, complex64")
    (entry,) = table["planes"]
    assert (entry["plane"], entry["file"]) == ("10 mm", "seen.png")
    assert 0.1 < entry["speckle_contrast"] < 2
    assert entry["mean_luminance"] > 0


def test_two_seeds_give_two_speckles_and_one_seed_gives_one(holoview: Run, tmp_path: Path) -> None:
    for seed, name in ((1, "a"), (2, "b"), (1, "c")):
        holoview("render", "simultaneous", *TORCH, "--random", seed, "-o", f"{name}.png")
    a, b, c = (_pixels(tmp_path / f"{name}.png") for name in "abc")
    assert np.array_equal(a, c)
    assert np.abs(a - b).mean() > 10


@pytest.mark.parametrize("bits", [8, 16])
def test_pattern_files_are_shown_as_the_drive_they_hold(holoview: Run, tmp_path: Path, bits: int) -> None:
    system = _system("simultaneous")
    levels = 2**bits - 1
    drive = (np.rint(hv.random_drive(system, 5).astype(np.float64) * levels) / levels).astype(np.float32)
    for number in (0, 1):
        write_pattern(tmp_path / f"{number}.png", drive[0, number], bits)
    holoview("render", "simultaneous", *TORCH, "--slm1", "0.png", "--slm2", "1.png", "-o", "seen.png")
    _assert_golden(tmp_path / "seen.png", system, drive, "10 mm")


def test_several_frames_take_a_pattern_each(holoview: Run, tmp_path: Path) -> None:
    system = _system("time-sequential-1slm")
    drive = np.rint(hv.random_drive(system, 2) * 255).astype(np.float32) / np.float32(255)
    for frame in range(3):
        write_pattern(tmp_path / f"{frame}.png", drive[frame, 0])
    arguments = ("--slm1", "0.png", "1.png", "--slm1", "2.png")
    assert holoview("render", "time-sequential-1slm", *TORCH, *arguments, "-o", "seen.png").code == 0
    _assert_golden(tmp_path / "seen.png", system, drive, "10 mm")


def test_a_hologram_is_shown_on_its_own_bench_or_another_with_its_lasers(holoview: Run, tmp_path: Path) -> None:
    system = _system("simultaneous", amplitudes=[[0.2, 0.1, 0.3]], gap="1 mm")
    drive = hv.random_drive(system, 9)
    Hologram(drive, system).save(tmp_path / "h.safetensors")
    holoview("render", "--hologram", "h.safetensors", "--backend", "torch", "-o", "own.png")
    _assert_golden(tmp_path / "own.png", system, drive, "10 mm")
    assert holoview("render", "holochrome-8", *TORCH, "--hologram", "h.safetensors", "-o", "other.png").code == 0
    _assert_golden(tmp_path / "other.png", system.with_(gap="2 mm"), drive, "10 mm")


def test_a_stop_of_exposure_doubles_the_light(holoview: Run) -> None:
    def luminance(*arguments: str) -> float:
        out = holoview("render", "simultaneous", *TORCH, "--json", "-o", "seen.png", *arguments).out
        return float(json.loads(out)["planes"][0]["mean_luminance"])

    assert luminance("--exposure", "1") == pytest.approx(2 * luminance(), rel=1e-6)


def test_a_black_picture_is_written_with_a_note(holoview: Run, tmp_path: Path) -> None:
    outcome = holoview("render", "simultaneous", *TORCH, "--exposure", "-60", "-o", "seen.png")
    assert outcome.code == 0
    assert "every picture is black" in outcome.err
    assert not _pixels(tmp_path / "seen.png").any()


def test_a_bench_that_no_light_passes_is_refused(holoview: Run, tmp_path: Path) -> None:
    write_pattern(tmp_path / "flat.png", np.zeros(SHAPE, np.float32))
    blocked = ("--set", "relay2.square=none", "--set", "relay2.dc_block_na=0.9", "--set", "relay2.iris_na=0.91")
    arguments = ("render", "simultaneous-1slm", *TORCH, *blocked, "--slm1", "flat.png", "-o", "seen.png")
    refused = holoview(*arguments)
    assert refused.code == 2 and "light" in refused.err and not (tmp_path / "seen.png").exists()


def test_auto_says_that_it_took_torch_and_why(holoview: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("holoview.light.gpu.device.native_adapters", list)
    outcome = holoview("render", "simultaneous", *SMALL, "-o", "seen.png")
    assert outcome.code == 0
    assert "backend: torch, complex64 (chosen because: graphics adapter: none was found; " in outcome.out
    assert "chosen because" in _texts(tmp_path / "seen.png")["holoview.backend"]


def test_what_the_model_isnt_true_of_is_told_beside_the_picture(holoview: Run) -> None:
    near = ("render", "holochrome-8", *TORCH, "--plane", "0.5mm", "-o", "out.png")
    assert "note:" not in holoview(*near).err
    outcome = holoview(*near, "--set", "upsample=1")
    assert outcome.code == 0
    assert "note: samples a pixel: with 1 sample a pixel, light at the edge of the first order" in outcome.err
    notes = json.loads(holoview(*near, "--set", "upsample=1", "--json").out)["notes"]
    assert [note.split(":")[0] for note in notes] == ["samples a pixel"]


@pytest.mark.parametrize("pitch", ["0.1 um", "0.3 um"])
def test_what_would_be_uniform_whatever_the_patterns_is_refused(holoview: Run, tmp_path: Path, pitch: str) -> None:
    outcome = holoview("render", "holochrome-8", *TORCH, "--set", f'pitch="{pitch}"')
    assert outcome.code == 2 and len(outcome.err.splitlines()) == 1
    assert "holds nothing but light that goes straight on" in outcome.err
    assert not list(tmp_path.glob("*.png"))


@pytest.mark.parametrize("space", ["srgb", "p3", "rec2020"])
def test_a_picture_of_16_bits_says_its_colour_space(holoview: Run, tmp_path: Path, space: str) -> None:
    output = tmp_path / "deep.png"
    assert holoview("render", "holochrome-8", *TORCH, "--colour-space", space, "-o", output).code == 0
    data = output.read_bytes()
    assert data[24:26] == bytes((16, 2)) and b"cICP" in data
