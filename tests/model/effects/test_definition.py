"""A mistake in the class of a user's effect is refused where its file is read, by name, with what was meant."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from holoview.light.model.effects.definition import mistakes_in_definition
from holoview.light.model.effects.effect import HOOKS, PLACES
from holoview.light.model.effects.registry import ids_beside, listed_effects, load_user_effects
from holoview.util.errors import UserError

pytestmark = pytest.mark.usefixtures("no_user_effects")

OWN = """
from holoview.light.effects import Effect, Parameter
from holoview.light.model.effects.effect import ListParameter, StartKind


class Haze(Effect):
    id = "haze"
    cause = "Haze adds light everywhere."
    finding = "Haze adds {share} of the mean."
    parameters = (Parameter("share", "Share.", low=0.0, high=1.0, prior=0.1, scan=(0.1, 0.9, 0.1)),)
    acts_on = ("modulator 1", "camera")

    def image(self, image, context, v):
        return image + v["share"] * image.mean()

    def stroke_response(self, share, context, v):
        return self.helper(share, v)

    def helper(self, share, v):
        return share * (1 - v["share"])
"""
SCAN, PARAMETERS = "scan=(0.1, 0.9, 0.1)", re.search(r"parameters = \(.*\),\)", OWN)
assert PARAMETERS

MISTAKES = {
    "a place of another name": ('"modulator 1"', '"slm1"', '"slm1" is no place; did you mean modulator 1'),
    "a place with a blank too few": ('"camera"', '"relay1"', '"relay1" is no place; did you mean relay 1'),
    "a place that is none": ('"camera"', '"detector"', '"detector" is no place; known: camera'),
    "a place without its comma": ('("modulator 1", "camera")', '("camera")', 'with a comma: ("camera",)'),
    "a parameter without its comma": ("0.1)),)", "0.1)))", "a single Parameter; expected a tuple, with a comma"),
    "a misspelt hook": ("def image(", "def images(", "has `images`, which nothing calls or reads; did you mean image"),
    "a hook of another kind": ("def image(", "def picture(", "has the method `picture`, which nothing calls"),
    "a misspelt hook with its helper": ("def stroke_response(", "def stroke_respons(", "did you mean stroke_response?"),
    "a misspelt variable": ("    acts_on", "    order_ = 1\n    acts_on", "has `order_`, which nothing calls or reads"),
    "a misspelt field": ("    cause =", "    causes =", "has no `cause`, but `causes`"),
    "an argument too few": (
        "image, context, v)",
        "image, v)",
        "takes (self, image, v); expected image(self, image, con",
    ),
    "arguments in another order": ("image, context, v)", "context, image, v)", "takes (self, context, image, v); expe"),
    "a hook that is no method": ("    acts_on", "    pupil = 3\n    acts_on", "Haze.pupil: isn't a method"),
    "a hook that its places never call": (
        "def helper(",
        "def pupil(self, pupil, context, v):\n        return pupil\n\n    def helper(",
        "names modulator 1, camera, so that its pupil is never called; expected relay 1 or relay 2",
    ),
    "a scan outside its bounds": (SCAN, "scan=(0.1, 1.1, 0.1)", "0.1 to 1.1; expected values from low to high, 0 to 1"),
    "a scan whose step doesn't divide it": (SCAN, "scan=(0.1, 0.9, 0.3)", "steps of 0.3 from 0.1 don't end at 0.9"),
    "a scan of two numbers": (SCAN, "scan=(0.1, 0.9)", "scan: (0.1, 0.9); expected (first, last, step)"),
    "a scan that goes down": (SCAN, "scan=(0.9, 0.1, 0.1)", "first ≤ last"),
    "a scan that stands still": (SCAN, "scan=(0.1, 0.9, 0.0)", "step > 0"),
    "a scan that isn't finite": (SCAN, 'scan=(0.1, float("nan"), 0.1)', "step > 0"),
    "a scan without end": (SCAN, "scan=(0.1, 0.9, 1e-9)", "8e+08 steps; expected at most 10000"),
    "a scan of the identity": (SCAN, "scan=(0.0, 0.0, 0.1)", "has no value but the identity"),
    "bounds without the identity": ("low=0.0", "low=0.5", "expected numbers with low ≤ identity ≤ high and prior > 0"),
    "a prior that isn't finite": ("prior=0.1", 'prior=float("inf")', "prior inf"),
    "bounds that are text": ("high=1.0", 'high="1"', "high '1'"),
    "a unit that isn't converted": ('"Share."', '"Share.", "µm"', '"µm"; expected pm, nm, um, mm or cm'),
    "an angle that isn't converted": ('"Share."', '"Share.", "rad"', '"rad"; expected urad or mrad'),
    "an unknown placeholder": ("{share} of", "{shares} of", "{shares} isn't a parameter; did you mean share?"),
    "a placeholder that never ends": ("{share} of", "{share of", "expected '}'"),
    "a number's format": ("{share} of", "{share:.2f} of", "which is text already"),
    "an id with a point": ('id = "haze"', 'id = "haze.1"', '"haze.1"; expected letters, digits and _'),
    "an id that is a number": ('id = "haze"', "id = 3", "Haze.id: 3; expected text"),
    "no id": ('    id = "haze"\n', "", "Haze: has no `id`"),
    "a misspelt look-alike": (
        "    acts_on",
        '    degenerate_with = ("distanc",)\n    acts_on',
        '"distanc" is no effect; did you mean distance',
    ),
    "a look-alike without its comma": (
        "    acts_on",
        '    degenerate_with = ("distance")\n    acts_on',
        'degenerate_with: a single str; expected a tuple, with a comma: ("distance",)',
    ),
    "an unknown start": ("    acts_on", '    start_kinds = ("ghosts",)\n    acts_on', "start_kinds: 'ghosts'"),
    "a start without its parameters": (
        "    acts_on",
        "    start_kinds = (StartKind.GHOST,)\n    acts_on",
        "GHOST without the parameter strength",
    ),
    "needs of another type": ("    acts_on", '    needs = {"planes": 2}\n    acts_on', "expected Needs(…)"),
    "two parameters of a name": (PARAMETERS[0], PARAMETERS[0].replace("),)", "),) * 2"), 'two are called "share"'),
}


def _write(folder: Path, text: str) -> Path:
    file = folder / "haze.py"
    file.write_text(text, encoding="utf-8")
    return file


def test_the_class_without_mistakes_is_accepted(tmp_path: Path) -> None:
    assert [effect.id for effect in load_user_effects(_write(tmp_path, OWN))] == ["haze"]


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_refused_by_name(tmp_path: Path, mistake: str) -> None:
    before, after, words = MISTAKES[mistake]
    assert before in OWN
    with pytest.raises(UserError, match=re.escape(words)) as caught:
        load_user_effects(_write(tmp_path, OWN.replace(before, after)))
    assert str(tmp_path / "haze.py") in str(caught.value)
    assert "haze" not in listed_effects()


def test_an_effect_that_overrides_nothing_is_refused(tmp_path: Path) -> None:
    text = OWN[: OWN.index("    def image")]
    with pytest.raises(UserError, match="overrides no hook, so that it changes nothing"):
        load_user_effects(_write(tmp_path, text))


def test_an_id_is_used_once(tmp_path: Path) -> None:
    twice = OWN + OWN[OWN.index("class") :].replace("class Haze", "class Fog")
    with pytest.raises(UserError, match='the id "haze" is in use'):
        load_user_effects(_write(tmp_path, twice))
    first = _write(tmp_path, OWN)
    load_user_effects(first)
    load_user_effects(first)  # read again, after an edit
    (tmp_path / "other").mkdir()
    fog = tmp_path / "other" / "fog.py"
    fog.write_text(OWN, encoding="utf-8")
    with pytest.raises(UserError, match=r'the id "haze" is in use by .*haze\.py'):
        load_user_effects(fog)
    with pytest.raises(UserError, match=r"haze\.py has the same name"):
        load_user_effects(_write(tmp_path / "other", OWN.replace('"haze"', '"fog"')))
    first.rename(tmp_path / "moved.py")
    load_user_effects(fog)


@pytest.mark.parametrize("name", listed_effects())
def test_the_library_is_held_to_the_same(name: str) -> None:
    assert [str(one) for one in mistakes_in_definition(listed_effects()[name], "library", ids_beside([]))] == []


def test_the_manual_and_the_template_name_every_place_and_hook() -> None:
    root = Path(__file__).resolve().parents[3]
    manual, template = ((root / path).read_text("utf-8") for path in ("docs/effects.md", "assets/effect.py.txt"))
    for word in (*PLACES, *HOOKS):
        assert word in template and f"`{word}" in manual, word
