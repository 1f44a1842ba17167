"""The newest picture of a rig's camera beside its prediction: residuals in units of the noise, χ²/n, histogram.

LiveView           the newest picture, and its prediction, which a worker thread computes
PicturePredictor   predicts one picture after the other

A diagnosis that follows the captures as they come: begun after a few, and again with more, in the background.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Captures, join_captures
from holoview.bench.captures.predictor import Prediction, Predictor
from holoview.bench.captures.prepared_captures import prepare_captures
from holoview.bench.diagnose.extended_model import with_preset_geometry
from holoview.bench.diagnose.intervals import format_value
from holoview.bench.diagnose.likelihood import Comparison, Values
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.diagnose.report.diagnosis import Cause, Diagnosis
from holoview.bench.diagnose.search_context import NeighbourVariances
from holoview.bench.experiment.rig_bench import diagnosis_options
from holoview.bench.rig.description import RigDescription
from holoview.bench.rig.devices import Counts
from holoview.bench.rig.registration import Registration
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.mailbox import LatestTask
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.jobs import BackgroundJob, JobControl

Image = NDArray[np.float32]
_BINS = 64


@dataclass(frozen=True, eq=False)
class PictureModel:
    """The model that predicts a picture. system: a bench in place of the rig's nominal one. values: effects on it.

    name: in words.
    """

    name: str
    system: System | None = None
    values: Values | None = None


NOMINAL = PictureModel("rig.toml")


@dataclass(frozen=True, eq=False)
class LivePicture:
    """A picture (y, x) of the camera in counts.

    white: counts above black of a saturated pixel. histogram: pixels in equal bins from 0 to saturation.
    saturated: share of the pixels that are.
    """

    counts: Counts
    black: float
    white: float
    histogram: NDArray[np.int64]
    saturated: float


@dataclass(frozen=True, eq=False)
class PredictedPicture:
    """A prediction of a picture. of: the measured picture. model: the name of the predicting model.

    expected (y, x): counts above black, with the scale that fits best. residual (y, x): measured − expected, in σ of
    the noise, 0 where a pixel can't be compared. chi2: mean squared residual of a pixel that can; noise alone: 1.
    """

    of: LivePicture
    model: str
    expected: Image
    residual: Image
    chi2: float


class LiveView:
    """picture: the newest one, None before the first. prediction: the newest one, of that picture or one before.

    model: the model that predicts pictures. problem: why there is no prediction, or "".
    """

    def __init__(self, session: EditingSession) -> None:
        self._session = session
        self.picture: LivePicture | None = None
        self.prediction: PredictedPicture | None = None
        self.model, self.problem = NOMINAL, ""
        self._latest: tuple[LivePicture, Captures] | None = None
        self._predict = PicturePredictor()
        self._task: LatestTask[PredictedPicture | UserError] = LatestTask(
            "prediction", session.call_on_owner, session.messages.post_error
        )

    @property
    def is_busy(self) -> bool:
        """Whether a prediction is being computed."""
        return self._task.is_busy

    @property
    def prediction_is_due(self) -> bool:
        """Whether the newest picture has none, and will have one."""
        return self._latest is not None and self.prediction is None and not self.problem

    def show(self, rig: RigDescription, counts: Counts, capture: Captures | None) -> None:
        """Shows a picture. capture: the same with its settings; None where these aren't known, without a prediction."""
        self.picture = live_picture(rig, counts)
        self._latest = None if capture is None else (self.picture, capture)
        if capture is None:
            self.prediction = None
        self._request()

    def set_model(self, model: PictureModel) -> None:
        """Predicts with another model from now on."""
        self.model = model
        self._request()

    def clear(self) -> None:
        """Forgets the picture."""
        self.picture = self.prediction = self._latest = None
        self.problem = ""

    def close(self) -> None:
        """Ends the thread."""
        self._task.close()

    def _request(self) -> None:
        if self._latest is not None:
            self._task.submit(partial(self._work, *self._latest, self.model), partial(self._put, self._latest[0]))

    def _work(self, picture: LivePicture, capture: Captures, model: PictureModel) -> PredictedPicture | UserError:
        try:
            return self._predict(picture, capture, model)
        except UserError as error:  # such as of a bench that isn't the rig's; told beside each picture
            return error

    def _put(self, picture: LivePicture, found: PredictedPicture | UserError) -> None:
        if self._latest is None:  # no laser is on by now
            return
        if isinstance(found, UserError):
            self.prediction, self.problem = None, str(found)
        else:
            self.prediction, self.problem = found, ""


