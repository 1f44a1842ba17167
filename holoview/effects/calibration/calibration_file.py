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

from holoview.effects.calibration.learned_maps import LearnedMaps
from holoview.effects.calibration.map_schema import MAP_SCHEMAS, map_sizes, read_layout
from holoview.util.safetensors_file import TensorFormat
from holoview.util.tables import parse_json_table

_FORMAT = TensorFormat(
    name="holoview-calibration",
    version="1",
    what="the maps of a calibration that `holoview calibrate` wrote",
    tensors=MAP_SCHEMAS,
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
    """Reads the file. Raises UserError when it is missing, damaged, of another format, or not as `map_schema` says."""
    with _FORMAT.open(path) as file:
        layout = read_layout(file.texts["layout"], f"{path}: layout")
        summary = parse_json_table(file.texts["summary"], f"{path}: summary", "the scores of a calibration")
        arrays = file.tensors(map_sizes(layout))
    maps = LearnedMaps(layout, {name: torch.from_numpy(array) for name, array in arrays.items()})
    return CalibrationFile(maps, summary)
