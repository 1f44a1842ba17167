"""Light as numbers: each format keeps every bit, is read by other programs, and is a target again."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path

import av
import numpy as np
import OpenEXR
import pytest
import tifffile

import holoview as hv
from holoview.commands.cli import main
from holoview.holograms.files.image_reader import picture_count
from holoview.holograms.files.light_file import read_light
from holoview.holograms.files.light_writer import write_light
from holoview.holograms.targets.picture import read_picture, read_pictures
from holoview.holograms.view import light_numbers
from holoview.light.colour import COLOUR_SPACES, rgb_to_xyz
from holoview.util.errors import UserError
from tests.explored import one_of_each


@pytest.fixture(scope="module")
def view() -> hv.View:
    # 18 × 26 samples: the last block of an .exr has two lines
    system = hv.load("holochrome-8").with_(shape=[9, 13], observer="age 60, field 4")
    return hv.simulate(system, hv.random_drive(system, seed=3), planes=["9 mm", "10 mm"], backend="torch")


@pytest.mark.parametrize("suffix", [".npz", ".npy", ".exr"])
@pytest.mark.parametrize("space", list(COLOUR_SPACES))
def test_every_number_comes_back_as_it_was(view: hv.View, suffix: str, space: str, tmp_path: Path) -> None:
    file = tmp_path / f"light{suffix}"
    hv.save(view, file, colour_space=space)
    light, written = read_light(file), light_numbers(view, COLOUR_SPACES[space])
    assert light.intensity is not None and light.intensity.dtype == np.float32
    np.testing.assert_array_equal(light.intensity, view.intensity)
    np.testing.assert_array_equal(light.xyz, view.xyz)
    np.testing.assert_array_equal(light.rgb, written.rgb)
    np.testing.assert_array_equal(light.wavelengths_m, view.wavelengths_m)
    np.testing.assert_array_equal(light.planes_m, view.focus_m)
    assert light.about["observer"] == "age 60, field 4" and light.about["rgb_space"] == COLOUR_SPACES[space].title
    assert light.about["axes"]["intensity"] == ["plane", "wavelength", "y", "x"]


def test_doubles_stay_doubles_in_an_npz(tmp_path: Path) -> None:
    system = hv.load("holochrome-8").with_(shape=[8, 8])
    view = hv.simulate(system, hv.random_drive(system), planes=["9 mm"], backend="torch64")
    hv.save(view, tmp_path / "a.npz")
    light = read_light(tmp_path / "a.npz")
    assert light.intensity is not None and light.intensity.dtype == np.float64
    np.testing.assert_array_equal(light.intensity, view.intensity)


def test_a_tiff_holds_linear_srgb_that_tifffile_reads(view: hv.View, tmp_path: Path) -> None:
    file = tmp_path / "a.tif"
    hv.save(view, file)
    np.testing.assert_array_equal(tifffile.imread(file), light_numbers(view, COLOUR_SPACES["srgb"]).rgb)
    assert read_light(file).about["observer"] == "age 60, field 4"
    np.testing.assert_array_equal(read_light(file).rgb, tifffile.imread(file))
    with pytest.raises(UserError, match=r"in Rec\. 2020; expected sRGB"):
        hv.save(view, file, colour_space="rec2020")


def test_an_npy_holds_the_intensity(view: hv.View, tmp_path: Path) -> None:
    hv.save(view, tmp_path / "a.npy")
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), view.intensity)


KINDS = ("npz", "npy", "exr", "tif")


@pytest.mark.parametrize(("one", "other"), one_of_each(product(KINDS, [*KINDS[1:], KINDS[0]])))
def test_each_pair_of_files_is_equal_to_the_last_bit(
    view: hv.View, one: str, other: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`compare` compares what both hold; `contrast` measures the same; as a target it is the same picture."""
    files = [tmp_path / f"a.{one}", tmp_path / f"b.{other}"]
    for file in files:
        hv.save(view, file)
    held = "rgb" if "tif" in (one, other) else "xyz, rgb, intensity"
    assert main(["compare", *map(str, files)]) == 0
    assert capsys.readouterr().out.splitlines() == [f"{z}: equal to the last bit ({held})" for z in ("9 mm", "10 mm")]
    found = []
    for file in files:
        assert main(["contrast", str(file), "--json"]) == 0
        found.append(json.loads(capsys.readouterr().out)["contrast"])
    # XYZ of a .tif is made from its RGB, which are rounded to 24 bits
    assert found[0] == (found[1] if held != "rgb" or one == other else pytest.approx(found[1], rel=1e-6))
    for first, second in zip(*map(read_pictures, files), strict=True):
        np.testing.assert_array_equal(first.rgb, second.rgb)


