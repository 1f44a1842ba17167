"""The hologram file: exact round trips, and clear refusals of everything that isn't one."""

from __future__ import annotations

import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.numpy import save_file
from safetensors.torch import save_file as save_torch_file

import holoview as hv
from holoview.holograms.hologram import FORMAT, VERSION, Hologram, load_hologram
from holoview.light.model import preset
from holoview.util.errors import UserError


def _system(**changes: Any) -> hv.System:
    small = {"shape": [6, 8], "wavelengths": ["460 nm", "532 nm", "638 nm"], "amplitudes": [[0.1, 1 / 3, 2.0]]}
    return hv.load("holochrome-8").edit(small).edit(changes)


def _hologram(**changes: Any) -> Hologram:
    system = _system(**changes)
    return Hologram(hv.random_drive(system), system)


def _tensors(**changes: Any) -> dict[str, Any]:
    hologram = _hologram()
    tensors = {
        "drive": hologram.drive,
        "amplitudes": np.array(hologram.system.amplitudes),
        "wavelengths": np.array(hologram.system.wavelengths_m),
    } | changes
    return {name: tensor for name, tensor in tensors.items() if tensor is not None}


def _metadata(**changes: Any) -> dict[str, str]:
    metadata = {"format": FORMAT, "version": VERSION, "system": preset.dumps(_system())} | changes
    return {key: text for key, text in metadata.items() if text is not None}


def _refusal(path: Path) -> str:
    with pytest.raises(UserError) as caught:
        load_hologram(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    return message


# --- round trips ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"modulators": [{"pitch": "8 um", "shape": [6, 8], "stroke": "825 nm"}], "gap": None},
        {"amplitudes": (np.eye(3) * [0.1, 1 / 3, 2.0]).tolist()},
        {"levels": [0, 0.1, 0.7, 1], "relay2": {"iris_na": 0.1, "aberration": {"Z4": "50 nm"}}},
        {"source": {"grid": [2, 3], "spacing": "8.6 mrad"}, "name": 'a "name"', "description": "λ = 1\n\ttwo\\lines"},
    ],
    ids=["plain", "one modulator", "frames", "levels and glass", "sources and odd text"],
)
def test_a_hologram_survives_its_file_exactly(changes: dict[str, Any], tmp_path: Path) -> None:
    hologram, path = _hologram(**changes), tmp_path / "h.safetensors"
    hologram.save(path)
    loaded = load_hologram(path)
    assert loaded.system == hologram.system
    assert loaded.drive.dtype == np.float32
    np.testing.assert_array_equal(loaded.drive, hologram.drive)
    assert list(tmp_path.iterdir()) == [path]


def test_a_drive_in_8_bits_is_rounded_once(tmp_path: Path) -> None:
    hologram, path = _hologram(), tmp_path / "h.safetensors"
    hologram.save(path, as_uint8=True)
    loaded = load_hologram(path)
    assert loaded.system == hologram.system and loaded.drive.dtype == np.float32
    assert np.abs(loaded.drive - hologram.drive).max() <= 0.5 / 255 + 2**-24, "half a step, and rounding of float32"
    loaded.save(path, as_uint8=True)
    np.testing.assert_array_equal(load_hologram(path).drive, loaded.drive)


def test_the_ends_of_the_stroke_are_exact_in_8_bits(tmp_path: Path) -> None:
    system, path = _system(), tmp_path / "h.safetensors"
    drive = np.zeros(system.drive_shape, np.float32)
    drive[:, 1] = 1.0
    Hologram(drive, system).save(path, as_uint8=True)
    np.testing.assert_array_equal(load_hologram(path).drive, drive)


def test_a_file_says_by_itself_what_it_is(tmp_path: Path) -> None:
    path = tmp_path / "h.safetensors"
    _hologram().save(path)
    header = path.read_bytes()[8:].split(b"}}")[0].decode()
    assert '"format":"holoview-hologram"' in header and '"version":"1"' in header
    for name in ("drive", "amplitudes", "wavelengths", "system"):
        assert f'"{name}":' in header


def test_a_missing_folder_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="doesn't exist"):
        _hologram().save(tmp_path / "nowhere" / "h.safetensors")


# --- holograms that can't be ----------------------------------------------------------------------------------------


def test_a_drive_of_another_shape_is_refused() -> None:
    with pytest.raises(UserError, match=r"drive: shape \(1, 1, 6, 8\); expected .*\(1, 2, 6, 8\)"):
        Hologram(np.zeros((1, 1, 6, 8), np.float32), _system())


@pytest.mark.parametrize("value", [-0.1, 1.001, np.nan, np.inf])
def test_a_drive_outside_the_stroke_is_refused(value: float) -> None:
    drive = hv.random_drive(_system())
    drive[0, 1, 2, 3] = value
    with pytest.raises(UserError, match="drive: values outside 0…1"):
        Hologram(drive, _system())


# --- files that can't be --------------------------------------------------------------------------------------------


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    assert "no such file" in _refusal(tmp_path / "nowhere.safetensors")
    assert "is a folder" in _refusal(tmp_path)