def live_picture(rig: RigDescription, counts: Counts) -> LivePicture:
    """A picture with its statistics."""
    camera = rig.bench.camera
    histogram, _ = np.histogram(counts, bins=_BINS, range=(0, camera.saturation + 1))
    white = camera.saturation - camera.black_level
    return LivePicture(counts, camera.black_level, white, histogram, float(np.mean(counts >= camera.saturation)))


class PicturePredictor:
    """Predicts pictures one after the other; light of the same settings isn't computed again. For one thread."""

    def __init__(self) -> None:
        self._known: tuple[tuple[Any, ...], tuple[Any, ...], Prediction] | None = None

    def __call__(self, picture: LivePicture, capture: Captures, model: PictureModel) -> PredictedPicture:
        """The prediction for a picture, which `capture` holds with its settings.

        Raises UserError for a model that isn't of the rig's modulators, or that no bench can be.
        """
        values: Values = model.values or {}
        if model.system is not None:
            capture, own, _ = with_preset_geometry(capture, model.system, model.name)
            values = {**own, **values}
        data = prepare_captures(capture)
        indices = np.array([0])
        light = _Known(self._prediction(capture, values, model))
        first = Comparison(light, data, indices, NeighbourVariances(data)(indices)).fit_gains(values)
        variance = capture.camera.noise_variance(first.expected).astype(np.float32)
        comparison = Comparison(light, data, indices, variance)
        fitted = comparison.fit_gains(values)
        chi2 = float(fitted.squares.sum() / max(comparison.pixel_count, 1.0))
        return PredictedPicture(picture, model.name, fitted.expected[0], fitted.residual[0], chi2)

    def _prediction(self, capture: Captures, values: Values, model: PictureModel) -> Prediction:
        names = ("wavelength_m", "distance_m", "power", "exposure_s")
        objects = (capture.levels.base, model.system)
        settings = (*(float(getattr(capture, name)[0]) for name in names), repr(values))
        known = self._known
        if known is None or settings != known[1] or any(a is not b for a, b in zip(objects, known[0], strict=True)):
            known = self._known = (objects, settings, Predictor(capture)([0], values))
        return known[2]


class _Known:
    """A predictor that knows one prediction."""

    fields_requested = 0

    def __init__(self, prediction: Prediction) -> None:
        self._prediction = prediction

    def __call__(self, indices: NDArray[np.intp], values: Values, *, grad: bool = False) -> Prediction:
        return self._prediction


# --- a diagnosis that follows -----------------------------------------------------------------------------------------


FIRST, FEW = 4, 3
"""Captures after which the first diagnosis begins; least number of further captures before the next one."""
MOST = 6
"""A diagnosis that begins by itself is of so many captures, spread evenly over all, so that it is quick."""
_GROWTH = 0.5  # of the captures, after which a running diagnosis is worth beginning again
TIME_S = 120.0
"""How long a search may take; records and intervals take a little longer."""

Diagnose = Callable[..., Diagnosis]


@dataclass(frozen=True, eq=False)
class CauseText:
    """A cause in words: its sentence, a line for each parameter with its interval, and its look-alikes."""

    sentence: str
    intervals: tuple[str, ...]
    doubts: tuple[str, ...]


