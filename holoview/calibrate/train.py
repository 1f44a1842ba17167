"""Trains the maps with Adam through the forward model, smooth captures first; yields a state after each epoch.

    loss = mean over the captures of a batch of χ²/pixels  +  Σ (θ/σ)² / (training captures · pixels)

- χ² = Σ w·(light − g·signal)² has the best gain g for each capture (`WeightedImage.best_gain`), so errors of exposure
  and laser power don't change the maps.
- The second term is the Gaussian prior of the maps (`prior_penalty`).
- An error of the bench decorrelates the speckle of rough patterns before that of smooth ones. So the first epoch has
  the smoothest 40 % of the captures, and the share rises to all of them after 30 % of the epochs.
- The weights allow for the model's own error, m = ½·√U of the mean light, with U the share of the image's variance that
  the model left unexplained when the capture was last trained on (`TrainingData.weighted_image`).

    for state in train(captures, known, split, layout, CalibrationSettings()):
        print(state.epoch, state.validation_chi2)
    maps = state.best_maps        # of the epoch with the lowest validation χ²; the loop may be left at any time
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.calibrate.checkpoint import CalibrationCheckpoint, TrainingProgress
from holoview.calibrate.data_split import DataSplit
from holoview.calibrate.forward_model import CalibrationModel, prior_penalty
from holoview.calibrate.settings import ADAM_BETAS, ADAM_FLOOR, LEARNING_RATES, CalibrationSettings
from holoview.calibrate.training_data import TrainingData
from holoview.captures.dataset import Captures
from holoview.captures.patterns import pattern_roughness
from holoview.model.effects.active_effects import EffectValues
from holoview.model.effects.learned_maps import LearnedMaps, MapLayout
from holoview.optimise.adam import Adam, cosine_decay
from holoview.util.errors import UserError

Tensor = torch.Tensor

_CURRICULUM_FIRST_SHARE = 0.4  # of the training captures, in the first epoch
_CURRICULUM_END = 0.3  # share of the epochs after which all training captures take part
_MAX_MODEL_ERROR = 0.5  # of the mean light; also the value before a capture was first trained on


@dataclass(frozen=True)
class TrainingState:
    """The state after an epoch.

    epoch: 0 is the nominal bench, before any step. epochs: the last one.
    validation_chi2: χ² per pixel on the validation captures, with the camera's noise alone.
    best_chi2, best_maps: lowest validation_chi2 so far, and the maps of that epoch.
    seconds: time spent so far, including that before a checkpoint.
    checkpoint: makes a checkpoint of this state; must be called before the next state is asked for.
    """

    epoch: int
    epochs: int
    validation_chi2: float
    best_chi2: float
    best_maps: LearnedMaps
    seconds: float
    checkpoint: Callable[[], CalibrationCheckpoint]


def train(
    captures: Captures,
    known: EffectValues,
    split: DataSplit,
    layout: MapLayout,
    settings: CalibrationSettings,
    resume: CalibrationCheckpoint | None = None,
) -> Iterator[TrainingState]:
    """Trains the maps of a layout; yields a state after every epoch, beginning with the nominal bench as epoch 0.

    known: {effect id: {parameter: value}} of effects that the bench has besides the maps.
    split: `split.train` is trained on, `split.validation` chooses the best epoch.
    resume: a checkpoint to continue from; on the same machine the results are the same bit for bit.

    Raises UserError when the checkpoint is of other captures, effects, layout or settings, or the loss isn't finite.
    """
    yield from _Training(captures, known, split, layout, settings, resume).run()


class _Training:
    """The tensors that are trained and the state of the optimiser."""

    def __init__(
        self,
        captures: Captures,
        known: EffectValues,
        split: DataSplit,
        layout: MapLayout,
        settings: CalibrationSettings,
        resume: CalibrationCheckpoint | None,
    ) -> None:
        self.captures, self.known, self.layout, self.settings = captures, known, layout, settings
        self.data, self.model = TrainingData(captures, known), CalibrationModel(captures, layout, known)
        roughness = pattern_roughness(captures)
        self.train_indices = split.train[np.argsort(roughness[split.train], kind="stable")]
        self.validation_indices = split.validation if len(split.validation) else split.train
        self.tensors = {n: t for n, t in LearnedMaps.nominal(layout).tensors.items() if t.numel()}
        self.adam = {name: Adam(tensor, ADAM_BETAS, ADAM_FLOOR) for name, tensor in self.tensors.items()}
        self.model_errors = np.full(len(captures), _MAX_MODEL_ERROR)
        self.best_tensors = {name: tensor.clone() for name, tensor in self.tensors.items()}
        self.progress = TrainingProgress(0, 0.0, math.inf)
        if resume is not None:
            resume.check_matches(captures, known, layout, settings, "checkpoint")
            self._restore(resume)

    def run(self) -> Iterator[TrainingState]:
        """Trains the epochs that are left; yields a state after each."""
        started = time.perf_counter() - self.progress.seconds
        for epoch in range(self.progress.epoch, self.settings.epochs + 1):
            if epoch > 0:
                self._train_epoch(epoch)
            chi2 = self._validation_chi2()
            if chi2 < self.progress.best_chi2:
                self.best_tensors = {name: tensor.clone() for name, tensor in self.tensors.items()}
            best = min(chi2, self.progress.best_chi2)
            self.progress = TrainingProgress(epoch + 1, time.perf_counter() - started, best)
            best_maps = LearnedMaps(self.layout, self._with_empty_maps(self.best_tensors))
            seconds = self.progress.seconds
            yield TrainingState(epoch, self.settings.epochs, chi2, best, best_maps, seconds, self._checkpoint)

    def _train_epoch(self, epoch: int) -> None:
        """Trains on the captures of an epoch in random order."""
        ramp_epochs = max(1.0, _CURRICULUM_END * self.settings.epochs)
        share = min(1.0, _CURRICULUM_FIRST_SHARE + (1 - _CURRICULUM_FIRST_SHARE) * epoch / ramp_epochs)
        chosen = self.train_indices[: max(1, math.ceil(share * len(self.train_indices)))]
        order = np.random.default_rng([self.settings.seed, epoch]).permutation(chosen)
        batches = [order[i : i + self.settings.batch] for i in range(0, len(order), self.settings.batch)]
        for number, batch in enumerate(batches):
            done = epoch - 1 + number / len(batches)
            self._step(batch, cosine_decay(done, self.settings.epochs) * self.settings.rate)

    def _step(self, batch: NDArray[np.intp], rate: float) -> None:
        """One step of Adam on the captures of a batch. rate: factor on all learning rates."""
        leaves = {name: tensor.requires_grad_() for name, tensor in self.tensors.items()}
        loss = self._loss(batch)
        if not math.isfinite(loss.item()):
            raise UserError("calibration", f"the loss became {loss.item()}", remedy="lower --rate")
        gradients = torch.autograd.grad(loss, list(leaves.values()))
        with torch.no_grad():
            for (name, tensor), gradient in zip(leaves.items(), gradients, strict=True):
                tensor.requires_grad_(False)
                tensor.sub_(self.adam[name].unit_step(gradient), alpha=rate * LEARNING_RATES[name])

    def _loss(self, batch: NDArray[np.intp]) -> Tensor:
        """The loss of a batch, with gradients; also updates the model errors of its captures."""
        self.model.set_maps(self._with_empty_maps(self.tensors))
        signals = self.model.predict(batch.tolist(), grad=True)
        terms = []
        for k, signal in zip(batch, signals, strict=True):
            image = self.data.weighted_image(int(k), float(self.model_errors[k]))
            terms.append(image.chi2(signal, image.best_gain(signal)))
            self.model_errors[k] = _model_error(image.unexplained_variance(signal.detach()))
        pixels = len(self.train_indices) * signals[0].numel()
        return torch.stack(terms).mean() + prior_penalty(self.tensors) / pixels

    def _validation_chi2(self) -> float:
        """Mean χ² per pixel of the validation captures, with weights from the camera's noise alone."""
        self.model.set_maps(self._with_empty_maps(self.tensors))
        total = 0.0
        for k in self.validation_indices:
            signal, image = self.model.predict([int(k)])[0], self.data.weighted_image(int(k))
            total += float(image.chi2(signal, image.best_gain(signal)))
        return total / len(self.validation_indices)

    def _with_empty_maps(self, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
        """The tensors with those of the layout that have no elements, which aren't trained."""
        return {name: tensors.get(name, torch.zeros(shape)) for name, shape in self.layout.shapes().items()}

    # --- checkpoints ------------------------------------------------------------------------------------------------

    def _checkpoint(self) -> CalibrationCheckpoint:
        arrays = {"mismatch": self.model_errors.copy()}
        for name, tensor in self.tensors.items():
            parts = {"": tensor, ".best": self.best_tensors[name], ".first": self.adam[name].first_moment}
            parts[".second"] = self.adam[name].second_moment
            arrays |= {name + part: value.numpy().copy() for part, value in parts.items()}
            arrays[f"{name}.count"] = np.array([self.adam[name].step_count], dtype=np.int64)
        return CalibrationCheckpoint.create(
            self.captures, self.known, self.layout, self.settings, self.progress, arrays
        )

    def _restore(self, resume: CalibrationCheckpoint) -> None:
        arrays = resume.tensors
        self.model_errors = arrays["mismatch"].copy()
        for name, adam in self.adam.items():
            self.tensors[name] = torch.from_numpy(arrays[name].copy())
            self.best_tensors[name] = torch.from_numpy(arrays[f"{name}.best"].copy())
            adam.first_moment = torch.from_numpy(arrays[f"{name}.first"].copy())
            adam.second_moment = torch.from_numpy(arrays[f"{name}.second"].copy())
            adam.step_count = int(arrays[f"{name}.count"][0])
        self.progress = resume.progress


def _model_error(unexplained_variance: float) -> float:
    """Standard deviation of the model's error, as a share of the mean light, from the unexplained variance U."""
    return min(_MAX_MODEL_ERROR, 0.5 * math.sqrt(max(unexplained_variance, 0.0)))
