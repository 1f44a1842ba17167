"""Other pictures of a hologram than what is seen: the phase of its patterns, and where its light leaves to."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.engine.frame import spectrum_behind_modulators
from holoview.engine.torch_executor import TorchExecutor
from holoview.model.plan import make_plan
from holoview.model.system import System
from holoview.optics.first_order import first_order
from holoview.optics.frame_inputs import make_frame_inputs
from holoview.optics.slm import optical_path
from holoview.session.document import Drive


def phase_turns(system: System, drive: Drive, frame: int, modulator: int) -> NDArray[np.float32]:
    """Phase (y, x) of a modulator's pattern in turns, 0…1, at the laser in the middle of the spectrum."""
    wavelength_m = float(np.sort(system.wavelengths_m)[len(system.wavelengths_m) // 2])
    path_m = optical_path(torch.from_numpy(drive[frame, modulator].copy()), system.modulators[modulator])
    turns: NDArray[np.float32] = torch.remainder(path_m / wavelength_m, 1.0).numpy()
    return turns


def eyebox_xyz(system: System, drive: Drive, check: Callable[[], None] = lambda: None) -> NDArray[np.float32]:
    """XYZ (y, x, 3) of the light in the first order of the last modulator, by direction: the eyebox.

    The direction without any tilt is in the middle, and the edges are at ±1/(2·pitch) cycles a metre: a laser's angle
    there is ±λ/(2·pitch). Behind the stops of relay 2, with the pixel's envelope in it; the mean luminance is 1/4. On
    a grid without padding, so one direction's neighbours aren't told apart. `check` is called between wavelengths and
    may raise.
    """
    plan = make_plan(system.edit({"propagation": "periodic"}))
    executor, order = TorchExecutor(plan, make_frame_inputs(plan, drive)), first_order(plan.grid)
    rows, columns = order.bins
    seen = np.zeros((len(rows), len(columns), 3))
    for wavelength in range(len(system.wavelengths_m)):
        for frame in plan.lit(wavelength):
            for source in range(len(plan.slopes)):
                check()
                spectrum = spectrum_behind_modulators(executor, wavelength, frame, source)
                passed = executor.transmit(spectrum, 1, wavelength, float(system.planes_m[0]))
                power = passed.abs().square().numpy()[np.ix_(rows, columns)]
                share = float(plan.weights[frame, wavelength]) / len(plan.slopes)
                seen += share * power[..., None] * plan.colour_weights[wavelength]
    mean = seen[..., 1].mean()
    return (seen / (4 * mean) if mean > 0 else seen).astype(np.float32)
