"""The newest picture of a rig's camera beside its prediction: residuals in units of the noise, χ²/n, histogram.

LiveView           the newest picture, and its prediction, which a worker thread computes
PicturePredictor   predicts one picture after the other
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.captures.predictor import Prediction, Predictor
from holoview.captures.prepared_captures import prepare_captures
from holoview.diagnose.extended_model import with_preset_geometry
from holoview.diagnose.likelihood import Comparison, Values
from holoview.diagnose.search_context import NeighbourVariances
from holoview.document.editing_session import EditingSession
from holoview.model.system import System
from holoview.rig.description import RigDescription
from holoview.rig.devices import Counts
from holoview.util.errors import UserError
from holoview.util.latest_task import LatestTask

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
    """A prediction of a picture. of: that picture. model: its name.

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

    model: what pictures are predicted with. problem: why there is no prediction, or "".
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
