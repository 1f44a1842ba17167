"""Deprecated place of `holoview.model.effects.hook_contexts`, for effect files from before version 0.1.0."""

from holoview.model.effects.old_names import moved

_NAMES = {"Surface": "ModulatorContext", "Aperture": "RelayContext", "Sensor": "CameraContext"}
__getattr__ = moved(__name__, "holoview.model.effects.hook_contexts", _NAMES)
