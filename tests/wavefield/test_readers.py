"""Every file format, written here from its description without the readers' code, is read back number by number."""

from __future__ import annotations

import struct
import zipfile
import zlib
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path

import h5py
import numpy as np
import OpenEXR
import psutil
import pytest
import scipy.io
import tifffile
from numpy.typing import NDArray
from PIL import Image
from safetensors.numpy import save_file

from holoview.holograms.fields.interpret.known_files import AlikeFiles, find_alike
from holoview.holograms.fields.reading import BinaryLayout, Reading, ReadRequest, read_wavefield
from holoview.holograms.files.readers import registry
from holoview.holograms.files.readers.contents import Facts
from holoview.util.errors import UserError

WAVES = (640e-9, 532e-9, 473e-9)
PITCH = (8e-6, 8e-6)
ONE = ReadRequest(pitch_m=PITCH, wavelengths_m=WAVES[:1])
THREE = ReadRequest(pitch_m=PITCH, wavelengths_m=WAVES)
GUESSED = ReadRequest(accept_guesses=True)
# A field is kept in complex64: real and imaginary part are rounded to 2⁻²⁴ of their size, which is 5 at most here.
ROUNDING = 5 * 2.0**-24


def _complex(*shape: int, seed: int = 1) -> NDArray[np.complex128]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def _values(reading: Reading) -> NDArray[np.complex64]:
    assert reading.wavefield is not None
    return reading.wavefield.values


def _pictures(reading: Reading) -> NDArray[np.float32]:
    assert reading.recording is not None
    return reading.recording.pictures


def _said(reading: Reading, key: str) -> tuple[str, str]:
    return next((p.value, p.origin) for p in reading.provenance if p.key == key)


# --- MATLAB ---


@pytest.mark.parametrize("compressed", [False, True])
def test_matlab_5_gives_the_complex_array_and_what_stands_beside_it(tmp_path: Path, compressed: bool) -> None:
    u = _complex(20, 30, 3)
    scipy.io.savemat(
        tmp_path / "f.mat",
        {"X": np.zeros((50, 50)), "dh": u, "pp": [8e-6, 9e-6], "wlen": np.array(WAVES), "txt": "hello"},
        do_compression=compressed,
    )
    reading = read_wavefield(tmp_path / "f.mat")
    np.testing.assert_allclose(_values(reading)[0], np.moveaxis(u, -1, 0), atol=ROUNDING)
    assert _said(reading, "variable") == ("dh", "guessed")
    assert _said(reading, "pitch") == ("8 um × 9 um", "file")
    assert [c.name for c in reading.candidates] == ["dh", "X"]


def test_a_structure_of_matlab_gives_its_fields(tmp_path: Path) -> None:
    u = _complex(20, 30)
    scipy.io.savemat(tmp_path / "f.mat", {"CGH": {"Hol": u, "setup": {"pp": 1e-6, "wlen": 633e-9}, "zrec": 0.0142}})
    reading = read_wavefield(tmp_path / "f.mat")
    np.testing.assert_allclose(_values(reading)[0, 0], u, atol=ROUNDING)
    assert _said(reading, "variable") == ("CGH.Hol", "guessed")
    assert _said(reading, "wavelengths") == ("633 nm", "file")
    assert _said(reading, "distance") == ("14.2 mm", "file")


