"""The power behind the last modulator or field and the stops of relay 2, from the spectrum there: in PyTorch."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.engine.frame import spectrum_behind_modulators
from holoview.engine.torch_executor import TorchExecutor
from holoview.model.passband import Transfer, rows_in_disc
from holoview.model.plan import Plan
from holoview.optics.bench import relay_response
from holoview.optics.frame_inputs import FrameInputs


def power_behind(plan: Plan, drive: Any) -> NDArray[np.float64]:
    """(wavelength,): power behind the last modulator or field and the stops of relay 2, from the spectrum there.

    drive: as of `simulate`. It takes the transforms of a frame up to the last spectrum, in PyTorch.
    """
    executor = TorchExecutor(replace(plan, planes=plan.planes[:1]), FrameInputs(plan, drive))
    ky, kx = (torch.from_numpy(k) for k in executor.frequencies(1))
    samples, power = math.prod(plan.grid.padded), np.zeros(len(plan.system.wavelengths_m))
    for wavelength in range(len(power)):
        pupil = executor.inputs.pupils[1][wavelength]
        passed = relay_response(_stops(plan, wavelength), ky, kx, pupil, executor.dtype)
        passed = passed.real.square() + passed.imag.square()
        for frame in plan.lit(wavelength):
            for source in range(len(plan.slopes)):
                values = spectrum_behind_modulators(executor, wavelength, frame, source).values
                squares = (values.real.square() + values.imag.square()) * passed
                power[wavelength] += float(plan.weights[frame, wavelength] * squares.double().sum()) / samples
    return power


def _stops(plan: Plan, wavelength: int) -> Transfer:
    """The way through the stops of relay 2 and the pupil of an eye alone, over no distance."""
    stops, eye = plan.stops(1, wavelength), plan.planes[0].eye
    if eye is None:
        return stops
    na, columns = eye.pupil_na(plan.nominal.field_m), plan.grid.padded[1]
    return replace(stops, support=rows_in_disc(stops.support, columns, na, eye.pupil_centre_na, stops.sine_step))
