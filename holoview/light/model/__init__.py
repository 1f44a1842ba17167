"""A display as data: its parts, how they are written, and every number that a simulation derives from them.

system       `System`: lasers, modulators, relays, focal planes, observer, effects
bench_parts  its parts: `Source`, `Modulator`, `Relay`, `Sampling`
stops        `SquareStop`, a square stop of a relay
fields       types of their fields; frozen dataclasses of such fields, built from tables and edited by dotted keys
preset       TOML files of systems, with inheritance
shorthand    shorthands of presets and edits (white balance, frames, a grid of sources) as plain fields
scheme       the colour schemes of the HoloChrome paper, applied to a system
eye          `Eye`: eyepiece, pupil, accommodation, chromatic aberration; published formulas of the human eye
focus        the planes on which the eye of a system is focused; `PupilPath`: a pupil that moves through the eyebox
passband     the frequencies that stops and pupils pass, as rows of integers; propagation over a distance
plan         `Plan`: grid, transfer functions, weights and colours, derived in float64
field_band   the share of a field's power at each frequency of its samples' band
validity     when the model stops being true: each limit with its threshold
derived_numbers  cut-offs, sampling, angles and limits of a bench, as text
effects      the framework of imperfections of real displays; the imperfections are in `holoview.light.effects`

Nothing here imports torch or wgpu, except what effects do to light (`effects.hook_contexts`, `effects.learned_maps`).
"""
