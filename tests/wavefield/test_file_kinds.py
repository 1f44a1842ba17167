"""What files of other programs hold beside plain arrays: decimal commas, parts, channels, palettes, animations."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import OpenEXR
import pytest
import scipy.io
import tifffile
from numpy.typing import NDArray
from PIL import Image

from holoview.holograms.fields.reading import Reading, read_wavefield
from holoview.holograms.files.readers.text_table import TextReader
from holoview.holograms.files.request import Quantity, ReadRequest
from holoview.holograms.load_field import open_hologram
from holoview.util.errors import UserError

ROWS, COLUMNS = 16, 20
AMPLITUDE = ReadRequest(accept_guesses=True, quantity="amplitude")


def _values(*shape: int, seed: int = 0) -> NDArray[np.float32]:
    return np.random.default_rng(seed).random(shape or (ROWS, COLUMNS)).astype(np.float32)


def _numbers(path: Path, quantity: Quantity = "amplitude", **known: Any) -> tuple[NDArray[Any], Reading]:
    """The amplitudes of a file, (frame, colour, y, x), and what was read."""
    reading = read_wavefield(path, ReadRequest(accept_guesses=True, quantity=quantity, **known))
    assert reading.wavefield is not None
    return reading.wavefield.values.real, reading


def _said(reading: Reading) -> dict[str, str]:
    return {known.key: known.value for known in reading.provenance}


# --- tables of text ---------------------------------------------------------------------------------------------------


def _table(values: NDArray[Any], separator: str, comma: bool = False) -> str:
    lines = [separator.join(f"{x:.4f}".replace(".", "," if comma else ".") for x in row) for row in values]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("separator", [";", "; ", "\t", " ", "  "])
def test_decimal_commas_are_read_and_said(separator: str, tmp_path: Path) -> None:
    values = np.round(_values(), 4)
    (tmp_path / "a.csv").write_text(_table(values, separator, comma=True))
    found, reading = _numbers(tmp_path / "a.csv")
    assert np.array_equal(found[0, 0], values)
    assert "its commas are taken as decimal signs" in reading.notes


@pytest.mark.parametrize("separator", [",", ", ", ";", "\t", " ", ",\t"])
def test_decimal_points_stay_what_they_are(separator: str, tmp_path: Path) -> None:
    values = np.round(_values(), 4)
    (tmp_path / "a.txt").write_text(_table(values, separator))
    found, reading = _numbers(tmp_path / "a.txt")
    assert np.array_equal(found[0, 0], values)
    assert not reading.notes


@pytest.mark.parametrize(
    "data",
    [
        b"\xef\xbb\xbf" + _table(_values(), ";", comma=True).encode(),
        _table(_values(), ",").encode("utf-16"),
        b"\xfe\xff" + _table(_values(), "\t").encode("utf-16-be"),
        "x (µm);y\n1;2\n".encode("latin-1") + _table(_values(), ";", comma=True).encode(),
        _table(_values(), ",").replace("\n", ",\r\n").encode(),
        b"% a comment\n" + _table(_values(), " ").encode() + b"# the end\n",
        _table(_values(), ";").replace("\n", "\r\r\n").encode(),
    ],
    ids=["utf-8 with a mark", "utf-16", "utf-16, big end first", "header in Latin-1", "trailing", "comments", "blank"],
)
def test_tables_in_other_dress_are_read(data: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(data)
    assert np.array_equal(_numbers(tmp_path / "a.csv")[0][0, 0], np.round(_values(), 4).astype(np.float32))


def test_rows_and_columns_that_count_are_left_out_and_said(tmp_path: Path) -> None:
    """As programs write tables with their index, and with the numbers of their columns as names."""
    values = np.round(_values(), 4)
    numbers = ",".join(map(str, range(COLUMNS)))
    lines = [",".join(f"{x:.4f}" for x in row) for row in values]
    (tmp_path / "rows.csv").write_text("\n".join([f",{numbers}", *(f"{y},{line}" for y, line in enumerate(lines))]))
    (tmp_path / "columns.csv").write_text("\n".join([numbers, *lines]))
    for name, word in (("rows", "column"), ("columns", "row")):
        found, reading = _numbers(tmp_path / f"{name}.csv")
        assert np.array_equal(found[0, 0], values.astype(np.float32))
        assert f"its first {word} counts from 0: it is left out" in reading.notes
    ramp = np.add.outer(np.zeros(12), np.arange(16))
    (tmp_path / "ramp.csv").write_text(_table(ramp, ","))
    assert np.array_equal(_numbers(tmp_path / "ramp.csv")[0][0, 0], ramp)


def test_complex_numbers_in_text(tmp_path: Path) -> None:
    u = np.round(_values(), 3) + 1j * np.round(_values(seed=1), 3)
    for form in ("{0.real}{0.imag:+}i", "({0.real}{0.imag:+}j)"):
        (tmp_path / "a.csv").write_text("\n".join(",".join(form.format(x) for x in row) for row in u))
        field = read_wavefield(tmp_path / "a.csv", ReadRequest(accept_guesses=True)).wavefield
        assert field is not None and np.array_equal(field.values[0, 0], u.astype(np.complex64))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1,234;5,678;9,012\n" * 9, '"1,234" may be 1.234 or 1234; .* decimal points'),
        ("0,512,0,034,0,250\n0,100,0,730,0,001\n" * 9, "commas may be decimal signs as well as separators"),
        ("0.5,0.1;0.7,0.2;0.9,0.3\n" * 9, "both commas and semicolons stand between digits"),
        ("1.234,5;2.345,6;3.456,7\n" * 9, "both commas and semicolons stand between digits"),
        ("1;2;3\n4;;6\n" * 9, "the cell in row 2, column 2 is empty"),
        (_table(_values(), " ") + "\n" + _table(_values(), " "), "holds 2 tables of 16 rows"),
        ("1 2 3\n4 5\n" * 9, "rows of 2 to 3 numbers"),
        ("\n".join(f"{y} {x} {x * y}" for y in range(5) for x in range(7)), "a list of the values at 5 × 7 places"),
    ],
)
def test_doubtful_tables_are_refused_with_what_would_decide(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(UserError, match=words):
        read_wavefield(tmp_path / "a.csv", AMPLITUDE)


# --- OpenEXR ----------------------------------------------------------------------------------------------------------


def _exr(path: Path, **parts: dict[str, NDArray[np.float32]]) -> Path:
    made = [
        OpenEXR.Part({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, channels, name)
        for name, channels in parts.items()
    ]
    with OpenEXR.File(made) as file:
        file.write(str(path))
    return path


def test_parts_of_openexr_are_listed_and_chosen_by_name(tmp_path: Path) -> None:
    left, right = _values(), _values(seed=1)
    file = _exr(tmp_path / "a.exr", left={"Y": left}, right={"Y": right})
    found, reading = _numbers(file)
    assert np.array_equal(found[0, 0], left)
    assert any("--variable takes another one like it: right" in note for note in reading.notes)
    assert np.array_equal(_numbers(file, variable="right")[0][0, 0], right)


def test_real_and_imaginary_channels_belong_to_one_part(tmp_path: Path) -> None:
    a, b, c, d = (_values(seed=seed) for seed in range(4))
    file = _exr(tmp_path / "a.exr", first={"real": a, "imag": b}, second={"real": c, "imag": d})
    for variable, expected in ((None, a + 1j * b), ("second.real,second.imag", c + 1j * d)):
        request = ReadRequest(accept_guesses=True, variable=variable)
        field = read_wavefield(file, request).wavefield
        assert field is not None and np.array_equal(field.values[0, 0], expected)


def test_channels_with_a_leading_dot_are_colours(tmp_path: Path) -> None:
    colours = _values(3, ROWS, COLUMNS)
    file = _exr(tmp_path / "a.exr", only=dict(zip((".R", ".G", ".B"), colours, strict=True)))
    assert np.array_equal(_numbers(file)[0][0], colours)


@pytest.mark.parametrize(
    ("names", "wavelengths_m"),
    [
        (("S0.450,0nm", "S0.632,8nm", "S0.550,5nm"), (632.8e-9, 550.5e-9, 450e-9)),
        (("T.0,4um", "T.0,6um", "T.0,5um"), (600e-9, 500e-9, 400e-9)),
        (("S0.600,0THz", "S0.400,0THz", "S0.500,0THz"), (749.48e-9, 599.58e-9, 499.65e-9)),
    ],
)
def test_spectral_channels_state_their_wavelengths(
    names: tuple[str, ...], wavelengths_m: tuple[float, ...], tmp_path: Path
) -> None:
    """JCGT 10(3), 2021; c = 299 792.458 nm·THz. Channels are sorted by falling wavelength."""
    shortest, longest, middle = _values(3, ROWS, COLUMNS)
    channels = dict(zip(names, (shortest, longest, middle), strict=True))
    stokes = {name.replace("S0", "S3"): longest for name in names if name.startswith("S0")}
    found, reading = _numbers(_exr(tmp_path / "a.exr", only=channels | stokes))
    assert reading.wavefield is not None
    assert reading.wavefield.wavelengths_m == pytest.approx(wavelengths_m, rel=1e-4)
    order = (longest, middle, shortest)
    assert np.array_equal(found[0], np.stack(order))
    assert any("S3 describes polarisation" in note for note in reading.notes) == bool(stokes)


# --- TIFF -------------------------------------------------------------------------------------------------------------


def test_channels_of_imagej_are_colours_and_slices_frames(tmp_path: Path) -> None:
    values = _values(4, 2, ROWS, COLUMNS)
    calibrated = {"imagej": True, "resolution": (4.0, 2.0), "photometric": "minisblack"}
    tifffile.imwrite(tmp_path / "tc.tif", values, metadata={"axes": "TCYX", "unit": "um"}, **calibrated)
    tifffile.imwrite(tmp_path / "c.tif", values[0], metadata={"axes": "CYX", "unit": "um"}, **calibrated)
    tifffile.imwrite(tmp_path / "z.tif", values[:, 0], metadata={"axes": "ZYX", "unit": "um"}, **calibrated)
    for name, expected in (("tc", values), ("c", values[:1]), ("z", values[:, :1])):
        found, reading = _numbers(tmp_path / f"{name}.tif", wavelengths_m=(6e-7, 5e-7)[: expected.shape[1]])
        assert np.array_equal(found, expected)
        assert reading.wavefield is not None
        assert reading.wavefield.pitch_m == pytest.approx((0.5e-6, 0.25e-6))
        assert ("its 2 channels are taken as colours" in reading.notes) == ("c" in name)


def test_an_ome_description_states_pitch_and_channels(tmp_path: Path) -> None:
    values = _values(3, ROWS, COLUMNS)
    sizes = {"PhysicalSizeX": 65.0, "PhysicalSizeXUnit": "nm", "PhysicalSizeY": 0.13}
    tifffile.imwrite(tmp_path / "a.ome.tif", values, photometric="minisblack", metadata={"axes": "CYX", **sizes})
    found, reading = _numbers(tmp_path / "a.ome.tif")
    assert np.array_equal(found, values[None])
    assert reading.wavefield is not None and reading.wavefield.pitch_m == pytest.approx((130e-9, 65e-9))


@pytest.mark.parametrize(("samples", "colours"), [(2, 1), (4, 3)])
@pytest.mark.parametrize("planes", ["contig", "separate"])
def test_alpha_is_no_colour(samples: int, colours: int, planes: Any, tmp_path: Path) -> None:
    values = (_values(ROWS, COLUMNS, samples) * 255).astype(np.uint8)
    stored = values if planes == "contig" else np.moveaxis(values, -1, 0)
    kind: Any = "minisblack" if colours == 1 else "rgb"
    tifffile.imwrite(tmp_path / "a.tif", stored, photometric=kind, planarconfig=planes, extrasamples=["unassalpha"])
    found, reading = _numbers(tmp_path / "a.tif")
    assert np.array_equal(np.rint(found[0] * 255), np.moveaxis(values[..., :colours], -1, 0))
    assert any("transparency" in note for note in reading.notes)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_where_the_smallest_number_is_white_numbers_are_turned_round(dtype: type, tmp_path: Path) -> None:
    full = np.iinfo(dtype).max
    values = (_values() * full).astype(dtype)
    values[0, :2] = 0, full
    tifffile.imwrite(tmp_path / "a.tif", full - values, photometric="miniswhite")
    found, reading = _numbers(tmp_path / "a.tif")
    np.testing.assert_allclose(found[0, 0] * full, values, atol=full * 2.0**-23)
    assert any("WhiteIsZero" in note for note in reading.notes)


def test_a_palette_is_looked_up(tmp_path: Path) -> None:
    index = (_values() * 255).astype(np.uint8)
    palette = (_values(3, 256) * 65535).astype(np.uint16)
    tifffile.imwrite(tmp_path / "a.tif", index, photometric="palette", colormap=palette)
    found, reading = _numbers(tmp_path / "a.tif")
    np.testing.assert_allclose(found[0] * 65535, palette[:, index], atol=0.01)
    assert any("palette" in note for note in reading.notes)


# --- pictures ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".gif", ".png"])
def test_of_an_animation_the_first_picture_is_read_and_said(suffix: str, tmp_path: Path) -> None:
    pictures = [Image.fromarray((_values(seed=seed) * 255).astype(np.uint8)) for seed in range(3)]
    pictures[0].save(tmp_path / f"a{suffix}", save_all=True, append_images=pictures[1:])
    found, reading = _numbers(tmp_path / f"a{suffix}")
    assert np.array_equal(np.rint(found[0, 0] * 255), np.asarray(pictures[0]))
    assert any("animation of 3 pictures, of which the first is read" in note for note in reading.notes)


def test_inks_palettes_and_turned_pictures_are_told(tmp_path: Path) -> None:
    grey = Image.fromarray((_values() * 255).astype(np.uint8))
    flag = grey.getexif()
    flag[0x112] = 6
    grey.save(tmp_path / "turned.jpg", exif=flag)
    Image.fromarray((_values(ROWS, COLUMNS, 4) * 255).astype(np.uint8), "CMYK").save(tmp_path / "inks.jpg")
    coloured = grey.convert("P")
    coloured.putpalette([*np.roll(np.arange(768) % 256, 7)])
    coloured.save(tmp_path / "palette.png")
    for name, words in (("turned.jpg", "orientation"), ("inks.jpg", "CMYK"), ("palette.png", "palette")):
        assert any(words in note for note in _numbers(tmp_path / name)[1].notes)


def _two_values(path: Path, pattern: NDArray[np.bool_]) -> str:
    Image.fromarray(np.where(pattern, np.uint8(255), np.uint8(0))).save(path)
    return _said(read_wavefield(path, ReadRequest(accept_guesses=True)))["quantity"]


@pytest.mark.long
def test_a_slit_is_an_aperture_and_fringes_are_a_bilevel_hologram(tmp_path: Path) -> None:
    y, x = np.mgrid[:256, :256]
    rng = np.random.default_rng(0)
    apertures = {
        "slit": abs(x - 128) < 5,
        "two slits": abs(abs(x - 128) - 20) < 3,
        "disc": np.hypot(y - 128, x - 128) < 60,
        "bars": (x // 16) % 2 == 0,
        "points": rng.random((256, 256)) < 0.02,
    }
    holograms = {
        "carrier along y": np.cos(2 * np.pi * y / 4 + 3 * np.sin(x / 20) + 2 * np.cos(y / 31)) > 0,
        "random object": rng.random((256, 256)) < 0.5,
        "ten samples a fringe": np.cos(2 * np.pi * y / 10 + 0.6 * x) > 0,
    }
    for name, pattern in apertures.items():
        assert _two_values(tmp_path / "a.png", pattern) == "amplitude", name
    for name, pattern in holograms.items():
        assert _two_values(tmp_path / "a.png", pattern) == "bilevel", name


def test_smooth_edges_and_jpeg_leave_a_drawing_an_aperture(tmp_path: Path) -> None:
    y, x = np.mgrid[:256, :256]
    disc = np.clip(60.5 - np.hypot(y - 128, x - 128), 0, 1)
    Image.fromarray(np.rint(255 * disc).astype(np.uint8)).save(tmp_path / "a.png")
    Image.fromarray(np.where(abs(x - 128) < 6, np.uint8(255), np.uint8(0))).save(tmp_path / "b.jpg", quality=90)
    for name in ("a.png", "b.jpg"):
        reading = read_wavefield(tmp_path / name, ReadRequest(accept_guesses=True))
        assert reading.kind == "field" and _said(reading)["quantity"] == "amplitude", name


def test_the_guess_names_the_option_that_changes_it(tmp_path: Path) -> None:
    pattern = np.zeros((64, 64), np.uint8)
    pattern[:, 30:34] = 255
    Image.fromarray(pattern).save(tmp_path / "a.png")
    (told,) = [p for p in read_wavefield(tmp_path / "a.png", ReadRequest(accept_guesses=True)).provenance
               if p.key == "quantity"]  # fmt: skip
    assert told.origin == "guessed" and "--quantity bilevel" in told.reason


def test_the_far_picture_of_a_slit_has_its_minima_and_says_its_scale(tmp_path: Path) -> None:
    """Fraunhofer: minima at n·λz/w on either side of the middle, 5.32 mm for 0.1 mm, 532 nm and 1 m."""
    slit = np.zeros((256, 1024), np.uint8)
    slit[:, 507:517] = 255
    Image.fromarray(slit).save(tmp_path / "slit.png")
    opened = open_hologram([tmp_path / "slit.png"], ReadRequest((10e-6, 10e-6), (532e-9,), 1.0))
    field = opened.hologram.field()
    power = np.square(np.abs(field.values[0, 0])).sum(axis=0)
    pitch_m = field.pitch_m[1]
    place_m = (np.arange(len(power)) - len(power) // 2) * pitch_m
    for order in (1, 2):
        near = np.abs(place_m - order * 5.32e-3) < 2e-3
        assert place_m[near][np.argmin(power[near])] == pytest.approx(order * 5.32e-3, abs=pitch_m)
    assert any(f"a sample of the picture is {pitch_m * 1e6:.4g} um wide" in note for note in opened.notes)


# --- variables and attributes -----------------------------------------------------------------------------------------


def test_coordinates_along_the_axes_of_hdf5_state_the_pitch(tmp_path: Path) -> None:
    """As netCDF, xarray and HoloPy write them, with settings that are YAML documents; uneven ones state nothing."""
    picture = np.random.default_rng(0).random((1, 24, 32)) + 1
    for name, uneven in (("even.h5", 0.0), ("uneven.h5", 0.3)):
        with h5py.File(tmp_path / name, "w") as file:
            data = file.create_dataset("data", data=picture)
            for axis, (key, step) in enumerate((("z", 0.0), ("x", 1.5e-7), ("y", 1.15e-7))):
                places = np.arange(picture.shape[axis]) * step
                places[1:2] *= 1 + uneven
                file.create_dataset(key, data=places).make_scale(key)
                data.dims[axis].attach_scale(file[key])
            data.attrs["illum_wavelen"] = "6.58e-07\n...\n"
    found = read_wavefield(tmp_path / "even.h5", ReadRequest(recording="in-line")).recording
    assert found is not None and found.pitch_m == pytest.approx((1.5e-7, 1.15e-7))
    assert found.wavelengths_m == pytest.approx([658e-9])
    with pytest.raises(UserError, match="pitch"):
        read_wavefield(tmp_path / "uneven.h5", ReadRequest(recording="in-line"))


def test_attributes_of_hdf5_state_lengths(tmp_path: Path) -> None:
    u = (_values() + 1j * _values(seed=1)).astype(np.complex64)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        dataset = file.create_dataset("holo", data=u)
        dataset.attrs.update({"illum_wavelen": 0.66, "pixel_size": "51.8 nm", "medium_index": 1.33})
    reading = read_wavefield(tmp_path / "a.h5")
    assert reading.wavefield is not None
    assert reading.wavefield.wavelengths_m == pytest.approx([660e-9])
    assert reading.wavefield.pitch_m == pytest.approx((51.8e-9,) * 2)
    assert any("--index 1.33" in note for note in reading.notes)


def test_variables_of_matlab_state_lengths(tmp_path: Path) -> None:
    phase = (_values() * 6.2).astype(np.float64)
    structure = {"lambda": "532 nm", "camera": {"pitch_um": 3.74}, "z_mm": 120.0}
    scipy.io.savemat(tmp_path / "a.mat", {"phs": phase, "params": structure})
    reading = read_wavefield(tmp_path / "a.mat")
    assert reading.wavefield is not None
    assert _said(reading)["quantity"] == "phase"
    assert reading.wavefield.pitch_m == pytest.approx((3.74e-6,) * 2)
    assert reading.wavefield.wavelengths_m == pytest.approx([532e-9])
    assert reading.wavefield.distance_m == pytest.approx(0.12)


def test_a_pitch_of_doubtful_unit_is_told(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"u": _values() + 1j, "pp": 0.02, "lambda_nm": 500.0})
    assert any("pitch 20 um was guessed" in note for note in read_wavefield(tmp_path / "a.mat").notes)


def test_of_two_lengths_in_a_name_the_wavelength_is_no_pitch(tmp_path: Path) -> None:
    u = (_values() + 1j).astype(np.complex64)
    for name, pitch_m in (("h_0.633um_3.45um", 3.45e-6), ("h_2um_3um", None), ("h_0.5um", 0.5e-6)):
        np.save(tmp_path / f"{name}.npy", u)
        request = ReadRequest(wavelengths_m=(633e-9,), accept_guesses=True)
        reading = read_wavefield(tmp_path / f"{name}.npy", request)
        assert reading.wavefield is not None
        assert any(q.key == "pitch" for q in reading.questions) == (pitch_m is None)
        assert pitch_m is None or reading.wavefield.pitch_m == pytest.approx((pitch_m,) * 2)


def test_a_hologram_comes_before_its_background(tmp_path: Path) -> None:
    holo = _values() + 1
    scipy.io.savemat(tmp_path / "a.mat", {"background": _values(seed=1), "holo": holo})
    assert np.array_equal(_numbers(tmp_path / "a.mat")[0][0, 0], holo.astype(np.float32))


def test_equal_arrays_are_named(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", first=_values() + 1j, second=_values(seed=1) + 1j)
    reading = read_wavefield(tmp_path / "a.npz", ReadRequest(accept_guesses=True))
    assert any('"first" is read; --variable takes another one like it: second' in note for note in reading.notes)


# --- bits -------------------------------------------------------------------------------------------------------------


def _recording(path: Path, counts: NDArray[Any]) -> Reading:
    tifffile.imwrite(path, counts)
    return read_wavefield(path, ReadRequest(accept_guesses=True, recording="in-line"))


def test_a_recording_says_its_bits_and_how_much_is_clipped(tmp_path: Path) -> None:
    counts = np.clip(np.random.default_rng(0).exponential(2000, (200, 200)), 0, 4095).astype(np.uint16)
    share = np.mean(counts == 4095)
    for stored, words in ((counts, "12 bits in 16"), (counts << np.uint16(4), "12 bits left-justified in 16")):
        reading = _recording(tmp_path / "a.tif", stored)
        assert _said(reading)["bits"] == words
        assert any(f"{share:.2%} of the samples are {stored.max()}" in note for note in reading.notes)
    assert not any("saturated" in note for note in _recording(tmp_path / "a.tif", counts // 2 + _fine(counts)).notes)


def _fine(counts: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Numbers that spread a pile of equal counts."""
    return np.random.default_rng(1).integers(0, 2000, counts.shape).astype(np.uint16)


