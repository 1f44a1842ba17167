"""The effect that applies the maps of a file that `holoview calibrate` learned from captures."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar

from holoview.light.model.effects.effect import Effect, FileParameter, Values
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.files import require_file

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.light.model.effects.hook_contexts import ModulatorContext, RelayContext
    from holoview.light.model.effects.learned_maps import LearnedMaps


class Calibrated(Effect):
    """Response tables, fringing, source, warp and pupils of a calibration (`model.effects.learned_maps`)."""

    id = "calibrated"
    cause = "The bench differs from its description in ways that a calibration has learned."
    finding = "The bench is as {file} describes it."
    parameters = (FileParameter("file", "The maps that a calibration wrote."),)
    acts_on = ("source", "modulator 1", "relay 1", "modulator 2", "relay 2")
    order = 5  # the maps were learned with all other effects applied
    listed: ClassVar[bool] = False
    on_all_elements = True

    def maps(self, v: Values) -> LearnedMaps:
        """The maps in the file. Raises UserError when it is missing or isn't a calibration."""
        file = require_file(str(v["file"]), "the maps of a calibration, beside the preset that names them")
        return _read_cached(str(file), file.stat().st_mtime_ns)

    def actual_system(self, system: System, v: Values) -> System:
        learned = self.maps(v)
        elements = learned.layout.elements
        if system.is_chain or elements:
            shown = tuple(system.drive_shapes) if system.is_chain else ()
            if shown != elements:
                told, own = (", ".join(names) or "one or two equal phase modulators" for names in (elements, shown))
                raise UserError(str(v["file"]), f"maps of {told}", expected=f"a bench of these, not of {own}")
            return system
        count, known = len(system.modulators), learned.layout.modulators
        if count != known:
            raise UserError(str(v["file"]), f"maps of {known} modulators", expected=f"a bench of {known}, not {count}")
        return system

    def stroke_response(self, share: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        return self.maps(v).stroke_response(share, context)

    def optical_path(self, path_m: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        learned = self.maps(v)
        return learned.with_fringing(path_m, context) if learned.has("fringing_px2") else path_m

    def transmission(self, transmission: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        learned = self.maps(v)
        if context.element:
            return transmission
        if context.number == 0:
            source = learned.source_field(context).to(transmission.dtype)
            return transmission * (source if transmission.shape == source.shape else context.sampled(source))
        return learned.warped_transmission(transmission, context) if learned.has("warp_m") else transmission

    def pupil(self, pupil: Tensor, context: RelayContext, v: Values) -> Tensor:
        return self.maps(v).pupil(pupil, context)


@lru_cache(maxsize=4)
def _read_cached(file: str, changed_ns: int) -> LearnedMaps:
    """The maps of a file; its time of change is an argument so that a changed file is read again."""
    from holoview.light.model.effects.learned_maps import read_calibration  # here: torch takes seconds to import

    return read_calibration(file).maps
