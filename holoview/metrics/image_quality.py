"""How good a hologram is: fidelity, speckle and eyebox together, because PSNR alone rewards an empty eyebox."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.colour import SRGB_TO_XYZ
from holoview.engine.frame import spectrum_behind_modulators
from holoview.engine.torch_executor import TorchExecutor
from holoview.io.hologram import Hologram
from holoview.metrics.delta_e import delta_e_linear_srgb
from holoview.metrics.eyebox import EyeboxUniformity, eyebox_uniformity
from holoview.metrics.psnr import Psnr, psnr_linear_srgb, psnr_luminance
from holoview.metrics.speckle import SpeckleContrast, speckle_contrast
from holoview.model.plan import make_plan
from holoview.numerics.image_region import Region
from holoview.optics.first_order import EYEBOX_BLOCKS, first_order
from holoview.optics.frame_inputs import make_frame_inputs
from holoview.view import View


@dataclass(frozen=True)
class ImageQuality:
    """Fidelity of a view to its target, at fixed brightness; speckle of the luminance, structure removed, by plane."""

    psnr: Psnr
    psnr_luminance: Psnr
    delta_e: float
    speckle: tuple[SpeckleContrast, ...]

    @property
    def mean_speckle_contrast(self) -> float:
        """Mean speckle contrast over the planes."""
        return float(np.mean([plane.contrast for plane in self.speckle]))


def measure_image_quality(view: View, stack: NDArray[np.floating], region: Region | None = None) -> ImageQuality:
    """Scores a view against its target (plane, y, x, 3) in linear sRGB; region (x, y, w, h) px is for the speckle."""
    wanted = np.asarray(stack) @ SRGB_TO_XYZ.T
    chosen = region or central_region(stack.shape[1:3])
    return ImageQuality(
        psnr=psnr_linear_srgb(view.rgb, stack),
        psnr_luminance=psnr_luminance(view.xyz, wanted),
        delta_e=delta_e_linear_srgb(np.clip(view.rgb, 0, 1), np.clip(stack, 0, 1)),
        speckle=tuple(
            speckle_contrast(seen[..., 1], region=chosen, target=known[..., 1])
            for seen, known in zip(view.xyz, wanted, strict=True)
        ),
    )


def central_region(shape: tuple[int, ...]) -> Region:
    """The central half of an image of (rows, columns), as (x, y, w, h)."""
    rows, columns = shape[0], shape[1]
    return columns // 4, rows // 4, columns // 2, rows // 2


def plane_midpoints(planes_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distances in the middle between neighbouring planes."""
    ordered = np.unique(planes_m)
    middle: NDArray[np.float64] = (ordered[1:] + ordered[:-1]) / 2
    return middle


def eyebox_uniformity_of(hologram: Hologram) -> EyeboxUniformity:
    """Uniformity of the light behind relay 2's stops, over the modulator's first order.

    Lasers add by luminance at equal spatial frequency: every wavelength fills its own first order, |f| ≤ 1/(2·pitch).
    """
    system = hologram.system
    plan = make_plan(system, system.planes_m[:1])
    executor = TorchExecutor(plan, make_frame_inputs(plan, hologram.drive))
    power = np.zeros(plan.grid.padded)
    for wavelength in range(len(plan.system.wavelengths_m)):
        stop = executor.transfer(1, wavelength, 0.0).abs().square().numpy()  # at no distance only stops are left
        for frame in plan.lit(wavelength):
            weight = plan.weights[frame, wavelength] * plan.colour_weights[wavelength, 1]
            for source in range(len(plan.slopes)):
                spectrum = spectrum_behind_modulators(executor, wavelength, frame, source)
                power += weight * stop * spectrum.abs().square().numpy()
    order = first_order(plan.grid)
    return eyebox_uniformity(power[np.ix_(*order.bins)], EYEBOX_BLOCKS, np.outer(*order.envelopes))
