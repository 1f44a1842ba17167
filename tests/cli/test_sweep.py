"""`holoview sweep`: numbers are those of other commands, points are kept, tolerances are roots."""

from __future__ import annotations

import csv
import io
import json
import math
import pickle
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from holoview.evidence.study import runner
from holoview.evidence.study.runner import ExecutionTarget, ResultStore
from holoview.evidence.sweep.axes import Axis, grid_points, own_value, parse_axis, settings_with
from holoview.evidence.sweep.points import ParameterSweep, PointRunner, SweptTarget
from holoview.evidence.sweep.tolerance import Tolerance, find_limits, parse_tolerance
from holoview.holograms.files.pictures import write_png
from holoview.holograms.hologram import Hologram, load_hologram
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.view import random_drive
from holoview.light.model import preset
from holoview.light.model.system import System
from holoview.util.errors import UserError
from tests.cli.conftest import Outcome

Holoview = Callable[..., Outcome]
SHAPE = "shape=[24,32]"
BENCH = ("simultaneous", "--set", SHAPE, "--set", "planes=10mm")


def small() -> System:
    return preset.load("simultaneous").with_(shape=[24, 32], planes=["10 mm"])


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    """A picture of the size of the simulation."""
    path = tmp_path / "target.png"
    values = np.random.default_rng(0).integers(60, 200, (6, 8, 3)).astype(np.uint8)
    write_png(path, np.kron(values, np.ones((8, 8, 1), np.uint8)), {})
    return path


def table(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(path.read_text(encoding="utf-8"))))


@pytest.mark.long
def test_a_point_has_the_numbers_that_contrast_optimise_and_render_print(holoview: Holoview, picture: Path) -> None:
    arguments = ("--set", "gap=1mm,2mm", "--set", "frames=2", "--target", picture)
    measures = "contrast,psnr,eyebox,light,luminance"
    made = holoview("optimise", "simultaneous", picture, *BENCH[1:], "--iterations", 2, "-o", "h.safetensors", "--json")
    assert made.code == 0, made.err
    scores = json.loads(made.out)
    swept = holoview("sweep", "h.safetensors", "--set", "gap=1mm,2mm", "--target", picture, "--measure", measures,
                     "-o", "s.csv", "--json")  # fmt: skip
    assert swept.code == 0, swept.err
    own = json.loads(swept.out)["points"][1]
    assert own["set"] == {"gap": 0.002}  # the bench's own gap
    # the same functions on the same patterns: equal but for the order of a sum
    assert own["psnr"] == pytest.approx(scores["psnr_db"], rel=1e-9)
    assert own["eyebox"] == pytest.approx(scores["eyebox_uniformity"], rel=1e-9)
    seen = json.loads(holoview("contrast", "h.safetensors", "--target", picture, "--json").out)
    for name, said in (("contrast", "contrast"), ("contrast_error", "standard_error")):
        if seen["withheld"]:  # of some seeds' patterns, two iterations don't show the target
            assert own[name] is None and seen[said] is None
        else:
            assert own[name] == pytest.approx(seen[said], rel=1e-9)
    numbers = holoview("render", "h.safetensors", "--backend", "torch", "-o", "seen.npz", "--json")
    (plane,) = json.loads(numbers.out)["planes"]
    assert own["light"] == pytest.approx(plane["light_in_picture"], abs=1e-9)  # which is rounded to 9 digits
    assert own["luminance"] == pytest.approx(plane["mean_luminance"], rel=1e-6)  # of f32 samples, summed in f32
    speckle = holoview("sweep", *BENCH, *arguments[:4], "--measure", "contrast", "-o", "random.csv")
    assert speckle.code == 0, speckle.err

    rendered = json.loads(
        holoview(
            "render", *BENCH, "--set", "frames=2", "--set", "gap=1mm", "--backend", "torch", "-o", "r.png", "--json"
        ).out
    )
    first = table(Path("random.csv"))[0]
    assert first["gap (mm)"] == "1.0"
    assert float(first["contrast"]) == pytest.approx(rendered["planes"][0]["speckle_contrast"], abs=1e-6)  # rounded


