"""Captures whose camera, powers or exposures nobody stated: what is unknown is NaN, and is estimated here, and said.

Black level: the darkest pixels. Electrons a count and read noise: photon transfer (`numerics.photon_transfer`), of two
pictures of one pattern where there are such, else of the highest frequencies of each picture; where these don't tell,
a full pixel of 10 000 electrons is assumed and the noise is that of neighbouring dark pixels. Exposures (or powers):
the mean light of each picture, so that the pictures' brightnesses say nothing any more.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Camera, Captures
from holoview.light.numerics.photon_transfer import PhotonTransfer, transfer_of_pictures, transfer_of_repeats

FULL_WELL = 10_000.0
"""Electrons of a full pixel, where nobody knows."""
_DARK_SHARE = 0.005  # of the pixels, the darkest, which tell the black level
_FEW = 4  # pictures whose dark noise tells how well a black level was estimated
_MOST_PICTURES = 16  # whose noise is looked at


BLACK_LEVEL, GAIN, READ_NOISE, PLACE = "black level", "electrons a count", "read noise", "focal length and axis"
"""How the sentences of `Captures.estimated` begin on what a diagnosis may put right without calling it a fault."""
_BLACK_NOISES = 2.0  # standard deviations of dark pixels: of an estimated black level
_PLACE_PX, _SCALE_ERROR = 0.5, 0.005  # standard deviations, at best, of an axis and of a scale that speckle told
_PLACE_GRAINS = 1.0  # standard deviation of that axis in grains of speckle: coma moves them against the rays' middle
_GRAINS = 0.5  # standard deviation, in grains of speckle, of where the light lies farther out


def uncertainties(captures: Captures) -> dict[str, dict[str, float]]:
    """Standard deviations {effect: {parameter: value}} of settings that were estimated and that pictures tell better.

    A difference from them is no fault of the bench: nobody stated them.
    """
    found: dict[str, dict[str, float]] = {}
    if any(sentence.startswith(BLACK_LEVEL) for sentence in captures.estimated):
        found["camera_black"] = {"black": _BLACK_NOISES * max(dark_noise(image) for image in captures.images[:_FEW])}
    if any(sentence.startswith(PLACE) for sentence in captures.estimated):
        shift_m = max(_PLACE_PX, _PLACE_GRAINS * _grain_px(captures)) * captures.camera.pitch_m
        found["camera_alignment"] = {"shift_y": shift_m, "shift_x": shift_m, "magnification": _scale_error(captures)}
    return found


def _scale_error(captures: Captures) -> float:
    """Standard deviation of a scale that speckle told: grains λf/W wide tell where the light is to a part of a grain,
    and the light's r.m.s. distance (pixels) from its middle is the lever."""
    black, levers = captures.camera.black_level, list[float]()
    for image in captures.images[:_FEW]:
        light = np.maximum(image - (np.median(image) if math.isnan(black) else black), 0.0)
        y, x = np.indices(light.shape)
        middle = [float((light * axis).sum() / max(light.sum(), 1.0)) for axis in (y, x)]
        square = np.square(y - middle[0]) + np.square(x - middle[1])
        levers.append(math.sqrt(float((light * square).sum() / max(light.sum(), 1.0))))
    return max(_SCALE_ERROR, _GRAINS * _grain_px(captures) / max(*levers, 1.0))


def _grain_px(captures: Captures) -> float:
    """Width λf/W of the grains on a Fourier bench, in camera pixels; 0 elsewhere."""
    if captures.focal_length_m is None:
        return 0.0
    width_m = max(captures.levels.shape[2:]) * captures.slms[0].pitch_m
    return float(captures.wavelength_m.max()) * captures.focal_length_m / width_m / captures.camera.pitch_m


def has_unknown(captures: Captures) -> bool:
    """Whether the black level, the gain, the read noise, a power or an exposure is NaN."""
    c = captures.camera
    camera = (c.black_level, c.electrons_per_count, c.read_noise)
    return any(map(math.isnan, camera)) or bool(np.isnan([captures.power, captures.exposure_s]).any())


def with_estimates(captures: Captures, compression_counts: float = 0.0) -> Captures:
    """The captures with numbers for what is unknown; `estimated` says, in sentences, how and what it costs.

    compression_counts: r.m.s. error of compressed pictures, which adds to the read noise and hides the camera's own.
    """
    if not has_unknown(captures):
        return captures
    camera, notes = _camera(captures, compression_counts)
    captures, more = _settings(replace(captures, camera=camera))
    return replace(captures, estimated=(*captures.estimated, *notes, *more))


