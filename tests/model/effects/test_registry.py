"""A user's own effects: loaded, applied, and refused in clear words."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from holoview.light.model.effects.hook_contexts import CameraContext
from holoview.light.model.effects.registry import get_effect, listed_effects, load_user_effects
from holoview.util.errors import UserError

OWN = """
from holoview.light.effects import Effect, Parameter

class Haze(Effect):
    id = "haze"
    cause = "Haze adds light everywhere."
    finding = "Haze adds {share} of the mean."
    parameters = (Parameter("share", "Share of the mean that is added.", low=0.0, high=1.0, prior=0.1),)
    acts_on = ("camera",)

    def image(self, image, at, v):
        return image + v["share"] * image.mean()
"""


pytestmark = pytest.mark.usefixtures("no_user_effects")


def test_a_users_own_effect_is_one_like_any_other(tmp_path: Path) -> None:
    file = tmp_path / "haze.py"
    file.write_text(OWN, encoding="utf-8")
    assert [effect.id for effect in load_user_effects(file)] == ["haze"]
    assert "haze" in listed_effects()
    assert get_effect("haze").parameters[0].name == "share"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1 / 0", "ZeroDivisionError"),
        ("def f(:", "SyntaxError"),
        ("x = 1", "defines no effect"),
        (OWN.replace('"haze"', '"gap"'), 'the id "gap" is in use'),
        (OWN.replace("cause =", "because ="), "has no `cause`"),
        (OWN.replace("prior=0.1", "prior=0.0"), "prior > 0"),
    ],
)
def test_a_file_that_cant_serve_is_refused_and_adds_nothing(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "own.py"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(UserError, match=words):
        load_user_effects(file)
    assert "haze" not in listed_effects()


def test_a_missing_file_and_an_unknown_effect_are_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no such file"):
        load_user_effects(tmp_path / "none.py")
    with pytest.raises(UserError, match="did you mean gap"):
        get_effect("gapp")


@pytest.mark.parametrize(
    ("wrong", "words"),
    [("image + nothing", "its image failed: NameError"), ("None", "its image returned nothing")],
)
def test_a_hook_that_fails_is_told_by_the_effects_name(tmp_path: Path, wrong: str, words: str) -> None:
    from holoview.light.optics.torch_effects import TorchEffects

    file = tmp_path / "haze.py"
    file.write_text(OWN.replace('image + v["share"] * image.mean()', wrong), encoding="utf-8")
    load_user_effects(file)
    with pytest.raises(UserError, match=f"effects.haze: {words}"):
        TorchEffects({"haze": {"share": 0.1}}).image(torch.ones(2, 2), CameraContext(4e-6, (2, 2)))
