"""Gradient descent on the maps: Adam through the forward model, from smooth captures to rough ones.

    loss = mean over a batch of Σ w·(light − gain·signal)² / pixels  +  prior / (captures · pixels)

The gain of each capture is the best one, always: exposure and laser power can't be mistaken for anything else. Smooth
patterns stay linear for longer, so training begins with the smoothest captures. The weights of a picture that is still
far off count the model's own error, so that bright pixels lead; they tighten as the error falls.

for state in train(captures, known, split, layout, Settings()):
    print(state.epoch, state.chi2)
learned = state.best          # whatever epoch it came from; stop at any time
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
from holoview.effects.learned_maps import LearnedMaps, MapLayout
from holoview.model.effects.active_effects import EffectValues
from holoview.optimise.adam import Adam, cosine_decay
from holoview.util.errors import UserError

Tensor = torch.Tensor

_CURRICULUM_FIRST_SHARE, _CURRICULUM_END = (
    0.4,
    0.3,
)  # of the captures in the first epoch; of the epochs until all take part
_MAX_MODEL_ERROR = 0.5


@dataclass(frozen=True)
class TrainingState:
    """After an epoch: epochs of all, χ²/n on held-out captures, the best so far and its maps, seconds spent."""

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
    """Learns the maps of a layout; a state after every epoch, the first one (epoch 0) of the nominal bench.

    known: effects {id: {parameter: value}} that the bench has beside. resume: a checkpoint to go on from, bit for bit
    on the same machine. Raises UserError when it is of another session, or when the loss isn't finite.
    """
    yield from _Training(captures, known, split, layout, settings, resume).run()


class _Training:
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
        self.material, self.model = TrainingData(captures), CalibrationModel(captures, layout, known)
        rough = pattern_roughness(captures)
        self.train_indices = split.train[np.argsort(rough[split.train], kind="stable")]
        self.validation_indices = split.validation if len(split.validation) else split.train
        self.tensors = {n: t for n, t in LearnedMaps.nominal(layout).tensors.items() if t.numel()}
        self.adam = {name: Adam(tensor, ADAM_BETAS, ADAM_FLOOR) for name, tensor in self.tensors.items()}
        self.mismatch = np.full(len(captures), _MAX_MODEL_ERROR)
        self.best = {name: tensor.clone() for name, tensor in self.tensors.items()}
        self.progress = TrainingProgress(0, 0.0, math.inf)
        if resume is not None:
            resume.check_matches(captures, known, layout, settings, "checkpoint")
            self._restore(resume)

    def run(self) -> Iterator[TrainingState]:
        started = time.perf_counter() - self.progress.seconds
        for epoch in range(self.progress.epoch, self.settings.epochs + 1):
            if epoch > 0:
                self._epoch(epoch)
            chi2 = self._validation_chi2()
            if chi2 < self.progress.best_chi2:
                self.best = {name: tensor.clone() for name, tensor in self.tensors.items()}
            best = min(chi2, self.progress.best_chi2)
            self.progress = TrainingProgress(epoch + 1, time.perf_counter() - started, best)
            learned = LearnedMaps(self.layout, self._with_empty_maps(self.best))
            seconds = self.progress.seconds
            yield TrainingState(epoch, self.settings.epochs, chi2, best, learned, seconds, self._checkpoint)

    def _epoch(self, epoch: int) -> None:
        """Every capture once, in random order, or of the first epochs the smoothest of them."""
        share = min(
            1.0,
            _CURRICULUM_FIRST_SHARE
            + (1 - _CURRICULUM_FIRST_SHARE) * epoch / max(1.0, _CURRICULUM_END * self.settings.epochs),
        )
        chosen = self.train_indices[: max(1, math.ceil(share * len(self.train_indices)))]
        order = np.random.default_rng([self.settings.seed, epoch]).permutation(chosen)
        batches = [order[i : i + self.settings.batch] for i in range(0, len(order), self.settings.batch)]
        for number, batch in enumerate(batches):
            done = epoch - 1 + number / len(batches)
            self._step(batch, cosine_decay(done, self.settings.epochs) * self.settings.rate)

    def _step(self, batch: NDArray[np.intp], rate: float) -> None:
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
        self.model.set_maps(self._with_empty_maps(self.tensors))
        signals = self.model.predict(batch.tolist(), grad=True)
        parts = []
        for k, signal in zip(batch, signals, strict=True):
            seen = self.material.weighted_image(int(k), float(self.mismatch[k]))
            parts.append(seen.chi2(signal, seen.best_gain(signal)))
            self.mismatch[k] = _mismatch(seen.unexplained_variance(signal.detach()))
        pixels = len(self.train_indices) * signals[0].numel()
        return torch.stack(parts).mean() + prior_penalty(self.tensors) / pixels

    def _validation_chi2(self) -> float:
        """χ²/n of the held-out captures with the weights of the camera's noise alone."""
        self.model.set_maps(self._with_empty_maps(self.tensors))
        total = 0.0
        for k in self.validation_indices:
            signal, seen = self.model.predict([int(k)])[0], self.material.weighted_image(int(k))
            total += float(seen.chi2(signal, seen.best_gain(signal)))
        return total / len(self.validation_indices)

    def _with_empty_maps(self, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
        """With the empty ones of the layout."""
        return {name: tensors.get(name, torch.zeros(shape)) for name, shape in self.layout.shapes().items()}

    # --- checkpoints ------------------------------------------------------------------------------------------------

    def _checkpoint(self) -> CalibrationCheckpoint:
        kept = {"mismatch": self.mismatch.copy()}
        for name, tensor in self.tensors.items():
            parts = {"": tensor, ".best": self.best[name], ".first": self.adam[name].first_moment}
            parts[".second"] = self.adam[name].second_moment
            kept |= {name + part: value.numpy().copy() for part, value in parts.items()}
            kept[f"{name}.count"] = np.array([self.adam[name].step_count], dtype=np.int64)
        return CalibrationCheckpoint.create(self.captures, self.known, self.layout, self.settings, self.progress, kept)

    def _restore(self, resume: CalibrationCheckpoint) -> None:
        kept = resume.tensors
        self.mismatch = kept["mismatch"].copy()
        for name, adam in self.adam.items():
            self.tensors[name] = torch.from_numpy(kept[name].copy())
            self.best[name] = torch.from_numpy(kept[f"{name}.best"].copy())
            adam.first_moment = torch.from_numpy(kept[f"{name}.first"].copy())
            adam.second_moment = torch.from_numpy(kept[f"{name}.second"].copy())
            adam.step_count = int(kept[f"{name}.count"][0])
        self.progress = resume.progress


def _mismatch(unexplained: float) -> float:
    """The model's own error (share of the mean light) that weights allow for."""
    return min(_MAX_MODEL_ERROR, 0.5 * math.sqrt(max(unexplained, 0.0)))