def _matlab_73(path: Path, name: str, u: NDArray[np.complex128], others: dict[str, list[list[float]]]) -> None:
    """As MATLAB writes it: a text of 512 bytes, axes in reverse, complex numbers as pairs."""
    with h5py.File(path, "w", userblock_size=512) as file:
        pairs = np.empty(u.T.shape, [("real", "<f8"), ("imag", "<f8")])
        pairs["real"], pairs["imag"] = u.T.real, u.T.imag
        file[name] = pairs
        file[name].attrs["MATLAB_class"] = np.bytes_("double")
        for key, value in others.items():
            file[key] = np.array(value).T
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def test_matlab_73_is_hdf5_with_its_axes_in_reverse(tmp_path: Path) -> None:
    u = _complex(20, 30, 3)
    _matlab_73(tmp_path / "f.mat", "CGH/Hol", u, {"CGH/setup/pp": [[1e-6]], "CGH/setup/wlen": [[*WAVES]]})
    reading = read_wavefield(tmp_path / "f.mat")
    np.testing.assert_allclose(_values(reading)[0], np.moveaxis(u, -1, 0), atol=ROUNDING)
    part = read_wavefield(tmp_path / "f.mat", ReadRequest(region=(4, 6, 10, 8)))
    np.testing.assert_allclose(_values(part)[0], np.moveaxis(u[6:14, 4:14], -1, 0), atol=ROUNDING)


def test_a_bilevel_hologram_gives_the_field_on_one_side_of_its_carrier(tmp_path: Path) -> None:
    """The real part of a field with frequencies above 0 along y is half the field and half its conjugate."""
    spectrum = np.zeros((32, 48), complex)
    spectrum[3:13, 5:20] = _complex(10, 15)
    u = np.fft.ifft2(spectrum)
    scipy.io.savemat(tmp_path / "bin.mat", {"Hbin": u.real})
    reading = read_wavefield(tmp_path / "bin.mat", ONE)
    np.testing.assert_allclose(_values(reading)[0, 0], u / 2, atol=ROUNDING)
    assert _said(reading, "quantity")[0] == "bilevel"


def test_a_file_of_the_jpeg_pleno_set_is_known_by_its_name(tmp_path: Path) -> None:
    _matlab_73(tmp_path / "DeepDices2K.mat", "data", _complex(16, 24, 3), {})
    reading = read_wavefield(tmp_path / "DeepDices2K.mat")
    assert _said(reading, "pitch") == ("4.8 um", "guessed")
    assert _said(reading, "wavelengths") == ("640 nm, 532 nm, 473 nm", "guessed")
    assert "5.07 mm, 7.41 mm, 86.7 mm" in " ".join(reading.notes)
    scipy.io.savemat(tmp_path / "opt_Squirrel.mat", {"dh": _complex(16, 24)})
    squirrel = read_wavefield(tmp_path / "opt_Squirrel.mat").wavefield
    assert squirrel is not None
    assert squirrel.reference_radius_m == 0.5


def test_an_array_like_those_of_the_jpeg_pleno_set_gives_better_guesses(tmp_path: Path) -> None:
    """`dh` of one colour is that of twelve holograms of one pitch and several wavelengths; `Hol` needs its size too."""
    scipy.io.savemat(tmp_path / "mine.mat", {"dh": _complex(16, 24)})
    reading = read_wavefield(tmp_path / "mine.mat", ReadRequest(accept_guesses=True))
    guesses = {question.key: (question.guess, question.reason) for question in reading.questions}
    assert guesses["pitch"][0] == "3.45 um" and "interfereIV" in guesses["pitch"][1]
    assert guesses["wavelengths"][1] == "the most usual laser of holograms"
    with pytest.raises(UserError, match=r"--pitch 3\.45um"):
        read_wavefield(tmp_path / "mine.mat")
    assert find_alike("Hol", 1, (1920, 1080)).facts == Facts((8e-6, 8e-6), (632.8e-9,))
    assert find_alike("Hol", 1, (24, 16)) == find_alike("U", 1, (1080, 1920)) == AlikeFiles()
    assert find_alike("data", 3, (8192, 8192)).facts.pitch_m == (0.4e-6, 0.4e-6)


