"""Quality of a hologram: fidelity, speckle and eyebox together, because PSNR alone rewards an unevenly lit eyebox."""

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
from holoview.metrics.perceptual import MsSsim, ms_ssim
from holoview.metrics.psnr import Psnr, psnr_linear_srgb, psnr_luminance
from holoview.metrics.speckle import SpeckleContrast, speckle_contrast
from holoview.model.plan import make_plan
from holoview.numerics.structural_similarity import scale_count
from holoview.numerics.tensors import Region
from holoview.optics.first_order import EYEBOX_BLOCKS, first_order
from holoview.optics.frame_inputs import FrameInputs
from holoview.view import View


@dataclass(frozen=True)
class ImageQuality:
    """Fidelity of a view to its target at fixed brightness, and the speckle contrast of its luminance.

    psnr: of linear sRGB (dB). psnr_luminance: of luminance (dB). delta_e: mean CIEDE2000. ms_ssim: multi-scale
    structural similarity of encoded sRGB; None for images with fewer than 11 rows or columns. speckle: of each plane,
    with the target's structure divided out.
    """

    psnr: Psnr
    psnr_luminance: Psnr
    delta_e: float
    ms_ssim: MsSsim | None
    speckle: tuple[SpeckleContrast, ...]

    @property
    def mean_speckle_contrast(self) -> float:
        """Mean speckle contrast over the planes."""
        return float(np.mean([plane.contrast for plane in self.speckle]))


def measure_image_quality(view: View, stack: NDArray[np.floating], region: Region | None = None) -> ImageQuality:
    """The quality of a view against its target (plane, y, x, 3) in linear sRGB.

    region: (x, y, width, height) in samples, in which speckle is measured; the central half when None.
    """
    target_xyz = np.asarray(stack) @ SRGB_TO_XYZ.T
    speckle_region = region or central_region(stack.shape[1:3])
    return ImageQuality(
        psnr=psnr_linear_srgb(view.rgb, stack),
        psnr_luminance=psnr_luminance(view.xyz, target_xyz),
        delta_e=delta_e_linear_srgb(np.clip(view.rgb, 0, 1), np.clip(stack, 0, 1)),
        ms_ssim=ms_ssim(view.rgb, stack) if scale_count(stack.shape[1:3]) else None,
        speckle=tuple(
            speckle_contrast(xyz[..., 1], region=speckle_region, target=target[..., 1])
            for xyz, target in zip(view.xyz, target_xyz, strict=True)
        ),
    )


def central_region(shape: tuple[int, ...]) -> Region:
    """The central half of an image of (rows, columns), as (x, y, w, h)."""
    rows, columns = shape[0], shape[1]
    return columns // 4, rows // 4, columns // 2, rows // 2


def plane_midpoints(planes_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The distances (m) halfway between neighbouring planes, in rising order."""
    ordered = np.unique(planes_m)
    midpoints: NDArray[np.float64] = (ordered[1:] + ordered[:-1]) / 2
    return midpoints


def eyebox_uniformity_of(hologram: Hologram) -> EyeboxUniformity:
    """Uniformity of the light behind the stops of relay 2, over the modulator's first order, wherever an eye is.

    Lasers are summed by luminance at equal spatial frequency, since the first order of each wavelength is |f| ≤
    1/(2·pitch).
    """
    system = hologram.system.with_(eye=None)
    plan = make_plan(system, system.planes_m[:1])
    executor = TorchExecutor(plan, FrameInputs(plan, hologram.drive))
    power = np.zeros(plan.grid.padded)
    band = np.ix_(*(k % padded for k, padded in zip(executor.frequencies(1), plan.grid.padded, strict=True)))
    for wavelength in range(len(plan.system.wavelengths_m)):
        stop = executor.transfer(1, wavelength, 0.0).abs().square().numpy()  # |H|² at distance 0: the stops alone
        for frame in plan.lit(wavelength):
            weight = plan.weights[frame, wavelength] * plan.colour_weights[wavelength, 1]
            for source in range(len(plan.slopes)):
                spectrum = spectrum_behind_modulators(executor, wavelength, frame, source)
                power[band] += weight * stop * spectrum.values.abs().square().numpy()
    order = first_order(plan.grid)
    return eyebox_uniformity(power[np.ix_(*order.bins)], EYEBOX_BLOCKS, np.outer(*order.envelopes))
