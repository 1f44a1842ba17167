"""Checks that all kinds of devices share: options, libraries that are missing, a stage's own coordinate."""

from __future__ import annotations

import re
import sys

import pytest

from holoview.bench.rig import open_rig
from holoview.bench.rig.devices import DeviceError
from holoview.bench.rig.kinds.checks import StageAxis, find_class, open_or_close, table, texts
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


@pytest.mark.parametrize(
    ("options", "position_m"), [({"zero": 12e-3}, 17e-3), ({"zero": 12e-3, "reversed": True}, 7e-3)]
)
def test_positions_and_distances_are_each_others_inverse(options: dict[str, float], position_m: float) -> None:
    axis = StageAxis.of(options)
    assert axis.position_m(5e-3) == pytest.approx(position_m, rel=1e-12)
    assert axis.distance_m(position_m) == pytest.approx(5e-3, rel=1e-12)


def test_a_stage_may_stop_within_the_tolerance() -> None:
    StageAxis.of({}).require_arrived(5.009e-3, 5e-3)
    with pytest.raises(DeviceError, match=r"stage: stopped at 5\.011 mm; expected 5 mm; .* raise stage.tolerance"):
        StageAxis.of({}).require_arrived(5.011e-3, 5e-3)


@pytest.mark.parametrize("error", [UserError("stage", "is wrong"), re.error("no pattern"), KeyboardInterrupt()])
def test_a_line_is_closed_whatever_goes_wrong_while_its_device_is_made(error: BaseException) -> None:
    class Line:
        closed = 0

        def close(self) -> None:
            self.closed += 1
            raise OSError("gone")

    def fail() -> None:
        raise error

    line = Line()
    with pytest.raises(type(error)):
        open_or_close(line, fail)
    assert line.closed == 1