@pytest.mark.long
@pytest.mark.parametrize("name", ["dices200k_{}_{}.bmp", "P00_{:02}{:02}.tif"])
def test_tiles_are_one_field_of_which_the_needed_ones_are_opened(tmp_path: Path, name: str) -> None:
    whole = np.random.default_rng(5).integers(0, 2, (5 * 700, 2 * 30)).astype(np.uint8) * 255
    for y, x in np.ndindex(5, 2):
        Image.fromarray(whole[700 * y : 700 * y + 700, 30 * x : 30 * x + 30]).save(tmp_path / name.format(y, x))
    (tmp_path / name.format(4, 1)).write_bytes(b"damaged")  # outside the part that is read and the middle
    part = ReadRequest(wavelengths_m=(532e-9,), quantity="amplitude", region=(10, 690, 40, 22))
    reading = read_wavefield([tmp_path / name.format(0, 0)], part)
    assert reading.wavefield is not None
    assert np.array_equal(reading.wavefield.values[0, 0].real, whole[690:712, 10:50] / 255)
    assert reading.wavefield.pitch_m[0] in (0.24e-6, 0.5e-6)
    (tmp_path / name.format(1, 1)).unlink()
    with pytest.raises(UserError, match="row 1, column 1"):
        read_wavefield([tmp_path / name.format(0, 0)], part)


def test_objects_of_matlab_are_refused_with_what_to_do(tmp_path: Path) -> None:
    name = b"thing\0\0\0"
    opaque = struct.pack("<IIII", 6, 8, 17, 0) + struct.pack("<II", 1, 5) + name
    element = struct.pack("<II", 14, len(opaque)) + opaque
    header = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    (tmp_path / "f.mat").write_bytes(header + element)
    with pytest.raises(UserError, match=r'"thing" is an object of MATLAB.*save its array'):
        read_wavefield(tmp_path / "f.mat", GUESSED)


def test_a_compressed_variable_that_unpacks_to_more_than_it_states_is_refused(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "f.mat", {"u": _complex(20, 30)}, do_compression=True)
    data = (tmp_path / "f.mat").read_bytes()
    (size,) = struct.unpack("<I", data[132:136])
    packed = zlib.compress(zlib.decompress(data[136 : 136 + size]) + bytes(1 << 24))
    (tmp_path / "f.mat").write_bytes(data[:132] + struct.pack("<I", len(packed)) + packed)
    with pytest.raises(UserError, match="unpacks to more than the stated"):
        read_wavefield(tmp_path / "f.mat", GUESSED)


def test_structures_without_end_are_refused(tmp_path: Path) -> None:
    inner = b""
    for _ in range(3000):
        body = struct.pack("<IIIIIIiiII", 6, 8, 1, 0, 5, 8, 1, 1, 1, 0) + inner  # a cell of one cell
        inner = struct.pack("<II", 14, len(body)) + body
    body = (
        struct.pack("<IIII", 6, 8, 1, 0) + struct.pack("<IIii", 5, 8, 1, 1) + struct.pack("<HH4s", 1, 1, b"s") + inner
    )
    element = struct.pack("<II", 14, len(body)) + body
    (tmp_path / "f.mat").write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + element)
    with pytest.raises(UserError, match="deep inside each other"):
        read_wavefield(tmp_path / "f.mat", GUESSED)


# --- HDF5, safetensors, EXR, TIFF ---


def test_hdf5_of_other_programs_keeps_its_axes_and_its_attributes(tmp_path: Path) -> None:
    u = _complex(3, 20, 30)
    with h5py.File(tmp_path / "f.h5", "w") as file:
        file.create_dataset("a/field", data=u, chunks=(1, 8, 8), compression="gzip")
        file["a/field"].attrs["pixel_pitch"] = 3.74
        file["a"].attrs["wavelengths"] = [639.0, 532.0, 473.0]
        file["ext"] = h5py.ExternalLink("/etc/passwd", "x")
    reading = read_wavefield(tmp_path / "f.h5", ReadRequest(region=(2, 3, 20, 10)))
    np.testing.assert_allclose(_values(reading)[0], u[:, 3:13, 2:22], atol=ROUNDING)
    assert _said(reading, "pitch") == ("3.74 um", "file")
    assert _said(reading, "wavelengths") == ("639 nm, 532 nm, 473 nm", "file")
    assert any("a link: not followed" in note for note in reading.notes)


