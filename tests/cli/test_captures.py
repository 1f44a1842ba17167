"""`holoview captures`: a virtual session is made, checked, shown, and a folder of pictures becomes the same session."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image

from holoview.bench.captures import Captures, read_captures, write_captures
from holoview.bench.captures.capture_file import BENCH_FILE, TABLE_FILE
from tests.captures.far_field import FarField, photograph, spread_pattern
from tests.captures.slmsuite_files import fourier, save
from tests.explored import explored

Run = Callable[..., Any]
SMALL = (
    "holochrome-8",
    *("--set", "shape=[20, 28]"),
    *("--set", 'planes=["3 mm"]'),
    *("--set", "relay1.iris_na=0.03"),
    *("--set", "relay2.iris_na=0.03"),
)


def _make(holoview: Run, name: str, *more: str) -> Captures:
    outcome = holoview("captures", "make", *SMALL, "--each", 1, "-o", name, *more)
    assert outcome.code == 0, outcome.err
    return read_captures(name)


def test_a_session_is_made_the_same_from_the_same_seed(holoview: Run, tmp_path: Path) -> None:
    first = _make(holoview, "a.h5", "--effects", "gap.gap_error=0.1mm", "crosstalk.sigma=0.4")
    again = _make(holoview, "b.h5", "--effects", "gap.gap_error=0.1mm", "crosstalk.sigma=0.4")
    other = _make(holoview, "c.h5", "--seed", "1")
    assert np.array_equal(first.images, again.images)
    assert not np.array_equal(first.images, other.images)
    assert first.gap_m == 2e-3  # what the laboratory believes
    assert first.images.dtype == np.uint16 and 2000 < first.images.max() <= 4095


def test_noise_is_that_of_the_camera(holoview: Run) -> None:
    """Without effects the model explains the pictures to their noise."""
    from holoview.bench.captures.predictor import Predictor

    captures = _make(holoview, "a.h5")
    signal = Predictor(captures)(range(8)).signal.double().numpy()
    for image, expected in zip(captures.images, signal, strict=True):
        valid = image < captures.camera.saturation
        seen = image[valid] - captures.camera.black_level
        expected = expected[valid] * (expected[valid] @ seen) / (expected[valid] @ expected[valid])
        chi2 = np.mean((seen - expected) ** 2 / captures.camera.noise_variance(expected))
        assert chi2 == pytest.approx(1.0, abs=5 * (2 / seen.size) ** 0.5)  # 5 σ of χ²/n


@pytest.mark.long
def test_a_check_tells_what_is_there_and_what_it_cant_tell(holoview: Run) -> None:
    _make(holoview, "a.h5")
    outcome = holoview("captures", "check", "a.h5")
    assert outcome.code == 0
    assert "8 captures, near field" in outcome.out and "28 x 20 pixels" in outcome.out
    assert "nothing found that is recorded wrongly" in outcome.out
    found = json.loads(holoview("captures", "check", "a.h5", "--json", "--quick").out)
    assert found["wavelengths_m"][0] == pytest.approx(440e-9, abs=40e-9) and len(found["wavelengths_m"]) == 8
    assert "gap" not in found["cant_tell"]
    fourier = ("captures", "make", "holochrome-8", "--set", "shape=[20, 28]", "--focal-length", "200mm", "-o", "f.h5")
    assert "one modulator on a Fourier bench" in holoview(*fourier).err
    single = (*fourier, "--scheme", "simultaneous+1slm", "--camera-pitch", "10um", "--each", "1")
    assert holoview(*single).code == 0
    said = holoview("captures", "check", "f.h5").out
    assert "Fourier bench" in said and "can't tell   gap" in said


@pytest.mark.long
def test_a_check_says_what_is_recorded_wrongly_unless_it_is_to_be_quick(holoview: Run, tmp_path: Path) -> None:
    captures = _make(holoview, "a.h5")
    write_captures("wrong.h5", dataclasses.replace(captures, levels=captures.levels[:, ::-1]))
    told = "records      slm_exchange: The patterns of the two modulators are exchanged in the records."
    assert told in holoview("captures", "check", "wrong.h5").out
    assert "records" not in holoview("captures", "check", "wrong.h5", "--quick").out
    found = json.loads(holoview("captures", "check", "wrong.h5", "--json").out)
    assert [wrong["effect"] for wrong in found["records"]["wrong"]] == ["slm_exchange"]


def test_a_sheet_shows_patterns_and_pictures(holoview: Run, tmp_path: Path) -> None:
    _make(holoview, "a.h5")
    assert holoview("captures", "show", "a.h5", "-o", "a.png", "--most", 3).code == 0
    with Image.open(tmp_path / "a.png") as sheet:
        assert sheet.width > 3 * 420 and sheet.height > 3 * 250


def _folder(captures: Captures, path: Path) -> Path:
    path.mkdir()
    lines = ["image,slm1,slm2,wavelength,distance,power,exposure"]
    for k in range(len(captures)):
        tifffile.imwrite(path / f"seen{k}.tif", captures.images[k])
        for n in (0, 1):
            Image.fromarray(captures.levels[k, n]).save(path / f"sent{n}-{k}.png")
        λ, z = captures.wavelength_m[k] * 1e9, captures.distance_m[k] * 1e3
        said = f"{λ:.9g} nm,{z:.9g} mm,{captures.power[k]!r},{captures.exposure_s[k]!r}".replace("np.float64", "")
        lines.append(f"seen{k}.tif,sent0-{k}.png,sent1-{k}.png,{said.replace('(', '').replace(')', '')}")
    (path / TABLE_FILE).write_text("\n".join(lines), encoding="utf-8")
    slm = f'pitch = "8 um"\nnum_levels = {captures.slms[0].num_levels}\nopd_range = "825 nm"\n'
    camera = captures.camera
    (path / BENCH_FILE).write_text(
        f'[slm1]\n{slm}[slm2]\n{slm}[camera]\npitch = "4 um"\nbit_depth = 12\nelectrons_per_count = '
        f"{camera.electrons_per_count!r}\nread_noise = 3.0\nblack_level = 64\n"
        '[geometry]\ngap = "2 mm"\niris1_na = 0.03\niris2_na = 0.03\n',
        encoding="utf-8",
    )
    return path


@pytest.mark.long
def test_a_folder_of_pictures_becomes_the_same_session(holoview: Run, tmp_path: Path) -> None:
    captures = _make(holoview, "a.h5")
    folder = _folder(captures, tmp_path / "folder")
    assert holoview("captures", "import", folder, "-o", "b.h5").code == 0
    found = read_captures("b.h5")
    assert np.array_equal(found.images, captures.images) and np.array_equal(found.levels, captures.levels)
    assert found.wavelength_m == pytest.approx(captures.wavelength_m) and found.camera == captures.camera
    assert (found.gap_m, found.slms) == (captures.gap_m, captures.slms)


@pytest.mark.long
def test_square_stops_are_measured_listed_and_imported(holoview: Run, tmp_path: Path) -> None:
    stops = ('relay1.square="first order"', 'relay2.square="first order at 550 nm"', "relay2.centre_na=[0, 0.002]")
    captures, folder = _make(holoview, "a.h5", *(word for stop in stops for word in ("--set", stop))), tmp_path / "b"
    said = "iris NA 0.03, square first order; then iris NA 0.03, square first order at 550 nm, centre [0, 0.002]"
    assert said in holoview("captures", "check", "a.h5").out
    bench = _folder(captures, folder) / BENCH_FILE
    text = bench.read_text(encoding="utf-8")
    text += 'square1 = "first order"\nsquare2 = "first order at 550 nm"\ncentre2_na = [0, 0.002]\n'
    bench.write_text(text, encoding="utf-8")
    assert holoview("captures", "import", folder, "-o", "b.h5").code == 0
    found = read_captures("b.h5")
    assert (found.relay1, found.relay2) == (captures.relay1, captures.relay2)


@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        (TABLE_FILE, "520", "x20", "line"),
        (TABLE_FILE, "seen0.tif", "gone.tif", "gone.tif: no such file"),
        (TABLE_FILE, "exposure", "time", "exposure: is missing"),
        (TABLE_FILE, "3 mm", "3", "has no unit"),
        (BENCH_FILE, 'pitch = "4 um"\n', "", "camera.pitch: is missing"),
        (BENCH_FILE, "[geometry]", "[geometri]", "did you mean geometry"),
        (BENCH_FILE, "iris2_na = 0.03", 'square2 = "second order"', 'geometry.square2: "second order"; expected a num'),
        (BENCH_FILE, "iris2_na = 0.03", "centre2_na = [0, 0.1]", "geometry.centre2_na: without an iris"),
        (BENCH_FILE, "iris2_na = 0.03", "iris2_na = 30", "geometry.iris2_na: 30 is out of range"),
        (BENCH_FILE, "bit_depth = 12", "bit_depth = ", "isn't TOML"),
        (BENCH_FILE, "bit_depth = 12", "bit_depth = 8", "expected 0 to 255"),
    ],
)
def test_what_is_wrong_in_a_folder_is_named(
    holoview: Run, tmp_path: Path, name: str, old: str, new: str, words: str
) -> None:
    folder = _folder(_make(holoview, "a.h5"), tmp_path / "folder")
    text = (folder / name).read_text(encoding="utf-8")
    if old == "520":  # a wavelength of whichever bench it is
        old = text.splitlines()[1].split(",")[3].split(" ")[0]
        new = "green"
    (folder / name).write_text(text.replace(old, new), encoding="utf-8")
    outcome = holoview("captures", "import", folder, "-o", "b.h5")
    assert outcome.code == 2 and words in outcome.err
    assert not (tmp_path / "b.h5").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--effects", "gapp.gap_error=1mm"), "did you mean gap"),
        (("--effects", "gap.error=1mm"), "unknown parameter"),
        (("--effects", "gap.gap_error"), "isn't KEY=VALUE"),
        (("--effects", "none.py"), "no such file"),
        (("--effects", "gap.gap_error=-3mm"), "effects.gap"),
        (("--set", "relay2.dc_block_na=0.01"), "has more than stops"),
        (("--each", "0"), "at least 1"),
        (("--camera-jitter", "5"), "has no unit"),
    ],
)
def test_a_session_that_cant_be_leaves_no_file(
    holoview: Run, tmp_path: Path, arguments: tuple[str, ...], words: str
) -> None:
    outcome = holoview("captures", "make", *SMALL, "-o", "a.h5", *arguments)
    assert outcome.code == 2 and words in outcome.err
    assert not (tmp_path / "a.h5").exists()


@pytest.mark.usefixtures("no_user_effects")
def test_own_effects_are_run_and_it_says_so(holoview: Run, tmp_path: Path) -> None:
    (tmp_path / "haze.py").write_text(
        "from holoview.light.effects import Effect, Parameter\n"
        "class Haze(Effect):\n"
        '    id, cause, finding, acts_on = "haze", "Haze.", "Haze of {share}.", ("camera",)\n'
        '    parameters = (Parameter("share", "Of the mean.", prior=0.1),)\n'
        "    def image(self, image, context, v):\n"
        '        return image + v["share"] * image.mean()\n',
        encoding="utf-8",
    )
    outcome = holoview("captures", "make", *SMALL, "--each", 1, "-o", "a.h5", "--effects", "haze.py", "haze.share=5")
    assert outcome.code == 0 and "running haze.py" in outcome.err
    hazy, clear = (read_captures(n).images for n in ("a.h5", (_make(holoview, "b.h5"), "b.h5")[1]))
    assert hazy.min() > clear.min() + 100


@pytest.mark.long
def test_left_justified_pictures_are_imported_as_the_camera_counted(holoview: Run, tmp_path: Path) -> None:
    captures = _make(holoview, "a.h5")
    shifted = dataclasses.replace(captures, images=captures.images << np.uint16(4))
    folder = _folder(shifted, tmp_path / "f")
    outcome = holoview("captures", "import", folder, "-o", "b.h5")
    assert outcome.code == 0
    assert "note: all counts are multiples of 16: they were brought back to 12 bits" in outcome.err
    assert np.array_equal(read_captures("b.h5").images, captures.images)
    bench = folder / BENCH_FILE
    bench.write_text(bench.read_text().replace("bit_depth = 12", "bit_depth = 16"))
    refused = holoview("captures", "import", folder, "-o", "c.h5")
    assert refused.code == 2 and "state bit_depth = 12" in refused.err


@pytest.mark.long
def test_a_table_with_semicolons_and_decimal_commas_is_imported(holoview: Run, tmp_path: Path) -> None:
    captures = _make(holoview, "a.h5")
    folder = _folder(captures, tmp_path / "f")
    table = folder / TABLE_FILE
    lines = [line.split(",") for line in table.read_text().splitlines()]
    rows = [[*line[:3], *(cell.replace(".", ",") for cell in line[3:])] for line in lines]
    table.write_text("\n".join(";".join(row) for row in rows))
    assert holoview("captures", "import", folder, "-o", "b.h5").code == 0
    found = read_captures("b.h5")
    assert np.array_equal(found.power, captures.power)
    assert found.wavelength_m == pytest.approx(captures.wavelength_m, rel=1e-8)  # nine digits


BENCH = FarField(coma=-0.3, defocus=0.1)
SMALL_BENCH = dataclasses.replace(BENCH, radius=20.0, axis=(58.0, 82.0), shape=(120, 160))
"""Half as many pixels along a side, where no length is measured: a fourth of the time."""


def _far_field_files(seeds: list[int], bench: FarField = BENCH) -> list[str]:
    """Pictures and patterns of an independent program's bench as PNG, and the arguments that import them."""
    for seed in seeds:
        pattern = spread_pattern(seed, (48, 64) if bench is SMALL_BENCH else (96, 128))
        Image.fromarray(pattern).save(f"mask{seed}.png")
        Image.fromarray(photograph(pattern, bench, seed)).save(f"seen{seed}.png")
    patterns = [text for seed in seeds for text in ("--pattern", f"mask{seed}.png")]
    return [*(f"seen{seed}.png" for seed in seeds), *patterns]


