"""The steps of the tour: what each says, the panel that it is about, and what its button does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from holoview.app.context import AppContext

_EFFECT = {"crosstalk": {"sigma": 0.4}}


@dataclass(frozen=True)
class TourStep:
    """A step: its title and text, the title of the panel that it shows, and a button with what it does."""

    title: str
    text: str
    panel: str
    button: str
    action: Callable[[], None]


def make_tour_steps(context: AppContext) -> tuple[TourStep, ...]:
    """The steps, whose buttons act on the viewer of `context`."""
    run = context.commands.run
    steps = (
        TourStep(
            "Focus",
            "The image is what an eye sees of a hologram. It has depth: drag the slider, or turn the wheel over the "
            "image with Ctrl held. At 9 mm the back of the still life is sharp, at 11 mm its front.",
            "Focal plane",
            "Play through all planes / stop",
            partial(run, "Play"),
        ),
        TourStep(
            "Lasers",
            "Eight lasers shine at once, and their speckle averages out. The keys 1 to 8 show one of them alone, 0 all "
            "again. Drag a peak to change its wavelength and power.",
            "Lasers",
            "One laser alone / all",
            lambda: context.edit_view("Solo", solo=0 if context.session.view_settings.solo is None else None),
        ),
        TourStep(
            "Effects",
            "A real bench differs from the plain model. Switch on an effect to see what it does to the image. Ctrl+Z "
            "undoes this, as every edit.",
            "Effects",
            "Crosstalk of the pixels on / off",
            lambda: context.change("Effects", "effects", {} if context.session.system.effects else _EFFECT),
        ),
        TourStep(
            "Optimise",
            "Ctrl+Enter finds patterns for the target. It begins with random ones: the picture comes out of the "
            "speckle. Keep ends it early, Cancel brings these patterns back. T compares the image with the target.",
            "Optimise",
            "Optimise",
            partial(run, "Optimise"),
        ),
        TourStep(
            "Your pictures",
            "Drop a picture on the window, or open one by Ctrl+O: it becomes the target. Ctrl+S saves the hologram, "
            "Ctrl+E the image as it is seen. ? shows all keys, and Ctrl+P finds any command.",
            "Files",
            "Open a picture…",
            partial(run, "Open…"),
        ),
    )
    return steps[:-1] if context.is_read_only else steps
