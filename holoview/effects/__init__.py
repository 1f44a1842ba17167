"""Effects: what real benches do and the plain model doesn't, one physical cause a file.

effect parameter   what an effect states: cause, parameters, the hooks of the slots that it changes
registry           all effects by id; a user's own files
places             what hooks work on: a modulator's surface, a relay's aperture, the camera's sensor
apply              a bench with its effects: hooks in order
every other file   one effect, named as its id
"""

from holoview.model.effects.effect import DataProperties, Effect, Needs
from holoview.model.effects.parameter import Parameter, Values

__all__ = ["DataProperties", "Effect", "Needs", "Parameter", "Values"]
