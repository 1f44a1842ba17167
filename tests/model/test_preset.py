"""Presets: the benches of the paper, inheritance, and TOML in both directions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from holoview.light.colour import D65_WHITE, observer_weights
from holoview.light.model import preset
from holoview.light.model.bench_parts import Relay
from holoview.util.errors import UserError

NAMES = preset.names()
CHAINS = [name for name in NAMES if preset.load(name).is_chain]
PAPER = [name for name in NAMES if name not in ("bench-plm", *CHAINS)]
TWINS = [name for name in NAMES if "-1slm" in name]
OPEN = [name for name in NAMES if name.endswith("-open")]


def _file(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def _refusal(path: Path | str) -> str:
    with pytest.raises(UserError) as caught:
        preset.load(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


# --- what is shipped ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_preset_bears_its_name_and_survives_toml_exactly(name: str, tmp_path: Path) -> None:
    system = preset.load(name)
    assert system.name == name
    assert system.description
    assert preset.loads(preset.dumps(system)) == system
    preset.save(system, tmp_path / "copy.toml")
    assert preset.load(tmp_path / "copy.toml") == system


@pytest.mark.parametrize("name", NAMES)
def test_the_mean_over_frames_of_a_shipped_preset_is_d65_white_of_luminance_one(name: str) -> None:
    system = preset.load(name)
    xyz = system.amplitudes.mean(axis=0) @ observer_weights(system.observer, system.wavelengths_m)
    np.testing.assert_allclose(xyz, D65_WHITE, atol=1e-6)
    assert system.observer == "eye"


@pytest.mark.parametrize("name", PAPER)
def test_a_simulated_bench_has_the_papers_modulators_and_planes(name: str) -> None:
    system = preset.load(name)
    for modulator in system.modulators:
        assert modulator.shape == (384, 512)
        assert modulator.pitch_m == 8e-6
        assert 2 * np.pi * modulator.stroke_m / 550e-9 == pytest.approx(3 * np.pi, rel=1e-12)
        assert modulator.levels is None
    assert system.sampling.upsample == 2
    assert (system.planes_m.min(), system.planes_m.max()) == (9e-3, 11e-3)
    assert system.gap_m == (None if name in TWINS else 2e-3)


@pytest.mark.parametrize(
    ("name", "wavelengths", "frames", "sources"),
    [
        ("time-sequential", 3, 3, 1),
        ("multiplexed", 3, 3, 1),
        ("simultaneous", 3, 1, 1),
        ("holochrome-8", 8, 1, 1),
        ("holochrome-8x3", 8, 3, 1),
        ("holochrome-16", 16, 1, 1),
        ("holochrome-multisource", 9, 3, 9),
        ("multisource-3x3", 3, 3, 9),
        ("bench-plm", 8, 1, 1),
    ],
)
def test_a_scheme_has_its_lasers_frames_and_sources(name: str, wavelengths: int, frames: int, sources: int) -> None:
    system = preset.load(name)
    assert system.amplitudes.shape == (frames, wavelengths)
    assert len(system.wavelengths_m) == wavelengths
    assert system.source.directions_rad.shape == (sources, 2)
    np.testing.assert_allclose(system.source.directions_rad.mean(axis=0), 0, atol=1e-18)


@pytest.mark.parametrize("name", ["time-sequential", "time-sequential-1slm", "multisource-3x3"])
def test_time_sequential_colour_shows_one_laser_a_frame(name: str) -> None:
    np.testing.assert_array_equal(preset.load(name).amplitudes > 0, np.eye(3, dtype=bool))


@pytest.mark.parametrize("name", OPEN)
def test_an_open_display_differs_from_its_original_by_the_stops_only(name: str) -> None:
    opened, original = preset.load(name), preset.load(name.removesuffix("-open"))
    assert opened.relay1.is_clear and opened.relay2.is_clear
    assert original.relay2 == Relay(square="first order")
    assert original.relay1 == (Relay() if len(original.modulators) == 1 else original.relay2)
    changes = {"relay1": {}, "relay2": {}, "name": name, "description": opened.description}
    assert original.edit(changes) == opened


@pytest.mark.parametrize("name", TWINS)
def test_a_twin_differs_from_its_original_by_the_second_modulator_only(name: str) -> None:
    twin, original = preset.load(name), preset.load(name.replace("-1slm", ""))
    assert len(twin.modulators) == 1 and twin.gap_m is None
    changes = {"modulators": original.modulators[:1], "gap": None, "name": name, "description": twin.description}
    assert original.edit(changes) == twin


def test_the_bench_has_two_four_bit_modulators_irises_and_a_dc_block() -> None:
    system = preset.load("bench-plm")
    p67 = [0, 0.0107, 0.0219, 0.0450, 0.0598, 0.0775, 0.1206, 0.1850, 0.3655]
    p67 += [0.3955, 0.4510, 0.5244, 0.6393, 0.7116, 0.8502, 1]  # TI, p67 evaluation module user guide
    assert len(system.modulators) == 2
    for modulator in system.modulators:
        np.testing.assert_array_equal(modulator.levels, p67)
        assert modulator.pitch_m == 10.8e-6
    assert system.gap_m == 5e-3
    assert (system.planes_m.min(), system.planes_m.max()) == (20e-3, 30e-3)
    assert system.relay1.iris_na and system.relay2.iris_na
    assert system.relay2.dc_block_na and system.relay2.dc_block_na < system.relay2.iris_na


# --- inheritance ----------------------------------------------------------------------------------------------------


def test_a_preset_states_only_what_differs_from_its_base(tmp_path: Path) -> None:
    _file(
        tmp_path,
        "first.toml",
        'base = "holochrome-8"\ndescription = "d"\n[relay2]\niris_na = 0.02\ndc_block_na = 0.001\n',
    )
    second = _file(tmp_path, "second.toml", 'base = "first.toml"\ngap = "3 mm"\n[relay2]\niris_na = 0.03\n')
    expected = preset.load("holochrome-8").edit(
        {"gap": "3 mm", "relay2.iris_na": 0.03, "relay2.dc_block_na": 0.001, "name": "second", "description": ""}
    )
    assert preset.load(second) == expected


@pytest.mark.parametrize("way", ["", "../loop/"], ids=["plain", "roundabout"])
def test_a_base_that_leads_back_to_itself_is_refused(tmp_path: Path, way: str) -> None:
    folder = tmp_path / "loop"
    folder.mkdir()
    first = _file(folder, "first.toml", f'base = "{way}second.toml"')
    _file(folder, "second.toml", f'base = "{way}first.toml"')
    message = _refusal(first)
    assert "its base leads back to itself" in message
    assert len(message) < 1000


@pytest.mark.parametrize(
    ("base", "fragment"),
    [('"nowhere.toml"', "nowhere.toml"), ('"holochrom-8"', "did you mean holochrome-8"), ("3", "base: 3")],
)
def test_a_base_that_cannot_be_found_is_refused_with_the_file_that_names_it(
    tmp_path: Path, base: str, fragment: str
) -> None:
    path = _file(tmp_path, "mine.toml", f"base = {base}")
    message = _refusal(path)
    assert message.startswith(f"{path}: ")
    assert fragment in message


# --- mistakes -------------------------------------------------------------------------------------------------------


def test_an_unknown_name_is_refused_with_the_nearest_ones() -> None:
    message = _refusal("holochrom-8")
    assert 'preset "holochrom-8": unknown' in message
    assert "did you mean holochrome-8" in message


@pytest.mark.parametrize(("name", "found"), [("nowhere.toml", "no such file"), ("a/b", "no such file"), ("", "folder")])
def test_a_missing_file_is_refused(name: str, found: str, tmp_path: Path) -> None:
    assert found in _refusal(tmp_path / name)


@pytest.mark.parametrize(
    ("text", "fragments"),
    [
        ('base = "holochrome-8"\ngap = ', ("isn't TOML",)),
        ('base = "holochrome-8"\ngap = "-3 mm"', ("gap: -3 mm",)),
        ('base = "holochrome-8"\n[relay2]\niris = 3', ("relay2.iris: unknown key", "iris_na")),
        ('gap = "2 mm"', ("is missing",)),
        ('base = "time-sequential"\nframes = 2', ("sequence: ", "(3, 3)")),
    ],
)
def test_a_mistake_in_a_file_is_refused_with_file_and_key(
    tmp_path: Path, text: str, fragments: tuple[str, ...]
) -> None:
    path = _file(tmp_path, "mine.toml", text)
    message = _refusal(path)
    assert message.startswith(f"{path}: ")
    for fragment in fragments:
        assert fragment in message


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_bytes(b"\xff\xfe\x00")
    assert f"{path}: can't be read" in _refusal(path)


def test_a_mistake_in_toml_text_names_where_the_text_came_from() -> None:
    with pytest.raises(UserError, match=r"^view\.png: amplitudes: is missing|^view\.png: wavelengths: is missing"):
        preset.loads('gap = "2 mm"', "view.png")
    with pytest.raises(UserError, match=r"^view\.png: isn't TOML"):
        preset.loads("gap =", "view.png")
