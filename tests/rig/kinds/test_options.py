"""What every kind of device shares: its options, and the extra that brings its library."""

from __future__ import annotations

import sys

import pytest

from holoview.rig import open_rig
from holoview.rig.kinds.checks import find_class, table, texts
from holoview.util.errors import UserError
from tests.rig.kinds.conftest import WriteRig


@pytest.mark.parametrize(
    ("device", "options", "library"),
    [
        ("slm1", 'device = "slmsuite"\nclass = "slmsuite.hardware.slms.holoeye.Holoeye"', "slmsuite"),
        ("stage", 'device = "serial"\nport = "loop://"\nmove = "X"', "serial"),
        ("stage", 'device = "micromanager"\nconfig = "a.cfg"\nlabel = "Z"', "pymmcore_plus"),
    ],
)
def test_a_library_that_is_missing_is_named_with_its_extra(
    write_rig: WriteRig, monkeypatch: pytest.MonkeyPatch, device: str, options: str, library: str
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(UserError, match=rf"{device}: device = .*{library} isn't installed; .*holoview\[rig\]"):
        open_rig(write_rig(**{device: options}))


def test_an_unknown_kind_is_named(write_rig: WriteRig) -> None:
    with pytest.raises(UserError, match=r'stage\.device: "manuel"; did you mean manual\?'):
        open_rig(write_rig(stage='device = "manuel"'))


def test_one_text_is_a_list_of_one() -> None:
    assert texts("a", "here") == ("a",) and texts(["a", "b"], "here") == ("a", "b")
    with pytest.raises(UserError, match=r"here\[1\]: 3 is not text"):
        texts(["a", 3], "here")
    with pytest.raises(UserError, match="here: 3; expected a table"):
        table(3, "here")


def test_a_class_is_found_by_its_path() -> None:
    assert find_class("pathlib.Path", "here").__name__ == "Path"
    with pytest.raises(UserError, match=r'here: "pathlib" has no class "Paths"; did you mean'):
        find_class("pathlib.Paths", "here")
