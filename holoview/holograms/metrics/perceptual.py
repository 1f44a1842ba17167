"""How an image looks to a person beside its target: MS-SSIM, FLIP and ColorVideoVDP.

`measure_score` computes them by their names in `holoview.holograms.metrics.perceptual_scores`.

`band_contrast` is the contrast of an image in a band of visual spatial frequencies.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from holoview.holograms.metrics.fidelity import PlaneScores, Stack, as_stacks
from holoview.holograms.metrics.perceptual_scores import samples_per_degree
from holoview.holograms.view import View
from holoview.light.colour import SRGB_TO_XYZ, gamut_map, srgb_encode
from holoview.light.numerics.structural_similarity import WINDOW, multi_scale_similarity, scale_count
from holoview.util.errors import UserError
from holoview.util.packages import import_optional

Image = NDArray[np.floating]


def measure_score(name: str, image: Image, target: Image, density: float) -> PlaneScores:
    """A score of linear sRGB images (y, x, 3) or stacks (plane, y, x, 3), not clipped.

    density: samples a degree of visual angle. White is 100 cd/m² for ColorVideoVDP.
    Raises UserError for a score that isn't installed, and for images that have other shapes or are too small for it.
    """
    return _MEASURES[name](image, target, density)


def measure_perceptual_scores(view: View, stack: Image, names: Sequence[str]) -> dict[str, PlaneScores]:
    """The named scores of a view against its target (plane, y, x, 3) in linear sRGB.

    The visual angle is that of the view's eyepiece, and without an eye that of the default one. Raises UserError as
    `measure_score` does.
    """
    angle = view.degrees_per_sample
    density = samples_per_degree(view.pitch_m, None) if angle is None else 1 / angle
    return {name: measure_score(name, view.rgb, stack, density) for name in names}


# --- MS-SSIM ----------------------------------------------------------------------------------------------------------

# Speckle, blur and lost detail lower it; an error of brightness that is even over a neighbourhood hardly does. So read
# it beside the PSNR or the colour difference. It is computed of encoded sRGB clipped to 0…1, since its constants are
# made for a display signal, channel by channel, as `holoview.light.numerics.structural_similarity` states with its
# source. Nothing is fitted: brightness counts as it is.


@dataclass(frozen=True)
class MsSsim(PlaneScores):
    """MS-SSIM of an image or a focal stack, 1 for equal ones.

    scales: number of scales, 5 from 176 rows and columns on. Values of different numbers can't be compared.
    """

    scales: int


def ms_ssim(image: ArrayLike, target: ArrayLike) -> MsSsim:
    """MS-SSIM of linear sRGB images (y, x, 3) or stacks (plane, y, x, 3): the mean over channels.

    Raises UserError when the shapes differ, aren't those of images, or have fewer than 11 rows or columns.
    """
    values, expected = as_stacks(image, target)
    scales = scale_count((values.shape[-3], values.shape[-2]))
    if scales == 0:
        found = f"{values.shape[-2]} x {values.shape[-3]} samples"
        raise UserError("image", found, expected=f"at least {WINDOW} rows and columns for MS-SSIM")
    pairs = zip(_signals(values), _signals(expected), strict=True)
    planes = tuple(float(multi_scale_similarity(seen, wanted).mean()) for seen, wanted in pairs)
    return MsSsim(float(np.mean(planes)), planes, scales)


def _signals(light: Stack) -> torch.Tensor:
    """The display signals (plane, channel, y, x), 0…1, of light (plane, y, x, 3)."""
    signal = srgb_encode(gamut_map(light))
    return torch.from_numpy(np.ascontiguousarray(np.moveaxis(signal, -1, 1)))


# --- FLIP -------------------------------------------------------------------------------------------------------------

# Colours are filtered by the contrast sensitivity of the eye at the given visual angle and compared in a space of equal
# differences; edges and points that appear or vanish count more. 0 is no difference, 1 the largest: green beside blue.
# The mean over all samples is the score that the authors recommend (P. Andersson, J. Nilsson, T. Akenine-Möller,
# M. Oskarsson, K. Åström and M. D. Fairchild, "FLIP: A Difference Evaluator for Alternating Images", Proc. ACM Comput.
# Graph. Interact. Tech. 3(2), 15 (2020)), computed by their own program.
#
# This is FLIP for a low dynamic range: of encoded sRGB, clipped to 0…1 as a screen does it. Light beyond white, such as
# bright grains of speckle, counts as white. Nothing is fitted: brightness counts as it is.


def flip(image: ArrayLike, target: ArrayLike, samples_per_degree: float) -> PlaneScores:
    """Mean FLIP of linear sRGB images (y, x, 3) or stacks (plane, y, x, 3); 0 for equal ones.

    samples_per_degree: of visual angle, the more the finer detail must be to go unnoticed.

    Raises UserError when the shapes differ or aren't those of images, for an angle that isn't positive, and without the
    library flip-evaluator.
    """
    library = import_optional("flip_evaluator", "FLIP")
    if not samples_per_degree > 0:
        raise UserError("FLIP", f"{samples_per_degree:g} samples a degree", expected="a positive number")
    planes = tuple(
        float(library.evaluate(wanted, seen, "LDR", True, False, True, {"ppd": samples_per_degree})[1])
        for seen, wanted in zip(*(_flip_signals(stack) for stack in as_stacks(image, target)), strict=True)
    )
    return PlaneScores(float(np.mean(planes)), planes)


def _flip_signals(light: Stack) -> NDArray[np.float32]:
    """The display signals (plane, y, x, channel), 0…1, of light (plane, y, x, 3)."""
    return np.ascontiguousarray(srgb_encode(gamut_map(light)), dtype=np.float32)


# --- ColorVideoVDP, in just-objectionable differences (JOD) -----------------------------------------------------------

# 10 JOD are no visible difference. Of two images that are 1 JOD apart, 75 % of people prefer the better one; strong
# errors may lead below 0. The metric filters light by the contrast sensitivity of the eye for luminance and colour, at
# its visual angle and absolute luminance, and lets structure mask errors (R. K. Mantiuk, P. Hanji, M. Ashraf, Y. Asano
# and A. Chapiro, "ColorVideoVDP: A visual difference predictor for image, video and display distortions", ACM Trans.
# Graph. 43(4), 129 (2024)). It is computed by its authors' program, as for a still image.
#
# The light itself is compared, as XYZ in cd/m², without a screen between: grains of speckle that are brighter than
# white and colours outside sRGB count as they are. Two things are approximate: holoview's XYZ is the eye's XYZ_F of
# cone fundamentals, which the metric takes for CIE 1931 XYZ; and the metric was fitted to judgements of pictures on
# screens, with few images of lasers and speckle among them. Its pyramid needs images of 16 rows and columns, and its
# coarsest band depends on the size: values of images of different sizes can't be compared.


WHITE_CD_M2 = 100.0
"""Luminance of the display's white, Y = 1, unless another one is given."""

