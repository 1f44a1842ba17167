"""Complex fields of other programs on the command line: what is known of them, what is seen of them, and their file."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import holoview as hv
from holoview.holograms.files.request import Viewpoint
from tests.cli.conftest import Outcome

Run = Callable[..., Outcome]

TORCH = ("--backend", "torch")
KNOWN = ("--pitch", "8um", "--wavelength", "532nm")
λ, PITCH_M, Z_M = 532e-9, 8e-6, 0.01
POINT = (20, 45)  # row and column to which the lens below converges


def _lens(z_m: float = Z_M, shape: tuple[int, int] = (64, 64), at: tuple[int, int] = POINT) -> NDArray[np.complex64]:
    """A field that converges to a point `z_m` behind its plane, above one of its samples."""
    y, x = np.mgrid[: shape[0], : shape[1]] * PITCH_M
    r2 = (x - at[1] * PITCH_M) ** 2 + (y - at[0] * PITCH_M) ** 2
    return np.exp(-1j * np.pi * r2 / (λ * z_m)).astype(np.complex64)


def _brightest(path: str) -> tuple[int, int]:
    """Row and column in the middle of the saturated samples of a picture."""
    green = np.asarray(Image.open(path))[..., 1].astype(float)
    rows, columns = np.nonzero(green == green.max())
    return round(float(rows.mean())), round(float(columns.mean()))


def test_a_field_is_rendered_at_its_distance_and_json_says_what_was_read_and_why(holoview: Run) -> None:
    np.save("lens.npy", _lens())
    done = holoview("render", "lens.npy", *KNOWN, "--plane", "1cm", *TORCH, "-o", "seen.png", "--json")
    assert done.code == 0
    result = json.loads(done.out)
    assert _brightest("seen.png") == POINT
    assert result["read"]["kind"] == "field"
    known = {entry["name"]: (entry["value"], entry["origin"]) for entry in result["read"]["properties"]}
    assert known["pitch"] == ("8 um", "given") and known["distance"] == ("10 mm", "given")
    assert known["sign of the phase"][1] == "guessed"
    assert all(entry["reason"] for entry in result["read"]["properties"])


def test_where_the_other_sign_is_sharper_both_are_shown(holoview: Run) -> None:
    np.save("lens.npy", _lens())
    arguments = ("render", "lens.npy", *KNOWN, "--plane=-1cm", *TORCH, "-o", "seen.png", "--json")
    done = holoview(*arguments)
    assert done.code == 0 and "--conjugate" in done.err
    files = json.loads(done.out)["planes"]
    assert [(Path(entry["file"]).name, entry.get("other_side", False)) for entry in files] == [
        ("seen.png", False),
        ("seen-other-side.png", True),
    ]
    assert _brightest("seen-other-side.png") == POINT
    assert len(json.loads(holoview(*arguments, "--conjugate").out)["planes"]) == 1


def test_of_an_off_axis_recording_the_order_is_taken_whose_image_is_sharp_at_the_distance(holoview: Run) -> None:
    fringes = np.exp(2j * np.pi * (np.indices((64, 64)) * np.array([0.21, 0.27])[:, None, None]).sum(axis=0))
    image = np.zeros((64, 64), complex)
    image[POINT] = 1
    frequency = np.fft.fftfreq(64, PITCH_M)
    back = np.exp(1j * np.pi * λ * Z_M * (frequency[:, None] ** 2 + frequency[None, :] ** 2))
    wave = np.fft.ifft2(np.fft.fft2(image) * back * (np.hypot(*np.meshgrid(frequency, frequency)) < 1.1e4))
    wave /= np.abs(wave).max()
    for reference in (fringes, fringes.conj()):
        np.save("fringes.npy", np.abs(wave + reference).astype(np.float32) ** 2)
        recorded = ("render", "fringes.npy", "--recording", "off-axis", *KNOWN, *TORCH, "-o", "seen.png")
        for plane, name in (("1cm", "object"), ("-1cm", "conjugate")):
            assert holoview(*recorded, f"--plane={plane}").code == 0
            # the tilt that an order's centre of gravity leaves moves the image by a few samples
            assert np.abs(np.subtract(_brightest("seen.png"), POINT)).max() <= 4, name


def test_an_order_that_is_given_is_taken_and_remembered(holoview: Run) -> None:
    y, x = np.indices((64, 64))
    np.save("fringes.npy", np.abs(_lens() + 2 * np.exp(2j * np.pi * (0.1 * y - 0.25 * x))) ** 2)
    chosen = (
        "--order=0.25,-0.1,0.2",
        "--plane",
        "1cm",
        *TORCH,
        "-o",
        "seen.png",
    )  # of O·R*, where R's tilt is opposite
    done = holoview("render", "fringes.npy", *KNOWN, *chosen, "--remember")
    assert done.code == 0 and "0.2500, -0.1000 cycles a pixel (x, y), radius 0.2000, as given" in done.err
    # the disc keeps 0.2 of the 0.48 cycles a pixel that the lens has at its edge: the point is 2.4 times as wide
    assert np.abs(np.subtract(_brightest("seen.png"), POINT)).max() <= 1
    again = holoview("render", "fringes.npy", "--plane", "1cm", *TORCH, "-o", "again.png")
    assert again.code == 0 and "as given" in again.err
    refused = holoview("render", "fringes.npy", "--order", "0.7,0.1", *TORCH, "-o", "again.png")
    assert refused.code == 2 and "order: at 0.7, 0.1" in refused.err
    refused = holoview("render", "fringes.npy", "--order", "left", *TORCH, "-o", "again.png")
    assert refused.code == 2 and "f_x,f_y" in refused.err


def test_from_a_viewpoint_the_image_stays_and_the_rest_is_dark(holoview: Run) -> None:
    np.save("lens.npy", _lens())
    seen = ("render", "lens.npy", *KNOWN, "--plane", "1cm", *TORCH, "-o", "seen.png")
    assert holoview(*seen, "--viewpoint=-1,0,16").code == 0
    # 16 samples of 8 µm focus to λz/(16·8 µm) = 42 µm, 5 samples
    assert np.abs(np.subtract(_brightest("seen.png"), POINT)).max() <= 5
    one = Path("seen.png").read_bytes()
    several = holoview(*seen, "--viewpoint=0,0,32", "--viewpoint=-1,0,16", "--json")
    names = [view["planes"][0]["file"] for view in json.loads(several.out)["viewpoints"]]
    assert several.code == 0 and names == ["seen-view1.png", "seen-view2.png"]
    assert np.array_equal(np.asarray(Image.open(names[1])), np.asarray(Image.open("seen.png")))
    assert Path("seen.png").read_bytes() == one  # it isn't written again
    behind = hv.load_field("lens.npy", pitch="8um", wavelengths="532nm", viewpoint=Viewpoint((-1.0, 0.0), 16.0))
    lit = np.abs(behind.drive[0, 0]) > 0
    assert lit[24:40, :16].all() and lit.sum() == 256
    for wrong, words in (("2,0,16", "viewpoint"), ("left", "--viewpoint"), ("0,0,3.2deg", "70 × 70 samples")):
        refused = holoview(*seen, f"--viewpoint={wrong}")  # 3.2° at 1 cm are 70 samples
        assert refused.code == 2 and words in refused.err


def test_colours_that_a_camera_took_beside_each_other_are_moved_and_remembered(holoview: Run) -> None:
    np.save("two.npy", np.stack([_lens(), np.roll(_lens(), 3, axis=1)]))
    shifts = ("--colour-shift", "0,0um", "-24,0um")
    known = ("--pitch", "8um", "--wavelength", "532nm", "532nm", "--plane", "1cm")
    assert holoview("info", "two.npy", *known[:-2], *shifts, "--remember").code == 0
    drive = hv.load_field("two.npy").drive[0]
    np.testing.assert_allclose(drive[0, :, :58], drive[1, :, :58], atol=1e-3 * np.abs(drive).max())


def test_notes_say_what_a_dump_of_bare_numbers_is(holoview: Run) -> None:
    _lens().astype("<c8").tofile("lens.bin")
    layout = ("--file-note", "binary.dtype=complex64", "binary.shape=[64, 64]")
    done = holoview("render", "lens.bin", *KNOWN, *layout, "--plane", "1cm", *TORCH, "-o", "seen.png")
    assert done.code == 0 and _brightest("seen.png") == POINT
    turned = (*layout, "transposed=true")
    assert holoview("render", "lens.bin", *KNOWN, *turned, "--plane", "1cm", *TORCH, "-o", "turned.png").code == 0
    assert _brightest("turned.png") == POINT[::-1]


@pytest.mark.parametrize(
    ("note", "words"), [("colour=red", "colour"), ("transposed", "KEY=VALUE"), ("phase_levels=-3", "above 0")]
)
def test_a_note_that_says_nothing_known_is_refused(holoview: Run, note: str, words: str) -> None:
    np.save("lens.npy", _lens())
    done = holoview("render", "lens.npy", *KNOWN, "--file-note", note, *TORCH, "-o", "seen.png")
    assert done.code == 2 and words in done.err
    assert not Path("seen.png").exists()


def test_the_image_of_a_conjugate_lies_before_the_plane(holoview: Run) -> None:
    np.save("lens.npy", _lens().conj())
    assert holoview("render", "lens.npy", *KNOWN, "--plane", "-1cm", *TORCH, "-o", "before.png").code == 0
    assert _brightest("before.png") == POINT
    other = holoview("render", "lens.npy", *KNOWN, "--conjugate", "--plane", "1cm", *TORCH, "-o", "other.png")
    assert other.code == 0 and _brightest("other.png") == POINT


def test_what_the_file_does_not_say_is_asked_for_with_a_guess(holoview: Run) -> None:
    np.save("lens.npy", _lens())
    asked = holoview("render", "lens.npy", *TORCH, "-o", "seen.png")
    assert asked.code == 2 and not Path("seen.png").exists()
    assert "--pitch" in asked.err and "--wavelength" in asked.err and "8 um" in asked.err
    guessed = holoview("render", "lens.npy", "--guess", "--plane", "1cm", *TORCH, "-o", "seen.png")
    assert guessed.code == 0 and "was guessed" in guessed.err


def test_options_are_remembered_beside_the_file(holoview: Run) -> None:
    np.save("lens.npy", _lens())
    assert holoview("info", "lens.npy", *KNOWN, "--distance", "1cm", "--remember").code == 0
    again = holoview("info", "lens.npy", "--json")
    read = json.loads(again.out)["read"]
    assert {entry["name"]: entry["origin"] for entry in read["properties"]}["pitch"] == "remembered"


@pytest.mark.parametrize("part", ["32,0,32,48", "1deg,0.5,0"])
def test_a_part_of_a_field_is_read_in_samples_or_in_degrees_as_seen_from_the_image(holoview: Run, part: str) -> None:
    np.save("lens.npy", _lens())
    info = holoview("info", "lens.npy", *KNOWN, "--plane", "1cm", "--aperture", part)
    size = round(2 * Z_M * np.tan(np.radians(0.5)) / PITCH_M)  # 22
    left = round((64 - size) / 2 + Z_M * np.tan(np.radians(0.5)) / PITCH_M)  # 21 + 10.9
    expected = "32 × 48 samples at 32, 0" if "deg" not in part else f"{size} × {size} samples at {left}, 21"
    assert info.code == 0 and expected in info.out
    whole = holoview("info", "lens.npy", *KNOWN, "--decimate", "4")
    assert "16 x 16 samples" in whole.out and "32 um" in whole.out


@pytest.mark.parametrize("steps", [(), ("--steps", "0,90,200"), ("--steps", "unknown")])
def test_a_phase_shifting_set_of_files_shows_its_phase_unwrapped(holoview: Run, steps: tuple[str, ...]) -> None:
    """A lens of several turns, and a speckled amplitude, as unknown steps need many fringes."""
    pytest.importorskip("skimage")
    y, x = np.mgrid[-48:48, -48:48] / 48
    wave = 10 * np.exp(1j * (9 * (x**2 + y**2) + 6 * x))
    shifts = np.radians([0, 90, 200]) if len(steps) == 2 else np.arange(3) * 2 * np.pi / 3
    for index, shift in enumerate(shifts):
        np.save(f"step{index}.npy", np.abs(wave + 20 * np.exp(1j * shift)) ** 2)
    names = [f"step{index}.npy" for index in range(3)]
    known = [*KNOWN, "--recording", "phase-shifting", *steps]
    options = ["--show", "unwrapped-phase", "--plane", "0mm", "--stage", "field", "--json", "-o", "p.png"]
    done = holoview("render", *names, *known, *options)
    assert done.code == 0, done.err
    low, high = (float(word) for word in re.findall(r"(-?[\d.]+) rad", json.loads(done.out)["planes"][0]["scale"]))
    expected = 9 * (x**2 + y**2) + 6 * x
    assert high - low == pytest.approx(np.ptp(expected), rel=0.02)


def test_a_field_that_is_one_sample_of_several_says_so(holoview: Run) -> None:
    shown = ("render", "holochrome-8", "--set", "shape=[16,24]", "--show", "phase", "--stage", "slm2", "-o", "p.png")
    assert "one sample" not in holoview(*shown).out
    effects = ("--effects", "second_line.share=0.25", "second_line.offset=4nm", "flicker.depth=0.1")
    said = "one sample of 2 spectral lines × "
    assert said in holoview(*shown, *effects).out
    (entry,) = json.loads(holoview(*shown, *effects, "--json").out)["planes"]
    assert said in entry["note"] and entry["wavelength_m"] == hv.load("holochrome-8").wavelengths_m[0]
    samples = int(entry["note"].split("× ")[1].split()[0])
    assert entry["share"] == pytest.approx(0.75 / samples)


def test_files_are_the_parts_of_one_field(holoview: Run) -> None:
    np.save("re.npy", _lens().real)
    np.save("im.npy", _lens().imag)
    parts = ("re.npy", "im.npy", "--parts", "real,imaginary", *KNOWN, "--plane", "1cm")
    assert holoview("render", *parts, *TORCH, "-o", "seen.png").code == 0
    assert _brightest("seen.png") == POINT


def test_a_far_image_is_seen_by_one_transform_and_planes_count_from_it(holoview: Run) -> None:
    """At 0.6 m the image lies 1.2 cm beside the axis, in a window λz/dx = 4 cm wide; the field itself is 1 mm wide."""
    np.save("far.npy", _lens(0.6, (128, 128), at=(64, 64 + 1500)))
    options = ("far.npy", *KNOWN, "--distance", "60cm", *TORCH)
    done = holoview("render", *options, "--plane", "60cm", "-o", "far.png", "--json")
    assert done.code == 0 and "Fresnel" in done.err
    assert json.loads(done.out)["planes"][0]["plane"] == "0 mm"
    row, column = _brightest("far.png")
    width_m = λ * 0.6 / PITCH_M
    # 128 samples of 0.31 mm, the size of the spot: the brightest is the nearest or its neighbour
    assert column == pytest.approx((1.2e-2 / width_m + 0.5) * 128, abs=1.5) and row == pytest.approx(64, abs=1.5)


def test_the_field_itself_is_seen_at_a_stage(holoview: Run) -> None:
    np.save("lens.npy", _lens())
    shown = ("render", "lens.npy", *KNOWN, "--plane", "1cm", "--show")
    done = holoview(*shown, "amplitude", "--stage", "plane", "-o", "amplitude.png", "--json")
    assert done.code == 0 and json.loads(done.out)["planes"][0]["quantity"] == "amplitude"
    assert _brightest("amplitude.png") == POINT
    for quantity in ("phase", "real", "imaginary", "phase-colour", "spectrum"):
        assert holoview(*shown, quantity, "--stage", "field", "-o", f"{quantity}.png").code == 0
    # the phase is 0, red, where the lens is thickest
    assert np.asarray(Image.open("phase.png"))[POINT].tolist() == [255, 64, 64]
    refused = holoview(*shown, "phase", "--stage", "slm2", "-o", "x.png")
    assert refused.code == 2 and "light, field, stop, plane" in refused.err
    assert "--show with it" in holoview("render", "lens.npy", *KNOWN, "--stage", "plane", "-o", "x.png").err


def test_a_field_is_exported_as_a_field_file_and_as_a_page(holoview: Run) -> None:
    np.save("lens.npy", _lens())
    assert holoview("export", "lens.npy", *KNOWN, "--distance", "1cm", "--field", "lens.safetensors").code == 0
    field = hv.load_field("lens.safetensors")
    np.testing.assert_array_equal(field.drive[0, 0], _lens())
    assert field.system.planes_m.tolist() == [0.01]
    assert holoview("export", "lens.safetensors", "--html", "lens.html", *TORCH).code == 0
    page = hv.load_field("lens.safetensors")
    assert "field" in page.system.description
    refused = holoview("export", "lens.safetensors", "--png", "patterns")
    assert refused.code == 2 and "a field" in refused.err and not Path("patterns").exists()


def test_a_modulators_hologram_is_exported_as_a_field_that_shows_the_same(holoview: Run) -> None:
    system = hv.load("simultaneous").with_(shape=[24, 32])
    hv.Hologram(hv.random_drive(system), system).save("hologram.safetensors")
    assert holoview("export", "hologram.safetensors", "--field", "field.safetensors").code == 0
    for name in ("hologram", "field"):
        done = holoview("render", f"{name}.safetensors", "--exposure", "0", *TORCH, "-o", f"{name}.png")
        assert done.code == 0
    pictures = [np.asarray(Image.open(f"{name}.png")).astype(int) for name in ("hologram", "field")]
    assert np.abs(pictures[0] - pictures[1]).max() <= 1  # complex64: at most the rounding of a code differs


def test_contrast_and_info_take_fields(holoview: Run) -> None:
    rng = np.random.default_rng(0)
    values = (rng.normal(size=(128, 128)) + 1j * rng.normal(size=(128, 128))).astype(np.complex64)
    np.save("speckle.npy", values)
    done = holoview("contrast", "speckle.npy", *KNOWN, "--plane", "0mm", "--json")
    # the contrast of n = 64² independent samples of an exponential law is 1 ± 1/√n·√2; five of these
    assert json.loads(done.out)["contrast"] == pytest.approx(1.0, abs=5 * np.sqrt(2) / 64)
    info = holoview("info", "speckle.npy", *KNOWN)
    assert "128 x 128 samples" in info.out and "phase range" not in info.out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["render", "no.npy", *KNOWN, "-o", "x.png"], "no such file"),
        (["render", "holochrome-8", "--pitch", "8um", "-o", "x.png"], "--pitch: with the preset holochrome-8"),
        (["render", "lens.npy", "--pitch", "8", "--wavelength", "532nm", "-o", "x.png"], "--pitch"),
        (["render", "lens.npy", "--pitch", "8m", "--wavelength", "532nm", "-o", "x.png"], "pitch"),
        (["render", "lens.npy", *KNOWN, "--random", "1", "-o", "x.png"], "--random"),
        (["render", "lens.npy", *KNOWN, "--scheme", "simultaneous", "-o", "x.png"], "--scheme"),
        (["render", "lens.npy", *KNOWN, "--set", "upsample=2", "-o", "x.png"], "known at points"),
        (["render", "lens.npy", *KNOWN, "--plane", "3m", "--propagation", "asm", "-o", "x.png"], "3"),
        (["render", "lens.npy", *KNOWN, "--steps", "0,90,180", "-o", "x.png"], "--steps"),
        (["render", "lens.npy", *KNOWN, "--aperture", "0,0,32", "-o", "x.png"], "--aperture"),
        (["render", "lens.npy", *KNOWN, "--aperture", "60,0,32,32", "-o", "x.png"], "region"),
        (["render", "lens.npy", *KNOWN, "--plane", "1cm", "--aperture", "9deg", "-o", "x.png"], "aperture"),
        (["render", "lens.npy", *KNOWN, "--parts", "real,colour", "-o", "x.png"], "colour"),
        (["render", "lens.npy", *KNOWN, "--effects", "crosstalk.sigma=0.4", *TORCH, "-o", "x.png"], "a field has none"),
        (["render", "cut.npy", *KNOWN, "-o", "x.png"], "cut.npy"),
    ],
)
def test_mistakes_with_fields_are_refused_in_one_line(holoview: Run, arguments: list[Any], words: str) -> None:
    np.save("lens.npy", _lens())
    Path("cut.npy").write_bytes(Path("lens.npy").read_bytes()[:1000])
    refused = holoview(*arguments)
    assert refused.code == 2 and words in refused.err
    lines = [line for line in refused.err.splitlines() if not line.startswith("note: ")]
    assert len(lines) == 1 and not Path("x.png").exists()


def _likeness(path: str, picture: NDArray[Any]) -> float:
    """Correlation of a rendered picture with another one of its shape, both blurred over its speckles."""
    seen = np.asarray(Image.open(path).convert("L"), float)
    blocks = [each.reshape(16, 8, 16, 8).mean(axis=(1, 3)).ravel() for each in (seen, picture)]
    return float(np.corrcoef(*blocks)[0, 1])


@pytest.mark.long
def test_of_phases_without_a_distance_the_far_field_or_the_focus_is_shown_and_said(holoview: Run) -> None:
    rng = np.random.default_rng(70)
    picture = np.zeros((128, 128))
    for _ in range(16):
        y, x = rng.integers(10, 100, 2)
        picture[y : y + 16, x : x + 6] = 1
    wave = picture * np.exp(2j * np.pi * rng.random(picture.shape))
    far = np.fft.fftshift(np.fft.ifft2(np.fft.ifftshift(wave)))
    near = _lens(shape=(128, 128), at=(70, 60))
    for name, pattern, value in (("far.png", far, "15.4 mm"), ("near.png", near, None)):
        levels = np.rint(np.angle(pattern) % (2 * np.pi) * 255 / (2 * np.pi))
        Image.fromarray(levels.astype(np.uint8)).save(name)
        done = holoview("render", name, *KNOWN, "--quantity", "phase", *TORCH, "-o", "seen.png", "--json")
        assert done.code == 0, done.err
        known = {entry["name"]: entry for entry in json.loads(done.out)["read"]["properties"]}["distance"]
        assert known["origin"] == "guessed" and f"distance {known['value']} was guessed" in done.err
        if value is None:  # the depth of focus is λ(2z/N·dx)² = 0.2 mm
            assert float(known["value"].removesuffix(" mm")) == pytest.approx(10, abs=0.2)
            assert np.abs(np.subtract(_brightest("seen.png"), (70, 60))).max() <= 1
        else:  # 128·(8 µm)²/532 nm
            assert known["value"] == value and "Fourier" in known["reason"]
            assert _likeness("seen.png", picture) > 0.7
    # asked for without a distance: the focal plane of a lens; and hv.load_field leaves a field in its plane
    done = holoview("render", "near.png", *KNOWN, "--propagation", "fourier", *TORCH, "-o", "seen.png")
    assert done.code == 0 and "15.4 mm" in done.err
    unmoved = hv.load_field("far.png", pitch="8um", wavelengths="532nm", quantity="phase").drive[0, 0]
    np.testing.assert_allclose(np.angle(unmoved), np.angle(np.exp(1j * np.angle(far))), atol=0.02)


def _tilted(turns: float) -> NDArray[np.complex64]:
    """A Gaussian beam of so many turns a sample along x."""
    y, x = (np.mgrid[:96, :96] - 47.5) * PITCH_M
    beam = np.exp(-(x**2 + y**2) / (0.1e-3) ** 2 + 2j * np.pi * turns * np.arange(96))
    return beam.astype(np.complex64)


@pytest.mark.long
def test_render_and_info_say_how_much_of_the_light_is_in_the_picture(holoview: Run) -> None:
    np.save("tilted.npy", _tilted(0.2))
    where = (*KNOWN, "--distance", "4cm", "--propagation", "asm")
    done = holoview("render", "tilted.npy", *where, *TORCH, "-o", "seen.png", "--json")
    result = json.loads(done.out)
    assert result["light_in_picture"] == result["planes"][0]["light_in_picture"] < 0.1
    assert "note: light in the picture: " in done.err and "--propagation auto" in done.err
    told = holoview("info", "tilted.npy", *where)
    assert "light in the picture" in told.out and "NOT TRUE" in told.out
    known = json.loads(holoview("info", "tilted.npy", *where, "--json").out)
    assert known["light_in_picture"] == pytest.approx(result["light_in_picture"], rel=1e-4)
    done = holoview("render", "tilted.npy", *where[:-2], *TORCH, "-o", "seen.png", "--json")
    assert json.loads(done.out)["light_in_picture"] > 0.95
    assert "light in the picture" not in done.err and "beside the axis" in done.err
    preset = holoview("render", "holochrome-8", *TORCH, "-o", "seen.png", "--json")
    assert 0 < json.loads(preset.out)["light_in_picture"] <= 1


def test_a_window_can_be_asked_for(holoview: Run) -> None:
    np.save("tilted.npy", _tilted(0.2))
    known = ("render", "tilted.npy", *KNOWN, "--distance", "4cm", *TORCH, "-o", "seen.png", "--json")
    beside = f"{0.04 * np.tan(np.arcsin(λ * 0.2 / PITCH_M)) * 1e3:.4g},0mm"
    done = holoview(*known, "--window-centre", beside, "--window-size", "0.8,0.6mm", "--window-pitch", "5um")
    assert json.loads(done.out)["light_in_picture"] > 0.95
    with Image.open("seen.png") as picture:
        assert picture.size == (160, 120)
    done = holoview(*known, "--window-size", "0.3mm")
    assert json.loads(done.out)["light_in_picture"] < 0.1 and "are in this window" in done.err
    for wrong in (("--window-centre", "1mm"), ("--window-size", "1,1,1mm"), ("--window-pitch", "0um")):
        refused = holoview(*known, *wrong)
        assert refused.code == 2 and "window" in refused.err
    refused = holoview("render", "holochrome-8", "--window-size", "1mm", *TORCH, "-o", "seen.png")
    assert refused.code == 2 and "--window-size" in refused.err


@pytest.mark.long
def test_render_says_what_it_guessed_as_info_does(holoview: Run) -> None:
    """A black and white picture, whose two values are guessed to be those of a bilevel hologram."""
    slit = np.zeros((64, 64), np.uint8)
    slit[:, 28:36] = 255
    Image.fromarray(slit).save("slit.png")
    known = ("slit.png", *KNOWN, "--distance", "1cm")
    done = holoview("render", *known, *TORCH, "-o", "seen.png", "--json")
    guesses = {entry["name"]: entry for entry in json.loads(done.out)["guesses"]}
    info = json.loads(holoview("info", *known, "--json").out)["read"]["properties"]
    assert {e["name"]: e["value"] for e in info if e["origin"] == "guessed"} == {
        name: entry["value"] for name, entry in guesses.items()
    }
    assert guesses and all(entry["reason"] for entry in guesses.values())
    for name, entry in guesses.items():
        assert f"note: {name} {entry['value']} was guessed: " in done.err
    given = holoview("render", *known, "--quantity", "amplitude", *TORCH, "-o", "seen.png", "--json")
    assert "quantity" in guesses and "quantity" not in [e["name"] for e in json.loads(given.out)["guesses"]]
    assert json.loads(holoview("render", "holochrome-8", *TORCH, "-o", "seen.png", "--json").out)["guesses"] == []
