"""Perceptual scores in the tables of a study: MS-SSIM always, FLIP and ColorVideoVDP where they are installed.

Which of them a job computes is among its settings, so that a result with fewer isn't taken for one with all.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.metrics.perceptual import measure_perceptual_scores
from holoview.metrics.perceptual_scores import OPTIONAL_SCORES, PERCEPTUAL_SCORES, require_scores, usable_scores
from holoview.study.scale import StudyScale
from holoview.study.study import Results
from holoview.view import View


def score_settings(scale: StudyScale) -> dict[str, list[str]]:
    """The setting of a job that names the scores: those that the scale asks for, else all that can be computed here.

    Raises UserError for a score whose library isn't installed or doesn't load.
    """
    if scale.scores is None:
        return {"scores": list(usable_scores(lambda problem: None))}
    require_scores(scale.scores)
    return {"scores": list(scale.scores)}


def score_numbers(view: View, target: NDArray[np.floating], settings: Mapping[str, Any]) -> dict[str, float]:
    """The scores that a job's settings name, means over the planes of a view with its target (plane, y, x, 3)."""
    scores = measure_perceptual_scores(view, target, settings["scores"])
    return {name: score.mean for name, score in scores.items()}


def score_names(results: Results) -> tuple[str, ...]:
    """The names of the scores that all jobs have computed."""
    return tuple(name for name in PERCEPTUAL_SCORES if all(name in job.settings["scores"] for job, _ in results))


def score_axis(name: str) -> str:
    """A score as the label of an axis."""
    score = PERCEPTUAL_SCORES[name]
    return f"{score.title} ({score.unit})" if score.unit else score.title


def notes_on_scores(results: Results) -> list[str]:
    """A note on the scores that are missing; none where all are there."""
    titles = [PERCEPTUAL_SCORES[name].title for name in OPTIONAL_SCORES if name not in score_names(results)]
    if not titles:
        return []
    verb = "isn't" if len(titles) == 1 else "aren't"
    return [
        f"{' and '.join(titles)} {verb} in the table: left out by --scores, or the extra perceptual is missing or "
        'doesn\'t load (pip install "holoview[perceptual]").'
    ]
