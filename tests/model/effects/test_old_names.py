"""Effect files that were written for the first version work, and say which name is new."""

from __future__ import annotations

import importlib
import warnings
from pathlib import Path

import pytest
import torch

from holoview.model.effects.active_effects import ActiveEffects
from holoview.model.effects.effect import Effect
from holoview.model.effects.hook_contexts import CameraContext, Pose
from holoview.model.effects.old_names import MEMBERS
from holoview.model.effects.registry import load_user_effects
from holoview.optics.torch_effects import TorchEffects

FILE = """
from holoview.effects.effect import Effect
from holoview.effects.parameter import Parameter


class Old(Effect):
    id = "old"
    cause = "Everything has its old name."
    finding = "A share {share}{more}."
    parameters = (Parameter("share", "Of it.", low=0.0, high=0.9, prior=0.05, scan=(0.1, 0.2, 0.1)),)
    where = ("modulator 2", "camera")

    def power(self, power, v):
        return power * (1 - v["share"])

    def moments(self, v):
        return ((0.5, 1.0), (0.5, 2.0))

    def aim(self, pose, v):
        return type(pose)(shift_m=(1e-6, 2e-6))

    def image(self, image, at, v):
        return image + at.places(image)[0]

    def starts(self, system):
        return [*super().starts(system), {"share": 0.5}]

    def words(self, system, v):
        return {"more": " and more"}
"""


@pytest.fixture
def old(tmp_path: Path, no_user_effects: None) -> Effect:
    (tmp_path / "old.py").write_text(FILE, encoding="utf-8")
    with pytest.warns(FutureWarning) as told:
        (effect,) = load_user_effects(tmp_path / "old.py")
    texts = [str(one.message) for one in told]
    for name in ("power", "moments", "aim", "where", "starts", "words"):
        assert f"`Old.{name}` is called `{MEMBERS[name]}` now; the old name works until version 0.3" in texts
    assert any("`holoview.effects.effect.Effect` is called `holoview.model.effects.effect.Effect`" in t for t in texts)
    return effect


def test_hooks_are_called_under_their_new_names(old: Effect) -> None:
    active = ActiveEffects({"old": {"share": 0.2}}, [old])
    assert active.laser_power(1.0) == pytest.approx(0.8)
    assert active.exposure_samples() == [(0.5, 1.0), (0.5, 2.0)]
    assert old.acts_on == ("modulator 2", "camera")
    effects = TorchEffects({"old": {"share": 0.2}}, [old])
    assert effects.camera_pose(3e-3) == Pose(shift_m=(1e-6, 2e-6))
    with pytest.warns(FutureWarning, match="`places` is called `positions` now"):
        found = effects.image(torch.zeros(3, 2), CameraContext(4e-6, (3, 2)))
    assert torch.equal(found[:, 0], CameraContext(4e-6, (3, 2)).positions(torch.zeros(3, 2))[0][:, 0])


def test_what_an_old_file_inherits_is_there_under_its_old_name(old: Effect) -> None:
    with pytest.warns(FutureWarning, match="`starts` is called `starting_points` now"):
        points = list(old.starting_points(None))  # type: ignore[arg-type]
    assert points == [{"share": 0.1}, {"share": 0.2}, {"share": 0.5}]
    assert old.format_finding(None, {"share": 0.1}) == "A share 0.1 and more."  # type: ignore[arg-type]


def test_new_names_warn_of_nothing_and_unknown_ones_are_unknown() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")

        class New(Effect):
            acts_on = ("camera",)

            def laser_power(self, power, v):  # type: ignore[no-untyped-def]
                return power

        assert New().overrides("laser_power") and not New().overrides("camera_pose")
    for module in ("effects", "effects.effect", "effects.parameter", "effects.places"):
        with pytest.raises(AttributeError, match="has no attribute 'Nothing'"):
            importlib.import_module(f"holoview.{module}").Nothing  # noqa: B018


@pytest.mark.parametrize(
    ("old", "new"), [("Surface", "ModulatorContext"), ("Aperture", "RelayContext"), ("Sensor", "CameraContext")]
)
def test_contexts_are_found_where_they_stood(old: str, new: str) -> None:
    with pytest.warns(FutureWarning, match=f"hook_contexts.{new}` now"):
        assert getattr(importlib.import_module("holoview.effects.places"), old).__name__ == new
    with pytest.warns(FutureWarning, match="DataProperties"):
        assert importlib.import_module("holoview.effects").Facts.__name__ == "DataProperties"
