"""Capture files whose data are elsewhere, or far larger than the file, are refused before anything is read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from holoview.captures import read_captures
from holoview.util.errors import UserError
from holoview.util.memory import VARIABLE
from tests.fuzz.valid_files import CAPTURES, valid, write

Edit = Callable[[h5py.File], object]
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
