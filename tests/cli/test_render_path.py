"""`holoview render --pupil-path`: what is seen along a path is what `render` shows of each place."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from holoview.commands import cli
from holoview.holograms.files.pupil_path_file import save_pupil_path
from holoview.light.model.focus import PupilPath

EYE = ("holochrome-8", "--set", "shape=[16, 24]", "--set", "eye={}", "--backend", "torch")
PATH = PupilPath((0.0, 2.0), (0.0, 2e-4), (-1e-3, 1e-3), (3e-3, 2e-3), (0.5, 1.0))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which a test runs, with a path of the pupil in path.csv, and one without focus in places.csv."""
    monkeypatch.chdir(tmp_path)
    save_pupil_path("path.csv", PATH)
    save_pupil_path("places.csv", PupilPath(PATH.times_s, PATH.y_m, PATH.x_m))
    return tmp_path


def _pixels(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path).convert("RGB")).astype(int)


def test_each_picture_is_what_the_eye_sees_from_that_place(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["render", *EYE, "--pupil-path", "path.csv", "--frames", "3", "-o", "seen", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["files"] == [f"seen/{number:04}.png" for number in range(3)]
    assert [state["time_s"] for state in printed["states"]] == [0.0, 1.0, 2.0]
    assert printed["states"][1]["plane"] == "10.2 mm (0.75 D)"
    middle = ["--set", 'eye.pupil="2.5 mm"', "--set", 'eye.pupil_y="0.1 mm"', "--plane", "0.75D", "-o", "alone.png"]
    assert cli.main(["render", *EYE, *middle]) == 0
    seen = _pixels(folder / "seen" / "0001.png")
    assert np.abs(seen - _pixels(folder / "alone.png")).max() <= 1, "the middle of the path, but for rounding"
    assert np.abs(seen - _pixels(folder / "seen" / "0000.png")).max() > 20


def test_an_animation_holds_the_same_pictures_for_as_long_as_the_path_takes(folder: Path) -> None:
    common = ["render", *EYE, "--pupil-path", "places.csv", "--plane", "10mm", "--exposure", "1"]
    assert cli.main([*common, "--frames", "2", "-o", "seen.png"]) == 0
    assert cli.main([*common, "--frames", "2", "-o", "seen"]) == 0
    with Image.open(folder / "seen.png") as image:
        assert image.n_frames == 2 and image.info["duration"] == pytest.approx(1000.0)
        for number in range(2):
            image.seek(number)
            kept = _pixels(folder / "seen" / f"{number:04}.png")
            assert np.array_equal(np.asarray(image.convert("RGB")), kept)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--pupil-path", "none.csv"], "none.csv: no such file"),
        (["--pupil-path", "path.csv", "--frames", "0"], "--frames: 0"),
        (["--pupil-path", "path.csv", "--plane", "10mm"], "the path tells"),
        (["--pupil-path", "places.csv", "--plane", "10mm", "11mm"], "2 planes"),
        (["--pupil-path", "path.csv", "-o", "seen.jpg"], 'suffix ".jpg"'),
        (["--pupil-path", "path.csv", "-o", "none/seen.png"], "doesn't exist"),
        (["--pupil-path", "path.csv", "-o", "path.csv"], "would overwrite --pupil-path"),
        (["--pupil-path", "path.csv", "--set", "eye=none"], "there is no eye"),
        (["--pupil-path", "path.csv", "--exposure", "99"], "--exposure"),
        (["--frames", "3"], "without --pupil-path"),
    ],
)
def test_mistakes_are_named_before_anything_is_computed(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], complaint: str
) -> None:
    assert cli.main(["render", *EYE, *arguments]) == 2
    assert complaint in capsys.readouterr().err
