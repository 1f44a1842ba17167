"""Which score stands beside the PSNR below the image: a command for each, and the next one by a click."""

from __future__ import annotations

from functools import partial

from holoview.app.context import AppContext
from holoview.metrics.perceptual_scores import PERCEPTUAL_SCORES, installed_scores


def add_score_commands(context: AppContext) -> None:
    """Adds a command for each score, and one for none, to the menu of the image."""
    add, choose = context.commands.add, partial(_choose, context)
    add("Score: PSNR alone", partial(choose, ""), "Image", help="No other score beside it.")
    for name, score in PERCEPTUAL_SCORES.items():
        add(f"Score: {score.title}", partial(choose, name), "Image", help=f"Beside the PSNR: {score.summary}.")


def choose_next_score(context: AppContext) -> None:
    """The next of the scores that are installed, and after the last one none."""
    options = ("", *installed_scores())
    present = context.session.view_settings.score
    _choose(context, options[(options.index(present) + 1) % len(options)] if present in options else "")


def _choose(context: AppContext, name: str) -> None:
    context.edit_view("Score", score=name)
