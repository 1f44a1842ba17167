"""Trains the maps with Adam through a differentiable model, smooth captures first; yields a state after each epoch.

TrainingData            camera images above the black level with inverse-variance weights
CalibrationModel        predicts camera images from the maps that are being learned, with gradients; the maps' prior
CalibrationCheckpoint   the full state between two epochs, in one safetensors file
train                   the training

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

A calibration that is resumed from its checkpoint on the same machine gives the same numbers, bit for bit, as one that
was never stopped. The checkpoint holds, for each tensor NAME of `holoview.light.model.effects.learned_maps.map_schemas`
that isn't empty:

NAME                      its present value
NAME.best                 its value in the epoch with the lowest χ² on the validation captures
NAME.first NAME.second    Adam's first and second moments
NAME.count                Adam's number of steps, int64 (1,)

and besides:

mismatch                  float64 (capture,): each capture's model error when it was last trained on
metadata                  format, version; layout, settings, progress and known effects as JSON; digest of the captures

The plan of a calibration, made before the training begins: settings, captures, maps.

CalibrationSettings, LEARNING_RATES    epochs, batch, rate; the learning rate of each tensor
split_captures                         the captures that are trained on, and those that only judge
map_layout_for                         the maps that the captures can determine, and their resolution
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Camera, Captures
from holoview.bench.captures.nominal_bench import stated_keys
from holoview.bench.captures.patterns import pattern_roughness
from holoview.bench.captures.predictor import PLAIN, Predictor, SamplingConfig
from holoview.bench.captures.prepared_captures import (
    PreparedCaptures,
    add_model_error,
    neighbour_variance,
    prepare_captures,
)
from holoview.holograms.optimise.adam import Adam, cosine_decay
from holoview.light.effects.calibrated import Calibrated
from holoview.light.model import preset
from holoview.light.model.bench_parts import Relay
from holoview.light.model.effects.effect import Values
from holoview.light.model.effects.learned_maps import (
    LearnedMaps,
    MapCache,
    MapLayout,
    RowsColumns,
    map_kind,
    map_schemas,
    map_sizes,
    read_layout,
)
from holoview.light.model.effects.registry import EffectValues
from holoview.light.model.fields import Integer, Number, described_field, same_field, validate
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.safetensors_file import TensorFormat, differing_fields, refuse_differences
from holoview.util.tables import ArraySchema, read_record

LEARNING_RATES: Mapping[str, float] = {
    "lut_steps": 0.03,
    "fringing_px2": 0.01,
    "source_log_amplitude": 0.02,
    "source_opd_m": 5e-9,
    "warp_m": 0.25e-6,
    "zernike_m": 5e-9,
    "pupil_log_amplitude": 0.02,
}
"""First step of Adam for each kind of tensor (`map_kind`), in the tensor's unit; `CalibrationSettings.rate` multiplies
all of them.
"""

ADAM_BETAS = (0.9, 0.95)

ADAM_FLOOR = 0.1
"""Lower bound of Adam's denominator as a share of its r.m.s. over a tensor (`rms_floor`).