def test_a_contrast_that_is_withheld_is_said(holoview: Holoview, picture: Path) -> None:
    """Random patterns don't show the target."""
    swept = holoview("sweep", "simultaneous", "--set", "shape=[48,64]", "--set", "planes=10mm", "--set", "gap=1mm,2mm",
                     "--target", picture, "--measure", "contrast,light", "-o", "s.csv", "--plot", "s.png")  # fmt: skip
    assert swept.code == 0, swept.err
    assert {row["contrast"] for row in table(Path("s.csv"))} == {"nan"}
    assert "note: speckle contrast withheld at 2 of 2 points: the picture doesn't show the target there" in swept.err
    assert Path("s.png").stat().st_size > 0


@pytest.mark.long
def test_a_sweep_goes_on_where_it_was_and_computes_anew_what_changed(holoview: Holoview, picture: Path) -> None:
    command = ("sweep", *BENCH, "--set", "gap=1mm:2mm:2", "--target", picture, "--measure", "psnr", "-o", "s.csv")
    assert holoview(*command).code == 0
    before = {path.name: path.stat().st_mtime_ns for path in Path("s.points").iterdir()}
    text = Path("s.csv").read_text(encoding="utf-8")
    next(Path("s.points").iterdir()).write_text("cut", encoding="utf-8")
    again = holoview(*command)
    assert again.code == 0 and Path("s.csv").read_text(encoding="utf-8") == text
    after = {path.name: path.stat().st_mtime_ns for path in Path("s.points").iterdir()}
    assert sorted(before) == sorted(after) and sum(before[name] != after[name] for name in before) == 1
    write_png(picture, np.full((48, 64, 3), 128, np.uint8), {})  # another picture of the same name
    assert holoview(*command).code == 0
    assert Path("s.csv").read_text(encoding="utf-8") != text


@pytest.mark.explores
def test_workers_find_what_one_process_finds(holoview: Holoview) -> None:
    system = small()
    Hologram(random_drive(system, 0), system).save("h.safetensors")  # --reseed moves no seeds of other processes
    command = ("sweep", "h.safetensors", "--set", "gap=1mm,3mm", "--optimise", 2, "--measure", "psnr,light")
    for name, more in (("one", ()), ("two", ("--workers", "2"))):
        made = holoview(*command, "-o", f"{name}.csv", *more)
        assert made.code == 0, made.err
    one, two = (table(Path(f"{name}.csv")) for name in ("one", "two"))
    for row, other in zip(one, two, strict=True):
        for key in row:  # f32 optimisations on other numbers of threads differ in rounding only: 4 iterations, 2 points
            assert float(row[key]) == pytest.approx(float(other[key]), rel=1e-3)


def test_an_interrupted_sweep_keeps_its_points_in_the_table(
    holoview: Holoview, monkeypatch: pytest.MonkeyPatch
) -> None:
    save, saved = ResultStore.save, list[str]()

    def then_interrupt(self: ResultStore, job: Any, result: Any) -> None:
        save(self, job, result)
        saved.append(job.label)
        if len(saved) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(ResultStore, "save", then_interrupt)
    command = ("sweep", *BENCH, "--set", "gap=1mm:3mm:3", "--measure", "contrast", "-o", "s.csv")
    stopped = holoview(*command)
    assert stopped.code == 130 and "2 points are in s.csv; the same command goes on" in stopped.err
    assert [row["gap (mm)"] for row in table(Path("s.csv"))] == ["1.0", "2.0"]
    assert holoview(*command).code == 0 and len(saved) == 3
    assert [row["gap (mm)"] for row in table(Path("s.csv"))] == ["1.0", "2.0", "3.0"]


