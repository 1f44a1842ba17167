"""What users' files import of holoview 1.0 can still be imported, and is the same."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from holoview.light.model.effects.registry import get_effect, load_user_effects, without_user_effects
from holoview.util.former_names import FORMER, present_name

EFFECT = '''"""An effect as files of 1.0 defined it."""

from holoview.effects import Effect, Parameter
from holoview.model.effects.effect import Values


class Dimmer(Effect):
    """The lasers are dimmer."""

    id = "dimmer"
    cause = "The lasers are dimmer than they were set."
    finding = "The lasers are dimmer by {share}."
    parameters = (Parameter("share", "Of the power that is missing.", low=0.0, high=0.5, prior=0.1),)
    acts_on = ("source",)

    def laser_power(self, power, v: Values):
        return power * (1 - v["share"])
'''


@pytest.mark.parametrize("former", FORMER)
def test_a_module_is_the_same_under_its_former_name(former: str) -> None:
    new = f"holoview.{FORMER[former]}"
    assert present_name(f"holoview.{former}") == new
    here, there = import_module(new), import_module(f"holoview.{former}")
    assert there is here
    assert here.__spec__ is not None
    assert here.__spec__.name == here.__name__ == new


def test_modules_of_packages_that_moved_are_found() -> None:
    program = (
        "from holoview.wavefield.readers.contents import Reader; from holoview.model.effects.effect import Effect\n"
        "import holoview.light.model.effects.effect as now, holoview.holograms.files.pictures\n"
        "import holoview.effects, holoview.io.pictures\n"
        "assert Effect is now.Effect is holoview.effects.Effect\n"
        "assert holoview.io.pictures is holoview.holograms.files.pictures\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.mark.parametrize("name", ["holoview.modell", "holoview.model.systems", "holoview.light.models"])
def test_a_name_that_never_was_is_none(name: str) -> None:
    with pytest.raises(ModuleNotFoundError):
        import_module(name)


def test_names_of_others_are_theirs() -> None:
    assert present_name("colour") is None
    assert present_name("json.model") is None
    assert present_name("holoview") is None
    assert present_name("holoview.light.model") is None


def test_an_effect_of_a_file_for_1_0_is_read(tmp_path: Path) -> None:
    file = tmp_path / "dimmer.py"
    file.write_text(EFFECT, encoding="utf-8")
    with without_user_effects():
        load_user_effects(file)
        assert get_effect("dimmer").cause.startswith("The lasers are dimmer")