def test_openexr_reads_the_spectral_layout(view: hv.View, tmp_path: Path) -> None:
    file = tmp_path / "a.exr"
    hv.save(view.at([1]), file, colour_space="p3")
    with OpenEXR.File(str(file), separate_channels=True) as opened:
        header, channels = dict(opened.header()), {name: np.array(c.pixels) for name, c in opened.channels().items()}
    names = [f"S0.{at * 1e9:.6f}nm".replace(".", ",").replace("S0,", "S0.") for at in view.wavelengths_m]
    assert set(channels) == {"R", "G", "B", "xyz.X", "xyz.Y", "xyz.Z", *names}
    for name, intensity in zip(names, view.intensity[1], strict=True):
        np.testing.assert_array_equal(channels[name], intensity)
    assert header["spectralLayoutVersion"] == "1.0"
    np.testing.assert_allclose(header["chromaticities"][:6], np.ravel(COLOUR_SPACES["p3"].chromaticities), atol=1e-7)
    rgb = np.stack([channels[name] for name in "RGB"], axis=-1)
    # float32 of a matrix product of numbers up to a few hundred
    xyz = rgb @ rgb_to_xyz(COLOUR_SPACES["p3"].chromaticities).T
    np.testing.assert_allclose(xyz, view.xyz[1], atol=4e-7 * float(np.abs(view.xyz).max()))


def test_ffmpeg_s_own_decoder_reads_the_same_numbers(view: hv.View, tmp_path: Path) -> None:
    hv.save(view.at([0]), tmp_path / "a.exr")
    with av.open(str(tmp_path / "a.exr")) as opened:
        frame = next(opened.decode(video=0))
    rows, columns = view.xyz.shape[1:3]
    assert frame.format.name == "gbrpf32le" and (frame.height, frame.width) == (rows, columns)
    green, blue, red = (np.frombuffer(plane, np.float32).reshape(rows, -1)[:, :columns] for plane in frame.planes)
    rgb = light_numbers(view, COLOUR_SPACES["srgb"]).rgb[0]
    np.testing.assert_array_equal(np.stack([red, green, blue], axis=-1), rgb)


def test_several_planes_are_parts_that_openexr_reads(view: hv.View, tmp_path: Path) -> None:
    hv.save(view, tmp_path / "a.exr")
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as opened:
        assert [str(opened.header(index)["name"]) for index in range(2)] == ["plane 1, 9 mm", "plane 2, 10 mm"]
        np.testing.assert_array_equal(opened.channels(1)["xyz.Y"].pixels, view.xyz[1, ..., 1])


@pytest.mark.parametrize("suffix", [".npz", ".npy", ".exr", ".tif"])
def test_light_is_a_target_to_the_last_bit(view: hv.View, suffix: str, tmp_path: Path) -> None:
    file = tmp_path / f"a{suffix}"
    hv.save(view, file)
    rgb = light_numbers(view, COLOUR_SPACES["srgb"]).rgb
    assert picture_count(file) == 2
    for picture, expected in zip(read_pictures(file), rgb, strict=True):
        np.testing.assert_array_equal(picture.rgb, expected)


def test_light_of_another_space_is_the_same_target(view: hv.View, tmp_path: Path) -> None:
    hv.save(view.at([0]), tmp_path / "a.exr", colour_space="rec2020")
    picture = read_picture(tmp_path / "a.exr")
    np.testing.assert_allclose(picture.rgb, view.rgb[0], atol=1e-6 * float(np.abs(view.rgb).max()))
    assert any("own primaries" in note for note in picture.notes)


