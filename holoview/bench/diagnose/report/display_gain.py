"""The gain of the extended model on the display: holograms optimised with either model, shown on the extended bench."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from holoview.bench.diagnose.extended_model import add_effect_values, extended_system
from holoview.bench.diagnose.likelihood import Values
from holoview.holograms.metrics.fidelity import psnr
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.solve import iterate
from holoview.holograms.targets.target import target_for
from holoview.holograms.view import simulate
from holoview.light.model.effects.registry import get_effect
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.figures import CaptionedTile, contact_sheet, greyscale_pixels
from holoview.util.files import data_dir
from holoview.util.progress import ProgressCallback

Floats = NDArray[np.float64]

ITERATIONS = 40
"""[1] Of each hologram that is optimised. Evidence: measured: half a minute; the value: none recorded."""

_PICTURE = "resolution.png"
_GAMMA = 2.2  # of the display on which the sheet is seen


@dataclass(frozen=True, eq=False)
class DisplayGain:
    """PSNR (dB) on the extended bench of holograms optimised with either model; sheet: both images as a PNG file."""

    nominal_db: float
    extended_db: float
    iterations: int
    sheet: bytes

    @property
    def gain_db(self) -> float:
        """The gain of the extended model."""
        return self.extended_db - self.nominal_db


def display_gain(
    nominal: System,
    known: Values,
    found: Values,
    *,
    iterations: int = ITERATIONS,
    progress: ProgressCallback | None = None,
) -> DisplayGain | None:
    """Optimises a small hologram at the middle wavelength with both models and simulates both on the extended bench.

    known, found: effects of the nominal model, and those found beyond it. iterations: of each optimisation. Effects of
    the camera alone aren't seen on the display and are left out. Returns None where no other effect was found, or where
    patterns can't be optimised for the effects (those that split a laser into several wavelengths or moments).
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
    target = np.asarray(stack, dtype=np.float64) @ np.array([0.2126, 0.7152, 0.0722])
    scaled = [_with_best_brightness(image, target) for image in shown]
    quality = [psnr(image, target, peak=float(target.max())) for image in scaled]
    names = ("target", f"nominal model, {quality[0]:.1f} dB", f"extended model, {quality[1]:.1f} dB")
    tiles = [
        CaptionedTile(greyscale_pixels(np.clip(image[0], 0, 1) ** (1 / _GAMMA)), name)
        for image, name in zip((target, *scaled), names, strict=True)
    ]
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


def _with_best_brightness(image: Floats, target: Floats) -> Floats:
    """The image scaled to the least squared difference from the target."""
    return image * float((image * target).sum() / np.maximum((image * image).sum(), 1e-30))
