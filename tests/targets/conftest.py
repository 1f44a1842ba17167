"""What tests of focal stacks share: small benches, and OpenEXR files of several parts or layers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from numpy.typing import NDArray

import holoview
from holoview.holograms.targets.focal_stack import StackSource, read_resized_pictures
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System

Bench = Callable[..., System]
"""(planes, shape): a bench with that many planes and a simulation grid of that shape."""

WriteExr = Callable[..., Path]
"""(path, *parts, **header): an OpenEXR file of parts (name, channels)."""

Layers = Callable[..., dict[str, NDArray[np.float32]]]
"""(stack, pattern): the channels 0.R, 0.G, 0.B, 1.R … of a stack, layers named by the pattern."""


def read_stack(
    source: StackSource, shape: tuple[int, int], space: str = "srgb", pictures: int | None = None
) -> NDArray[np.float32]:
    """The pictures of a rendered focal stack as (plane, y, x, 3) linear light."""
    return np.stack([picture.rgb for picture in read_resized_pictures(source, shape, space, pictures)])


@pytest.fixture
def bench() -> Bench:
    def make(planes: int, shape: tuple[int, int] = (6, 8)) -> System:
        modulator = {"pitch": "8 um", "shape": list(shape), "stroke": "825 nm"}
        changes = {
            "planes": [f"{9 + i / 2} mm" for i in range(planes)],
            "modulators": [modulator, modulator],
            "sampling": {"upsample": 1},
        }
        system = holoview.load("holochrome-8").edit(changes)
        assert make_plan(system).grid.shape == shape
        return system

    return make


@pytest.fixture
def write_exr() -> WriteExr:
    def write(path: Path, *parts: tuple[str, dict[str, NDArray[Any]]], **more: Any) -> Path:
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **more}
        with OpenEXR.File([OpenEXR.Part(dict(header), channels, name) for name, channels in parts]) as file:
            file.write(str(path))
        return path

    return write


@pytest.fixture
def layers() -> Layers:
    def named(stack: NDArray[np.float32], pattern: str = "{}") -> dict[str, NDArray[np.float32]]:
        return {
            f"{pattern.format(i)}.{colour}": picture[..., channel].copy()
            for i, picture in enumerate(stack)
            for channel, colour in enumerate("RGB")
        }

    return named
