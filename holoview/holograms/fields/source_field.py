"""The light before modulator 1 as a known complex field: measured, or computed by another program or another bench."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from holoview.holograms.fields.field_bench import lit_field
from holoview.holograms.fields.field_file import FIELD_FORMAT, read_field
from holoview.holograms.fields.reading import read_wavefield
from holoview.holograms.fields.wavefield import Wavefield
from holoview.light.model.effects.effect import Effect, FileParameter, Parameter, Values
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.files import require_file
from holoview.util.safetensors_file import format_of
from holoview.util.units import format_rounded

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.light.model.effects.hook_contexts import ModulatorContext

_NEAREST = 0.02  # of a wavelength: how far that of the field may be from the laser's


class SourceField(Effect):
    """A complex field multiplies the plane waves of the source, on the axis or tilted, at the samples of modulator 1.

    The field of the file is brought over `distance` by the angular spectrum, and sampled there by the band-limited sum
    over its frequencies, which is exact: its pitch may be any, its middle is that of the modulator, and light that its
    window doesn't hold is dark. Its mean intensity over the modulator becomes 1, that of the plane wave, at each
    wavelength, because the powers of the lasers are properties of the bench.
    """

    id = "source_field"
    cause = "The light before modulator 1 is a known complex field, not a plane wave."
    finding = "The light before modulator 1 is that of {file}."
    parameters = (
        FileParameter("file", "A complex field, in any format that `holoview info` reads."),
        Parameter("distance", "From the field's plane to modulator 1.", "mm", low=-2.0, high=2.0, prior=1e-3),
    )
    acts_on = ("source",)
    order = 3  # it lights what the modulator leaves unmodulated too
    listed: ClassVar[bool] = False

    def actual_system(self, system: System, v: Values) -> System:
        field = self._field(v)
        for λ in system.wavelengths_m:
            _wavelength_index(field, float(λ))
        return system

    def transmission(self, transmission: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        self._field(v)
        shape = tuple(n * context.upsample for n in context.shape)
        window = (*shape, context.pitch_m / context.upsample)
        light = _sampled_light(*_version(v), context.wavelength_m, float(v["distance"]), window)
        return context.sampled(transmission) * light.to(transmission.dtype).to(transmission.device)

    def _field(self, v: Values) -> Wavefield:
        """The field in the file. Raises UserError when there is none, or one that changes from frame to frame."""
        require_file(str(v["file"]), "a complex field: the light before modulator 1")
        return _read(*_version(v))


def _version(v: Values) -> tuple[str, int]:
    """The name of the file and the time of its last change, by which a changed file is read again."""
    file = str(v["file"])
    return file, Path(file).stat().st_mtime_ns


@lru_cache(maxsize=2)
def _read(file: str, changed_ns: int) -> Wavefield:
    if format_of(file) == FIELD_FORMAT:
        field = read_field(file)[0]
    else:
        reading = read_wavefield(file)
        if reading.wavefield is None:
            remedy = f"`holoview export {file} --field light.safetensors` makes one of it"
            raise UserError(file, "a camera's recording", expected="a complex field", remedy=remedy)
        field = reading.wavefield
    if field.frames > 1:
        raise UserError(file, f"{field.frames} frames", expected="one: the light stays the same")
    return field


def _wavelength_index(field: Wavefield, wavelength_m: float) -> int:
    """The index of the field's wavelength that is a laser's. Raises UserError where it has none so near."""
    index = int(np.abs(field.wavelengths_m - wavelength_m).argmin())
    if abs(field.wavelengths_m[index] / wavelength_m - 1) > _NEAREST:
        known = ", ".join(format_rounded(float(λ), "nm") for λ in field.wavelengths_m)
        found = f"no light of {format_rounded(wavelength_m, 'nm')}, but of {known}"
        raise UserError(field.name or "field", found, expected="a field of each laser's wavelength, within 2 %")
    return index


@lru_cache(maxsize=16)
def _sampled_light(
    file: str, changed_ns: int, wavelength_m: float, distance_m: float, window: tuple[int, int, float]
) -> Any:
    """The light (y, x) complex64 at the samples of a window (rows, columns, pitch), as a tensor."""
    import torch

    from holoview.light.optics.free_space import AngularSpectrum, SampleWindow

    field = _read(file, changed_ns)
    values = torch.from_numpy(lit_field(field)[0, _wavelength_index(field, wavelength_m)].astype(np.complex128))
    rows, columns, pitch_m = window
    there = SampleWindow((rows, columns), (pitch_m, pitch_m))
    path = AngularSpectrum.make(field.shape, field.pitch_m, wavelength_m, distance_m, there)
    light = path.propagate(values)
    mean = float(light.abs().square().mean())
    if not mean > 0:
        raise UserError(file, "no light on modulator 1", expected="a field that overlaps it")
    return (light / math.sqrt(mean)).to(torch.complex64)
