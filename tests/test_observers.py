"""Observers: CIE 2006 by age and field, people, own tables, the texts that name them, and what they do to a bench."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import holoview as hv
from assets import make_observers
from holoview.commands.cli import main
from holoview.light import colour
from holoview.light.observers import PEOPLE, cones_of, drawn_people, load_observer, observer_rows, parse_observer
from holoview.util.errors import UserError

VISIBLE_M = np.arange(390, 831) * 1e-9
LASERS_M = np.array([460e-9, 532e-9, 638e-9])


def _published(name: str) -> tuple[np.ndarray, np.ndarray]:
    table = colour.import_colour_science().MSDS_CMFS[name]
    inside = (table.wavelengths >= 390) & (table.wavelengths <= 830)
    return table.wavelengths[inside] * 1e-9, np.nan_to_num(table.values)[inside]


# --- CIE 2006 ---------------------------------------------------------------------------------------------------------


def test_the_standard_person_of_two_degrees_is_the_published_table() -> None:
    at_m, published = _published("Stockman & Sharpe 2 Degree Cone Fundamentals")
    np.testing.assert_allclose(colour.cone_fundamentals(at_m, 32, 2), published, atol=1e-12)
    # area-normalised and multiplied by the area again: rounding alone
    same = colour.observer_weights("age 32, field 2", VISIBLE_M)
    np.testing.assert_allclose(same, colour.observer_weights("eye", VISIBLE_M), atol=1e-12)


def test_ten_degrees_are_those_of_the_published_tables() -> None:
    # Derived from the 2° table by the equations of CIE 170-1; both are printed with six figures, and the macula with
    # four, between whose 5 nm a spline runs: worst measured 1.1e-4 of the peak, at the S cone's steep short end.
    at_m, published = _published("Stockman & Sharpe 10 Degree Cone Fundamentals")
    np.testing.assert_allclose(colour.cone_fundamentals(at_m, 32, 10), published, atol=1.2e-4)
    at_m, published = _published("CIE 2015 10 Degree Standard Observer")
    xyz = colour.observer_weights("age 32, field 10", at_m)
    np.testing.assert_allclose(xyz * (published[:, 1].sum() / xyz[:, 1].sum()), published, atol=2.5e-4)


@pytest.mark.parametrize(
    ("nm", "lms"),
    # log10 of the absorbances of CIE 170-1:2006, tables of low optical density
    [
        (440, (-0.92675, -0.76267, -0.08115)),
        (500, (-0.30399, -0.13844, -1.45859)),
        (600, (-0.23784, -0.78679, -5.70383)),
    ],
)
def test_the_cones_without_filters_have_the_published_absorbances(nm: int, lms: tuple[float, ...]) -> None:
    bare = parse_observer("age 32, field 2, lens -90, macula -100")
    waves, response = cones_of(bare)
    lens = observer_rows("filters")[1][:, :2].sum(axis=1)
    lens = np.pad(lens, (0, len(waves) - len(lens)))
    quanta = response / waves[:, None] * 10 ** (0.1 * lens[:, None])
    density = np.array([0.38 + 0.54 * np.exp(-2 / 1.333)] * 2 + [0.30 + 0.45 * np.exp(-2 / 1.333)])
    absorbance = -np.log10(1 - (1 - 10**-density) * quanta / quanta.max(axis=0)) / density
    # Figures of the tables and of the densities, 5 decimals each; of S beyond 500 nm six figures of a response of 1e-5.
    at = absorbance[waves == nm][0]
    np.testing.assert_allclose(np.log10(at)[:2], lms[:2], atol=1e-3)
    np.testing.assert_allclose(np.log10(at)[2], lms[2], atol=2e-3)


@pytest.mark.parametrize(("age", "growth"), [(20, 0.76), (32, 1.0), (60, 1.56), (70, 2.227), (80, 2.894)])
def test_the_lens_yellows_as_cie_170_says(age: int, growth: float) -> None:
    young, old = (colour.cone_fundamentals(np.array([430e-9, 560e-9]), a, 4) for a in (32, age))
    grows = observer_rows("filters")[1][[430 - 390, 560 - 390], 0]
    # the ratio of two wavelengths, so that the scale of the peak cancels
    expected = 10 ** (-(growth - 1) * (grows[0] - grows[1]))
    np.testing.assert_allclose((old[0] / old[1]) / (young[0] / young[1]), expected, rtol=1e-9)


def test_a_shift_moves_a_cones_peak_and_density_broadens_it() -> None:
    waves, usual = cones_of(parse_observer("age 32, lens -90, macula -100"))
    _, shifted = cones_of(parse_observer("age 32, lens -90, macula -100, shift-L 5"))
    assert waves[shifted[:, 0].argmax()] - waves[usual[:, 0].argmax()] == pytest.approx(5, abs=1)
    np.testing.assert_array_equal(shifted[:, 1:], usual[:, 1:])
    _, dense = cones_of(parse_observer("age 32, lens -90, macula -100, M 50"))
    assert dense[:, 1].sum() > usual[:, 1].sum()


@pytest.mark.parametrize("who", ["age 20", "age 80, field 10", "field 1", "person 1", "person 100, field 10"])
def test_equal_energy_is_the_same_white_to_every_person(who: str) -> None:
    # 2.5e-5: to that the matrices of CIE 170-2 make equal areas of the functions of 2° and 10°
    total = colour.observer_weights(who, VISIBLE_M).sum(axis=0)
    np.testing.assert_allclose(total, colour.observer_weights("eye", VISIBLE_M).sum(axis=0), rtol=2e-4)
    assert np.isfinite(colour.observer_weight_derivatives(who, LASERS_M)).all()


def test_cie_1964_is_the_published_table() -> None:
    np.testing.assert_allclose(colour.observer_weights("cie1964", 450e-9)[0], (0.370702, 0.089456, 1.99480), atol=1e-3)


# --- people -----------------------------------------------------------------------------------------------------------


def test_the_people_are_those_that_the_seed_draws_and_spread_as_published() -> None:
    file = make_observers.FOLDER / "people.csv"
    assert file.read_text(encoding="utf-8") == make_observers.people()
    rows = observer_rows("people")[1]
    assert len(rows) == PEOPLE and rows[:, 0].min() >= 20 and rows[:, 0].max() <= 70
    # the standard deviation of 100 normal numbers scatters by 1/√200 = 7 %, five of which are 36 %
    np.testing.assert_allclose(rows[:, 1:].std(axis=0), (18.7, 36.5, 9, 9, 7.4, 2, 1.5, 1.3), rtol=0.36)


def test_the_filters_are_those_of_the_published_table() -> None:
    assert (make_observers.FOLDER / "filters.csv").read_text(encoding="utf-8") == make_observers.filters()
    nm, densities = observer_rows("filters")
    for line in make_observers.FILTERS.splitlines():
        at, *published = map(float, line.split())
        np.testing.assert_allclose(densities[nm == at][0], published, atol=1e-6)


def test_people_see_one_light_in_different_colours() -> None:
    xyz = np.array([colour.observer_weights(who, LASERS_M).sum(axis=0) for who in drawn_people(20)])
    assert (xyz.std(axis=0) / xyz.mean(axis=0)).max() > 0.02
    assert len(set(drawn_people())) == PEOPLE


# --- texts ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "kept"),
    [
        ("eye", "eye"),
        (" age 60 ", "age 60, field 2"),
        ("field 4, age 25.5", "age 25.5, field 4"),
        ("age 40, shift-L -1.5, lens 10, macula 0", "age 40, field 2, lens 10, shift-L -1.5"),
        ("person 7", "person 7"),
        ("person 7, field 10", "person 7, field 10"),
        ("camera c: 400 .2; 410 .3; 420 0.5; 430 .4;440 0", "camera c: 400 0.2; 410 0.3; 420 0.5; 430 0.4; 440 0"),
    ],
)
def test_equal_observers_have_one_text(text: str, kept: str) -> None:
    assert parse_observer(text).text == kept and parse_observer(kept).text == kept


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("age 5", r"'5'; expected 20 to 80 years"),
        ("age nan", r"expected 20 to 80 years"),
        ("field 30", r"'30'; expected 1 to 10 degrees"),
        ("age 40, age 50", "known: age, field"),
        ("person 101", r"'101'; expected 1 to 100"),
        ("person 1.5", r"expected 1 to 100"),
        ("person 3, age 40", "person and field alone"),
        ("macula -150", "expected -100 to 300 %"),
        ("eyes", "did you mean eye"),
        ("me.csv", "by --observer"),
        ("camera c: 400 .2; 410 .3", "5 to 1000"),
        ("", "observer"),
    ],
)
def test_an_impossible_observer_is_one_sentence(text: str, found: str) -> None:
    with pytest.raises(UserError, match=found):
        hv.load("holochrome-8").with_(observer=text)


# --- tables of one's own ----------------------------------------------------------------------------------------------


def _csv(path: Path, at: np.ndarray, values: np.ndarray, heading: str = "nm,L,M,S") -> Path:
    rows = [",".join(f"{x:.9g}" for x in (nm, *row)) for nm, row in zip(at, np.atleast_2d(values.T).T, strict=True)]
    path.write_text("\n".join([heading, *rows]) + "\n", encoding="utf-8")
    return path


NM = np.arange(390, 831, 1.0)


def test_ones_own_cones_are_seen_as_the_eye_they_describe(tmp_path: Path) -> None:
    cones = colour.cone_fundamentals(NM * 1e-9)
    who = load_observer(_csv(tmp_path / "my eye.csv", NM, cones))
    assert who.startswith("cones my-eye: 390 ")
    system = hv.load("holochrome-8").with_(observer=who)
    again = hv.load("holochrome-8").with_(observer=system.observer)
    assert again == system
    # nine figures in the file
    np.testing.assert_allclose(
        colour.observer_weights(who, LASERS_M), colour.observer_weights("eye", LASERS_M), rtol=2e-8, atol=1e-8
    )


def test_a_cameras_quantum_efficiency_weighs_by_photons(tmp_path: Path) -> None:
    at = np.arange(400.0, 1001.0, 20.0)
    who = load_observer(_csv(tmp_path / "cmos.csv", at, np.full((len(at), 1), 0.6), "nm,qe"))
    weights = colour.observer_weights(who, [500e-9, 940e-9])
    # a flat efficiency: the response to energy rises as the wavelength, and is 1 at the last of the table
    np.testing.assert_allclose(weights, np.outer([0.5, 0.94], colour.D65_WHITE), rtol=1e-12)
    system = hv.System(["940 nm"], [[1.0]], [hv.Modulator("8 um", (16, 16), "800 nm")], observer=who)
    with pytest.raises(UserError, match="400 to 1000 nm"):
        system.with_(wavelengths=["1100 nm"], amplitudes=[[1.0]])


def test_a_colour_camera_sees_equal_energy_as_white(tmp_path: Path) -> None:
    peaks = np.exp(-(((NM[:, None] - [600, 540, 460]) / 40) ** 2))
    who = load_observer(_csv(tmp_path / "c.csv", NM, peaks, "nm,R,G,B"))
    assert who.startswith("camera")
    total = colour.observer_weights(who, NM * 1e-9).sum(axis=0)
    np.testing.assert_allclose(total / total[1], colour.D65_WHITE, rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (lambda at, v: (at / 1000, v), "wavelengths from 0.39 to 0.83; expected nanometres"),
        (lambda at, v: (at * 1e-9, v), "expected nanometres"),
        (lambda at, v: (at, np.log10(v + 1e-6)), "of logarithms give the powers of ten"),
        (lambda at, v: (at, 100 * v), "divide per cent by 100"),
        (lambda at, v: (np.delete(at, slice(50, 100)), np.delete(v, slice(50, 100), 0)), "a gap from 439 to 490 nm"),
        (lambda at, v: (at, np.where(at[:, None] == 500, np.nan, v)), "row 111: 'nan'; expected a number"),
        (lambda at, v: (np.where(at == 500, 499, at), v), "499 nm twice"),
        (lambda at, v: (at, v * [1, 1, 0]), "a column of zeros"),
        (lambda at, v: (at, v[:, :2]), "rows of 3 columns"),
        (lambda at, v: (at[:3], v[:3]), "3 rows"),
    ],
)
def test_gaps_and_wrong_units_of_a_table_are_one_sentence(change: object, found: str, tmp_path: Path) -> None:
    at, values = change(NM, colour.cone_fundamentals(NM * 1e-9))  # type: ignore[operator]
    file = _csv(tmp_path / "cones.csv", at, values)
    with pytest.raises(UserError, match=found):
        load_observer(file)


@pytest.mark.parametrize("separator", [";", "\t"])
def test_commas_are_decimal_signs_where_something_else_separates(separator: str, tmp_path: Path) -> None:
    rows = [[nm, 0.25, 0.5, 0.125] for nm in range(400, 500, 10)]
    found = []
    for name, between, sign in (("a.csv", ",", "."), ("b.csv", separator, ",")):
        lines = [between.join(f"{value:g}".replace(".", sign) for value in row) for row in rows]
        (tmp_path / name).write_text("\n".join([between.join(["nm", "r", "g", "b"]), *lines]))
        found.append(load_observer(tmp_path / name).partition(":")[2])
    assert found[0] == found[1]


def test_an_empty_cell_and_other_text_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("nm,qe\n" + "\n".join(f"{nm},0.1" for nm in range(400, 500, 10)) + "\n500,\n")
    with pytest.raises(UserError, match="an empty cell; expected a number"):
        load_observer(tmp_path / "a.csv")
    (tmp_path / "b.csv").write_text("hello\n")
    with pytest.raises(UserError, match="rows of no columns"):
        load_observer(tmp_path / "b.csv")


# --- through everything -----------------------------------------------------------------------------------------------


def test_the_command_line_takes_an_observer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    small = ["--set", "shape=[24,32]", "--backend", "torch"]
    for number, who in enumerate(("eye", "age 70, field 4")):
        assert main(["render", "holochrome-8", *small, "--observer", who, "-o", str(tmp_path / f"{number}.png")]) == 0
    assert (tmp_path / "0.png").read_bytes() != (tmp_path / "1.png").read_bytes()
    assert main(["render", "holochrome-8", *small, "--observer", "age 5", "-o", str(tmp_path / "c.png")]) != 0
    assert "expected 20 to 80 years" in capsys.readouterr().err
    at = np.arange(400.0, 801.0, 10.0)
    _csv(tmp_path / "cmos.csv", at, 0.5 + 0.0 * at[:, None], "nm,qe")
    for name, code in (("cmos.csv", 0), ("none.csv", 1)):
        found = main(
            ["render", "holochrome-8", *small, "--observer", str(tmp_path / name), "-o", str(tmp_path / "c.png")]
        )
        assert (found != 0) == code
    assert "none.csv: no such file" in capsys.readouterr().err


def test_contrast_is_that_of_the_observer_and_of_light_as_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bench = ["holochrome-8", "--set", "shape=[24,32]", "--observer", "person 3"]
    assert main(["contrast", *bench, "--plane", "10mm", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    for suffix in (".npz", ".exr"):
        file = tmp_path / f"a{suffix}"
        assert main(["render", *bench, "--plane", "10mm", "--backend", "torch", "-o", str(file)]) == 0
        capsys.readouterr()
        assert main(["contrast", str(file), "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["contrast"] == found["contrast"]


def test_what_a_person_sees_are_the_lasers_in_their_cones() -> None:
    system = hv.load("holochrome-8").with_(shape=[24, 32], observer="person 4")
    view = hv.simulate(system, hv.random_drive(system, seed=0), backend="torch")
    lasers = system.amplitudes.mean(axis=0)
    expected = np.einsum("pwyx,wc->pyxc", view.intensity, colour.observer_weights("person 4", system.wavelengths_m))
    np.testing.assert_allclose(view.xyz, expected, rtol=1e-4, atol=1e-5 * float(lasers.max()))


def test_a_hologram_file_keeps_a_camera(tmp_path: Path) -> None:
    at = np.arange(400.0, 801.0, 10.0)
    who = load_observer(_csv(tmp_path / "cmos.csv", at, 0.5 + 0.0 * at[:, None], "nm,qe"))
    system = hv.load("holochrome-8").with_(shape=[16, 16], observer=who)
    hv.Hologram(hv.random_drive(system), system).save(tmp_path / "h.safetensors")
    assert hv.load_hologram(tmp_path / "h.safetensors").system == system
