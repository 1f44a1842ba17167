"""Every mistake is one line on stderr (where, what, what is expected, what to do), code 2, and nothing written."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn

import imagecodecs
import numpy as np
import pytest
from PIL import Image

import holoview as hv
from holoview.holograms.hologram import Hologram
from holoview.light.gpu.device import Device
from tests.cli.conftest import SRGB
from tests.file_limits import limit_of_file_size

Run = Callable[..., Any]
Files = dict[str, tuple[int, int]]

SHAPE = (24, 32)
SMALL = ["--set", "shape=[24,32]"]
RENDER = ["render", "holochrome-8", *SMALL, "--backend", "torch", "-o", "seen.png"]
ONE = ["render", "holochrome-8-1slm", *SMALL, "--backend", "torch", "-o", "seen.png"]
OPTIMISE = ["optimise", "holochrome-8", *SMALL, "--iterations", "1", "-o", "h.safetensors"]


def _preset(folder: Path, name: str, text: str) -> None:
    (folder / name).write_text(f'base = "holochrome-8"\n{text}\n', encoding="utf-8")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path) -> Path:
    """An empty folder filled with things that are wrong in one way each."""
    rng = np.random.default_rng(0)
    grey = rng.integers(0, 256, SHAPE, dtype=np.uint8)
    Image.fromarray(grey).save(tmp_path / "grey.png")
    Image.fromarray(grey).save(tmp_path / "grey.jpg")
    Image.fromarray(grey[:, 1:]).save(tmp_path / "narrow.png")
    Image.fromarray(rng.integers(0, 256, (*SHAPE, 3), dtype=np.uint8)).save(tmp_path / "colour.png", icc_profile=SRGB)
    Image.fromarray(np.stack([grey, grey // 2], axis=-1)).save(tmp_path / "glass.png")
    Image.fromarray(np.zeros((*SHAPE, 3), np.uint8)).save(tmp_path / "black.png", icc_profile=SRGB)
    deep = rng.integers(0, 65536, (*SHAPE, 3)).astype(np.uint16)
    (tmp_path / "colour16.png").write_bytes(imagecodecs.png_encode(deep))
    data = (tmp_path / "grey.png").read_bytes()
    (tmp_path / "half.png").write_bytes(data[: len(data) // 2])
    (tmp_path / "text.png").write_text("not a picture")
    (tmp_path / "empty.png").touch()
    np.save(tmp_path / "deep.npy", np.full(SHAPE, 2.0))
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "folder.safetensors").mkdir()
    system = hv.load("holochrome-8").edit({"shape": [12, 16]})
    Hologram(hv.random_drive(system), system).save(tmp_path / "other.safetensors")
    _preset(tmp_path, "unit.toml", 'gap = "2 furlong"')
    _preset(tmp_path, "negative.toml", '[[modulators]]\npitch = "-8 um"\nshape = [24, 32]\nstroke = "825 nm"')
    _preset(tmp_path, "single.toml", '[[modulators]]\npitch = "8 um"\nshape = [24, 32]\nstroke = "825 nm"')
    _preset(tmp_path, "table.toml", "amplitudes = [[1, 1], [1, 1]]")
    _preset(tmp_path, "behind.toml", 'planes = ["9 mm", "-1 mm"]')
    _preset(tmp_path, "key.toml", "pitch = 3")
    (tmp_path / "loop.toml").write_text('base = "loop.toml"\n')
    (tmp_path / "broken.toml").write_text("gap = \n")
    return tmp_path


def _files(folder: Path) -> Files:
    return {str(path): (path.stat().st_size, path.stat().st_mtime_ns) for path in folder.rglob("*")}


def _assert_refused(holoview: Run, folder: Path, arguments: list[str], fragments: list[str]) -> None:
    before = _files(folder)
    outcome = holoview(*arguments)
    assert outcome.code == 2, outcome.out
    assert outcome.out == ""
    assert len(outcome.err.splitlines()) == 1, outcome.err
    assert outcome.err.startswith("holoview: ")
    for fragment in fragments:
        assert fragment in outcome.err
    assert _files(folder) == before


PRESETS: list[tuple[list[str], list[str]]] = [
    (["info", "holochrom-8"], ['preset "holochrom-8"', "unknown", "did you mean holochrome-8"]),
    (["info", "zzz"], ['preset "zzz"', "known: ", "simultaneous"]),
    (["info", "missing.toml"], ["missing.toml", "no such file", "holoview presets"]),
    (["info", "broken.toml"], ["broken.toml", "isn't TOML", "line 1"]),
    (["info", "loop.toml"], ["loop.toml", "its base leads back to itself"]),
    (["info", "key.toml"], ["key.toml: pitch", "unknown key"]),
    (["info", "unit.toml"], ["unit.toml: gap", '"2 furlong"', "expected a length", "mm"]),
    (["info", "negative.toml"], ["negative.toml: modulators[0].pitch", "-8 um", "between 0.01 um and 1000 um"]),
    (["info", "single.toml"], ["single.toml: gap", "2 mm with one modulator", "add a second [[modulators]]"]),
    (["info", "table.toml"], ["table.toml: amplitudes", "(2, 2)", "(frames, 8)"]),
    (["render", "behind.toml"], ["behind.toml: planes[1]", "-1 mm", "between 0 mm and"]),
]

CHANGES: list[tuple[str, list[str]]] = [
    ("gap", ["--set gap", "KEY=VALUE"]),
    ("=3", ["--set =3", "KEY=VALUE"]),
    ("gap=", ["gap", '""', "expected a number and a unit"]),
    ("gap=nan", ["gap", "nan", "between 0 mm"]),
    ("gap=2 furlong", ["gap", '"2 furlong"', "expected a length"]),
    ("gap=3\nfurlong", ["gap", "furlong"]),
    ("pitch=-8 um", ["pitch", "-8 um is out of range", "between 0.01 um"]),
    ("nosuch=1", ["nosuch", "unknown key"]),
    ("relay2.iris=0.1", ["relay2.iris", "unknown key", "iris_na"]),
    ("amplitudes=[1,2]", ["amplitudes", "(1, 2)", "expected (frames, 8)"]),
    ("amplitudes=black", ["amplitudes", '"black"', '"white"']),
    ('wavelengths=["500 nm","600 nm"]', ["amplitudes", "(1, 8)", "give amplitudes together with wavelengths"]),
    ("frames=0", ["frames", "0", "a whole number from 1"]),
    ("shape=[0,3]", ["shape[0]", "0", "a whole number from 2"]),
    ("upsample=2.5", ["upsample", "2.5", "a whole number"]),
]

PATTERNS: list[tuple[list[str], list[str]]] = [
    ([*ONE, "--slm1", "narrow.png"], ["narrow.png", "31 x 24 pixels", "expected 32 x 24 pixels"]),
    ([*ONE, "--slm1", "colour.png"], ["colour.png", "is a coloured picture", "expected a greyscale pattern"]),
    ([*ONE, "--slm1", "colour16.png"], ["colour16.png", "is a coloured picture"]),
    ([*ONE, "--slm1", "glass.png"], ["glass.png", "is partly transparent", "expected"]),
    ([*ONE, "--slm1", "half.png"], ["half.png", "truncated or damaged"]),
    ([*ONE, "--slm1", "text.png"], ["text.png", "isn't a PNG", "expected a pattern"]),
    ([*ONE, "--slm1", "grey.jpg"], ["grey.jpg", "isn't a PNG", "expected a pattern"]),
    ([*ONE, "--slm1", "empty.png"], ["empty.png", "the file is empty"]),
    ([*ONE, "--slm1", "missing.png"], ["missing.png", "no such file"]),
    ([*ONE, "--slm1", "folder.png"], ["folder.png", "is a folder"]),
    ([*ONE, "--slm1", "grey.png", "grey.png"], ["patterns", "2 for modulator 1", "1 for --slm1", "holochrome-8-1slm"]),
    ([*RENDER, "--slm1", "grey.png"], ["patterns", "1 for modulator 1", "1 for --slm1 and 1 for --slm2"]),
    ([*RENDER, "--slm2", "grey.png"], ["--slm2", "without --slm1"]),
    ([*RENDER, "--slm1", "grey.png", "--random", "1"], ["--slm1 with --random", "expected one of them"]),
    ([*RENDER, "--hologram", "other.safetensors"], ["other.safetensors", "(1, 2, 12, 16)", "(1, 2, 24, 32)"]),
    ([*RENDER, "--hologram", "grey.png"], ["grey.png", "can't be read", "hologram file"]),
    ([*RENDER, "--hologram", "missing"], ["missing", "no such file", "hologram file"]),
]

PICTURES: list[tuple[list[str], list[str]]] = [
    (
        ["text.png"],
        ["text.png", "is not a picture", "GIF, PNG, JPEG, TIFF or OpenEXR"],
    ),
    (["half.png"], ["half.png", "truncated or damaged"]),
    (["empty.png"], ["empty.png", "the file is empty"]),
    (["missing.png"], ["missing.png", "no such file", "check the name"]),
    (["folder.png"], ["folder.png", "holds no pictures", "one a plane"]),
    (["black.png"], ["black everywhere"]),
    (["colour.png", "--depth", "narrow.png"], ["narrow.png", "31 x 24 pixels", "the picture's size, 32 x 24"]),
    (["colour.png", "--depth", "colour.png"], ["colour.png", "is in colour", "expected depths"]),
    (["colour.png", "--depth", "deep.npy"], ["deep.npy", "depths from 2 to 2", "0 (nearest) … 1 (farthest)"]),
    (["colour.png", "--depth", "grey.png", "--at", "9mm"], ["grey.png", "a depth map and one distance"]),
    (
        ["colour.png", "--depth", "grey.png", "--near", "9mm", "--far", "11mm"],
        ["depth range", "near at 9 mm, far at 11 mm", "exchange the two"],
    ),
    (["colour.png", "--near", "9mm"], ["--near/--far", "without --depth", "--at"]),
    (["colour.png", "--at", "30mm"], ["30 mm", "inside the planes, 9 mm to 11 mm"]),
    (["colour.png", "--at", "-3mm"], ["-3 mm", "inside the planes"]),
    (["colour.png", "--start", "other.safetensors"], ["(1, 2, 12, 16)", "(1, 2, 24, 32)"]),
    (["colour.png", "--start", "grey.png"], ["grey.png", "can't be read"]),
]

NUMBERS: list[tuple[list[str], list[str]]] = [
    ([*RENDER, "--plane", "-1mm"], ["--plane", "-1mm lies before the last modulator", "expected 0 mm or more"]),
    ([*RENDER, "--plane=-1mm"], ["--plane", "-1mm lies before the last modulator"]),
    ([*RENDER, "--plane", "nan"], ["--plane", '"nan"', "a number and a unit"]),
    ([*RENDER, "--plane", "10"], ["--plane", '"10" has no unit']),
    ([*RENDER, "--plane", "1e9mm"], ["planes[0]", "1e+09 mm is out of range", "between 0 mm and 1000 mm"]),
    ([*RENDER, "--plane"], ["--plane", "expected at least one argument", "holoview render --help"]),
    ([*RENDER, "--exposure", "inf"], ["--exposure", "inf", "a finite number"]),
    ([*RENDER, "--exposure", "200"], ["--exposure", "200", "from -60 to 60 stops"]),
    ([*RENDER, "--exposure", "x"], ["--exposure", "'x'", "holoview render --help"]),
    ([*RENDER, "--random", "-1"], ["--random", "-1", "a whole number from 0"]),
    ([*RENDER, "--random", "1.5"], ["--random", "1.5", "a whole number from 0"]),
    ([*OPTIMISE, "colour.png", "--iterations", "0"], ["iterations", "0", "at least 1"]),
    ([*OPTIMISE, "colour.png", "--brightness", "-1"], ["--brightness", "-1", "a factor from"]),
    ([*OPTIMISE, "colour.png", "--brightness", "inf"], ["--brightness", "inf", "a finite number"]),
    ([*OPTIMISE, "colour.png", "--step", "nan"], ["step", "nan", "a finite number"]),
    ([*OPTIMISE, "colour.png", "--seed", "-1"], ["--seed", "-1", "a whole number from 0"]),
    (["demo", "--iterations", "0"], ["iterations", "0", "at least 1"]),
    (["demo", "--shape", "4", "4"], ["--shape", "4 4", "at least 16"]),
]

OUTPUTS: list[tuple[list[str], list[str]]] = [
    ([*RENDER, "-o", "nowhere/seen.png"], ["nowhere/seen.png", "the folder nowhere doesn't exist", "create it"]),
    ([*RENDER, "-o", "folder.png"], ["folder.png", "is a folder", "expected the name of a .png file"]),
    ([*RENDER, "-o", "seen.jpg"], ["seen.jpg", '".jpg"', "expected .png"]),
    ([*RENDER, "-o", "seen"], ["seen", "suffix", "expected .png"]),
    ([*RENDER, "-o", ""], ["suffix", "expected .png"]),
    ([*RENDER, "-o", "x" * 300 + ".png"], [os.strerror(errno.ENAMETOOLONG)]),
    ([*OPTIMISE, "colour.png", "-o", "nowhere/h.safetensors"], ["the folder nowhere doesn't exist"]),
    ([*OPTIMISE, "colour.png", "-o", "folder.safetensors"], ["folder.safetensors", "is a folder"]),
    ([*OPTIMISE, "colour.png", "-o", "h.png"], ["h.png", '".png"', "expected .safetensors"]),
    (["export", "missing", "--png", "out"], ["missing", "no such file", "hologram's file"]),
    (["export", "other.safetensors", "--png", "grey.png"], ["grey.png", "can't be made", "choose another folder"]),
    (["export", "other.safetensors", "--png", "out", "--levels"], ["--levels", "continuous", "leave it out"]),
    (["demo", "-o", "grey.png"], ["grey.png", "is a file", "expected a folder"]),
]

USAGE: list[tuple[list[str], list[str]]] = [
    ([], ["COMMAND", "holoview --help"]),
    (["nosuch"], ["'nosuch'", "presets", "render", "holoview --help"]),
    (["info"], ["PRESET|FILE", "required", "holoview info --help"]),
    (["optimise", "holochrome-8"], ["TARGET", "required", "holoview optimise --help"]),
    (["presets", "--nope"], ["--nope"]),
    (["info", "holochrome-8", "--json", "--toml"], ["--toml", "not allowed with", "--json"]),
    (["render"], ["PRESET", "is missing", "--hologram FILE"]),
    (["render", "--plane", "10mm", "holochrome-8"], ["PRESET", "is missing", "give it first"]),
]

BACKENDS: list[tuple[list[str], list[str]]] = [
    ([*RENDER, "--backend", "cuda"], ["backend", '"cuda"', "expected auto or wgpu or torch"]),
    ([*RENDER, "--adapter", "nosuch"], ["--adapter", "with --backend torch", "expected --backend wgpu or auto"]),
    (["demo", "--backend", "cuda"], ["backend", '"cuda"']),
]


@pytest.mark.parametrize(
    ("arguments", "fragments"),
    [*PRESETS, *PATTERNS, *NUMBERS, *OUTPUTS, *USAGE, *BACKENDS],
    ids=lambda v: " ".join(v)[:60],
)
def test_a_mistake_is_refused_in_one_line(
    holoview: Run, folder: Path, arguments: list[str], fragments: list[str]
) -> None:
    _assert_refused(holoview, folder, arguments, fragments)


@pytest.mark.parametrize(("change", "fragments"), CHANGES, ids=lambda v: v if isinstance(v, str) else "")
def test_a_wrong_change_is_refused(holoview: Run, folder: Path, change: str, fragments: list[str]) -> None:
    _assert_refused(holoview, folder, ["info", "holochrome-8", "--set", change], fragments)


def test_a_gap_needs_a_second_modulator(holoview: Run, folder: Path) -> None:
    arguments = ["info", "holochrome-8-1slm", "--set", "gap=2 mm"]
    _assert_refused(holoview, folder, arguments, ["gap", "2 mm with one modulator", "add a second [[modulators]]"])


@pytest.mark.parametrize(("arguments", "fragments"), PICTURES, ids=lambda v: " ".join(v)[:60])
def test_a_picture_that_can_not_be_aimed_at_is_refused(
    holoview: Run, folder: Path, arguments: list[str], fragments: list[str]
) -> None:
    _assert_refused(holoview, folder, [*OPTIMISE, *arguments], fragments)


@pytest.mark.parametrize("command", [RENDER, [*OPTIMISE, "colour.png"]], ids=["render", "optimise"])
def test_a_folder_that_takes_no_files_is_refused_before_any_work(
    holoview: Run, folder: Path, command: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any, **__: Any) -> NoReturn:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr("tempfile.TemporaryFile", refuse)  # as root, permissions refuse nothing
    _assert_refused(holoview, folder, command, ["can't be written", os.strerror(errno.EACCES), "choose another folder"])


def test_a_disk_that_fills_up_leaves_no_half_file(holoview: Run, folder: Path) -> None:
    before = _files(folder)
    with limit_of_file_size(1000):
        outcome = holoview(*RENDER)
    assert outcome.code == 2
    assert outcome.err.splitlines()[-1].startswith("holoview: seen.png: can't be written: File too large; free ")
    assert _files(folder) == before


@pytest.mark.parametrize("error", [MemoryError(), RuntimeError("DefaultCPUAllocator: can't allocate memory")])
def test_a_grid_beyond_the_memory_is_one_line(
    holoview: Run, folder: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def allocate(*_: Any) -> NoReturn:
        raise error

    monkeypatch.setattr("holoview.commands.render.random_drive", allocate)
    _assert_refused(holoview, folder, RENDER, ["memory", "choose a smaller shape"])


def test_wgpu_without_an_adapter_is_refused_rather_than_replaced(
    holoview: Run, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("holoview.light.gpu.device.native_adapters", list)
    for command in (RENDER, ["demo"]):
        arguments = [*command, "--backend", "wgpu"]
        _assert_refused(holoview, folder, arguments, ["graphics adapter", "none was found", "--backend torch"])


def test_an_adapter_that_was_named_but_is_not_there_is_refused_under_auto_too(
    holoview: Run, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("holoview.light.gpu.device.native_adapters", list)
    _assert_refused(holoview, folder, [*RENDER, "--backend", "auto", "--adapter", "GeForce"], ["graphics adapter"])


def test_an_adapter_of_too_small_limits_is_refused_by_name(
    holoview: Run, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    about = {"device": "Toy", "adapter_type": "IntegratedGPU", "backend_type": "Vulkan", "description": "toy driver"}
    toy = SimpleNamespace(info=about, limits={"max-buffer-size": 1 << 20}, features=frozenset())
    monkeypatch.setattr("holoview.light.gpu.device.native_adapters", lambda: [toy])
    fragments = ["adapter Toy", "max-buffer-size is 1048576", "at least 67108864", "--backend torch"]
    _assert_refused(holoview, folder, [*RENDER, "--backend", "wgpu"], fragments)


@pytest.mark.gpu
def test_a_grid_beyond_the_limits_of_the_gpu_is_refused(
    holoview: Run, folder: Path, device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    limits = dict(device.limits) | {"max-storage-buffer-binding-size": 1 << 14}
    small = Device(device.raw, device.info, limits)
    monkeypatch.setattr("holoview.light.gpu.device.open_device", lambda _: small)
    fragments = ["padded field", "128 x 96", "needs", "at most", "max-storage-buffer-binding-size", device.info.name]
    _assert_refused(holoview, folder, [*RENDER, "--backend", "wgpu"], fragments)


@pytest.mark.gpu
def test_an_unknown_adapter_is_refused_with_the_known_ones(holoview: Run, folder: Path, device: Device) -> None:
    arguments = [*RENDER, "--backend", "wgpu", "--adapter", "no such card"]
    _assert_refused(holoview, folder, arguments, ["'no such card'", device.info.name])


@pytest.mark.parametrize("given", ["0", "-3s", "10 parsecs", ""])
def test_a_time_must_be_one(holoview: Run, given: str) -> None:
    outcome = holoview("diagnose", "c.h5", f"--time={given}")
    assert outcome.code == 2 and "expected a time such as 90s, 10min or 1.5h" in outcome.err