@pytest.mark.parametrize("suffix", ["npz", "exr", "tif", "npy"])
def test_render_and_export_write_numbers(suffix: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / f"a.{suffix}"
    small = ["--set", "shape=[24,32]", "--backend", "torch", "--plane", "9mm", "10mm"]
    assert main(["render", "holochrome-8", *small, "-o", str(out), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert [entry["plane"] for entry in printed["planes"]] == ["9 mm", "10 mm"] and out.exists()
    system = hv.load("holochrome-8").with_(shape=[24, 32])
    hologram = hv.Hologram(hv.random_drive(system), system)
    hologram.save(tmp_path / "h.safetensors")
    assert main(["export", str(tmp_path / "h.safetensors"), "--light", str(tmp_path / f"b.{suffix}")]) == 0
    if suffix in ("npz", "exr"):
        light = read_light(out)
        expected = hv.simulate(system, hv.random_drive(system), planes=["9 mm", "10 mm"], backend="torch")
        np.testing.assert_array_equal(light.xyz, expected.xyz)
        assert len(read_light(tmp_path / f"b.{suffix}").planes_m) == len(system.planes_m)
        assert hv.load("holochrome-8").name in light.about["system"]


def test_numbers_take_no_exposure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "a.exr"
    assert main(["render", "holochrome-8", "--set", "shape=[8,8]", "--exposure", "1", "-o", str(out)]) != 0
    assert "numbers are written as they are" in capsys.readouterr().err


def test_damaged_and_other_files_are_one_sentence(view: hv.View, tmp_path: Path) -> None:
    for suffix in (".npz", ".npy", ".exr", ".tif"):
        hv.save(view, tmp_path / f"a{suffix}")
        data = (tmp_path / f"a{suffix}").read_bytes()
        for end in (len(data) // 2, len(data) - 40):
            (tmp_path / f"b{suffix}").write_bytes(data[:end])
            with pytest.raises(UserError):
                read_light(tmp_path / f"b{suffix}")
    np.savez(tmp_path / "c.npz", about=np.zeros(3, np.uint8), rgb=np.zeros((1, 2, 2, 3)), xyz=np.zeros((1, 2, 2, 3)))
    with pytest.raises(UserError, match=r"c\.npz"):
        read_light(tmp_path / "c.npz")
    np.savez(tmp_path / "d.npz", field=np.zeros(3))
    with pytest.raises(UserError, match="no light that holoview wrote"):
        read_light(tmp_path / "d.npz")


def test_a_grey_tiff_that_says_it_is_light_is_one_sentence(tmp_path: Path) -> None:
    file = tmp_path / "grey.tif"
    about = json.dumps({"format": "holoview light 1"})
    tifffile.imwrite(file, np.ones((4, 5), np.float32), description=about)
    with pytest.raises(UserError, match="holds colours of shape"):
        read_light(file)


def test_numbers_that_need_too_much_memory_are_refused(
    view: hv.View, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    light = light_numbers(view, COLOUR_SPACES["srgb"])
    monkeypatch.setenv("HOLOVIEW_MEMORY", "1kB")
    with pytest.raises(UserError, match="of memory"):
        write_light(tmp_path / "a.exr", light)
    assert not (tmp_path / "a.exr").exists()


def test_equal_lasers_dont_share_a_channel(tmp_path: Path) -> None:
    lasers = {"wavelengths": ["532 nm", "532 nm"], "amplitudes": [[1.0, 1.0]]}
    system = hv.load("holochrome-8").with_(shape=[8, 8], **lasers)
    view = hv.simulate(system, hv.random_drive(system), planes=["9 mm"], backend="torch")
    with pytest.raises(UserError, match="equal wavelength"):
        hv.save(view, tmp_path / "a.exr")
    hv.save(view, tmp_path / "a.npz")


def test_compare_says_equal_to_the_last_bit_or_how_far(
    view: hv.View, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hv.save(view, tmp_path / "a.npz")
    hv.save(view, tmp_path / "a.exr")
    hv.save(view.exposed(0.5), tmp_path / "b.exr")
    assert main(["compare", str(tmp_path / "a.npz"), str(tmp_path / "a.exr")]) == 0
    printed = capsys.readouterr().out
    assert printed.splitlines() == [f"{z}: equal to the last bit (xyz, rgb, intensity)" for z in ("9 mm", "10 mm")]
    assert main(["compare", str(tmp_path / "b.exr"), str(tmp_path / "a.exr"), "--json"]) == 0
    (first, _) = json.loads(capsys.readouterr().out)["planes"]
    assert not first["equal"] and first["delta_e"] > 0
    assert first["largest_xyz"] == pytest.approx((2**0.5 - 1) * float(view.xyz[0].max()), rel=1e-5)
    hv.save(view.at([0]), tmp_path / "c.exr")
    assert main(["compare", str(tmp_path / "c.exr"), str(tmp_path / "a.exr")]) != 0
    assert "light of shape (1, 18, 26, 3)" in capsys.readouterr().err
