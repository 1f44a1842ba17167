"""The framework of effects: what an imperfection of a display states, and how the active ones change the model.

effect          base class `Effect`, its hooks, and what it requires of the data
parameter       a parameter of an effect: unit, bounds, prior, the value at which it is off
list_parameter  a parameter that is a list of numbers
registry        all effects by id: those of `holoview.effects` and those of users' files
effect_table    the field of `System` that holds the active effects and their values
active_effects  active effects applied to a `System`, to laser powers and exposures, without torch
hook_contexts   what a hook is told about its modulator, relay or camera, and tools for its maps
learned_maps    maps that a calibration learned, what they do to light, and their file
"""
