"""The bench as `holoview calibrate` learned it from captures: maps in a file instead of numbers."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from holoview.effects.effect import Effect
from holoview.effects.parameter import FileParameter, Values
from holoview.errors import UserError
from holoview.system import System

if TYPE_CHECKING:
    from torch import Tensor

    from holoview.effects.learned import Learned
    from holoview.effects.places import Aperture, Surface


class Calibrated(Effect):
    """Tables, source, warp and pupils of a calibration, as `holoview.effects.learned` describes them."""

    id = "calibrated"
    cause = "The bench differs from its description in ways that a calibration has learned."
    finding = "The bench is as {file} describes it."
    parameters = (FileParameter("file", "The maps that a calibration wrote."),)
    where = ("source", "modulator 1", "relay 1", "modulator 2", "relay 2")
    order = 5  # maps were learned on top of what has a name
    listed: ClassVar[bool] = False

    def learned(self, v: Values) -> Learned:
        """The maps; UserError where the file is missing or isn't one."""
        file = str(v["file"])
        if not Path(file).is_file():
            expected = "the maps of a calibration, beside the preset that names them"
            raise UserError(f"effects.{self.id}: {file}", "no such file", expected=expected)
        return _read(file, Path(file).stat().st_mtime_ns)

    def bench(self, system: System, v: Values) -> System:
        learned = self.learned(v)
        count, known = len(system.modulators), learned.layout.modulators
        if count != known:
            raise UserError(str(v["file"]), f"maps of {known} modulators", expected=f"a bench of {known}, not {count}")
        return system

    def response(self, share: Tensor, at: Surface, v: Values) -> Tensor:
        return self.learned(v).response(share, at.number)

    def path(self, path_m: Tensor, at: Surface, v: Values) -> Tensor:
        learned = self.learned(v)
        return learned.fringed(path_m, at) if learned.has("fringing_px2") else path_m

    def transmission(self, light: Tensor, at: Surface, v: Values) -> Tensor:
        learned = self.learned(v)
        if at.number == 0:
            source = learned.source(at).to(light.dtype)
            return light * (source if light.shape == source.shape else at.sampled(source))
        return learned.warped(light, at) if learned.has("warp_m") else light

    def pupil(self, pupil: Tensor, at: Aperture, v: Values) -> Tensor:
        return self.learned(v).pupil(pupil, at)


@lru_cache(maxsize=4)
def _read(file: str, changed_ns: int) -> Learned:
    """The maps of a file; read again when it changed."""
    from holoview.effects.learned_file import read_learned  # here: needs torch

    return read_learned(file).learned