Elements that the captures hardly determine, whose gradients are mostly noise, then move less than the others.
"""

_MIN_EPOCHS, _MIN_STEPS = 40, 300  # of a calibration without --epochs


def default_epochs(captures: int, batch: int) -> int:
    """Epochs for a number of training captures: at least 300 steps and at least 40 epochs."""
    return max(_MIN_EPOCHS, math.ceil(_MIN_STEPS / math.ceil(captures / batch)))


_SHARE = Number(low=np.nextafter(0, 1), high=np.nextafter(0.8, 0), words="between 0 and 0.8")


@dataclass(frozen=True)
class CalibrationSettings:
    """How to train. The field names are keys of checkpoints and appear in error messages."""

    epochs: int = described_field(
        Integer(1, 100_000),
        "Passes over the training captures; by `holoview calibrate` as many as make 300 steps, at least 40.",
        default=40,
    )
    batch: int = described_field(Integer(1, 10_000), "Captures a step.", default=4)
    rate: float = described_field(
        Number(low=np.nextafter(0, 1), high=100, words="above 0, at most 100"), "Factor of all steps.", default=1.0
    )
    seed: int = described_field(
        Integer(0, 2**63 - 1), "Of what is held out and of the order of the captures.", default=0
    )
    share: float = described_field(
        Number(words=_SHARE.words),
        "Of the captures that only judge; `split_captures` checks it.",
        flag="held-out",
        default=0.2,
    )
    finer: int = same_field(SamplingConfig, "finer")
    padding: int = same_field(SamplingConfig, "padding")
    points: int | None = same_field(SamplingConfig, "points")
    has_weighted_stops: bool = same_field(SamplingConfig, "has_weighted_stops")

    def __post_init__(self) -> None:
        validate(self)

    @property
    def sampling(self) -> SamplingConfig:
        """How finely the bench is sampled."""
        return SamplingConfig(self.finer, self.padding, self.points, self.has_weighted_stops)


Indices = NDArray[np.intp]
Floats = NDArray[np.float64]


# --- captures that are trained on, and captures that only judge ---


_MIN_CAPTURES = 4
_MIN_PLANES_TO_HOLD_OUT_ONE = 3
_MIN_WAVELENGTHS_TO_HOLD_OUT_ONE = 4


@dataclass(frozen=True)
class DataSplit:
    """Indices of captures, each (n,) and ascending; the four sets are disjoint.

    train: captures whose images the maps are fitted to.
    validation: captures of the same wavelengths and planes; they choose the epoch whose maps are kept.
    unseen_planes: all captures of one plane that `train` lacks; empty with fewer than three planes.
    unseen_wavelengths: all captures of one wavelength that `train` lacks; empty with fewer than four wavelengths.
    """

    train: Indices
    validation: Indices
    unseen_planes: Indices
    unseen_wavelengths: Indices

    def groups(self) -> dict[str, Indices]:
        """The sets that aren't empty, by the names under which their scores are written."""
        groups = {
            "train": self.train,
            "captures": self.validation,
            "planes": self.unseen_planes,
            "wavelengths": self.unseen_wavelengths,
        }
        return {name: indices for name, indices in groups.items() if len(indices)}


def split_captures(captures: Captures, held_out_share: float = 0.2, seed: int = 0) -> DataSplit:
    """Splits captures at random, with the same share of every wavelength and plane in the validation set.

    The middle one of three or more planes and the middle one of four or more wavelengths are held out whole: maps
    that hold between the planes and wavelengths of the training predict them, too.

    held_out_share: validation captures as a share of those that aren't held out whole, between 0 and 0.8.
    seed: of the random choice.

    Raises UserError for fewer than four captures or a share outside its range.
    """
    _SHARE.parse(held_out_share, "held-out share")
    if len(captures) < _MIN_CAPTURES:
        found = f"{len(captures)} capture{'s' if len(captures) > 1 else ''}"
        raise UserError(
            "captures", found, expected=f"at least {_MIN_CAPTURES}: some to learn from and some to judge by"
        )
    of_wavelength = _middle_value_mask(captures.wavelength_m, _MIN_WAVELENGTHS_TO_HOLD_OUT_ONE)
    of_plane = _middle_value_mask(captures.distance_m, _MIN_PLANES_TO_HOLD_OUT_ONE) & ~of_wavelength
    rest = np.flatnonzero(~of_wavelength & ~of_plane)
    validation = _stratified_sample(captures, rest, held_out_share, np.random.default_rng(seed))
    train = np.setdiff1d(rest, validation)
    return DataSplit(train, validation, np.flatnonzero(of_plane), np.flatnonzero(of_wavelength))


