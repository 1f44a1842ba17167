"""The power behind the last modulator or field and the stops of relay 2, from the spectrum there: in PyTorch."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.light.engine.frame import spectrum_behind_modulators
from holoview.light.engine.torch_executor import TorchExecutor, spectrum_power
from holoview.light.model.plan import Plan
from holoview.light.optics.frame_inputs import FrameInputs


def power_behind(plan: Plan, drive: Any) -> NDArray[np.float64]:
    """(wavelength,): power behind the last modulator or field and the stops of relay 2, from the spectrum there.

    drive: as of `simulate`. It takes the transforms of a frame up to the last spectrum, in PyTorch.
    """
    executor = TorchExecutor(plan, FrameInputs(plan, drive))
    power = np.zeros(len(plan.system.wavelengths_m))
    for wavelength in range(len(power)):
        passed = executor.passed_amplitude(wavelength)
        for frame in plan.lit(wavelength):
            for source in range(len(plan.slopes)):
                values = spectrum_behind_modulators(executor, wavelength, frame, source).values
                power[wavelength] += float(plan.weights[frame, wavelength]) * spectrum_power(values, passed)
    return power / math.prod(plan.grid.padded)