MIN_SIDE = 16
"""Least number of rows and columns of an image."""

_BLACK_CD_M2 = 0.005  # the least light that the metric's own model of a display gives


def color_video_vdp(
    image: ArrayLike, target: ArrayLike, samples_per_degree: float, white_cd_m2: float = WHITE_CD_M2
) -> PlaneScores:
    """JOD of linear sRGB images (y, x, 3) or stacks (plane, y, x, 3), not clipped; 10 for equal ones.

    samples_per_degree: of visual angle. white_cd_m2: luminance of Y = 1, on which depends what can be seen.

    Raises UserError when the shapes differ or aren't those of images, for images with fewer than 16 rows or columns, an
    angle or a luminance that isn't positive, and without the library cvvdp.
    """
    library = import_optional("pycvvdp", "ColorVideoVDP")
    if not (samples_per_degree > 0 and white_cd_m2 > 0):
        found = f"{samples_per_degree:g} samples a degree, white of {white_cd_m2:g} cd/m²"
        raise UserError("ColorVideoVDP", found, expected="positive numbers")
    stacks = as_stacks(image, target)
    rows, columns = stacks[0].shape[1:3]
    if min(rows, columns) < MIN_SIDE:
        expected = f"at least {MIN_SIDE} rows and columns for ColorVideoVDP"
        raise UserError("image", f"{columns} x {rows} samples", expected=expected)
    metric = library.cvvdp(
        display_photometry=_light_itself(library),
        display_geometry=library.vvdp_display_geometry((columns, rows), ppd=samples_per_degree),
        quiet=True,
    )
    seen, wanted = (_absolute_xyz(stack, white_cd_m2) for stack in stacks)
    with torch.inference_mode():
        pairs = zip(seen, wanted, strict=True)
        planes = tuple(float(metric.predict(one, other, dim_order="CHW")[0]) for one, other in pairs)
    return PlaneScores(float(np.mean(planes)), planes)


