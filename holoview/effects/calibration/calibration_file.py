"""The safetensors file of a calibration: the tensors of `learned_maps` in SI units, with their layout and a summary.

metadata: format, version, layout (JSON), summary (JSON: from what it was learned, and how well it predicts captures).
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch

from holoview.effects.calibration.learned_maps import TENSORS, LearnedMaps, MapLayout
from holoview.util.errors import UserError
from holoview.util.safetensors_file import TensorFormat

_FORMAT = TensorFormat(
    name="holoview-calibration",
    version="1",
    what="the maps of a calibration that `holoview calibrate` wrote",
    tensors=TENSORS,
    metadata_keys=("layout", "summary"),
)


@dataclass(frozen=True)
class CalibrationFile:
    """Learned maps and the summary of their calibration."""

    maps: LearnedMaps
    summary: dict[str, Any]


def write_calibration(path: str | os.PathLike[str], learned: LearnedMaps, summary: Mapping[str, Any]) -> None:
    """Writes the file atomically. Raises UserError when it can't be written."""
    tensors = {name: tensor.detach().float().numpy() for name, tensor in learned.tensors.items()}
    _FORMAT.write(path, tensors, {"layout": learned.layout.to_json(), "summary": json.dumps(summary)})


def read_calibration(path: str | os.PathLike[str]) -> CalibrationFile:
    """Reads the file. Raises UserError when it is missing, damaged, of another format, or holds wrong shapes or NaN."""
    arrays, texts = _FORMAT.read(path)
    layout = MapLayout.from_json(texts["layout"], f"{path}: layout")
    for name, shape in layout.shapes().items():
        if arrays[name].shape != shape:
            raise UserError(f"{path}: {name}", f"shape {arrays[name].shape}", expected=f"{shape}, as its layout says")
        if not bool(torch.isfinite(torch.from_numpy(arrays[name])).all()):
            raise UserError(f"{path}: {name}", "holds NaN or infinity", expected="finite numbers")
    tensors = {name: torch.from_numpy(arrays[name].copy()) for name in TENSORS}
    return CalibrationFile(LearnedMaps(layout, tensors), json.loads(texts["summary"]))
