"""Small benches on which the shaders are compared with torch: between them, they use every branch of every stage."""

from __future__ import annotations

from typing import Any

import numpy as np

from holoview.model.bench_parts import Modulator
from holoview.model.system import System

_P67 = [0, 0.0107, 0.0219, 0.045, 0.0598, 0.0775, 0.1206, 0.185, 0.3655, 0.3955, 0.451, 0.5244, 0.6393, 0.7116, 0.8502]
SOURCES = {"directions": [[0.0, 0.0], [0.01, -0.02], [-0.03, 0.005]]}
CHANGES: dict[str, dict[str, Any]] = {
    "two modulators": {},
    "one modulator": {"modulators": [{"pitch": "8 um", "shape": [25, 32], "stroke": "825 nm"}], "gap": None},
    "tilted sources": {"source": SOURCES},
    "a tilt for each wavelength": {"source": SOURCES | {"tilts": [[0.002, 0.0], [-0.001, 0.004]]}},
    "irises and a DC block": {"relay1.iris_na": 0.025, "relay2.iris_na": 0.02, "relay2.dc_block_na": 0.003},
    "glass in both relays": {
        "relay1": {"iris_na": 0.03, "aberration": {"Z5": "40 nm", "Z8": "-60 nm"}},
        "relay2": {"iris_na": 0.025, "apodisation_na": 0.02, "aberration": {"Z4": "70 nm"}},
    },
    "sixteen uneven levels": {"levels": [*_P67, 1]},
    "lasers in turn": {"amplitudes": [[2.0, 0.0], [0.0, 4.0], [0.5, 1.5]]},
    "one sample a pixel, periodic": {"upsample": 1, "propagation": "periodic"},
    "nine samples a pixel": {"upsample": 3},
    "250 x 384 samples, periodic": {"shape": [125, 192], "propagation": "periodic"},
    "first orders": {"relay1.square": "first order", "relay2.square": "first order"},
    "stops beside the axis": {
        "relay1": {"square": 0.02, "centre_na": [0.012, -0.02], "dc_block_na": 0.004},
        "relay2": {"iris_na": 0.02, "centre_na": [0.0, 0.025]},
        "source": SOURCES,
        "propagation": "periodic",
    },
    "one modulator, a stop, tilted sources": {
        "modulators": [{"pitch": "8 um", "shape": [25, 32], "stroke": "825 nm"}],
        "gap": None,
        "source": SOURCES,
        "relay2.square": "first order",
    },
    "compact": {"shape": [27, 45], "upsample": 3, "propagation": "compact", "relay2.iris_na": 0.01},
    "an eye": {
        "eye": {"pupil": "1.5 mm", "pupil_y": "0.4 mm", "pupil_x": "-0.3 mm", "accommodation": ["0.3 D", "2 D"]}
    },
    "an eye that moves as a whole, with a prescription": {
        "eye": {
            "eyepiece": "25 mm",
            "pupil": "auto",
            "pupil_x": "0.2 mm",
            "chromatic_axis": "pupil",
            "stiles_crawford": True,
            "prescription": {"sphere": "-0.5 D", "cylinder": "0.75 D", "axis": 30.0, "aberration": {"Z8": "60 nm"}},
        },
        "relay2.square": "first order",
    },
    "no gap, planes at zero and far": {"gap": 0.0, "planes": [0.0, "50 mm"], "propagation": "periodic"},
}
"""The changes of `parity_bench` that make each bench, by its name."""


def parity_bench(**changes: Any) -> System:
    """A bench of two modulators of 25 × 32 pixels, two lasers and two planes, with some of its keys changed."""
    modulator = Modulator(pitch_m=8e-6, shape=(25, 32), stroke_m=825e-9)
    base = System(
        wavelengths_m=np.array([460e-9, 638e-9]),
        amplitudes=np.array([[1.0, 2.0]]),
        modulators=(modulator, modulator),
        gap_m=1e-3,
        planes_m=np.array([3e-3, 4e-3]),
    )
    return base.edit(changes)
