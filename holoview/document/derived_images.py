"""Images derived from a hologram other than its focal planes: the phase of a pattern, and the eyebox.

Both are computed in torch, which takes a second to import: call them on a worker thread.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from holoview.document.document import Drive
from holoview.engine.frame import spectrum_behind_modulators
from holoview.model.plan import make_plan
from holoview.model.system import System
from holoview.optics.first_order import first_order


def phase_turns(system: System, drive: Drive, frame: int, modulator: int) -> NDArray[np.float32]:
    """Phase (y, x) of a modulator's pattern at the median wavelength, in turns modulo 1: 2π radians are one turn."""
    import torch  # slow start: a viewer begins with neither image

    from holoview.optics.slm import optical_path

    wavelength_m = float(np.sort(system.wavelengths_m)[len(system.wavelengths_m) // 2])
    path_m = optical_path(torch.from_numpy(drive[frame, modulator].copy()), system.modulators[modulator])
    turns: NDArray[np.float32] = torch.remainder(path_m / wavelength_m, 1.0).numpy()
    return turns


def eyebox_xyz(
    system: System, drive: Drive, by_place: bool = False, check: Callable[[], None] = lambda: None
) -> NDArray[np.float32]:
    """XYZ (y, x, 3) of the light in the first diffraction order of the last modulator: the eyebox.

    By spatial frequency, 0 is in the middle and the edges are at ±1/(2·pitch), where the angle of a laser is
    ±λ/(2·pitch). By place behind an eyepiece, it is a square up to the edge of the longest wavelength; the others fill
    less of it.
    The light is taken behind the stops of relay 2 and includes the envelope of a pixel's aperture; it is scaled to a
    mean luminance of 1/4. The grid isn't padded, so the resolution is one period of the grid. The eye of the system
    doesn't count. `check` is called before each spectrum and may raise an exception to cancel.
    """
    from holoview.engine.torch_executor import TorchExecutor
    from holoview.optics.frame_inputs import FrameInputs

    plan = make_plan(system.edit({"propagation": "periodic", "eye": None}))
    executor, order = TorchExecutor(plan, FrameInputs(plan, drive)), first_order(plan.grid)
    rows, columns = order.bins
    shape = (max(len(rows), len(columns)),) * 2 if by_place else (len(rows), len(columns))
    xyz = np.zeros((*shape, 3))
    band = np.ix_(*(k % padded for k, padded in zip(executor.frequencies(1), plan.grid.padded, strict=True)))
    power = np.zeros(plan.grid.padded)
    for wavelength, λ in enumerate(plan.system.wavelengths_m):
        for frame in plan.lit(wavelength):
            for source in range(len(plan.slopes)):
                check()
                spectrum = spectrum_behind_modulators(executor, wavelength, frame, source)
                passed = executor.transmit(spectrum, 1, wavelength, float(system.planes_m[0]))
                power[band] = passed.values.abs().square().numpy()
                seen = power[np.ix_(rows, columns)]
                if by_place:
                    seen = _by_place(seen, float(λ / plan.system.wavelengths_m.max()))
                share = float(plan.weights[frame, wavelength]) / len(plan.slopes)
                xyz += share * seen[..., None] * plan.colour_weights[wavelength]
    mean = xyz[..., 1].mean()
    return (xyz / (4 * mean) if mean > 0 else xyz).astype(np.float32)


def _by_place(power: NDArray[np.float64], factor: float) -> NDArray[np.float64]:
    """A first order (y, x), by frequency, as a square picture of the eyebox whose sum is the same.

    factor: side of this wavelength's eyebox over that of the picture, at most 1. Linear interpolation.
    """
    side, matrices = max(power.shape), []
    for n in power.shape:
        at = (np.arange(side) - side // 2) * (n / (side * factor)) + n // 2
        below = np.floor(at).astype(int)
        matrix = np.zeros((side, n))
        for index, weight in ((below, 1 - (at - below)), (below + 1, at - below)):
            inside = (index >= 0) & (index < n)
            matrix[np.flatnonzero(inside), index[inside]] += weight[inside]
        matrices.append(matrix * (n / (side * factor)))
    placed: NDArray[np.float64] = matrices[0] @ power @ matrices[1].T
    return placed