class LiveDiagnosis:
    """Diagnoses captures of a rig as jobs of the session; a running diagnosis gives way to one of more captures.

    time_s: how long a search may take. diagnosis: the last result, None before the first. seen: captures that were
    there when it was begun. so_far, forecast: sentences of the running one, or "". is_on: whether it begins by itself.
    registration: of the rig, if it was aligned; the effects that it knows aren't named as causes.
    """

    def __init__(self, session: EditingSession, run: Diagnose = diagnose) -> None:
        self._session, self._run = session, run
        self.time_s, self.is_on = TIME_S, True
        self.diagnosis: Diagnosis | None = None
        self.seen, self.so_far, self.forecast = 0, "", ""
        self.registration: Registration | None = None
        self._job: BackgroundJob | None = None
        self._next: tuple[list[Captures], int] | None = None
        self._begun = 0

    @property
    def job(self) -> BackgroundJob | None:
        """The running diagnosis; None while there is none."""
        return self._job if self._job is not None and self._job.is_active else None

    def offer(self, captures: Sequence[Captures], *, is_all: bool = False) -> None:
        """Diagnoses these captures if that is due. is_all: no more come for now."""
        count = len(captures)
        step = 1 if is_all else max(FEW, round(_GROWTH * self._begun))
        if self.is_on and count >= max(FIRST, self._begun + step):
            chosen = np.unique(np.rint(np.linspace(0, count - 1, MOST)).astype(int))
            self._start([captures[k] for k in chosen], count)

    def start(self, captures: Sequence[Captures]) -> None:
        """Diagnoses all these captures, one in each element, in place of those that are being diagnosed."""
        self._start(list(captures), len(captures))

    def cancel(self) -> None:
        """Ends a running diagnosis without a result."""
        self._next = None
        if self._job is not None:
            self._job.cancel()

    def clear(self) -> None:
        """Forgets the diagnosis, as for other captures."""
        self.cancel()
        self.diagnosis, self.seen, self._begun, self.so_far, self.forecast = None, 0, 0, "", ""

    def _start(self, captures: list[Captures], seen: int) -> None:
        self.cancel()
        self._begun, self.so_far, self.forecast, self._next = seen, "", "", (captures, seen)
        self._start_next()

    def _start_next(self) -> None:
        """Starts the waiting diagnosis once the last has ended: two at a time would take turns."""
        if self._next is None or self.job is not None:
            return
        (captures, seen), self._next = self._next, None
        work, show = partial(self._work, captures, self.time_s), partial(self._show, seen)
        self._job = self._session.jobs.start("Diagnosis", work, show, on_end=self._start_next)

    def _work(self, captures: list[Captures], time_s: float, control: JobControl) -> Diagnosis:
        found = self._run(
            join_captures(captures),
            **diagnosis_options(self.registration),
            progress=control.report,
            time_s=time_s,
            is_asked_to_end=lambda: control.is_cancelled,
            so_far=lambda text: self._session.call_on_owner(partial(self._note, control, "so_far", text)),
            forecast=lambda text: self._session.call_on_owner(partial(self._note, control, "forecast", text)),
        )
        control.check()
        return found

    def _note(self, control: JobControl, name: str, text: str) -> None:
        if self._job is not None and self._job.control is control and not control.is_cancelled:
            setattr(self, name, text)

    def _show(self, seen: int, found: Diagnosis) -> None:
        self.diagnosis, self.seen, self.so_far, self.forecast = found, seen, "", ""


def cause_text(cause: Cause) -> CauseText:
    """A named cause as a panel shows it."""
    intervals = tuple(f"{name} = {format_value(cause.effect, name, own)}" for name, own in cause.intervals.items())
    alike = ", ".join(f"{name} ({share:.2f})" for name, share in cause.confounded_with.items())
    doubts = (f"looks much like {alike}" if alike else "", f"to tell: {cause.separate_by}" if cause.separate_by else "")
    return CauseText(cause.sentence, intervals, tuple(filter(None, doubts)))
