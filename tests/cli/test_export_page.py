"""`holoview export --html` writes a page that the viewer's reader opens again."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import holoview as hv
from holoview.viewer.page.page import read_page

Run = Callable[..., Any]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    system = hv.load("holochrome-8").with_(shape=[24, 32])
    file = tmp_path / "a.safetensors"
    hv.Hologram(hv.random_drive(system), system).save(file, as_uint8=True)
    return file


def test_a_page_is_written_and_read_again(holoview: Run, file: Path, tmp_path: Path) -> None:
    Image.fromarray(np.full((24, 32, 3), 90, np.uint8)).save(tmp_path / "grey.png")
    outcome = holoview(
        "export",
        file,
        "--html",
        "out.html",
        "--backend",
        "torch",
        "--target",
        tmp_path / "grey.png",
        "--region",
        "2,2,9,9",
    )
    assert outcome.code == 0 and outcome.out.startswith("out.html (")
    (name, hologram), *others = read_page(tmp_path / "out.html").items()
    expected = hv.load_hologram(file)
    assert (name, others) == ("a", [])
    assert hologram.system == expected.system and np.array_equal(hologram.drive, expected.drive)


def test_files_of_one_name_are_numbered(holoview: Run, file: Path, tmp_path: Path) -> None:
    assert holoview("export", file, file, "--html", "two.html", "--backend", "torch").code == 0
    assert list(read_page(tmp_path / "two.html")) == ["a", "a (2)"]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--html", "out.png"], ".html"),
        (["--html", "out.html", "--depth", "a.safetensors"], "--target"),
        (["--html", "out.html", "--plane", "3 m"], "plane"),
        (["--html", "out.html", "--region", "0,0,900,9"], "region"),
        (["--html", "out.html", "--png", "x"], "not allowed"),
        ([], "required"),
    ],
)
def test_wrong_options_get_a_sentence(holoview: Run, file: Path, tmp_path: Path, options: list[str], says: str) -> None:
    outcome = holoview("export", file, *options)
    assert outcome.code == 2 and says in outcome.err
    assert not (tmp_path / "out.html").exists()


def test_patterns_are_of_one_hologram(holoview: Run, file: Path) -> None:
    outcome = holoview("export", file, file, "--png", "patterns")
    assert outcome.code == 2 and "2 holograms" in outcome.err


def test_a_contrast_can_be_computed_again_by_a_reader(holoview: Run, file: Path, tmp_path: Path) -> None:
    outcome = holoview("contrast", file, "--plane", "9.5mm", "--region", "8,8,20,20", "--live", "claim.html", "--json")
    assert outcome.code == 0
    found = json.loads(outcome.out)
    text = (tmp_path / "claim.html").read_text(encoding="utf-8")
    stated = json.dumps(f"{found['contrast']:.3f} ± {found['standard_error']:.3f}")
    assert f'"value":{stated},"region":{{"x":8,"y":8,"width":20,"height":20}}' in text
    assert '"plane_m":0.0095' in text


def test_a_picture_cannot_be_computed_again(holoview: Run, tmp_path: Path) -> None:
    Image.fromarray(np.full((24, 32, 3), 90, np.uint8)).save(tmp_path / "grey.png")
    outcome = holoview("contrast", "grey.png", "--live", "claim.html")
    assert outcome.code == 2 and "--live" in outcome.err


def test_a_study_without_holograms_refuses_it(holoview: Run) -> None:
    outcome = holoview("study", "memory-effect", "--quick", "--live")
    assert outcome.code == 2 and "--live" in outcome.err