@pytest.mark.long
def test_a_row_begins_with_neighbours_patterns_and_other_parameters_don_t_mix(tmp_path: Path, picture: Path) -> None:
    """Each start is the drive of the neighbour with the same other parameters; the first is found again."""
    sweep = ParameterSweep(small(), ("psnr",), target=SweptTarget(str(picture)), settings=Settings(iterations=1))
    axes = [Axis("gap", (1e-3, 2e-3, 3e-3), "mm", True), Axis("optimiser.eyebox", (0, 1))]
    swept = PointRunner(sweep, axes, ResultStore(tmp_path / "points", keeps_holograms=True))
    swept.run_grid(grid_points(axes))
    jobs = {job.key: job for _, job in swept.asked}
    first = {point["optimiser.eyebox"]: job for point, job in swept.asked if point["gap"] == 1e-3}
    assert len(swept.rows()) == len(swept.asked) == 6
    for point, job in swept.asked:
        after = jobs.get(job.settings["after"])
        if point["gap"] == 1e-3 or point["gap"] == 3e-3:  # again, from the second's patterns
            assert after is not None and after.label == f"gap = 2 mm, optimiser.eyebox = {point['optimiser.eyebox']}"
        else:  # from the run-in, which isn't reported
            assert after is None and job.settings["after"] not in (None, first[point["optimiser.eyebox"]].key)


def test_limits_are_the_roots_of_an_analytic_curve_and_pairs_its_corners() -> None:
    """psnr = 30 − (gap − 2)²/0.25 − |x|·4 in mm and µm: 0.5 dB is lost at gap = 2 ± √0.125 and at x = ±0.125."""
    system = small()
    axes = [
        Axis("gap", (1e-3, 2e-3, 3e-3), "mm", True),
        Axis("effects.slm_alignment.shift_x", (-1e-6, 0.0, 1e-7), "um", True),
    ]

    def evaluate(own: Any, points: Sequence[Any]) -> list[dict[str, float]]:
        return [
            {"psnr": 30 - (1e3 * p["gap"] - 2) ** 2 / 0.25 - 4e6 * abs(p["effects.slm_alignment.shift_x"])}
            for p in points
        ]

    found = find_limits(axes, system, [Tolerance("psnr", 0.5)], evaluate)
    gap, shift = found.limits
    half = 0.25 * math.sqrt(2)
    # roots are found within 1 % of the tolerance: 0.005 dB over a slope of 2·0.354/0.25 dB/mm
    assert gap.low == pytest.approx(2e-3 - half * 1e-3, abs=0.005 / (8 * half) * 1.01e-3)
    assert gap.high == pytest.approx(2e-3 + half * 1e-3, abs=0.005 / (8 * half) * 1.01e-3)
    assert shift.low == pytest.approx(-0.125e-6, abs=0.005 / 4 * 1.01e-6)
    assert shift.high is None and shift.ends[1] == 1e-7  # beyond the range
    (corner,) = found.corners
    assert corner.loss == pytest.approx(2.0, abs=0.02)  # two losses of the tolerance add up


def test_worse_is_higher_for_contrast_and_lower_for_psnr() -> None:
    assert Tolerance("contrast", 0.1).loss({"contrast": 0.5}, {"contrast": 0.7}) == pytest.approx(2)
    assert Tolerance("psnr", 0.5).loss({"psnr": 20}, {"psnr": 21}) == pytest.approx(-2)
    assert parse_tolerance("light=1%") == Tolerance("light", 0.01)
    assert parse_tolerance("psnr = 0.5 dB") == Tolerance("psnr", 0.5)


