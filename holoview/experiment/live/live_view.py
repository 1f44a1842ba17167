"""The newest picture of a rig's camera and its prediction, which a worker thread computes."""

from __future__ import annotations

from functools import partial

from holoview.captures.dataset import Captures
from holoview.document.editing_session import EditingSession
from holoview.experiment.live.live_comparison import (
    LivePicture,
    PictureModel,
    PicturePredictor,
    PredictedPicture,
    live_picture,
)
from holoview.rig.description import RigDescription
from holoview.rig.devices import Counts
from holoview.util.errors import UserError
from holoview.util.latest_task import LatestTask

NOMINAL = PictureModel("rig.toml")


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