GEOMETRY = ("--wavelength", "532nm", "--pitch", "36um", "--camera-pitch", "12um", "--focal-length", "255mm")


@pytest.mark.long
def test_pictures_and_patterns_become_captures_that_say_what_was_assumed(holoview: Run) -> None:
    arguments = _far_field_files([31, 32], SMALL_BENCH)
    mask = np.full(SMALL_BENCH.shape, 255, np.uint8)
    mask[:, :20] = 0
    Image.fromarray(mask).save("mask.png")
    more = ("--mask", "mask.png", "--roi", "5:115,0:160", "--overlay", "over.png", "-o", "c.h5")
    outcome = holoview("captures", "import", *arguments, *GEOMETRY, *more)
    assert outcome.code == 0, outcome.err
    for words in ("orientation none", "in each of 2 pictures", "a full turn", "electrons a count", "exposures from"):
        assert words in outcome.err
    captures = read_captures("c.h5")
    assert captures.usable is not None
    assert not captures.usable[:, :, :20].any() and not captures.usable[:, :5].any()
    with Image.open("over.png") as overlay:
        assert overlay.width > 3 * SMALL_BENCH.shape[1]  # measured, predicted, both, and both enlarged
    told = holoview("captures", "check", "c.h5", "--quick").out
    assert "left out" in told and "rows 5 to 114, columns 20 to 159" in told
    assert "estimated    electrons a count" in told
    assert holoview("captures", "show", "c.h5", "-o", "sheet.png").code == 0


