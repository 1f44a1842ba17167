"""Capture files: nothing is lost on the way, and whatever can't be is refused by its name."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from holoview.bench.captures import Camera, Captures, SlmSpec, read_captures, write_captures
from holoview.light.model.bench_parts import Relay
from holoview.util.errors import UserError
from holoview.util.memory_limit import VARIABLE
from tests.fuzz.valid_files import CAPTURES, valid, write

Edit = Callable[[h5py.File], None]
SQUARE = Relay(iris_na=0.04, square="1.1 first order at 550 nm", centre_na=(0.001, -0.0025))


def _captures(modulators: int = 2) -> Captures:
    rng = np.random.default_rng(1)
    two = modulators == 2
    return Captures(
        levels=rng.integers(0, 16, (3, modulators, 6, 8), dtype=np.uint8),
        images=rng.integers(64, 900, (3, 12, 16), dtype=np.uint16),
        wavelength_m=np.array([450e-9, 520e-9, 638e-9]),
        distance_m=np.full(3, 4e-3),
        power=np.array([1.0, 0.5, 0.25]),
        exposure_s=np.full(3, 0.01),
        slms=(SlmSpec(8e-6, 16, 780e-9),) * modulators,
        camera=Camera(4e-6, 12, 4.0, 3.0, 64.0),
        gap_m=1e-3 if two else None,
        relay1=Relay(iris_na=0.03 if two else None),
        relay2=Relay(iris_na=0.03),
    )


def _same(first: Captures, second: Captures) -> bool:
    pairs = ((getattr(first, f.name), getattr(second, f.name)) for f in dataclasses.fields(Captures))
    return all(np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b for a, b in pairs)


@pytest.mark.parametrize(
    "captures",
    [
        _captures(),
        _captures(1),
        dataclasses.replace(_captures(1), distance_m=np.zeros(3), focal_length_m=0.2, relay2=Relay()),
        dataclasses.replace(_captures(), levels=np.full((3, 2, 6, 8), 15, np.uint16)),
        dataclasses.replace(_captures(), relay1=Relay(square="first order"), relay2=SQUARE),
        dataclasses.replace(_captures(1), distance_m=np.zeros(3), focal_length_m=0.2, relay2=SQUARE),
    ],
    ids=["near field", "one modulator", "Fourier bench", "16 bit levels", "square stops", "square on Fourier bench"],
)
def test_what_is_written_is_read_again(captures: Captures, tmp_path: Path) -> None:
    write_captures(tmp_path / "c.h5", captures)
    assert _same(read_captures(tmp_path / "c.h5"), captures)


@pytest.mark.parametrize("value", [None, 0, 1, np.True_])
def test_a_file_may_state_whether_camera_pixels_integrate(value: object, tmp_path: Path) -> None:
    """As a number or as h5py writes a truth value; files without it keep their meaning."""
    write_captures(tmp_path / "c.h5", _captures())
    with h5py.File(tmp_path / "c.h5", "a") as h5:
        if value is not None:
            h5["camera"].attrs["integrates"] = value
    read = read_captures(tmp_path / "c.h5")
    assert read.camera.integrates is (None if value is None else bool(value))
    write_captures(tmp_path / "again.h5", read)
    assert read_captures(tmp_path / "again.h5").camera == read.camera


def test_what_is_unknown_is_ignored(tmp_path: Path) -> None:
    write_captures(tmp_path / "c.h5", _captures())
    with h5py.File(tmp_path / "c.h5", "a") as h5:
        h5["notes"] = "a cold morning"
        h5["camera"].attrs["serial"] = 7
    assert _same(read_captures(tmp_path / "c.h5"), _captures())


def test_stops_are_attributes_of_the_geometry(tmp_path: Path) -> None:
    """Those of an iris are where every version of the format has them; others only where there are such stops."""
    relay1, relay2 = Relay(square=0.031, centre_na=(0.0, 0.002)), SQUARE
    write_captures(tmp_path / "c.h5", dataclasses.replace(_captures(), relay1=relay1, relay2=relay2))
    with h5py.File(tmp_path / "c.h5") as h5:
        found = {key: np.asarray(value).tolist() for key, value in h5["geometry"].attrs.items()}
    assert found == {
        "gap": 1e-3,
        "square1": 0.031,
        "centre1_na": [0.0, 0.002],
        "iris2_na": 0.04,
        "square2": "1.1 first order at 550 nm",
        "centre2_na": [0.001, -0.0025],
    }
    write_captures(tmp_path / "c.h5", _captures())
    with h5py.File(tmp_path / "c.h5") as h5:
        assert dict(h5["geometry"].attrs) == {"gap": 1e-3, "iris1_na": 0.03, "iris2_na": 0.03}


@pytest.mark.parametrize(
    "value",
    ["first order at 550 nm", np.bytes_(b"first order at 550 nm"), np.array(["first order at 550 nm"], dtype="S")],
    ids=["text", "bytes", "array of bytes"],
)
def test_text_is_read_as_any_library_writes_it(value: object, tmp_path: Path) -> None:
    write_captures(tmp_path / "c.h5", _captures())
    with h5py.File(tmp_path / "c.h5", "a") as h5:
        h5["geometry"].attrs["square2"] = value
        h5["geometry"].attrs["centre2_na"] = np.array([[0.001, 0.002]])  # a row, as of a program that has no vectors
    expected = Relay(iris_na=0.03, square="first order at 550 nm", centre_na=(0.001, 0.002))
    assert read_captures(tmp_path / "c.h5").relay2 == expected


def _without(name: str) -> Edit:
    def edit(h5: h5py.File) -> None:
        del h5[name]

    return edit


def _attribute(group: str, name: str, value: object) -> Edit:
    def edit(h5: h5py.File) -> None:
        h5[group].attrs[name] = value

    return edit


def _no_attribute(group: str, name: str) -> Edit:
    def edit(h5: h5py.File) -> None:
        del h5[group].attrs[name]

    return edit


def _changed(*edits: Edit) -> Edit:
    def edit(h5: h5py.File) -> None:
        for one in edits:
            one(h5)

    return edit


def _dataset(name: str, value: object) -> Edit:
    def edit(h5: h5py.File) -> None:
        attributes = dict(h5[name].attrs) if name in h5 else {}
        del h5[name]
        h5[name] = value
        h5[name].attrs.update(attributes)

    return edit


def _nan(h5: h5py.File) -> None:
    h5["distance"][1] = np.nan


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        *(
            (_without(n), f"{n}: is missing")
            for n in ("slm1/levels", "camera/images", "wavelength", "distance", "power")
        ),
        (_attribute("/", "format", "something"), 'attribute format: "something"'),
        (_attribute("/", "version", 2), "attribute version: 2"),
        (_no_attribute("/", "format"), "attribute format: is missing"),
        (_no_attribute("camera", "bit_depth"), "camera attribute bit_depth: is missing"),
        (_no_attribute("slm1", "pitch"), "slm1 attribute pitch: is missing"),
        (_no_attribute("geometry", "gap"), "geometry attribute gap: is missing"),
        (_attribute("slm1", "pitch", "8 um"), "slm1 attribute pitch: '8 um'; expected a finite number"),
        (_dataset("slm1/levels", np.zeros((3, 6, 8), np.float32)), "slm1/levels: numbers of type float32"),
        (_dataset("slm1/levels", np.zeros((3, 6), np.uint8)), r"slm1/levels: an array of shape \(3, 6\)"),
        (
            _dataset("slm2/levels", np.zeros((3, 5, 8), np.uint8)),
            r"slm2/levels: an array of shape \(3, 5, 8\); expected \(capture = 3, row = 6",
        ),
        (_dataset("camera/images", np.zeros((3, 12, 16), np.int32)), "camera/images: numbers of type int32"),
        (
            _dataset("camera/images", np.full((2, 12, 16), 99, np.uint16)),
            r"camera/images: an array of shape \(2, 12, 16\); expected \(capture = 3",
        ),
        (_dataset("wavelength", np.array(520e-9)), "wavelength: an array of shape"),
        (_dataset("wavelength", np.full(3, 520.0)), "wavelength: 520; expected .* it looks like nanometres"),
        (_dataset("distance", np.full(3, 4.0)), "distance: 4; expected .* it looks like millimetres"),
        (_dataset("distance", np.full(3, 0.4)), "distance: 0.4: light would spread .* millimetres"),
        (_nan, "distance: holds nan at capture 1"),
        (_attribute("geometry", "gap", 2.0), "geometry attribute gap: 2; .* millimetres"),
        (_attribute("slm1", "pitch", 8.0), "slm1 attribute pitch: 8; .* it looks like micrometres"),
        (_attribute("slm1", "pitch", 0.008), "slm1 attribute pitch: 0.008; .* it looks like millimetres"),
        (_attribute("geometry", "focal_length", 200.0), "focal_length: 200; .* millimetres"),
        (_attribute("camera", "axis_y", 1e-4), "axis_y, axis_x: stated for a near field"),
        (_attribute("geometry", "iris1_na", 30.0), "iris1_na: 30"),
        (_attribute("geometry", "iris1_na", "0.03"), "geometry attribute iris1_na: '0.03' is not a number"),
        (_attribute("geometry", "square2", 30.0), "geometry attribute square2: 30 is out of range; .* first order"),
        (_attribute("geometry", "square2", "first"), 'geometry attribute square2: "first"; .* "first order at 550 nm"'),
        (_attribute("geometry", "square1", [0.03, 0.02]), "geometry attribute square1: .* is not a number"),
        (_attribute("geometry", "centre2_na", 0.002), r"geometry attribute centre2_na: 0.002; expected \[y, x\]"),
        (_attribute("geometry", "centre2_na", [0.0, 2.0]), r"geometry attribute centre2_na\[1\]: 2 is out of range"),
        (
            _changed(_no_attribute("geometry", "iris1_na"), _attribute("geometry", "centre1_na", [0.0, 0.1])),
            "geometry attribute centre1_na: without an iris or a square stop; give iris1_na or square1",
        ),
        (_attribute("slm1", "num_levels", 8), "slm1/levels: level 15; expected 0 to 7"),
        (_attribute("camera", "bit_depth", 8), "camera/images: .* counts; expected 0 to 255"),
        (_attribute("camera", "bit_depth", 40), "camera attribute bit_depth: 40"),
        (_attribute("camera", "electrons_per_count", 0.0), "electrons_per_count: 0"),
        (_attribute("camera", "black_level", 5000.0), "black_level: 5000"),
        (_dataset("power", np.array([1.0, 0.0, 1.0])), "power: 0; expected positive"),
        (_dataset("camera/images", np.full((3, 12, 16), 64, np.uint16)), "camera/images: all are dark"),
        (_dataset("camera/images", np.full((3, 12, 16), 4095, np.uint16)), "camera/images: all are saturated"),
        (
            _dataset("camera/images", np.full((3, 16, 12), 99, np.uint16)),
            "camera/images: .* rows and columns look swapped",
        ),
    ],
)
def test_what_cant_be_is_refused_by_its_name(edit: Edit, words: str, tmp_path: Path) -> None:
    path = tmp_path / "c.h5"
    write_captures(path, _captures())
    with h5py.File(path, "a") as h5:
        edit(h5)
    with pytest.raises(UserError, match=words) as caught:
        read_captures(path)
    assert str(path) in str(caught.value)


def test_a_file_that_isnt_there_or_isnt_hdf5_or_is_cut_short(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no such file"):
        read_captures(tmp_path / "none.h5")
    (tmp_path / "text.h5").write_text("hello", encoding="utf-8")
    with pytest.raises(UserError, match="isn't an HDF5 file"):
        read_captures(tmp_path / "text.h5")
    write_captures(tmp_path / "whole.h5", _captures())
    data = (tmp_path / "whole.h5").read_bytes()
    for share in (0.3, 0.6, 0.95):
        (tmp_path / "cut.h5").write_bytes(data[: int(share * len(data))])
        with pytest.raises(UserError, match=r"is cut short|isn't an HDF5 file|is damaged"):
            read_captures(tmp_path / "cut.h5")


def test_a_damaged_dataset_is_told_as_such(tmp_path: Path) -> None:
    path = tmp_path / "c.h5"
    write_captures(path, _captures())
    with h5py.File(path) as h5:
        chunk = h5["camera/images"].id.get_chunk_info(0)
    data = bytearray(path.read_bytes())
    data[chunk.byte_offset : chunk.byte_offset + chunk.size] = bytes(chunk.size)
    path.write_bytes(data)
    with pytest.raises(UserError, match="is damaged"):
        read_captures(path)


def test_two_modulators_dont_go_with_a_focal_length() -> None:
    with pytest.raises(UserError, match="slm2: on a Fourier bench"):
        write_captures("unused.h5", dataclasses.replace(_captures(), focal_length_m=0.2, distance_m=np.zeros(3)))


@pytest.mark.parametrize(
    ("captures", "words"),
    [
        (
            dataclasses.replace(_captures(1), relay1=Relay(iris_na=0.03)),
            "attribute iris1_na: with one modulator",
        ),
        (
            dataclasses.replace(_captures(1), relay1=Relay(square=0.03)),
            "attribute square1: with one modulator",
        ),
        (dataclasses.replace(_captures(), relay2=Relay(dc_block_na=1e-3)), "relay2: has more than stops"),
    ],
    ids=["iris", "square", "DC block"],
)
def test_stops_that_a_file_cant_hold_are_refused(captures: Captures, words: str, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=words):
        write_captures(tmp_path / "c.h5", captures)
    assert not (tmp_path / "c.h5").exists()


SHAPE = (CAPTURES, 24, 32)


def _again(name: str, *arguments: object, **keywords: object) -> Edit:
    def edit(h5: h5py.File) -> None:
        del h5[name]
        h5.create_dataset(name, *arguments, **keywords)

    return edit


def _link(name: str, link: object) -> Edit:
    def edit(h5: h5py.File) -> None:
        del h5[name]
        h5[name] = link

    return edit


def _virtual(h5: h5py.File) -> None:
    layout = h5py.VirtualLayout(SHAPE, np.uint16)
    layout[:] = h5py.VirtualSource("other.h5", "camera/images", SHAPE)
    del h5["camera/images"]
    h5.create_virtual_dataset("camera/images", layout)


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (_again("camera/images", SHAPE, np.uint16, external=[("secret", 0, 2 * 24 * 32 * CAPTURES)]), "in other files"),
        (_virtual, "camera/images: has its data in other files"),
        (_link("camera/images", h5py.ExternalLink("other.h5", "camera/images")), "is an external link"),
        (_link("camera", h5py.ExternalLink("other.h5", "camera")), "is an external link"),
        (_link("power", h5py.SoftLink("/exposure")), "power: is a soft link"),
        (_again("camera/images", (CAPTURES, 21000, 21000), np.uint16, chunks=(1, 999, 999)), "GB of data in a file of"),
        (_again("power", (CAPTURES,), "f8", chunks=(2**28,), maxshape=(None,)), "power: .* in a file of"),
    ],
)
def test_data_elsewhere_and_bombs_are_refused(edit: Edit, words: str, tmp_path: Path) -> None:
    files = valid("captures")
    write(tmp_path, files | {"other.h5": files["captures.h5"], "secret": b"x" * 2 * 24 * 32 * CAPTURES})
    assert len(read_captures(tmp_path / "captures.h5")) == CAPTURES
    with h5py.File(tmp_path / "captures.h5", "a") as h5:
        edit(h5)
    with pytest.raises(UserError, match=words):
        read_captures(tmp_path / "captures.h5")


def test_captures_that_need_more_than_is_allowed_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path, valid("captures"))
    monkeypatch.setenv(VARIABLE, "1MB")
    with pytest.raises(UserError, match=r"captures\.h5: captures: needs about .* of memory"):
        read_captures(tmp_path / "captures.h5")


@pytest.mark.parametrize(
    ("group", "name", "value"),
    [
        *[("camera", name, x) for name in ("bit_depth", "read_noise") for x in (np.nan, np.inf)],
        *[("slm1", "num_levels", x) for x in (np.nan, np.inf, 12.5, 1e300)],
        ("camera", "bit_depth", 12.5),
    ],
)
def test_attributes_are_finite_and_whole_where_they_count(group: str, name: str, value: float, tmp_path: Path) -> None:
    write(tmp_path, valid("captures"))
    with h5py.File(tmp_path / "captures.h5", "a") as h5:
        h5[group].attrs[name] = value
    with pytest.raises(UserError, match=f"{group} attribute {name}: "):
        read_captures(tmp_path / "captures.h5")