def _middle_value_mask(values: NDArray[np.float64], min_distinct: int) -> NDArray[np.bool_]:
    """Mask of the captures at the middle one of the distinct values; nowhere true if these are fewer than a minimum."""
    distinct = np.unique(values)
    if len(distinct) < min_distinct:
        return np.zeros(len(values), dtype=bool)
    return values == distinct[len(distinct) // 2]


def _stratified_sample(captures: Captures, indices: Indices, share: float, rng: np.random.Generator) -> Indices:
    """A share (at least one) of some captures, which takes the same share of each wavelength and plane."""
    keys = np.stack([captures.wavelength_m[indices], captures.distance_m[indices]], axis=1)
    groups = [indices[(keys == key).all(axis=1)] for key in np.unique(keys, axis=0)]
    shuffled = [rng.permutation(group) for group in groups]
    ranked = [
        (rank / len(group), number, int(k)) for number, group in enumerate(shuffled) for rank, k in enumerate(group)
    ]
    count = max(1, round(share * len(indices)))
    return np.sort(np.array([k for _, _, k in sorted(ranked)[:count]], dtype=np.intp))


# --- maps that the captures can determine ---


_SOURCE_PIXELS_PER_NODE = 8
_MAX_ANCHORS = 4
_PUPIL_NODES = 17
_WARP_NODES = (4, 5)
_NOLL_1 = tuple(range(4, 16))  # without tilts: a tilt in relay 1 shifts the field on modulator 2, as the warp does
_NOLL_2 = tuple(range(2, 16))  # with tilts, which shift the camera's image; a piston changes no intensity


def map_layout_for(
    captures: Captures, train: NDArray[np.intp], pixels_per_node: int = _SOURCE_PIXELS_PER_NODE
) -> MapLayout:
    """The layout of the maps that captures of the indices `train` (n,) can determine.

    pixels_per_node: modulator pixels per node and axis of the source's maps; of a chain pixels of its first modulator.
    """
    wavelengths = np.unique(captures.wavelength_m[train])
    if captures.chain is not None:
        return _chain_layout(captures.chain, wavelengths, pixels_per_node)
    has_two_slms, has_camera_relay = len(captures.slms) == 2, not captures.is_fourier
    return MapLayout(
        modulators=len(captures.slms),
        reference_m=float(wavelengths.mean()),
        anchors_m=_anchors(wavelengths),
        source_nodes=_source_node_counts(captures.levels.shape[2:], pixels_per_node),
        warp_nodes=_WARP_NODES if has_two_slms else (0, 0),
        noll1=_NOLL_1 if has_two_slms else (),
        noll2=_NOLL_2 if has_camera_relay else (),
        degree=_degree(wavelengths),
        pupil_nodes=(_PUPIL_NODES, _PUPIL_NODES) if has_camera_relay else (0, 0),
        sine1=_pupil_radius_na(captures, captures.relay1),
        sine2=_pupil_radius_na(captures, captures.relay2),
    )


def _chain_layout(chain: System, wavelengths: Floats, pixels_per_node: int) -> MapLayout:
    """The layout of the maps of a chain: a table for each element that shows patterns, its light, and its spaces."""
    way, u = chain.way, chain.sampling.upsample
    spaces = [relay for relay in range(len(way.relays)) if relay != way.last and way.kernel(relay) is None]
    spaces.append(way.last)

    def sine(relay: int) -> float:
        if way.relays[relay].has_aperture:
            return max(way.relays[relay].pupil_radius_sine(float(λ), way.orders_m[relay]) for λ in wavelengths)
        return _all_directions(way.sample_m, float(wavelengths.max()))

    names = tuple(chain.drive_shapes)
    return MapLayout(
        modulators=len(names),
        reference_m=float(wavelengths.mean()),
        anchors_m=_anchors(wavelengths),
        source_nodes=_source_node_counts([n // u for n in way.shape], pixels_per_node),
        noll1=_NOLL_1,
        noll2=_NOLL_2,
        degree=_degree(wavelengths),
        pupil_nodes=(_PUPIL_NODES, _PUPIL_NODES),
        elements=names,
        relays=tuple(map(way.relay_words, spaces)),
        sines=tuple(map(sine, spaces)),
    )


def _degree(wavelengths: Floats) -> int:
    """The degree of polynomials in the wavelength that so many wavelengths determine."""
    return 0 if len(wavelengths) < 2 else 1 if len(wavelengths) < 4 else 2


def _anchors(wavelengths: NDArray[np.float64]) -> tuple[float, ...]:
    """Wavelengths at which the source's maps are stored, evenly spaced; between them they are interpolated."""
    count = min(len(wavelengths), _MAX_ANCHORS)
    return tuple(float(λ) for λ in np.linspace(wavelengths[0], wavelengths[-1], count))


def _source_node_counts(shape: Sequence[int], pixels_per_node: int) -> RowsColumns:
    rows, columns = (max(3, math.ceil(n / pixels_per_node) + 1) for n in shape)
    return rows, columns


def _pupil_radius_na(captures: Captures, relay: Relay) -> float:
    """Radius of a relay's pupil in direction sines, of all wavelengths the largest.

    Without an iris or a square stop that of the circle around all simulated directions.
    """
    pitch_m = captures.slms[0].pitch_m
    if relay.has_aperture:
        return max(relay.pupil_radius_sine(float(λ), pitch_m) for λ in captures.wavelengths_m)
    return _all_directions(pitch_m / captures.upsample, float(captures.wavelength_m.max()))


def _all_directions(sample_m: float, wavelength_m: float) -> float:
    """Radius of the circle around all directions that samples of this pitch hold, a direction sine."""
    return min(1.0, math.sqrt(2) * wavelength_m / (2 * sample_m))


# --- training ---------------------------------------------------------------------------------------------------------


Tensor = torch.Tensor


_MIN_USABLE_SHARE = 1e-3


@dataclass(frozen=True)
class WeightedImage:
    """The image of one capture.

    light: (y, x), counts of the lasers' light.
    weight: (y, x), 1/variance in counts⁻²; 0 for a pixel that isn't used (saturated, stuck, or at the border).
    """

    light: Tensor
    weight: Tensor

    def best_gain(self, signal: Tensor) -> Tensor:
        """The factor g on a predicted signal s (y, x) that minimises Σ w·(light − g·s)²: Σ w·s·light / Σ w·s².

        It carries no gradient, because at the minimum the derivative of χ² with respect to g is zero.
        """
        with torch.no_grad():
            weighted = self.weight * signal
            return (weighted * self.light).sum() / (weighted * signal).sum().clamp_min(1e-30)

    def chi2(self, signal: Tensor, gain: Tensor | float) -> Tensor:
        """χ² per used pixel of gain · signal, Σ w·(light − g·s)² / n."""
        squares = self.weight * (self.light - gain * signal).square()
        return squares.sum() / (self.weight > 0).sum()

    def reweighted(self, camera: Camera, expected: Tensor) -> WeightedImage:
        """The same image with weights from the camera's noise at an expected signal (y, x); the used pixels stay."""
        variance = torch.from_numpy(camera.noise_variance(expected.numpy()).astype(np.float32))
        return WeightedImage(self.light, torch.where(self.weight > 0, 1 / variance, 0.0))

    def unexplained_variance(self, signal: Tensor) -> float:
        """Mean square of the residual light − g·s over the variance of the light, with the best gain g."""
        used = self.weight > 0
        light, residual = self.light[used], (self.light - self.best_gain(signal) * signal)[used]
        return float(residual.square().mean() / light.var().clamp_min(1e-30))


class TrainingData:
    """The images of all captures, to train on and to score with.

    Weights follow from the images alone (see `neighbour_variance`), so that a model can't lower its χ² by predicting
    light that widens the error bars. Raises UserError for a capture that has hardly a usable pixel.

    known: effects of the bench, {effect id: {parameter: value}}: black level and ambient light are subtracted.
    """

    def __init__(self, captures: Captures, known: EffectValues | None = None) -> None:
        self.captures = captures
        self._dark_counts = Predictor(captures).counts_without_lasers(range(len(captures)), known or {})
        self._prepared: PreparedCaptures = prepare_captures(captures)
        usable_share = self._prepared.usable.mean(axis=(1, 2))
        if float(usable_share.min()) < _MIN_USABLE_SHARE:
            worst = int(usable_share.argmin())
            raise UserError(
                f"camera/images, capture {worst}",
                "hardly a pixel can be used: all are saturated or stuck",
                expected="a picture within the camera's range",
                remedy="leave it out or take it again with a shorter exposure",
            )

    def weighted_image(self, capture: int, model_error: float = 0.0) -> WeightedImage:
        """The image of a capture of this index.

        model_error: standard deviation of the model's own error as a share of the image's mean light. Adding it to the
        camera's noise makes the weights more uniform, so that dim pixels with little noise don't dominate the fit of a
        model that is still far off.
        """
        indices: NDArray[np.intp] = np.array([capture])
        light = self._prepared.light[indices]
        variance = add_model_error(neighbour_variance(self._prepared, indices), light, model_error)
        weight = np.where(self._prepared.usable[indices], 1 / variance, 0.0).astype(np.float32)
        lasers = light[0] - np.broadcast_to(self._dark_counts, self._prepared.light.shape)[capture]
        return WeightedImage(torch.from_numpy(lasers), torch.from_numpy(weight[0]))


# --- the model and its prior ---


PRIOR_SIGMA: Mapping[str, float] = {
    "lut_steps": 0.5,
    "fringing_px2": 0.2,
    "source_log_amplitude": 0.5,
    "source_opd_m": 200e-9,
    "warp_m": 20e-6,
    "zernike_m": 200e-9,
    "pupil_log_amplitude": 0.3,
}
"""Standard deviation of the Gaussian prior of the elements of each kind of tensor (`map_kind`), in the tensor's unit.

The prior has its mean at the nominal bench, so elements that the captures don't determine stay near zero.
"""

_CACHE_MB = 128


class _TrainableCalibrated(Calibrated):
    """The effect `calibrated` with maps in memory instead of in a file, so that gradients reach their tensors."""

    listed: ClassVar[bool] = False

    def __init__(self) -> None:
        self.current_maps: LearnedMaps | None = None

    def maps(self, v: Values) -> LearnedMaps:
        assert self.current_maps is not None
        return self.current_maps


class CalibrationModel:
    """Predicts the camera images of captures for given maps.

    captures: their patterns and conditions; the images aren't used.
    layout: of the maps.
    known: {effect id: {parameter: value}} of effects that the bench has besides the maps.
    sampling: of the bench.
    double_precision: computes in complex128 instead of complex64.
    """

    def __init__(
        self,
        captures: Captures,
        layout: MapLayout,
        known: EffectValues,
        sampling: SamplingConfig = PLAIN,
        *,
        double_precision: bool = False,
    ) -> None:
        self.layout, self.known = layout, dict(known)
        self._effect = _TrainableCalibrated()
        self._predictor = Predictor(
            captures,
            extra_effects=(self._effect,),
            double_precision=double_precision,
            cache_mb=_CACHE_MB,
            **sampling.keywords,
        )
        self._map_cache, self._version = MapCache(), 0

    def set_maps(self, tensors: Mapping[str, Tensor]) -> None:
        """Sets the tensors to predict with; must be called again after a tensor was changed in place."""
        self._map_cache.of_tensors = {}
        self._effect.current_maps = LearnedMaps(self.layout, tensors, self._map_cache)
        self._version += 1

    def predict(self, indices: Sequence[int], *, grad: bool = False) -> Tensor:
        """Predicted images (capture, y, x) of captures, with the maps, up to one factor per capture.

        grad: whether the result carries gradients with respect to the tensors.
        """
        # the predictor caches by parameter values: a new version number makes it evaluate the maps again
        table = {**self.known, _TrainableCalibrated.id: {"file": f"version {self._version}"}}
        return self._predictor(indices, table, grad=grad).signal

    def predict_nominal(self, indices: Sequence[int]) -> Tensor:
        """As `predict`, without maps: the bench with its known effects only."""
        return self._predictor(indices, self.known).signal


def prior_penalty(tensors: Mapping[str, Tensor]) -> Tensor:
    """Σ (θ/σ)² over all elements θ of the tensors, with σ from PRIOR_SIGMA: −2 log(prior) up to a constant."""
    parts = [
        (tensor / PRIOR_SIGMA[map_kind(name)]).square().sum() for name, tensor in tensors.items() if tensor.numel()
    ]
    return torch.stack(parts).sum()


# --- checkpoints ---


_TEXTS = ("layout", "settings", "progress", "known", "captures")


def _format(layout: MapLayout | None) -> TensorFormat:
    """The file format for the maps of a layout; with None, for reading the metadata only."""
    shapes, maps = ({}, ()) if layout is None else (layout.shapes(), map_schemas(layout))
    schemas = [part for map_ in maps if 0 not in shapes[map_.name] for part in _part_schemas(map_)]
    return TensorFormat(
        name="holoview-calibration-checkpoint",
        version="1",
        what="a checkpoint that `holoview calibrate` wrote",
        tensors=(ArraySchema("mismatch", ("float64",), ("capture",), low=0.0, may_be_infinite=True), *schemas),
        metadata_keys=_TEXTS,
    )


def _part_schemas(learned: ArraySchema) -> tuple[ArraySchema, ...]:
    """The arrays of the file for a tensor: its value and the best one, Adam's moments and number of steps."""
    name = learned.name
    return (
        learned,
        learned.alike(f"{name}.best", learned.low, learned.high),
        learned.alike(f"{name}.first"),
        learned.alike(f"{name}.second", low=0.0),
        ArraySchema(f"{name}.count", ("int64",), (1,), low=0.0, high=1e9),
    )


@dataclass(frozen=True)
class TrainingProgress:
    """How far a calibration has come. The field names are keys of the checkpoint's JSON.

    epoch: the next one to train.
    seconds: time spent so far.
    best_chi2: lowest χ² per pixel on the validation captures.
    """

    epoch: int
    seconds: float
    best_chi2: float

    def __post_init__(self) -> None:
        if self.epoch < 0 or not 0 <= self.seconds < math.inf or math.isnan(self.best_chi2):
            found = f"epoch {self.epoch} after {self.seconds} s, χ² {self.best_chi2}"
            raise UserError("progress", found, expected="numbers of 0 or more")


@dataclass(frozen=True)
class CalibrationCheckpoint:
    """The state of a calibration between two epochs.

    known_effects_json: effects that the bench has besides the learned maps.
    digest: `captures_digest` of the captures.
    tensors: {name: array}, as listed at the head of this module.
    """

    layout: MapLayout
    settings: CalibrationSettings
    known_effects_json: str
    digest: str
    progress: TrainingProgress
    tensors: dict[str, NDArray[Any]]

    @staticmethod
    def create(
        captures: Captures,
        known: EffectValues,
        layout: MapLayout,
        settings: CalibrationSettings,
        progress: TrainingProgress,
        tensors: Mapping[str, NDArray[Any]],
    ) -> CalibrationCheckpoint:
        """A checkpoint of the calibration of these captures, on a bench with these known effects."""
        return CalibrationCheckpoint(
            layout, settings, _effects_json(known), captures_digest(captures), progress, dict(tensors)
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the file atomically: an existing file is replaced only by a complete one. Raises UserError."""
        texts = {
            "layout": self.layout.to_json(),
            "settings": json.dumps(dataclasses.asdict(self.settings)),
            "progress": json.dumps(dataclasses.asdict(self.progress)),
            "known": self.known_effects_json,
            "captures": self.digest,
        }
        _format(self.layout).write(path, self.tensors, texts)

    def check_matches(
        self, captures: Captures, known: EffectValues, layout: MapLayout, settings: CalibrationSettings, where: str
    ) -> None:
        """Raises UserError, naming what differs, unless captures, effects, layout and settings are the checkpoint's."""
        differing = ["the captures"] * (self.digest != captures_digest(captures))
        differing += ["the known effects"] * (self.known_effects_json != _effects_json(known))
        differing += ["the maps"] * (self.layout != layout)
        differing += differing_fields(self.settings, settings)
        refuse_differences(differing, where, "calibration", "captures, preset and options")


def load_checkpoint(path: str | os.PathLike[str]) -> CalibrationCheckpoint:
    """Reads a checkpoint. Raises UserError when the file is missing, damaged, or of another format."""
    with _format(None).open(path) as file:
        texts, what = file.texts, file.format.what
    layout = read_layout(texts["layout"], f"{path}: layout")
    settings = read_record(CalibrationSettings, texts["settings"], f"{path}: settings", what)
    progress = read_record(TrainingProgress, texts["progress"], f"{path}: progress", what)
    with _format(layout).open(path) as file:
        tensors = file.tensors(map_sizes(layout))
    return CalibrationCheckpoint(layout, settings, texts["known"], texts["captures"], progress, tensors)


_SLM_KEYS = ("pitch_m", "num_levels", "opd_range_m")  # a chain, which has the rest, is part of a digest itself


def captures_digest(captures: Captures) -> str:
    """SHA-256 (hexadecimal) of the captures' patterns, images, conditions and geometry."""
    digest = hashlib.sha256(repr((captures.levels.shape, captures.images.shape)).encode())
    for name in ("levels", "images", "wavelength_m", "distance_m", "power", "exposure_s"):
        digest.update(np.ascontiguousarray(getattr(captures, name)).tobytes())
    camera = dataclasses.asdict(captures.camera)
    if camera["integrates"] is None:  # not stated, as in all files of former versions
        del camera["integrates"]
    bench: dict[str, Any] = {
        "slms": [{key: getattr(slm, key) for key in _SLM_KEYS} for slm in captures.slms],
        "camera": camera,
        "gap": captures.gap_m,
        "focal_length": captures.focal_length_m,
        "relays": [stated_keys(relay) for relay in (captures.relay1, captures.relay2)],
    }
    bench |= {} if captures.chain is None else {"chain": preset.dumps(captures.chain)}
    digest.update(json.dumps(bench, sort_keys=True).encode())
    return digest.hexdigest()


def _effects_json(known: EffectValues) -> str:
    return json.dumps({name: dict(values) for name, values in known.items()}, sort_keys=True)


# --- the training ---


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
        self.data = TrainingData(captures, known)
        self.model = CalibrationModel(captures, layout, known, settings.sampling)
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
                tensor.sub_(self.adam[name].unit_step(gradient), alpha=rate * LEARNING_RATES[map_kind(name)])

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
