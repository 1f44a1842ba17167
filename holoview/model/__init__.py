"""A display as data: what it consists of, how that is written, and every number that a simulation derives from it.

system            `System`: lasers, modulators, relays, focal planes, observer, effects
bench_parts       its parts: `Source`, `Modulator`, `Relay`, `Sampling`
field_types       types of their fields: parse text or numbers to checked SI values, and write them back
dataclass_fields  frozen dataclasses with such fields: built from tables, written to tables, edited by dotted keys
shorthand         shorthands of presets and edits (white balance, frames, a grid of sources) as plain fields
preset            TOML files of systems, with inheritance
scheme            the colour schemes of the HoloChrome paper, applied to a system
eye               `Eye`: eyepiece, pupil, accommodation, chromatic aberration, prescription
human_eye         published formulas: refraction against wavelength, size of the pupil
visual_angle      angles under which lengths are seen through an eyepiece
focus             the planes on which the eye of a system is focused
pupil_path        `PupilPath`: a pupil that moves through the eyebox, and what it sees at each time
passband          the frequencies that stops and pupils pass, as rows of integers
transfer          the propagation of one wavelength over one distance, as numbers
plan              `Plan`: grid, transfer functions, weights and colours, derived in float64
sampled_distance  how much light of a distance the band limit of a grid leaves
validity          when the model stops being true: each limit with its threshold
effects           the framework of imperfections of real displays; the imperfections are in `holoview.effects`

Nothing here imports torch or wgpu, except what effects do to light (`effects.hook_contexts`, `effects.learned_maps`).
"""