@pytest.mark.long
def test_pairs_in_a_table_and_lengths_of_slmsuite_do_too(holoview: Run) -> None:
    _far_field_files([31])
    Path("pairs.csv").write_text("image,slm1,exposure\nseen31.png,mask31.png,0.02\n", encoding="utf-8")
    save(Path("cal.h5"), fourier(0.25 / 12e-6, (163, 118)))
    outcome = holoview(
        "captures", "import", "pairs.csv", "--slmsuite", "cal.h5", "--power", "1", "--read-noise", "8", "-o", "c.h5"
    )
    assert outcome.code == 0, outcome.err
    assert "wavelength 532 nm, pitch 36 um, camera pitch 12 um, focal length 250 mm" in outcome.err
    captures = read_captures("c.h5")
    assert captures.focal_length_m == pytest.approx(0.25, rel=0.01)
    assert (captures.power[0], captures.exposure_s[0], captures.camera.read_noise) == (1.0, 0.02, 8.0)


BAD_IMPORTS = {
    "one for each picture": ("a.png", "b.png", "--pattern", "a.png", *GEOMETRY),
    "such as 100:500,200:900": ("a.png", "--pattern", "a.png", "--roi", "3-9", *GEOMETRY),
    "as the pictures": ("a.png", "--pattern", "a.png", "--mask", "small.png", *GEOMETRY),
    'or "unknown"': ("a.png", "--pattern", "a.png", "--read-noise", "much", *GEOMETRY),
    "between 0.1 um and 1000 um": ("a.png", "--pattern", "a.png", *GEOMETRY, "--pitch", "0um"),
    "is missing": ("a.png", "--pattern", "a.png", "--wavelength", "532nm"),
    "differ by up to": ("a.png", "--pattern", "colour.png", *GEOMETRY),
    "stands nowhere": ("seen31.png", "--pattern", "other.png", *GEOMETRY),
}


@pytest.mark.parametrize("said", explored(BAD_IMPORTS, len(BAD_IMPORTS) - 1))  # all but the search of a pattern
def test_imports_that_cant_be_are_refused_in_words(said: str, holoview: Run) -> None:
    rng = np.random.default_rng(1)
    Image.fromarray(rng.integers(0, 256, (96, 128), dtype=np.uint8)).save("a.png")
    Image.fromarray(rng.integers(0, 256, (96, 128), dtype=np.uint8)).save("b.png")
    Image.fromarray(rng.integers(0, 256, (20, 30), dtype=np.uint8)).save("small.png")
    Image.fromarray(rng.integers(0, 256, (96, 128, 3), dtype=np.uint8)).save("colour.png")
    if "seen31.png" in BAD_IMPORTS[said]:
        _far_field_files([31], SMALL_BENCH)
        Image.fromarray(rng.integers(0, 256, (48, 64), dtype=np.uint8)).save("other.png")
    outcome = holoview("captures", "import", *BAD_IMPORTS[said], "-o", "c.h5")
    assert outcome.code != 0
    assert said in outcome.err
    assert not Path("c.h5").exists()