def _absolute_xyz(light: Stack, white_cd_m2: float) -> torch.Tensor:
    """XYZ in cd/m² (plane, channel, y, x) of linear sRGB (plane, y, x, 3)."""
    xyz = np.maximum(white_cd_m2 * (light @ SRGB_TO_XYZ.T), _BLACK_CD_M2)
    return torch.from_numpy(np.ascontiguousarray(np.moveaxis(xyz, -1, 1), dtype=np.float32))


def _light_itself(library: Any) -> Any:
    """A model of a display for the metric that passes XYZ in cd/m² on as it is."""

    class LightItself(library.vvdp_display_photometry):  # type: ignore[misc]
        rgb2xyz_list = np.eye(3).tolist()

        def __init__(self) -> None:
            self.short_name = "light itself"

        def forward(self, xyz: torch.Tensor) -> torch.Tensor:
            return xyz

        def is_input_display_encoded(self) -> bool:
            return False

    return LightItself()


_MEASURES: dict[str, Callable[[Image, Image, float], PlaneScores]] = {
    "ms_ssim": lambda image, target, _: ms_ssim(image, target),
    "flip": flip,
    "jod": color_video_vdp,
}


# --- contrast in a band of frequencies --------------------------------------------------------------------------------


Band = tuple[float, float]


def band_contrast(image: NDArray[np.floating], degrees_per_sample: float, band: Band) -> float:
    """Root mean square of an image's part in a band of frequencies, over its mean.

    image: (y, x) luminance. degrees_per_sample: visual angle of a sample. band: lowest and highest frequency, cycles a
    degree. The image is multiplied by a Hann window, so that its borders don't count; a grating of modulation m has the
    contrast m/√2 (Michelson's is m).

    Raises UserError for an image that is dark, or too small or too coarse for the band.
    """
    spectrum = _band_spectrum(image, degrees_per_sample, band)
    return float(np.sqrt((np.abs(spectrum) ** 2).sum()))


def contrast_like(
    image: NDArray[np.floating], reference: NDArray[np.floating], degrees_per_sample: float, band: Band
) -> float:
    """The contrast in a band of the part of an image that is like a reference of the same shape (y, x).

    The part is the reference's structure times the factor that fits best, so that speckle and other structure don't
    count; where contrast is reversed, it is negative. The other arguments are those of `band_contrast`, and of the
    reference with itself it is that.

    Raises UserError as `band_contrast` does.
    """
    seen, wanted = (_band_spectrum(each, degrees_per_sample, band) for each in (image, reference))
    size = float(np.sqrt((np.abs(wanted) ** 2).sum()))
    return float((wanted.conj() * seen).sum().real) / size if size > 0 else 0.0


def _band_spectrum(image: NDArray[np.floating], degrees_per_sample: float, band: Band) -> NDArray[np.complex128]:
    """Fourier coefficients in the band of an image over its mean, whose squares add to the squared contrast."""
    rows, columns = image.shape
    window = np.outer(np.hanning(rows), np.hanning(columns))
    total = float((image * window).sum())
    y, x = (np.fft.fftfreq(n, degrees_per_sample) for n in image.shape)
    frequency = np.hypot(y[:, None], x[None, :])
    inside = (frequency >= band[0]) & (frequency <= band[1])
    if total <= 0 or not inside.any() or band[1] > 0.5 / degrees_per_sample:
        raise UserError(
            "contrast",
            f"an image of {columns} x {rows} samples, {1 / degrees_per_sample:.3g} a degree",
            expected=f"light, and a size and a sampling for {band[0]:g} to {band[1]:g} cycles a degree",
        )
    mean = total / float(window.sum())
    spectrum = np.fft.fft2((image / mean - 1) * window)[inside]
    return np.asarray(spectrum / np.sqrt(image.size * float((window**2).sum())))
