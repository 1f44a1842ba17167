"""The framework of effects: what an imperfection of a display states, and how the active ones change the model.

effect          base class `Effect`, its hooks, and what it requires of the data
registry        all effects by id, those of users' files too; the field of `System` that holds the active ones
hook_contexts   what a hook is told about its modulator, relay or camera, and tools for its maps
learned_maps    maps that a calibration learned, what they do to light, and their file
"""
