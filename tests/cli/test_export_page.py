"""`holoview export --html` writes a page that the viewer's reader opens again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import holoview as hv
from holoview.page.page import read_page

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
