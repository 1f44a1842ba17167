"""The viewer's observer: an age slider, and colour-matching functions; each is a step of undo."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.viewer.render.view_settings import NOW
from tests.gui.conftest import Gui

pytestmark = pytest.mark.gpu


def test_an_age_slider_changes_what_is_seen_and_undo_brings_it_back(gui: Gui) -> None:
    gui.context.show_panel("Gamut")
    gui.draw_until_idle()
    before = np.array(gui.context.side_renderers.xyz(NOW))
    assert gui.session.system.observer == "eye"
    gui.click(gui.item_position("age", 0.35, 0.5))
    gui.draw_until_idle()
    who = gui.session.system.observer
    assert who.startswith("age ") and who.endswith(", field 2")
    assert 40 < float(who.split()[1].rstrip(",")) <= 80
    after = np.array(gui.context.side_renderers.xyz(NOW))
    assert np.abs(after - before).max() > 0.01 * np.abs(before).max()
    gui.session.undo()
    gui.draw_until_idle()
    assert gui.session.system.observer == "eye"
    np.testing.assert_array_equal(gui.context.side_renderers.xyz(NOW), before)


def test_an_observer_of_the_command_line_is_shown_and_kept(gui: Gui) -> None:
    gui.session.change("Observer", {"observer": "person 9"})
    gui.context.show_panel("Gamut")
    gui.draw_until_idle()
    assert gui.session.system.observer == "person 9"
