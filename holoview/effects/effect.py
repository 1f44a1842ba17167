"""Deprecated place of `holoview.model.effects.effect`: effect files import from `holoview.effects` now."""

from holoview.model.effects.old_names import moved

__getattr__ = moved(__name__, "holoview.model.effects.effect", {"Facts": "DataProperties", "Moment": "ExposureSample"})
