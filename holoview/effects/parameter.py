"""The old place of `holoview.model.effects.parameter`, for effect files: import from `holoview.effects` instead."""

from holoview.model.effects.old_names import moved

__getattr__ = moved(__name__, "holoview.model.effects.parameter")
