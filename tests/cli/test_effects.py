"""`holoview effects`: lists them, tries those of a file, and writes one to start from."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from holoview.bench.captures.effect_trial import try_effect
from holoview.commands.cli import main
from holoview.light.model.effects.registry import ids_beside, listed_effects
from tests.explored import explored

pytestmark = pytest.mark.usefixtures("no_user_effects")
TRIED = {"crosstalk", "aberration1", "camera_black", "plane_errors", "laser_power"}


@pytest.fixture
def template(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    assert main(["effects", "new", "dusty_lens"]) == 0
    return tmp_path / "dusty_lens.py"


def _found(file: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, dict[str, dict[str, object]]]:
    capsys.readouterr()
    code = main(["effects", "check", str(file), "--json"])
    (checks,) = json.loads(capsys.readouterr().out)["effects"].values()
    return code, {one["check"]: one for one in checks}


def test_the_template_works_as_it_is(template: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "class DustyLens(Effect)" in template.read_text("utf-8")
    code, checks = _found(template, capsys)
    assert code == 0 and all(one["passed"] for one in checks.values()) and len(checks) == 7
    assert main(["effects", "check", str(template)]) == 0
    assert "dusty_lens: all is well" in capsys.readouterr().out
    small = ["captures", "make", "holochrome-8", "--set", "shape=[8,8]", "--each", "1", "-o", "a.h5"]
    assert main([*small, "--effects", str(template), "dusty_lens.share=0.2"]) == 0


def test_a_file_is_never_overwritten(template: Path, capsys: pytest.CaptureFixture[str]) -> None:
    template.write_text("mine", encoding="utf-8")
    assert main(["effects", "new", "dusty_lens"]) == 2
    assert "dusty_lens.py: is there already" in capsys.readouterr().err and template.read_text("utf-8") == "mine"
    for wrong in ("gap", "Two words", "../up", "a.b"):
        assert main(["effects", "new", wrong]) == 2


@pytest.mark.parametrize(
    ("before", "after", "check", "words"),
    [
        ('transmission + v["share"]', "transmission + 0.1", "vanishes at its identity", "a jump"),
        ('(1 - v["share"]) * transmission + v["share"]', "transmission", "hooks are called", "don't change"),
        ('return (1 - v["share"])', 'return float("nan") * (1 - v["share"])', "hooks are called", "isn't finite"),
        ('+ v["share"]', '+ (v["share"] > 0.025)', "derivative by each parameter", "not smooth"),
        (
            'return (1 - v["share"]) * transmission',
            'return (1 - v["share"]) * transmission.detach()',
            "gradient by the patterns",
            "doesn't depend on its pattern by torch",
        ),
        ("transmission, context, v):\n", "transmission, context, v):\n        lost\n", "hooks are called", "NameError"),
        ('("modulator 1",)', '("slm1",)', "definition", "did you mean modulator 1"),
    ],
)
def test_what_is_wrong_is_found(
    template: Path, capsys: pytest.CaptureFixture[str], before: str, after: str, check: str, words: str
) -> None:
    text = template.read_text("utf-8")
    assert before in text
    template.write_text(text.replace(before, after), encoding="utf-8")
    code, checks = _found(template, capsys)
    assert code == 1 and checks[check]["passed"] is False and words in str(checks[check]["found"])
    assert main(["effects", "check", str(template)]) == 1
    assert "something is wrong" in capsys.readouterr().out


def test_the_list_has_every_effect_with_its_places(template: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main(["effects"]) == 0
    lines = capsys.readouterr().out.splitlines()
    on_elements = ["amplitude_gamma", "leakage", "mask_depth", "misplaced"]
    assert [line.split()[0] for line in lines] == [*listed_effects(), *on_elements]
    assert main(["effects", "list", str(template), "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert listed["dusty_lens"]["acts_on"] == ["modulator 1"] and listed["gap"]["parameters"] == {"gap_error": "m"}


@pytest.mark.parametrize("name", explored(listed_effects(), TRIED))
def test_no_effect_of_the_library_fails_a_check(name: str) -> None:
    wrong = [one for one in try_effect(listed_effects()[name], "library", ids_beside([])) if one.is_passed is False]
    assert not wrong
