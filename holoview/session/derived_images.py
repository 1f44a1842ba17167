"""Images derived from a hologram other than its focal planes: the phase of a pattern, and the eyebox.

Both are computed in torch, which takes a second to import: call them on a worker thread.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from holoview.engine.frame import spectrum_behind_modulators
from holoview.model.plan import make_plan
from holoview.model.system import System
from holoview.optics.first_order import first_order
from holoview.session.document import Drive


def phase_turns(system: System, drive: Drive, frame: int, modulator: int) -> NDArray[np.float32]:
    """Phase (y, x) of a modulator's pattern at the median wavelength, in turns modulo 1: 2π radians are one turn."""
    import torch  # slow start: a viewer begins with neither image

    from holoview.optics.slm import optical_path

    wavelength_m = float(np.sort(system.wavelengths_m)[len(system.wavelengths_m) // 2])
    path_m = optical_path(torch.from_numpy(drive[frame, modulator].copy()), system.modulators[modulator])
    turns: NDArray[np.float32] = torch.remainder(path_m / wavelength_m, 1.0).numpy()
    return turns


def eyebox_xyz(system: System, drive: Drive, check: Callable[[], None] = lambda: None) -> NDArray[np.float32]:
    """XYZ (y, x, 3) of the light in the first diffraction order of the last modulator, by direction: the eyebox.

    The spatial frequency 0 is in the middle and the edges are at ±1/(2·pitch), where the angle of a laser is
    ±λ/(2·pitch). The light is taken behind the stops of relay 2 and includes the envelope of a pixel's aperture; it is
    scaled to a mean luminance of 1/4. The grid isn't padded, so the resolution is one period of the grid. `check` is
    called before each spectrum and may raise an exception to cancel.
    """
    from holoview.engine.torch_executor import TorchExecutor
    from holoview.optics.frame_inputs import make_frame_inputs

    plan = make_plan(system.edit({"propagation": "periodic"}))
    executor, order = TorchExecutor(plan, make_frame_inputs(plan, drive)), first_order(plan.grid)
    rows, columns = order.bins
    xyz = np.zeros((len(rows), len(columns), 3))
    band = np.ix_(*(k % padded for k, padded in zip(executor.frequencies(1), plan.grid.padded, strict=True)))
    power = np.zeros(plan.grid.padded)
    for wavelength in range(len(system.wavelengths_m)):
        for frame in plan.lit(wavelength):
            for source in range(len(plan.slopes)):
                check()
                spectrum = spectrum_behind_modulators(executor, wavelength, frame, source)
                passed = executor.transmit(spectrum, 1, wavelength, float(system.planes_m[0]))
                power[band] = passed.values.abs().square().numpy()
                share = float(plan.weights[frame, wavelength]) / len(plan.slopes)
                xyz += share * power[np.ix_(rows, columns)][..., None] * plan.colour_weights[wavelength]
    mean = xyz[..., 1].mean()
    return (xyz / (4 * mean) if mean > 0 else xyz).astype(np.float32)
