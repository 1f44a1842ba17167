"""A rig in a session: pictures with their prediction, lasers that go off whatever hangs, limits, captures, plans."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from holoview.bench.captures.capture_file import read_captures
from holoview.bench.rig import live_devices
from holoview.util.errors import UserError
from holoview.viewer.document.rig_session import MODELS
from tests.experiment.live.conftest import LASER_M, Rigged
from tests.experiment.live.fake_bench import PLAN


def test_live_pictures_agree_with_their_prediction_but_for_noise(rigged: Rigged) -> None:
    """χ²/n of n usable pixels has the standard deviation √(2/n); within five of it."""
    rigged.open()
    rigged.light_up()
    found = rigged.rig.view.prediction
    assert found is not None
    n = (48 - 2 * 10) * (64 - 2 * 10)  # without the border
    assert abs(found.chi2 - 1) < 5 * np.sqrt(2 / n)
    newest = rigged.rig.view.picture
    rigged.wait(lambda: rigged.rig.view.picture is not newest)


def test_another_model_predicts_other_pictures(rigged: Rigged) -> None:
    rigged.open()
    rigged.light_up()
    good = rigged.rig.view.prediction
    rigged.session.change("Gap", {"effects": {"crosstalk": {"sigma": 0.6}}})
    rigged.rig.choose_model(MODELS[1])
    rigged.wait(lambda: (p := rigged.rig.view.prediction) is not None and p.model == MODELS[1])
    bad = rigged.rig.view.prediction
    assert good is not None and bad is not None and bad.chi2 > 2 * good.chi2


def test_the_lasers_go_off_while_the_camera_hangs(rigged: Rigged) -> None:
    rigged.open()
    rigged.light_up()
    rigged.bench.hangs["camera"] = True
    rigged.wait(rigged.bench.hung.is_set)
    rigged.wait(lambda: rigged.rig.waiting.startswith("waiting for the camera ("))
    assert rigged.bench.laser is not None
    rigged.rig.lasers_off()
    rigged.wait(lambda: rigged.bench.laser is None and not rigged.rig.off_problem)
    assert rigged.rig.state.wavelength_m is None
    rigged.bench.hangs["camera"] = False
    rigged.wait(lambda: not rigged.rig.is_busy)
    assert rigged.rig.is_open


def test_nothing_that_was_asked_for_before_they_went_off_switches_lasers_on_again(rigged: Rigged) -> None:
    rigged.open()
    rigged.bench.hangs["stage"] = True
    plan = rigged.path.with_name("plan.toml")
    plan.write_text(PLAN, encoding="utf-8")
    rigged.rig.run_plan(plan)
    rigged.wait(rigged.bench.hung.is_set)
    rigged.rig.lasers_off()
    calls = len(rigged.bench.calls)
    rigged.bench.hangs["stage"] = False
    rigged.wait(lambda: "take" in rigged.bench.calls[calls:])  # the live picture that follows
    assert "on" not in rigged.bench.calls[calls:]
    rigged.rig.switch_on(LASER_M, 0.5)
    rigged.wait(lambda: rigged.bench.laser == (LASER_M, 0.5))


def test_what_the_limits_forbid_is_refused_before_it_is_sent(rigged: Rigged) -> None:
    rigged.open()
    calls = {"on", "move"}
    with pytest.raises(UserError, match="power"):
        rigged.rig.switch_on(LASER_M, 1.5)
    with pytest.raises(UserError, match="stage"):
        rigged.rig.move_to(0.5e-3)
    with pytest.raises(UserError, match="exposure"):
        rigged.rig.set_exposure(2.0)
    rigged.rig.set_exposure(0.02)
    rigged.wait(lambda: rigged.rig.state.exposure_s == 0.02)
    assert not calls & set(rigged.bench.calls)


def test_an_error_of_a_device_switches_the_lasers_off_and_connecting_again_mends_it(rigged: Rigged) -> None:
    rigged.open()
    rigged.light_up()
    rigged.bench.fails["camera"] = True
    rigged.wait(lambda: rigged.rig.status == "failed")
    rigged.wait(lambda: rigged.bench.laser is None)
    assert "check its cable" in rigged.rig.problem and rigged.messages[-1] == rigged.rig.problem
    with pytest.raises(UserError, match="connect again"):
        rigged.rig.switch_on(LASER_M, 1.0)
    rigged.bench.fails["camera"] = False
    rigged.rig.reconnect()
    rigged.wait(lambda: rigged.rig.is_open and not rigged.rig.is_busy)
    assert rigged.bench.opened == 2 and rigged.rig.view.picture is not None


def test_connecting_again_leaves_a_device_that_hangs_behind(rigged: Rigged) -> None:
    rigged.open()
    rigged.light_up()
    rigged.bench.hangs["camera"] = True
    rigged.wait(rigged.bench.hung.is_set)
    rigged.rig.reconnect()
    rigged.wait(lambda: rigged.bench.opened == 2)
    assert rigged.bench.laser is None
    rigged.bench.hangs["camera"] = False
    rigged.wait(lambda: rigged.rig.is_open and not rigged.rig.is_busy)


def test_a_capture_is_on_the_disk_at_once(rigged: Rigged) -> None:
    rigged.open()
    with pytest.raises(UserError, match="send a pattern"):
        rigged.rig.take_capture(searches_exposure=False)
    rigged.light_up()
    for _ in range(2):
        rigged.rig.take_capture(searches_exposure=False)
    rigged.wait(lambda: len(rigged.rig.captures) == 2)
    folder = rigged.rig.captures.folder
    assert folder is not None and len([read_captures(file) for file in folder.glob("*.h5")]) == 2
    assert rigged.bench.laser is not None  # they stay on as they were
    rigged.rig.save_captures(rigged.path.with_name("both.h5"))
    saved = read_captures(rigged.path.with_name("both.h5"))
    assert np.array_equal(saved.images[1], rigged.rig.captures.all[1].images[0]) and not folder.exists()


def test_a_plan_runs_to_its_end_with_the_lasers_off(rigged: Rigged) -> None:
    rigged.open()
    plan, output = rigged.path.with_name("plan.toml"), rigged.path.with_name("out.h5")
    plan.write_text(PLAN, encoding="utf-8")
    rigged.rig.run_plan(plan, output)
    rigged.wait(lambda: rigged.rig.plan_job is None)
    assert len(read_captures(output)) == len(rigged.rig.captures) == 3
    assert rigged.bench.laser is None and rigged.rig.state.wavelength_m is None


@pytest.mark.long
def test_a_plan_that_is_cancelled_keeps_its_captures_and_goes_on(rigged: Rigged) -> None:
    rigged.open()
    plan, output = rigged.path.with_name("plan.toml"), rigged.path.with_name("out.h5")
    plan.write_text(PLAN.replace("each = 3", "each = 12"), encoding="utf-8")
    kept = output.with_name("out.h5.captures")
    rigged.bench.hangs_while["camera"] = lambda: len(list(kept.glob("[0-9]*.h5"))) == 2
    rigged.rig.run_plan(plan, output)
    rigged.wait(rigged.bench.hung.is_set)
    rigged.rig.cancel_plan()
    rigged.bench.hangs_while.clear()
    rigged.wait(lambda: rigged.rig.plan_job is None and rigged.bench.laser is None)
    taken = len(list(kept.glob("[0-9]*.h5")))
    assert 2 <= taken <= 3 and not output.exists(), "two, and perhaps the one in flight"
    rigged.wait(lambda: len(rigged.rig.captures) == taken)
    rigged.rig.run_plan(plan, output)
    rigged.wait(lambda: rigged.rig.plan_job is None)
    assert len(read_captures(output)) == len(rigged.rig.captures) == 12


def test_a_plan_that_the_limits_forbid_is_refused(rigged: Rigged, tmp_path: Path) -> None:
    rigged.open()
    plan = tmp_path / "plan.toml"
    plan.write_text('distances = ["9.5 mm"]\n', encoding="utf-8")
    with pytest.raises(UserError, match=r"9\.5 mm"):
        rigged.rig.run_plan(plan)
    assert rigged.rig.plan_job is None


def test_closing_switches_the_lasers_off_though_the_camera_hangs(rigged: Rigged) -> None:
    rigged.open()
    rigged.light_up()
    rigged.bench.hangs["camera"] = True
    rigged.wait(rigged.bench.hung.is_set)
    assert rigged.rig.close() == ""
    assert rigged.bench.laser is None


def test_lasers_that_do_not_answer_are_told(rigged: Rigged, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_devices, "OFF_TIMEOUT_S", 0.2)
    rigged.open()
    rigged.light_up()
    rigged.bench.hangs["lasers"] = True
    rigged.rig.lasers_off()
    rigged.wait(lambda: "switch them off by hand" in rigged.rig.off_problem)
    assert "switch them off by hand" in rigged.rig.close()


def test_lasers_that_fail_are_told(rigged: Rigged) -> None:
    rigged.open()
    rigged.light_up()
    rigged.bench.fails["lasers"] = True
    rigged.rig.lasers_off()
    rigged.wait(lambda: "didn't answer" in rigged.rig.off_problem)
    rigged.bench.fails["lasers"] = False
    rigged.rig.lasers_off()
    rigged.wait(lambda: rigged.bench.laser is None and not rigged.rig.off_problem)