def test_safetensors_with_real_and_imaginary_part(tmp_path: Path) -> None:
    u = _complex(20, 30)
    tensors = {"u_real": u.real.astype("f4"), "u_imag": u.imag.astype("f4"), "mask": np.ones((99, 99), "f4")}
    save_file(tensors, tmp_path / "f.safetensors", metadata={"pitch": "6.4e-6", "wavelength": "5.2e-7"})
    reading = read_wavefield(tmp_path / "f.safetensors")
    np.testing.assert_allclose(_values(reading)[0, 0], u, atol=ROUNDING)
    assert _said(reading, "pitch") == ("6.4 um", "file")


def test_two_exr_files_are_real_and_imaginary_part_in_three_colours(tmp_path: Path) -> None:
    u = _complex(20, 30, 3)
    for name, part in (("real", u.real), ("imag", u.imag)):
        channels = {c: part[..., i].astype("f4").copy() for i, c in enumerate("RGB")}
        OpenEXR.File({}, channels).write(str(tmp_path / f"dice_{name}.exr"))
    paths = [tmp_path / "dice_real.exr", tmp_path / "dice_imag.exr"]
    reading = read_wavefield(paths, THREE)
    np.testing.assert_allclose(_values(reading)[0], np.moveaxis(u, -1, 0), atol=ROUNDING)
    alone = read_wavefield(paths[0], THREE)
    assert any("dice_imag.exr" in note for note in alone.notes)


@pytest.mark.parametrize("compression", [None, "zlib"])
def test_complex_tiff_and_stacks(tmp_path: Path, compression: str | None) -> None:
    u = _complex(20, 30).astype("c8")
    tifffile.imwrite(tmp_path / "c.tif", u, compression=compression)
    np.testing.assert_array_equal(_values(read_wavefield(tmp_path / "c.tif", ONE))[0, 0], u)
    phases = np.random.default_rng(0).uniform(-np.pi, np.pi, (8, 64, 64)).astype("f4")
    tifffile.imwrite(tmp_path / "p.tif", phases, compression=compression, photometric="minisblack", byteorder=">")
    values = _values(read_wavefield(tmp_path / "p.tif", ONE))
    np.testing.assert_allclose(values[:, 0], np.exp(1j * phases), atol=8 * 2.0**-24)


def test_a_16_bit_tiff_that_uses_8_bits_is_scaled_by_8_bits(tmp_path: Path) -> None:
    levels = np.random.default_rng(0).integers(0, 256, (64, 64)).astype("u2")
    tifffile.imwrite(tmp_path / "phase.tif", levels)
    reading = read_wavefield(tmp_path / "phase.tif", ONE)
    assert _said(reading, "phase levels") == ("255", "guessed")
    np.testing.assert_allclose(_values(reading)[0, 0], np.exp(2j * np.pi * levels / 255), atol=8 * 2.0**-24)


# --- pictures ---


