"""Chains of elements as data: what they are read from, and the sentence on each that can't be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import holoview as hv
from holoview.light.model import preset
from holoview.light.model.derived_numbers import info_rows
from holoview.light.model.masks import mask_values
from holoview.light.model.system import System
from holoview.light.model.validity import exceeded_limits

UM, MM, NM = 1e-6, 1e-3, 1e-9
PHASE = {"kind": "phase", "pitch": 8 * UM, "shape": (24, 32), "stroke": 825 * NM}
AMPLITUDE = {"kind": "amplitude", "pitch": 8 * UM, "shape": (24, 32)}
MASK = {"kind": "mask", "pitch": 4 * UM, "shape": (48, 64), "pattern": "random", "stroke": 600 * NM}
GAP = {"kind": "space", "distance": 1 * MM}
STOPS = {"kind": "space", "iris_na": 0.03}


def chain(*elements: Any, **changes: Any) -> System:
    values = {"wavelengths_m": [532 * NM], "amplitudes": [[1.0]], "planes_m": [3 * MM]} | changes
    return System(elements=elements, **values)


CANNOT_BE: dict[str, tuple[tuple[Any, ...], dict[str, Any], tuple[str, ...]]] = {
    "nothing": ((), {}, ("modulators: 0 of them",)),
    "no kind": (({"pitch": 8 * UM},), {}, ("elements[0].kind: is missing", "phase, amplitude")),
    "an unknown kind": (({"kind": "prism"},), {}, ("elements[0].kind: 'prism'",)),
    "an unknown key": ((PHASE | {"stoke": 1},), {}, ("elements[0].stoke: unknown key", "stroke")),
    "no modulator": ((MASK,), {}, ("no modulator", "phase, amplitude or complex")),
    "a space first": ((GAP, AMPLITUDE), {}, ("elements[0]: a space",)),
    "a field beside": (({"kind": "field", "pitch": 4 * UM, "shape": (48, 64)}, AMPLITUDE), {}, ("a field beside",)),
    "no distance": ((PHASE, STOPS, AMPLITUDE), {}, ("elements.space.distance: is missing",)),
    "a last distance": (
        (AMPLITUDE, GAP),
        {},
        ("elements[1].distance: 1 mm behind the last element", "the planes tell"),
    ),
    "two spaces with stops": (
        (AMPLITUDE, GAP | {"iris_na": 0.02}, GAP | {"iris_na": 0.03}, PHASE),
        {},
        ("a space behind a space with other stops",),
    ),
    "one name twice": ((PHASE | {"name": "slm"}, AMPLITUDE | {"name": "slm"}), {}, ('"slm" is the name of several',)),
    "a name that is a path": ((PHASE | {"name": "../slm"},), {}, ("elements[0].name", "letters, digits")),
    "a pitch between samples": (
        (PHASE, MASK | {"pitch": 3 * UM}),
        {},
        ("elements.mask.pitch: 3 um", "a whole multiple of the sample, 4 um", "upsample = 8 would fit"),
    ),
    "a range that falls": (
        (AMPLITUDE | {"range": [0.9, 0.1]},),
        {},
        ("elements[0].range: 0.9 to 0.1", "two amplitudes from 0 to 1, the lower one first"),
    ),
    "an amplitude above 1": ((AMPLITUDE | {"range": [0.0, 1.2]},), {}, ("elements[0].range: [0.0, 1.2]",)),
    "a pitch that nothing fits": (
        (PHASE, MASK | {"pitch": 3.1 * UM}),
        {},
        ("elements.mask.pitch: 3.1 um", "4 um would fit"),
    ),
    "edges between samples": (
        (PHASE, MASK | {"shape": (47, 64)}),
        {},
        ("elements.mask.offset", "edges on samples", "an offset of 2 um along y would fit"),
    ),
    "a place between samples": ((PHASE, AMPLITUDE | {"offset": (1 * UM, 0.0)}), {}, ("elements.", "edges on samples")),
    "a first order of whose": (
        (PHASE, MASK, {"kind": "space", "square": "first order"}),
        {},
        ("elements.space.square", "whose it is", "first order of phase"),
    ),
    "a first order of nobody": (
        (PHASE, MASK, {"kind": "space", "square": "first order of glass"}),
        {},
        ('the first order of "glass"', "phase, mask"),
    ),
    "a lens too short": (
        (AMPLITUDE, {"kind": "lens", "focal_length": 1 * MM}),
        {},
        ("elements.lens.focal_length: 1 mm", "make ghosts"),
    ),
    "a Fourier plane too small": (
        (AMPLITUDE, {"kind": "fourier", "focal_length": 9 * MM}),
        {},
        ("elements.fourier.focal_length: 9 mm", "can't hold the first order"),
    ),
    "a Fourier plane that wraps": (
        (AMPLITUDE | {"shape": (32, 32)}, {"kind": "fourier", "focal_length": 3 * MM}),
        {"sampling": hv.Sampling(propagation="periodic")},
        ("fourier with periodic propagation",),
    ),
    "planes from nobody": ((PHASE, AMPLITUDE), {"planes_from": "eye"}, ('planes_from: "eye"', "phase, amplitude")),
    "effects": (
        (PHASE, AMPLITUDE),
        {"effects": {"undiffracted": {"share": 0.1}}},
        ("effects.undiffracted", "element = "),
    ),
    "a mask of nothing": (({"kind": "mask", "pitch": 8 * UM},), {}, ("elements[0].file: is missing",)),
    "a random mask without a stroke": ((PHASE, MASK | {"stroke": None}), {}, ("elements[1].stroke: is missing",)),
    "a DC block over the iris": (
        (PHASE, {"kind": "space", "iris_na": 0.01, "dc_block_na": 0.02}),
        {},
        ("dc_block_na", "nothing would pass"),
    ),
    "beside a gap": ((PHASE, AMPLITUDE), {"gap_m": 1 * MM}, ("elements: beside a gap or relays",)),
}


@pytest.mark.parametrize("name", CANNOT_BE)
def test_a_chain_that_cannot_be_is_a_sentence(name: str) -> None:
    elements, changes, words = CANNOT_BE[name]
    with pytest.raises(hv.UserError) as caught:
        chain(*elements, **changes)
    assert all(word in str(caught.value) for word in words), str(caught.value)


def _saved(tmp_path: Path, values: Any) -> str:
    np.save(tmp_path / "mask.npy", values)
    return str(tmp_path / "mask.npy")


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (np.zeros((47, 64)), "47 × 64 values; expected the mask's shape, 48 × 64"),
        (np.full((48, 64), np.nan), "aren't finite"),
        (np.full((48, 64), 1.5), "amplitudes from 1.5 to 1.5"),
        (np.full((48, 64), -0.5), "amplitudes from -0.5"),
        (np.full((2, 48, 64), 1.0), "optical paths from 1 to 1"),
        (np.zeros((48, 64), complex), "complex numbers"),
        (np.zeros((3, 48, 64)), "the shape (3, 48, 64)"),
        (np.zeros(5), "the shape (5,)"),
    ],
)
def test_a_mask_that_is_none_is_a_sentence(tmp_path: Path, values: Any, words: str) -> None:
    mask = {"kind": "mask", "pitch": 4 * UM, "shape": (48, 64), "file": _saved(tmp_path, values)}
    with pytest.raises(hv.UserError) as caught:
        chain(PHASE, mask)
    assert words in str(caught.value)
    assert caught.value.where.startswith("elements.mask.")


def test_a_mask_that_is_missing_is_a_sentence() -> None:
    with pytest.raises(hv.UserError, match=r"nowhere\.npy"):
        chain(PHASE, {"kind": "mask", "pitch": 4 * UM, "file": "nowhere.npy"})


def test_masks_are_read_from_paths_amplitudes_both_and_pictures(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    path_m, amplitude = random.uniform(-1e-6, 1e-6, (4, 6)), random.random((4, 6))

    def read(values: Any, **keys: Any) -> Any:
        mask = {"kind": "mask", "pitch": 8 * UM, "file": _saved(tmp_path, values)} | keys
        (found,) = (e for e in chain(PHASE, mask).elements if e.kind == "mask")
        return mask_values(found)  # type: ignore[arg-type]

    assert np.array_equal(read(path_m).path_m, path_m) and read(path_m).amplitude is None
    (tmp_path / "mask.npy").unlink()
    both = read(np.stack([path_m, amplitude]), name="both")
    assert np.array_equal(both.path_m, path_m) and np.array_equal(both.amplitude, amplitude)
    grey = np.round(255 * amplitude).astype(np.uint8)
    Image.fromarray(grey).save(tmp_path / "mask.png")
    picture = {"kind": "mask", "pitch": 8 * UM, "file": str(tmp_path / "mask.png")}
    for keys, what in (({}, "amplitude"), ({"stroke": 600 * NM}, "path_m")):
        element = chain(PHASE, picture | keys).elements[1]
        scale = keys.get("stroke", 1.0)
        assert np.allclose(getattr(mask_values(element), what), grey / 255 * scale, rtol=1e-12)  # type: ignore[arg-type]


def test_a_chain_is_the_same_after_a_file(tmp_path: Path) -> None:
    np.save(tmp_path / "mask.npy", np.zeros((48, 64)))
    mask = {"kind": "mask", "pitch": 4 * UM, "file": str(tmp_path / "mask.npy"), "name": "glass"}
    lens = {"kind": "lens", "focal_length": 50 * MM}
    system = chain(PHASE, GAP | {"square": "first order of phase"}, mask, lens, STOPS | {"aberration": {"Z5": 5e-8}})
    preset.save(system, tmp_path / "bench.toml")
    assert 'file = "mask.npy"' in (tmp_path / "bench.toml").read_text()  # beside it, so that both can be moved
    assert preset.load(tmp_path / "bench.toml").elements == system.elements


def test_elements_are_edited_by_name_or_place_and_replace_those_of_a_base(tmp_path: Path) -> None:
    system = chain(PHASE, GAP, AMPLITUDE | {"name": "coarse"})
    assert system.edit({"elements.coarse.levels": 2}).elements[2].levels.tolist() == [0.0, 1.0]  # type: ignore[attr-defined]
    assert system.edit({"elements.1.distance": "2 mm"}).way.distances_m[0] == 2 * MM
    with pytest.raises(hv.UserError, match=r"elements\.phase\.pitch|elements\.NAME\.pitch"):
        system.with_(pitch="8 um")
    with pytest.raises(hv.UserError, match="unknown key"):
        system.edit({"elements.mask.pitch": "8 um"})
    (tmp_path / "a.toml").write_text(
        'base = "holochrome-8"\n[[elements]]\nkind = "amplitude"\npitch = "8 um"\nshape = [24, 32]\n'
    )
    assert [e.kind for e in preset.load(tmp_path / "a.toml").elements] == ["amplitude"]
    (tmp_path / "b.toml").write_text((tmp_path / "a.toml").read_text() + "[relay2]\niris_na = 0.02\n")
    with pytest.raises(hv.UserError, match=r"relay2: beside \[\[elements\]\]"):
        preset.load(tmp_path / "b.toml")


def test_a_chain_of_two_equal_phase_modulators_is_a_bench_of_the_short_form() -> None:
    system = chain(PHASE, GAP | {"iris_na": 0.03}, PHASE | {"name": "second"}, STOPS)
    assert not system.is_chain
    assert (system.gap_m, system.relay1.iris_na, system.relay2.iris_na) == (1 * MM, 0.03, 0.03)
    assert system.with_(gap="2 mm").elements[1].distance_m == 2 * MM  # type: ignore[attr-defined]
    assert system.edit({"elements.second.stroke": "700 nm"}).modulators[1].stroke_m == pytest.approx(700 * NM)
    assert preset.loads(preset.dumps(system)) == system
    assert chain(PHASE, GAP, PHASE | {"pitch": 16 * UM, "shape": (12, 16)}).is_chain


def test_the_same_element_may_stand_twice() -> None:
    slm = hv.load("holochrome-8").with_(shape=(24, 32)).elements[0]
    amplitude = chain(AMPLITUDE).elements[0]
    system = chain(amplitude, GAP, amplitude, slm)
    assert list(system.drive_shapes) == ["amplitude1", "amplitude2", "phase"]


def test_spaces_that_follow_each_other_are_one() -> None:
    system = chain(PHASE, GAP, GAP | {"iris_na": 0.02}, AMPLITUDE)
    assert system.way.distances_m[0] == 2 * MM
    assert system.way.relays[0].iris_na == 0.02


def test_stops_are_told_by_the_names_of_their_spaces() -> None:
    """Those of spaces that are one have both names; of a short form their places."""
    wide = {"kind": "space", "iris_na": 0.5}  # beyond the samples, which hold λ/(2·4 µm)
    parts = (PHASE, GAP | {"name": "way", "iris_na": 0.02}, {**GAP, "name": "on"}, AMPLITUDE, wide | {"name": "rest"})
    system = chain(*parts)
    rows = [row.name for row in info_rows(system) if row.heading == "cut-offs"]
    assert "iris of way and on" in rows and "iris of rest" in rows
    (told,) = [limit for limit in exceeded_limits(hv.make_plan(system)) if "the stops of" in limit]
    assert "the stops of rest reach" in told
    short = chain(PHASE, GAP | {"name": "way", "iris_na": 0.02}, PHASE, wide)
    assert {"iris of relay 1", "iris of relay 2"} < {row.name for row in info_rows(short)}