def _camera(captures: Captures, compression_counts: float) -> tuple[Camera, list[str]]:
    camera, notes = captures.camera, list[str]()
    some = np.unique(np.linspace(0, len(captures) - 1, _MOST_PICTURES).round().astype(int)).tolist()
    if math.isnan(camera.black_level):
        counts = np.concatenate([captures.images[k][captures.usable_pixels(k)] for k in some])
        camera = replace(camera, black_level=float(np.quantile(counts, _DARK_SHARE)))
        share = 100 * _DARK_SHARE
        notes.append(f"{BLACK_LEVEL} {camera.black_level:g} counts, from the darkest {share:g} % of the pixels")
    if not (math.isnan(camera.electrons_per_count) or math.isnan(camera.read_noise)):
        return camera, notes
    found, how = (None, "") if compression_counts else _transfer(captures, camera.black_level, some)
    if found is None:
        gain, noise = FULL_WELL / camera.saturation, _dark_noise(captures, some)
        noise = math.hypot(noise, compression_counts)
        told = "the pictures don't tell it: assumed, a full pixel of 10 000 electrons"
        noise_told = "from neighbouring dark pixels" + (" and the JPEG's steps" if compression_counts else "")
    else:
        gain, noise = found.electrons_per_count, max(found.read_noise_counts, 0.1)
        told = f"{how}, to {100 * found.relative_error:.0f} % (one standard deviation)"
        noise_told = how
    if math.isnan(camera.electrons_per_count):
        camera = replace(camera, electrons_per_count=gain)
        notes.append(f"{GAIN} {gain:.3g}: {told}; χ²/n is relative to it")
    if math.isnan(camera.read_noise):
        camera = replace(camera, read_noise=noise * camera.electrons_per_count)
        notes.append(f"{READ_NOISE} {noise:.2g} counts ({camera.read_noise:.3g} electrons): {noise_told}")
    return camera, notes


def _transfer(captures: Captures, black: float, some: list[int]) -> tuple[PhotonTransfer | None, str]:
    def light(k: int) -> NDArray[np.float64]:
        return captures.images[k].astype(np.float64) - black

    usable = {k: captures.usable_pixels(k) & (captures.images[k] < captures.camera.saturation) for k in some}
    for first in some:
        for second in (k for k in some if k > first and _is_repeat(captures, first, k)):
            found = transfer_of_repeats(light(first), light(second), usable[first] & usable[second])
            if found is not None:
                return found, f"from pictures {first} and {second} of the same pattern"
    found = transfer_of_pictures([light(k) for k in some], [usable[k] for k in some])
    return found, "from the finest structure of the pictures"


def _is_repeat(captures: Captures, first: int, second: int) -> bool:
    same = (captures.levels, captures.wavelength_m, captures.distance_m)
    return all(np.array_equal(column[first], column[second]) for column in same)


def _dark_noise(captures: Captures, some: list[int]) -> float:
    return float(np.median([dark_noise(captures.images[k]) for k in some]))


def dark_noise(picture: NDArray[np.unsignedinteger] | NDArray[np.floating]) -> float:
    """Standard deviation (counts) of dark pixels, from differences of neighbours in the darkest tenth, at least 0.3."""
    light = picture.astype(np.float64)
    means = (light[:, 1:] + light[:, :-1]) / 2
    differences = (light[:, 1:] - light[:, :-1])[means <= np.quantile(means, 0.1)]
    return max(float(differences.std()) / math.sqrt(2), 0.3) if len(differences) else 0.3


def _settings(captures: Captures) -> tuple[Captures, list[str]]:
    """Unknown powers and exposures from the light of the pictures, relative to the brightest of each wavelength."""
    power, exposure, notes = captures.power.copy(), captures.exposure_s.copy(), list[str]()
    no_power, no_exposure = np.isnan(power), np.isnan(exposure)
    light = np.array(
        [
            max(float(image[captures.usable_pixels(k)].mean()) - captures.camera.black_level, 1e-3)
            for k, image in enumerate(captures.images)
        ]
    )
    for wavelength_m in captures.wavelengths_m:
        same = captures.wavelength_m == wavelength_m
        light[same] /= light[same].max()
    if no_power.any():
        power[no_power] = np.where(no_exposure, 1.0, light / np.where(no_exposure, 1.0, exposure))[no_power]
    if no_exposure.any():
        exposure[no_exposure] = np.where(no_power, light, light / power)[no_exposure]
    if (no_power | no_exposure).any():
        names = " and ".join(name for name, some in (("powers", no_power), ("exposures", no_exposure)) if some.any())
        cost = "nothing that shows in the brightness of whole pictures can be told"
        notes.append(f"{names} from the pictures' own light: {cost}")
    return replace(captures, power=power, exposure_s=exposure), notes
