"""rig.toml: what is missing, unknown or wrong is named with its place; what is right is read in SI units."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from holoview.bench.rig import open_rig, read_rig
from holoview.util.errors import UserError
from tests.rig.conftest import CAMERA_SHAPE, LASERS_M, SHAPE, TABLES, MakeRig, write_rig


def test_a_rig_is_read_in_si_units(make_rig: MakeRig) -> None:
    rig = make_rig()
    assert (rig.name, rig.slm_shape, rig.camera_shape) == ("small bench", SHAPE, CAMERA_SHAPE)
    assert rig.wavelengths_m == LASERS_M and rig.stage_m == (0.0, 0.01)
    assert rig.bench.gap_m == 1e-3 and rig.bench.camera.black_level == 64 and len(rig.bench.slms) == 2
    assert rig.limits.power == 1.0 and rig.limits.exposures_s == (1e-5, 0.5)
    assert rig.limits.stage_m == rig.stage_m
    assert rig.devices["slm2"].kind == "virtual" and rig.devices["slm2"].options["settle"] == 0.1


def test_lasers_are_sorted_and_the_name_is_that_of_the_file_by_default(make_rig: MakeRig) -> None:
    rig = make_rig({"name": None, "lasers.wavelengths": ["638 nm", "450 nm"], "limits.stage": ["1 mm", "2 mm"]})
    assert rig.name == "rig" and rig.wavelengths_m == LASERS_M
    assert rig.limits.stage_m == (1e-3, 2e-3)


def test_settling_that_is_to_be_measured_is_waited_for_long_until_then(make_rig: MakeRig) -> None:
    rig = make_rig({"slm1.settle": "auto", "slm2.settle": 0.2})
    first, second = rig.devices["slm1"], rig.devices["slm2"]
    assert first.measures_settling and first.options["settle"] == 0.5
    assert not second.measures_settling and second.options["settle"] == 0.2


def test_one_modulator_is_enough(make_rig: MakeRig) -> None:
    rig = make_rig({"slm2": None, "geometry.gap": None, "geometry.iris1_na": None})
    assert len(rig.bench.slms) == 1 and "slm2" not in rig.devices


TABLE_KEYS = [
    *(f"slm1.{key}" for key in ("device", "shape", "pitch", "num_levels", "opd_range")),
    *(f"slm2.{key}" for key in ("device", "shape", "pitch", "num_levels", "opd_range")),
    *(f"camera.{key}" for key in TABLES["camera"]),
    *(f"{name}.device" for name in ("lasers", "stage")),
    *("lasers.wavelengths", "stage.range", "limits.power", "limits.exposure"),
]


@pytest.mark.parametrize("key", [*TABLE_KEYS, "slm1", "camera", "lasers", "stage", "limits"])
def test_what_is_missing_is_named(make_rig: MakeRig, key: str) -> None:
    with pytest.raises(UserError) as raised:
        make_rig({key: None})
    assert raised.value.where.endswith(f"rig.toml: {key}") and raised.value.found == "is missing"


@pytest.mark.parametrize(
    ("key", "value", "where", "words"),
    [
        ("camrea", {"pitch": "1 um"}, "camrea", "did you mean camera"),
        ("limits.powre", 1.0, "limits.powre", "did you mean power"),
        ("geometry.gab", "1 mm", "geometry.gab", "did you mean gap"),
        ("name", 3, "name", "a text"),
        ("lasers", 3, "lasers", "unknown table"),
        ("slm1.device", 3, "slm1.device", "a text"),
        ("slm1.shape", [16], "slm1.shape", "rows and columns"),
        ("slm1.shape", [16.5, 24], "slm1.shape", "rows and columns"),
        ("slm2.shape", [16, 25], "slm2.shape", "[16, 24]"),
        ("camera.shape", [0, 5], "camera.shape[0]", "between 1 and 65536"),
        ("camera.pitch", "4 kg", "camera.pitch", "kg"),
        ("lasers.wavelengths", ["450 nm", "450 nm"], "lasers.wavelengths", "distinct"),
        ("lasers.wavelengths", ["450 m"], "lasers.wavelengths[0]", "out of range"),
        ("lasers.wavelengths", [], "lasers.wavelengths", "at least one"),
        ("stage.range", ["5 mm", "1 mm"], "stage.range", "the lower one first"),
        ("stage.range", ["5 mm"], "stage.range", "two values"),
        ("limits.stage", ["5 mm", "1 mm"], "limits.stage", "the lower one first"),
        ("limits.stage", ["5 mm", "11 mm"], "limits.stage", "within"),
        ("limits.exposure", [0.5, 0.1], "limits.exposure", "the lower one first"),
        ("limits.exposure", [0.0, 0.1], "limits.exposure[0]", "greater than 0"),
        ("limits.power", -1.0, "limits.power", "greater than 0"),
        ("limits.power", 0.0, "limits.power", "greater than 0"),
        ("slm1.settle", "slow", "slm1.settle", "is not a number"),
        ("slm1.settle", -0.1, "slm1.settle", "out of range"),
        ("slm1.num_levels", 1, "slm1 attribute num_levels", "2 to 65536"),
        ("slm1.pitch", "8 mm", "slm1 attribute pitch", "8e-6"),
        ("camera.bit_depth", 20, "camera attribute bit_depth", "1 to 16"),
        ("camera.electrons_per_count", 0, "camera attribute electrons_per_count", "above 0"),
        ("camera.black_level", 5000, "camera attribute black_level", "0 to 4095"),
        ("camera.shape", [48, 32], "camera/images", "rows and columns look swapped"),
        ("limits.power", float("nan"), "limits.power", "greater than 0"),
    ],
)
def test_what_is_wrong_is_named_with_what_is_expected(
    make_rig: MakeRig, key: str, value: Any, where: str, words: str
) -> None:
    with pytest.raises(UserError) as raised:
        make_rig({key: value})
    assert raised.value.where.endswith(f"rig.toml: {where}")
    assert words in str(raised.value)


def test_a_file_that_isnt_toml_or_isnt_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"missing\.toml"):
        read_rig(tmp_path / "missing.toml")
    (tmp_path / "rig.toml").write_text("name = ", encoding="utf-8")
    with pytest.raises(UserError, match=r"isn't TOML"):
        read_rig(tmp_path / "rig.toml")


def test_an_unknown_kind_of_device_is_named_before_anything_is_opened(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    opening = import_module("holoview.bench.rig.open_rig")  # the package has a function of this name
    monkeypatch.setattr(opening, "KINDS", {"virtual": lambda *_: pytest.fail("a device was opened")})
    with pytest.raises(UserError, match=r"camera\.device.*virtaul.*did you mean virtual"):
        open_rig(make_rig({"camera.device": "virtaul"}))


def test_the_file_of_secrets_is_read_beside_the_rig(tmp_path: Path) -> None:
    write_rig(tmp_path / "rig.toml", {"virtual": None, "virtual.bench": "hidden.toml"})
    assert dict(read_rig(tmp_path / "rig.toml").virtual) == {"bench": "hidden.toml"}