@pytest.mark.long
def test_the_tolerance_of_a_hologram_is_where_it_loses_so_much(holoview: Holoview, picture: Path) -> None:
    """On a bench: at the limits that are found the hologram has lost 0.5 dB within a hundredth of it."""
    made = holoview("optimise", "simultaneous", picture, *BENCH[1:], "--iterations", 15, "-o", "h.safetensors")
    assert made.code == 0, made.err
    asked = ("--set", "gap=1mm:3mm:3", "--tolerance", "psnr=0.5dB", "--target", picture, "--measure", "psnr")
    swept = holoview("sweep", "h.safetensors", *asked, "-o", "t.csv", "--plot", "t.png", "--json")
    assert swept.code == 0, swept.err
    found = json.loads(swept.out)
    (limits,) = found["tolerance"]["limits"]
    assert 1e-3 < limits["low"] < limits["own"] == 2e-3 < limits["high"] < 3e-3
    by_gap = {point["set"]["gap"]: point["psnr"] for point in found["points"]}
    for side in ("low", "high"):
        assert by_gap[2e-3] - by_gap[limits[side]] == pytest.approx(0.5, abs=0.0051)
    assert Path("t.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--set", "gapp=1mm:3mm:3"), "--set gapp: unknown parameter; did you mean gap?"),
        (("--set", "optimiser.iteration=1,2"), "did you mean iterations"),
        (("--set", "effects.gap.gap_eror=0:1um:3"), "gap_error"),
        (("--set", "gap=3mm:1mm:3"), "doesn't rise"),
        (("--set", "gap=1mm:1mm:3"), "doesn't rise"),
        (("--set", "gap=nan:1mm:3"), '"nan" in nan:1mm:3; expected a finite number'),
        (("--set", "gap=1mm:inf:3"), '"inf" in 1mm:inf:3'),
        (("--set", "gap=1mm:3mm:1"), "COUNT of 2 or more"),
        (("--set", "gap=1mm:3mm"), "COUNT of 2 or more"),
        (("--set", "gap=1mm:3mrad:3"), "mixes units"),
        (("--set", "gap=1mm,,3mm"), "empty value"),
        (("--set", "gap=1mm,1mm"), "a value twice"),
        (("--set", "gap=1mm,2mm", "--set", "gap=1mm:3mm:3"), "is swept twice"),
        (("--set", "gap=1mm:3mm:10001"), "10001 points in all"),
        (("--set", "gap=1mm:3m:3"), "out of range"),
        (("--set", "frames=1:2:3"), "1.5"),
        ((), "no parameter has several values"),
        (("--set", "gap=1mm,2mm", "--measure", "sharpness"), '"sharpness"; expected contrast'),
        (("--set", "gap=1mm,2mm", "--cold"), "--cold: without --optimise"),
        (("--set", "gap=1mm,2mm", "--brightness", "2", "--measure", "contrast"), "--brightness: without a target"),
        (("--set", "gap=1mm:3mm:3", "--tolerance", "psnr"), "expected MEASURE=AMOUNT"),
        (("--set", "gap=1mm:3mm:3", "--tolerance", "psnr=0"), "an amount above 0"),
        (("--set", "gap=1mm:3mm:3", "--tolerance", "contrast=1dB"), "has the unit dB"),
        (("--set", "gap=1mm,3mm", "--tolerance", "psnr=1dB"), "has no tolerance; expected a range"),
        (("--set", "frames=1:3:3", "--tolerance", "psnr=1dB"), "isn't a number that varies continuously"),
        (("--set", "gap=3mm:4mm:3", "--tolerance", "psnr=1dB"), "without the bench's own 2 mm"),
        (("--set", "relay2.iris_na=0.01:0.02:3", "--tolerance", "psnr=1dB"), "the bench has none"),
        (("--set", "gap=1mm,2mm", "--workers", "0"), "--workers"),
    ],
)
def test_a_mistake_is_one_sentence_before_anything_is_computed(
    holoview: Holoview, arguments: tuple[str, ...], said: str
) -> None:
    refused = holoview("sweep", *BENCH, *arguments, "-o", "s.csv")
    assert refused.code == 2 and said in refused.err, refused.err
    assert refused.err.strip().splitlines()[-1].startswith("holoview: ") and not Path("s.csv").exists()


def test_patterns_that_don_t_fit_a_point_are_refused_with_a_remedy(holoview: Holoview) -> None:
    system = small()
    Hologram(random_drive(system, 0), system).save("h.safetensors")
    refused = holoview("sweep", "h.safetensors", "--set", "frames=1,3", "-o", "s.csv")
    assert refused.code == 2 and "--optimise N finds patterns for it" in refused.err
    assert load_hologram("h.safetensors").system == system


