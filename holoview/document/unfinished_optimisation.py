"""A running optimisation as a session saves it, and how it goes on after a crash of the viewer."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from holoview.document.document import Document
from holoview.document.editing_session import EditingSession
from holoview.document.optimisation_job import (
    OptimisationJob,
    OptimisationRequest,
    run_optimisation,
    running_optimisation,
)
from holoview.optimise.eyes import CHROMATIC, OptimisedEyes
from holoview.optimise.settings import Settings
from holoview.util.tables import read_record

_WHAT = "the rest of an optimisation"


@dataclass(frozen=True)
class RestOfOptimisation:
    """What was still to be done.

    settings: with the iterations that are left, as JSON. pupils, chromatic: of its eyes, as text; no pupils for the
    own place alone. Other fields as of its request.

    Raises UserError for settings that can't be.
    """

    settings: str
    only_plane_m: float | None = None
    device: str = "auto"
    pupils: str = ""
    chromatic: str = CHROMATIC[0]

    def __post_init__(self) -> None:
        self.request()

    def request(self) -> OptimisationRequest:
        """The request that goes on from the present patterns."""
        settings = read_record(Settings, self.settings, "settings", _WHAT)
        eyes = OptimisedEyes.from_text(self.pupils or None, self.chromatic)
        return OptimisationRequest(
            settings, start_patterns="now", eyes=eyes, only_plane_m=self.only_plane_m, device=self.device
        )


@dataclass(frozen=True, eq=False)
class UnfinishedOptimisation:
    """The best result so far, and what is left to do; None where it can't go on from that result."""

    best: Document
    rest: RestOfOptimisation | None = None

    def rest_table(self) -> dict[str, Any] | None:
        """What is left, as a table."""
        return None if self.rest is None else dataclasses.asdict(self.rest)


def read_rest(table: Mapping[str, Any] | None) -> RestOfOptimisation | None:
    """What was left, from its table. Raises UserError for another table."""
    return None if table is None else read_record(RestOfOptimisation, json.dumps(table), "unfinished", _WHAT)


def unfinished_optimisation(session: EditingSession) -> UnfinishedOptimisation | None:
    """The optimisation that runs now, once there is a result of it.

    One with larger pixels takes seconds, and its result isn't what it could go on from.
    """
    best, job = session.preview_document, running_optimisation(session)
    if best is None:
        return None
    if job is None or job.latest is None or job.request.superpixel > 1:
        return UnfinishedOptimisation(best)
    settings, done = job.request.settings, job.latest.iteration
    left = settings.iterations - done
    if left < 1:
        return UnfinishedOptimisation(best)
    step_rad = settings.step_rad * math.sqrt(left / settings.iterations)
    rest = json.dumps(dataclasses.asdict(dataclasses.replace(settings, iterations=left, step_rad=step_rad)))
    eyes, request = job.request.eyes, job.request
    pupils = "" if eyes.pupils is None else str(eyes.pupils)
    return UnfinishedOptimisation(
        best, RestOfOptimisation(rest, request.only_plane_m, request.device, pupils, eyes.chromatic)
    )


def continue_optimisation(session: EditingSession, unfinished: UnfinishedOptimisation) -> None:
    """Goes on from the best result with the iterations that were left, where that is possible."""
    if unfinished.rest is None or session.target_spec is None or running_optimisation(session) is not None:
        return
    best = unfinished.best
    job = OptimisationJob(session, unfinished.rest.request(), session.document, best.system, start_drive=best.drive)
    session.messages.post("The optimisation goes on from the best patterns so far.")
    run_optimisation(session, job)