def test_phases_that_are_left_justified_have_their_own_turn(tmp_path: Path) -> None:
    levels = np.arange(256, dtype=np.uint16).reshape(16, 16) << np.uint16(8)
    tifffile.imwrite(tmp_path / "phase.tif", levels)
    field = read_wavefield(tmp_path / "phase.tif", ReadRequest(accept_guesses=True)).wavefield
    assert field is not None
    expected = np.exp(2j * np.pi * (levels >> np.uint16(8)) / 255)
    np.testing.assert_allclose(field.values[0, 0], expected, atol=1e-6)


def test_colours_in_separate_files_have_one_scale(tmp_path: Path) -> None:
    """Amplitudes up to 900 in one file and 3000 in another of one camera keep their ratio."""
    for colour, most in (("red", 900), ("green", 3000), ("blue", 2000)):
        tifffile.imwrite(tmp_path / f"amplitude_{colour}.tif", np.full((8, 8), most, np.uint16))
    files = [tmp_path / f"amplitude_{colour}.tif" for colour in ("red", "green", "blue")]
    field = read_wavefield(files, ReadRequest((8e-6, 8e-6), (6e-7, 5e-7, 4e-7), quantity="amplitude")).wavefield
    assert field is not None
    assert field.values[0, :, 0, 0] == pytest.approx(np.array([900, 3000, 2000]) / 4095, rel=1e-6)


def test_binary_data_with_digits_are_no_table() -> None:
    assert not TextReader().recognises(struct.pack("<I", 7) + b"\n1 2 3\n")