@pytest.mark.parametrize("share", [0.0, 0.002, 0.1, 0.6, 0.999])
def test_a_truncated_file_is_refused(share: float, tmp_path: Path) -> None:
    path = tmp_path / "h.safetensors"
    _hologram().save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    assert "can't be read" in _refusal(path)


def test_a_file_with_something_behind_its_end_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "h.safetensors"
    _hologram().save(path)
    path.write_bytes(path.read_bytes() + b"more")
    assert "can't be read" in _refusal(path)


@pytest.mark.parametrize("content", [b"\x89PNG\r\n\x1a\n" + bytes(100), b"gap = 3\n" * 20, bytes(64)])
def test_a_file_of_another_kind_is_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "h.safetensors"
    path.write_bytes(content)
    assert "expected a hologram file" in _refusal(path) or "expected format" in _refusal(path)


class _Bomb:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self.path),)


@pytest.mark.parametrize("suffix", [".safetensors", ".pt", ".npy", ".pkl"])
def test_a_pickle_is_refused_and_never_run(suffix: str, tmp_path: Path) -> None:
    path, marker = tmp_path / f"h{suffix}", tmp_path / "executed"
    path.write_bytes(pickle.dumps(_Bomb(marker)))
    assert "can't be read" in _refusal(path)
    torch.save({"drive": _Bomb(marker)}, path)
    assert "can't be read" in _refusal(path)
    assert not marker.exists()


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16, torch.float8_e4m3fn], ids=str)
def test_the_weights_of_a_network_are_refused(dtype: torch.dtype, tmp_path: Path) -> None:
    path = tmp_path / "network.safetensors"
    save_torch_file({"layer.weight": torch.zeros(4, 4).to(dtype)}, path)
    assert 'format "none"' in _refusal(path)


@pytest.mark.parametrize(
    ("metadata", "fragment"),
    [
        ({"format": "other"}, 'format "other"'),
        ({"version": "2"}, "version 2"),
        ({"format": None}, 'format "none"'),
        ({"system": None}, "lacks its system"),
        ({"system": "gap ="}, "isn't TOML"),
        ({"system": 'gap = "2 mm"'}, "is missing"),
        ({"system": preset.dumps(_system(gap="3 mm")).replace("3 mm", "-3 mm")}, "gap: -3 mm"),
    ],
    ids=str,
)
def test_a_file_whose_description_is_foreign_or_impossible_is_refused(
    metadata: dict[str, Any], fragment: str, tmp_path: Path
) -> None:
    path = tmp_path / "h.safetensors"
    save_file(_tensors(), path, metadata=_metadata(**metadata))
    assert fragment in _refusal(path)


TABLE, LINE = np.array([[0.1, 1 / 3, 2.0]]), np.array([460e-9, 532e-9, 638e-9])


@pytest.mark.parametrize(
    ("tensors", "fragment"),
    [
        ({"drive": None}, "lacks drive"),
        ({"amplitudes": None, "wavelengths": None}, "lacks amplitudes, wavelengths"),
        ({"drive": np.zeros((1, 2, 6, 9), np.float32)}, "drive"),
        ({"drive": np.full((1, 2, 6, 8), 1.5, np.float32)}, "drive: values outside 0…1"),
        ({"drive": np.full((1, 2, 6, 8), np.nan, np.float32)}, "drive: holds nan at frame 0"),
        ({"drive": np.full((1, 2, 6, 8), 0.5j, np.complex64)}, "drive"),
        ({"amplitudes": np.vstack([TABLE, TABLE])}, "amplitudes: an array of shape (2, 3)"),
        ({"amplitudes": TABLE[:, :2]}, "amplitudes"),
        ({"amplitudes": -TABLE}, "amplitudes: values outside 0…"),
        ({"amplitudes": np.array(1.0)}, "amplitudes"),
        ({"wavelengths": LINE[None]}, "wavelengths"),
        ({"wavelengths": np.array(532e-9)}, "wavelengths"),
        ({"wavelengths": LINE * 1e9}, "wavelengths: contradict"),
        ({"wavelengths": LINE + 1e-9}, "wavelengths"),
        ({"amplitudes": 2 * TABLE}, "amplitudes"),
    ],
    ids=lambda x: (
        " ".join(f"{k} {'none' if v is None else v.shape}" for k, v in x.items()) if isinstance(x, dict) else x
    ),
)
def test_a_file_that_contradicts_itself_is_refused(tensors: dict[str, Any], fragment: str, tmp_path: Path) -> None:
    path = tmp_path / "h.safetensors"
    save_file(_tensors(**tensors), path, metadata=_metadata())
    assert fragment in _refusal(path)


def test_paths_of_effects_count_from_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A bench names the field that lights it relative to the present folder; the hologram's file lies beside it."""
    for name in ("made", "read"):
        (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path)
    system = _system().edit({"effects.source_field.file": "made/beam.safetensors"})
    Hologram(hv.random_drive(system), system).save("made/lit.safetensors")
    (tmp_path / "made").rename(tmp_path / "moved")
    monkeypatch.chdir(tmp_path / "read")
    lit = load_hologram("../moved/lit.safetensors").system.effect_values["source_field"]
    assert Path(str(lit["file"])) == tmp_path / "moved" / "beam.safetensors"