def test_amplitude_and_phase_are_found_by_the_names_of_two_bitmaps(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    amplitude, phase = (rng.integers(0, 256, (20, 30, 3)).astype("u1") for _ in range(2))
    Image.fromarray(amplitude).save(tmp_path / "dice8k_ampli.bmp")
    Image.fromarray(phase).save(tmp_path / "dice8k_phase.bmp")
    reading = read_wavefield([tmp_path / "dice8k_phase.bmp", tmp_path / "dice8k_ampli.bmp"], THREE)
    expected = amplitude / 255 * np.exp(2j * np.pi * phase / 255)
    np.testing.assert_allclose(_values(reading)[0], np.moveaxis(expected, -1, 0), atol=8 * 2.0**-24)


def test_grey_phases_that_are_stored_as_colours_are_one_colour(tmp_path: Path) -> None:
    levels = np.random.default_rng(0).integers(0, 256, (40, 60)).astype("u1")
    Image.fromarray(np.stack([levels] * 3, axis=-1)).save(tmp_path / "a.png")
    reading = read_wavefield(tmp_path / "a.png", ReadRequest(pitch_m=PITCH, wavelengths_m=WAVES[:1], phase_levels=256))
    assert _said(reading, "quantity") == ("phase", "guessed")
    np.testing.assert_allclose(_values(reading)[0, 0], np.exp(2j * np.pi * levels / 256), atol=8 * 2.0**-24)


def test_16_bit_png_keeps_its_bits(tmp_path: Path) -> None:
    levels = np.random.default_rng(0).integers(0, 65536, (40, 60)).astype("u2")
    Image.fromarray(levels).save(tmp_path / "phase.png")
    values = _values(read_wavefield(tmp_path / "phase.png", ONE))
    np.testing.assert_allclose(values[0, 0], np.exp(2j * np.pi * levels / 65535), atol=8 * 2.0**-24)


def test_three_grey_files_are_the_colours_of_one_recording(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    paths = []
    for name in ("doll_B", "doll_R", "doll_G"):
        paths.append(tmp_path / f"{name}.bmp")
        Image.fromarray(rng.normal(128, 20, (30, 40)).clip(0, 255).astype("u1")).save(paths[-1])
    reading = read_wavefield(paths, THREE)
    assert reading.kind == "recording"
    red = np.asarray(Image.open(tmp_path / "doll_R.bmp"))
    np.testing.assert_array_equal(_pictures(reading)[0, 0], red)


def test_a_set_of_phase_shifted_pictures_is_a_recording_of_several(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for number in range(4):
        Image.fromarray(rng.normal(128, 20, (30, 40)).clip(0, 255).astype("u1")).save(tmp_path / f"I{number}.png")
    request = ReadRequest(pitch_m=PITCH, wavelengths_m=WAVES[:1], recording="phase-shifting")
    reading = read_wavefield(sorted(tmp_path.iterdir()), request)
    assert _pictures(reading).shape == (4, 1, 30, 40)


def test_a_real_picture_with_negative_values_is_a_recording_unless_it_is_stated(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.random.default_rng(0).normal(0, 40, (40, 60)))
    reading = read_wavefield(tmp_path / "a.npy", ONE)
    assert reading.kind == "recording"
    assert "negative" in next(p.reason for p in reading.provenance if p.key == "quantity")
    stated = ReadRequest(pitch_m=PITCH, wavelengths_m=WAVES[:1], quantity="amplitude")
    assert read_wavefield(tmp_path / "a.npy", stated).kind == "field"


# --- OpenHolo ---


def _openholo(
    u: NDArray[np.complex128], dtype: str, code: int, planar: bool, base: int = 1, text: bool = False, unit: int = 3
) -> bytes:
    """A field (wavelength, y, x) as OpenHolo writes it. unit: of lengths, 0 m … 4 nm. code: 0 polar, 1 Cartesian."""
    waves, rows, columns = u.shape
    types = ("int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64", "float32", "float64")
    planes = np.stack([np.abs(u), np.angle(u)] if code == 0 else [u.real, u.imag])
    if np.dtype(dtype).kind in "iu" and code == 0:
        limits = np.iinfo(dtype)
        steps = float(limits.max) - limits.min
        planes[1] = np.round((planes[1] / np.pi + 1) / 2 * steps) + limits.min
        if dtype == "int64":
            planes[1] = np.minimum(planes[1], np.nextafter(2.0**63, 0))
        planes[0] = np.round(planes[0])
    planes = planes if planar else np.moveaxis(planes, 1, -1)
    data = planes.astype(dtype)
    scale = 10.0 ** -(0, 2, 3, 6, 9)[unit]
    codes = (unit + base, waves, 1 + base, (1 if planar else 0) + base)
    kinds = (unit + base, types.index(dtype) + base, base, code + base, int(np.dtype(dtype).kind in "iu"))
    body = data.tobytes()
    fields = (73 + 8 * waves, columns, rows, 8e-6 / scale, 9e-6 / scale, *codes, *kinds, -1.0, 1.0, len(body), 0)
    lengths = [w / scale for w in WAVES[:waves]]
    if text:
        head = (b"160120", b"\0", b"\2", b"0", b"0", b"120", *(str(f).encode() for f in (*fields, *lengths)))
        return b"OH\r\n" + b"\r\n".join(head) + b"\r\n" + " ".join(f"{x:.17g}" for x in data.ravel()).encode()
    header = struct.pack("<IIIddBIBBBBBBBddQB", *fields)
    start = 24 + len(header) + 8 * waves
    table = struct.pack(f"<{waves}d", *lengths)
    return struct.pack("<2sQBBIII", b"OH", start + len(body), 3, 0, 0, 0, start) + header + table + body


@pytest.mark.parametrize("planar", [False, True])
@pytest.mark.parametrize("base", [0, 1])
@pytest.mark.parametrize(("dtype", "waves"), [("float64", 3), ("float32", 1), ("float32", 2)])
def test_openholo_files_of_both_orders_and_both_countings(
    tmp_path: Path, planar: bool, base: int, dtype: str, waves: int
) -> None:
    u = _complex(waves, 20, 30)
    (tmp_path / "f.ohc").write_bytes(_openholo(u, dtype, 1, planar, base))
    reading = read_wavefield(tmp_path / "f.ohc")
    np.testing.assert_allclose(_values(reading)[0], u, atol=ROUNDING)
    assert reading.wavefield is not None
    np.testing.assert_allclose(reading.wavefield.wavelengths_m, WAVES[:waves], rtol=1e-12)
    np.testing.assert_allclose(reading.wavefield.pitch_m, (9e-6, 8e-6), rtol=1e-12)


@pytest.mark.parametrize("dtype", ["int8", "int16", "int32", "uint8", "uint16", "int64"])
def test_openholo_phases_of_whole_numbers(tmp_path: Path, dtype: str) -> None:
    u = np.round(10 * np.abs(_complex(1, 20, 30))) * np.exp(1j * np.angle(_complex(1, 20, 30, seed=2)))
    (tmp_path / "f.ohc").write_bytes(_openholo(u, dtype, 0, True))
    values = _values(read_wavefield(tmp_path / "f.ohc"))
    # amplitudes are scaled to 1 at the type's full scale; phases are rounded to half a step
    scale = np.abs(u).max() / np.abs(values).max()
    steps = 2.0 ** (8 * np.dtype(dtype).itemsize)
    limit = np.abs(u).max() * (np.pi / (steps - 1) + 8 * 2.0**-24)
    np.testing.assert_allclose(values[0] * scale, u, atol=limit)


def test_openholo_files_of_text_have_crlf(tmp_path: Path) -> None:
    u = _complex(1, 20, 30)
    (tmp_path / "f.ohc").write_bytes(_openholo(u, "float64", 1, True, text=True))
    np.testing.assert_allclose(_values(read_wavefield(tmp_path / "f.ohc"))[0], u, atol=ROUNDING)


def test_openholo_files_that_were_written_column_by_column(tmp_path: Path) -> None:
    u = _complex(1, 20, 30)
    data = bytearray(_openholo(u, "float64", 1, True))
    columns_first = np.stack([u.real, u.imag]).transpose(0, 1, 3, 2).tobytes()
    data[-len(columns_first) :] = columns_first
    (tmp_path / "f.ohc").write_bytes(data)
    np.testing.assert_allclose(
        _values(read_wavefield(tmp_path / "f.ohc", ReadRequest(transposed=True)))[0], u, atol=ROUNDING
    )


def test_openholo_links_are_not_followed_and_truncation_is_found(tmp_path: Path) -> None:
    data = bytearray(_openholo(_complex(1, 20, 30), "float64", 1, True))
    (tmp_path / "short.ohc").write_bytes(data[:-9])
    with pytest.raises(UserError, match=r"truncated: 9591 bytes of numbers; expected 9600"):
        read_wavefield(tmp_path / "short.ohc")
    data[24 + 37] = 2  # the code of the store, after three u32, two f64, u8, u32 and four u8
    (tmp_path / "link.ohc").write_bytes(data)
    with pytest.raises(UserError, match="names of other files"):
        read_wavefield(tmp_path / "link.ohc")


# --- dumps, text, refusals ---


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("interleaved", [True, False])
def test_a_binary_dump_is_read_as_a_few_keys_say(tmp_path: Path, order: str, interleaved: bool) -> None:
    u = _complex(20, 30)
    parts = np.stack([u.real, u.imag], axis=-1 if interleaved else 0)
    header = b"HOLO 30 20\r\n"
    (tmp_path / "u.raw").write_bytes(header + parts.astype(">f4").tobytes(order="C" if order == "C" else "F"))
    layout = BinaryLayout(">f4", (20, 30), order=order, parts=("real", "imaginary"), interleaved=interleaved)  # type: ignore[arg-type]
    reading = read_wavefield(tmp_path / "u.raw", ReadRequest(pitch_m=PITCH, wavelengths_m=WAVES[:1], binary=layout))
    np.testing.assert_allclose(_values(reading)[0, 0], u, atol=ROUNDING)
    assert any("HOLO 30 20" in note for note in reading.notes)


def test_a_table_of_text_is_read(tmp_path: Path) -> None:
    phase = np.random.default_rng(0).uniform(-np.pi, np.pi, (40, 50))
    text = "# phase, rad\r\n" + "\r\n".join("\t".join(f"{x:.9g}" for x in row) for row in phase)
    (tmp_path / "Phase_2cm.txt").write_bytes(text.encode())
    reading = read_wavefield(tmp_path / "Phase_2cm.txt", ONE)
    np.testing.assert_allclose(_values(reading)[0, 0], np.exp(1j * phase), atol=8 * 2.0**-24)
    assert _said(reading, "distance") == ("20 mm", "guessed")


def test_a_torch_file_is_refused_with_what_to_do(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "holo.pt", "w") as archive:
        archive.writestr("holo/data.pkl", b"\x80\x02}.")
    with pytest.raises(UserError, match=r"np\.save"):
        read_wavefield(tmp_path / "holo.pt", GUESSED)


def test_an_array_that_claims_more_than_its_file_is_refused_at_once(tmp_path: Path) -> None:
    np.save(tmp_path / "u.npy", np.zeros((4, 4)))
    data = (tmp_path / "u.npy").read_bytes().replace(b"(4, 4)", b"(9999999, 9999999)"[:6].ljust(6))
    (tmp_path / "u.npy").write_bytes(data)
    with pytest.raises(UserError):
        read_wavefield(tmp_path / "u.npy", GUESSED)


def test_a_zip_bomb_is_refused_by_its_stated_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    header = b"\x93NUMPY\x01\x00v\x00" + b"{'descr': '<c16', 'fortran_order': False, 'shape': (2048, 2048), }".ljust(
        117
    )
    for name, size in (("short", 0), ("whole", 16 << 22)):
        with zipfile.ZipFile(tmp_path / f"{name}.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            archive.writestr("u.npy", header + b"\n" + bytes(size))
    with pytest.raises(UserError, match="truncated"):
        read_wavefield(tmp_path / "short.npz", GUESSED)
    left = 50_000_000
    monkeypatch.setenv("HOLOVIEW_MEMORY", str(psutil.Process().memory_info().rss + left))
    assert (tmp_path / "whole.npz").stat().st_size < left / 50
    with pytest.raises(UserError, match="of memory"):
        read_wavefield(tmp_path / "whole.npz", GUESSED)


def test_a_laboratory_adds_a_reader_by_an_entry_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entry = EntryPoint("ours", "tests.wavefield.plugin_reader:OurReader", registry.GROUP)
    monkeypatch.setattr(registry, "entry_points", lambda group: (entry,) if group == registry.GROUP else ())
    registry.all_readers.cache_clear()
    try:
        (tmp_path / "a.ours").write_bytes(b"OURS" + np.arange(12, dtype="<c16").tobytes())
        reading = read_wavefield(tmp_path / "a.ours", ONE)
        np.testing.assert_array_equal(_values(reading)[0, 0], np.arange(12).reshape(3, 4))
    finally:
        registry.all_readers.cache_clear()


def test_six_files_are_two_parts_in_three_colours(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    files: dict[str, NDArray[np.uint8]] = {}
    for name in [f"{part}_{nm}nm.png" for part in ("phase", "ampli") for nm in (450, 638, 520)]:
        files[name] = rng.integers(0, 256, (20, 30)).astype("u1")
        Image.fromarray(files[name]).save(tmp_path / name)
    reading = read_wavefield([tmp_path / name for name in files], ReadRequest(pitch_m=PITCH))
    assert _said(reading, "wavelengths") == ("638 nm, 520 nm, 450 nm", "guessed")
    for index, nm in enumerate((638, 520, 450)):
        phase, amplitude = files[f"phase_{nm}nm.png"], files[f"ampli_{nm}nm.png"]
        expected = amplitude / 255 * np.exp(2j * np.pi * phase / 255)
        np.testing.assert_allclose(_values(reading)[0, index], expected, atol=8 * 2.0**-24)


def test_files_that_do_not_belong_together_are_refused(tmp_path: Path) -> None:
    for name, shape in (("real", (8, 9)), ("phase", (8, 9)), ("imag", (9, 8))):
        np.save(tmp_path / f"{name}.npy", np.random.default_rng(0).normal(size=shape))
    with pytest.raises(UserError, match=r"the parts real, phase don't make a field.*--parts"):
        read_wavefield([tmp_path / "real.npy", tmp_path / "phase.npy"], ONE)
    with pytest.raises(UserError, match="its parts have different sizes"):
        read_wavefield([tmp_path / "real.npy", tmp_path / "imag.npy"], ONE)


def test_of_a_coloured_picture_and_one_wavelength_the_channel_is_taken_that_sees_it(tmp_path: Path) -> None:
    colours = np.random.default_rng(0).normal(128, 20, (30, 40, 3)).clip(0, 255).astype("u1")
    Image.fromarray(colours).save(tmp_path / "holo.bmp")
    for nm, channel in ((633, 0), (532, 1), (450, 2)):
        request = ReadRequest(pitch_m=PITCH, wavelengths_m=(nm * 1e-9,))
        np.testing.assert_array_equal(
            _pictures(read_wavefield(tmp_path / "holo.bmp", request))[0, 0], colours[..., channel]
        )


def test_real_and_imaginary_part_as_pictures_have_their_zero_in_the_middle(tmp_path: Path) -> None:
    parts = np.random.default_rng(0).integers(0, 256, (2, 20, 30)).astype("u1")
    for name, part in zip(("holo_real.png", "holo_imag.png"), parts, strict=True):
        Image.fromarray(part).save(tmp_path / name)
    values = _values(read_wavefield([tmp_path / "holo_real.png", tmp_path / "holo_imag.png"], ONE))
    expected = (parts[0] - 127.5 + 1j * (parts[1] - 127.5)) / 127.5
    np.testing.assert_allclose(values[0, 0], expected, atol=2.0**-23)


@pytest.mark.parametrize("given", ["20cm", "200mm", "0p2m"])
def test_a_name_that_contradicts_the_distance_is_told(tmp_path: Path, given: str) -> None:
    np.save(tmp_path / f"dice_{given}.npy", _complex(20, 30))
    request = ReadRequest(pitch_m=PITCH, wavelengths_m=WAVES[:1], distance_m=0.15)
    reading = read_wavefield(tmp_path / f"dice_{given}.npy", request)
    assert _said(reading, "distance") == ("150 mm", "given")
    assert any("distances contradict: 150 mm (as given), 200 mm" in note for note in reading.notes)
    behind = read_wavefield(tmp_path / f"dice_{given}.npy", replace(request, distance_m=-0.199))
    assert behind.notes == ()
