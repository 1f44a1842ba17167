"""What a better model buys on the display: the same hologram optimised with both, shown on the bench as it is."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from holoview.diagnose.comparison import Values
from holoview.diagnose.extended_model import add_effect_values, extended_system
from holoview.model.effects.registry import get_effect
from holoview.model.system import System
from holoview.optimise.settings import Settings
from holoview.optimise.solve import iterate
from holoview.report.contact_sheet import CaptionedTile, contact_sheet
from holoview.targets.target import target_for
from holoview.util.errors import UserError
from holoview.util.files import data_dir
from holoview.util.progress import ProgressCallback
from holoview.view import simulate

Floats = NDArray[np.float64]

_ITERATIONS = 40
_PICTURE = "resolution.png"


@dataclass(frozen=True, eq=False)
class DisplayGain:
    """PSNR (dB) on the bench as it is, of holograms optimised with either model; a PNG sheet of both."""

    nominal_db: float
    extended_db: float
    iterations: int
    sheet: bytes

    @property
    def gain_db(self) -> float:
        """What the extended model gains."""
        return self.extended_db - self.nominal_db


def display_gain(
    nominal: System,
    known: Values,
    found: Values,
    *,
    iterations: int = _ITERATIONS,
    progress: ProgressCallback | None = None,
) -> DisplayGain | None:
    """Optimises a small hologram at the middle wavelength with both models and shows both on the extended bench.

    What only the camera does isn't seen on the display and is left out. None where nothing is left, or where patterns
    can't be optimised for the effects (those that split lasers into several lines or moments).
    """
    middle = float(nominal.wavelengths_m[len(nominal.wavelengths_m) // 2])
    bench = nominal.edit({"wavelengths": [middle], "amplitudes": [[1.0]]})
    before, after = (
        extended_system(bench, _without_camera_effects(values)) for values in (known, add_effect_values(known, found))
    )
    if before == after:
        return None
    stack = target_for(bench, data_dir("assets") / _PICTURE).stack
    settings = Settings(iterations=iterations, free=("patterns",), loss="mono")
    try:
        shown = [
            _optimise_and_simulate(model, after, stack, settings, progress, k)
            for k, model in enumerate((before, after))
        ]
    except UserError:
        return None
    wanted = np.asarray(stack, dtype=np.float64) @ np.array([0.2126, 0.7152, 0.0722])
    scaled = [_with_best_brightness(image, wanted) for image in shown]
    quality = [_psnr(image, wanted) for image in scaled]
    names = ("target", f"nominal model, {quality[0]:.1f} dB", f"extended model, {quality[1]:.1f} dB")
    tiles = [CaptionedTile(_grey(image[0]), name) for image, name in zip((wanted, *scaled), names, strict=True)]
    sheet = contact_sheet("On the bench as it is", ["", "", ""], [tiles], width=360)
    buffer = io.BytesIO()
    Image.fromarray(sheet).save(buffer, "PNG")
    return DisplayGain(quality[0], quality[1], iterations, buffer.getvalue())


def _without_camera_effects(values: Values) -> dict[str, dict[str, float]]:
    """Without effects of the camera alone."""
    return {name: dict(own) for name, own in values.items() if get_effect(name).acts_on != ("camera",)}


def _optimise_and_simulate(
    model: System,
    bench: System,
    stack: NDArray[np.floating],
    settings: Settings,
    progress: ProgressCallback | None,
    turn: int,
) -> Floats:
    """Intensity (plane, y, x) on `bench` of a hologram optimised with `model`."""
    state = None
    for state in iterate(model, stack, settings):
        if progress is not None:
            progress(turn * settings.iterations + state.iteration, 2 * settings.iterations, "holograms")
    assert state is not None
    view = simulate(bench, state.best.drive, backend="torch")
    return np.asarray(view.intensity, dtype=np.float64).sum(axis=1)


def _with_best_brightness(image: Floats, wanted: Floats) -> Floats:
    """The image at the brightness that suits the target best."""
    return image * float((image * wanted).sum() / np.maximum((image * image).sum(), 1e-30))


def _psnr(image: Floats, wanted: Floats) -> float:
    return float(10 * np.log10(wanted.max() ** 2 / np.mean(np.square(image - wanted))))


def _grey(image: Floats) -> NDArray[np.uint8]:
    shade = np.rint(255 * np.clip(image / 1.0, 0, 1) ** (1 / 2.2)).astype(np.uint8)
    return np.repeat(shade[..., None], 3, axis=2)
