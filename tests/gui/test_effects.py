"""Effects: every one of the library is switched by name, its sliders come from its parameters, undo takes it back."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from holoview.light.model.effects.registry import effects_for, listed_effects
from holoview.light.model.system import System
from holoview.viewer.app.panels.image import ImagePanel
from holoview.viewer.app.panels.parameters import EffectsPanel
from holoview.viewer.render.view_settings import NOW
from tests.gui.conftest import Gui, small_bench

pytestmark = pytest.mark.gpu

IRISES = {"relay1.iris_na": 0.02, "relay2.iris_na": 0.02}


@pytest.fixture
def make(make_gui: Callable[..., Gui]) -> Callable[..., Gui]:
    def opened(**changes: Any) -> Gui:
        return make_gui(small_bench(**changes), (800, 480), engine=True, panels=(ImagePanel, EffectsPanel))

    return opened


def _switch(name: str) -> Callable[[Any], None]:
    return lambda ctx: ctx.item_click(f"Effects/**/{name}")


@pytest.mark.long
def test_every_effect_of_the_library_has_a_switch(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(small_bench(**IRISES), (640, 1600), panels=(EffectsPanel,))
    lines = [name for name in gui.context.item_rects if name.startswith("effect ")]
    for line in lines[::-1]:  # from below, so that sliders that open don't move what is next
        gui.click(gui.item_position(line, 0.1))
    assert set(gui.session.system.effect_values) == set(listed_effects())
    gui.context.commands.run("Switch off all effects")
    assert gui.session.system == small_bench(**IRISES)


def _chain(**changes: Any) -> System:
    """A phase modulator, a space with an iris, a coarser amplitude modulator, a mask, and a space with a stop."""
    elements: list[dict[str, Any]] = [
        {"kind": "phase", "name": "slm", "pitch": 8e-6, "shape": (24, 32), "stroke": 825e-9},
        {"kind": "space", "name": "way", "distance": 1e-3, "iris_na": 0.025},
        {"kind": "amplitude", "name": "coarse", "pitch": 32e-6, "shape": (6, 8)},
        {"kind": "mask", "name": "still", "pitch": 8e-6, "shape": (24, 32), "pattern": "random", "stroke": 3e-7},
        {"kind": "space", "name": "rest", "square": "first order of slm"},
    ]
    chain = System([532e-9, 620e-9], [[1.0, 1.0]], elements=elements, planes_m=[2e-3])
    return chain.edit(changes) if changes else chain


_BENCHES: dict[str, Callable[[], System]] = {"short": lambda: small_bench(**IRISES), "chain": _chain}


def test_effects_on_elements_are_switches_below_the_names_of_the_elements(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(_chain(**{"effects.leakage@coarse.amplitude": 0.15}), (640, 2400), panels=(EffectsPanel,))
    lines = [name for name in gui.context.item_rects if name.startswith("effect ")]
    assert {"effect leakage@coarse", "effect misplaced@still", "effect iris@way", "effect bandwidth"} <= set(lines)
    assert "effects.leakage@coarse.amplitude" in gui.context.item_rects, "its sliders are open, as it is on"
    gui.drag(
        gui.item_position("effects.leakage@coarse.amplitude", 0.3),
        gui.item_position("effects.leakage@coarse.amplitude", 0.5),
        steps=4,
    )
    changed = gui.session.system.effect_values["leakage@coarse"]["amplitude"]
    assert changed > 0.2
    gui.click(gui.item_position("effect leakage@coarse", 0.1))
    assert gui.session.system == _chain()
    gui.draw_frames(2)
    gui.click(gui.item_position("effect leakage@coarse", 0.1))
    assert gui.session.system.effect_values == {"leakage@coarse": {"amplitude": changed}}
    for _ in range(3):
        gui.press_chord("Ctrl+Z")
    assert gui.session.system.effect_values == {"leakage@coarse": {"amplitude": 0.15}}


@pytest.mark.explores
@pytest.mark.parametrize(
    ("bench", "name"), [(bench, effect.id) for bench in _BENCHES for effect in effects_for(_BENCHES[bench]())]
)
def test_every_effect_is_shown_and_undone(make_gui: Callable[..., Gui], bench: str, name: str) -> None:
    plain = _BENCHES[bench]()
    gui = make_gui(plain, (640, 2400), panels=(ImagePanel, EffectsPanel))
    gui.click(gui.item_position(f"effect {name}", 0.1))
    if name == "gap@rest":  # the way to the planes has no distance of its own
        assert gui.session.system == plain
        assert "use the effect distance" in gui.last_message()
        return
    assert set(gui.session.system.effect_values) == {name}, gui.last_message()
    gui.draw_until_idle()
    assert np.isfinite(gui.context.side_renderers.xyz(NOW)).all()
    assert not [message.text for message in gui.session.messages.all if message.kind == "error"]
    gui.press_chord("Ctrl+Z")
    assert gui.session.system == plain


def test_an_effect_changes_the_image_and_undo_brings_it_back(make: Callable[..., Gui]) -> None:
    gui = make()
    gui.draw_until_idle()
    plain = gui.context.side_renderers.xyz(NOW).copy()
    gui.engine(_switch("gap"))
    gui.draw_until_idle()
    common = listed_effects()["gap"].parameters[0].prior
    assert gui.session.system.effect_values == {"gap": {"gap_error": common}}
    assert np.abs(gui.context.side_renderers.xyz(NOW) - plain).mean() > 0.01
    steps = len(gui.session.history)
    gui.drag(gui.item_position("effects.gap.gap_error", 0.55), gui.item_position("effects.gap.gap_error", 0.8), steps=6)
    assert gui.session.system.effect_values["gap"]["gap_error"] > 2 * common
    assert len(gui.session.history) == steps + 1, "a drag is one step"
    gui.click(gui.item_position("effects.gap.gap_error"), button=2)
    assert gui.session.system.effect_values["gap"]["gap_error"] == 0.0
    for _ in range(3):
        gui.press_chord("Ctrl+Z")
    assert gui.session.system == small_bench()
    gui.draw_until_idle()
    assert np.array_equal(gui.context.side_renderers.xyz(NOW), plain)


def test_an_effect_that_is_switched_off_and_on_has_its_values_again(make: Callable[..., Gui]) -> None:
    gui = make()
    gui.engine(_switch("tilt"))
    gui.engine(lambda ctx: ctx.item_input_value("Effects/**/tilt x", 3.0))
    values = gui.session.system.effect_values
    assert values["tilt"]["tilt_x"] == pytest.approx(3e-3)
    gui.engine(_switch("tilt"))
    assert not gui.session.system.effects
    gui.engine(_switch("tilt"))
    assert gui.session.system.effect_values == values


def test_what_the_bench_lacks_cannot_be_switched_on(make: Callable[..., Gui]) -> None:
    gui = make(relay1={}, relay2={})
    gui.engine(lambda ctx: ctx.item_input_value("Effects/##words", "aberration1"))
    gui.click(gui.item_position("effect aberration1", 0.1))
    assert not gui.session.system.effects
    gui.session.change("Iris", {"relay1.iris_na": 0.02})
    gui.draw_frames(2)
    gui.click(gui.item_position("effect aberration1", 0.1))
    assert set(gui.session.system.effect_values) == {"aberration1"}


def test_effects_are_found_by_words_of_their_cause(make: Callable[..., Gui]) -> None:
    gui = make()
    gui.engine(lambda ctx: ctx.item_input_value("Effects/##words", "falls in at an angle"))
    gui.context.item_rects.clear()
    gui.draw_frames(2)
    assert [name for name in gui.context.item_rects if name.startswith("effect ")] == ["effect tilt"]