@pytest.mark.parametrize("folder", [None, "kept"])
def test_a_sweep_that_is_refused_while_it_runs_leaves_no_empty_folder(
    folder: str | None, holoview: Holoview, tmp_path: Path
) -> None:
    points = tmp_path / "s.points"
    if folder is not None:
        (points / folder).mkdir(parents=True)
    outside = ("--region", "0,0,1000,1000", "--measure", "contrast", "-o", tmp_path / "s.csv")
    outcome = holoview("sweep", *BENCH, "--set", "gap=1mm,2mm", *outside)
    assert outcome.code == 2 and "region" in outcome.err
    assert points.exists() == (folder is not None)
    assert not (tmp_path / "s.csv").exists()


def test_axes_take_units_lists_and_tables() -> None:
    gap = parse_axis("gap=1:3mm:5")
    assert gap is not None and gap.values == (1e-3, 1.5e-3, 2e-3, 2.5e-3, 3e-3) and gap.heading == "gap (mm)"
    frames = parse_axis("frames=1:5:3")
    assert frames is not None and frames.values == (1, 3, 5) and all(type(value) is int for value in frames.values)
    shapes = parse_axis("shape=[48,64],[96,128]")
    assert shapes is not None and shapes.values == ([48, 64], [96, 128]) and not shapes.is_numeric
    who = parse_axis('observer="age 20, field 2","age 70, field 2"')
    assert who is not None and who.values == ("age 20, field 2", "age 70, field 2")
    assert parse_axis("gap=2mm") is None and parse_axis("shape=[48,64]") is None


def test_a_bench_tells_its_own_value_of_any_number() -> None:
    system = small().edit(
        {"relay2.iris_na": 0.02, "relay2.aberration": {"Z4": "50 nm"}, "effects.gap.gap_error": "0.1 mm"}
    )
    assert own_value(system, "gap") == 2e-3 and own_value(system, "relay2.iris_na") == 0.02
    assert own_value(system, "relay2.aberration.Z4") == 5e-8 and own_value(system, "relay2.aberration.Z5") == 0.0
    assert own_value(system, "effects.gap.gap_error") == 1e-4 and own_value(small(), "effects.gap.gap_error") == 0.0
    assert own_value(system, "pitch") == own_value(system, "modulators.0.pitch") == system.modulators[0].pitch_m
    for key in ("upsample", "sampling.padding", "wavelengths", "observer", "name", "relay2", "modulators.7.pitch"):
        with pytest.raises(UserError):
            own_value(system, key)


def test_optimiser_settings_are_read_as_their_fields_say() -> None:
    changed = settings_with(Settings(), {"iterations": 7, "free": "patterns"})
    assert changed.iterations == 7 and changed.free == ("patterns",)
    with pytest.raises(UserError, match=r"optimiser\.iterations"):
        settings_with(Settings(), {"iterations": -1})


def test_jobs_go_to_any_executor_of_the_studies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By Dask as by processes: the study and its settings are pickled and run by `run_in_worker`."""

    class Inline:
        has_free_slot = True

        def submit(self, function: Any, *arguments: Any) -> Any:
            future: Future[Any] = Future()
            function, arguments = pickle.loads(pickle.dumps((function, arguments)))
            future.set_result(function(runner.WorkerResources(), *arguments))
            return future

    @contextmanager
    def inline(address: str) -> Any:
        yield Inline()

    monkeypatch.setattr(runner, "dask_executor", inline)
    axes = [Axis("gap", (1e-3, 2e-3), "mm", True)]
    drive = random_drive(small(), 3)
    results = []
    for place, target in enumerate((ExecutionTarget(), ExecutionTarget(1, "tcp://anywhere:1"))):
        store = ResultStore(tmp_path / str(place))
        results.append(
            PointRunner(ParameterSweep(small(), ("light",), drive), axes, store, target).run_grid(grid_points(axes))
        )
    assert results[0] == results[1]
