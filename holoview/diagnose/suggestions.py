"""What to do about an error that no effect describes: which effect to write, and which capture shows more of it."""

from __future__ import annotations

_HOW = "docs/effects.md says how"
_SUGGESTIONS = {
    "source": (
        "an effect that overrides `transmission` for modulator 1, amplitude and wavefront of the light on it",
        "captures with flat patterns, which show the beam alone",
    ),
    "modulator 1": (
        "an effect that overrides `stroke_response` or `optical_path` for modulator 1",
        "captures with flat patterns at several levels, and one column or row at a time at another level",
    ),
    "modulator 2": (
        "an effect that overrides `stroke_response` or `optical_path` for modulator 2",
        "captures with modulator 1 flat and modulator 2 at several levels, then one column or row at another level",
    ),
    "relay 1": (
        "an effect that overrides `pupil` for relay 1",
        "captures with modulator 2 flat and white noise on modulator 1, which fills the pupil",
    ),
    "relay 2": (
        "an effect that overrides `pupil` for relay 2",
        "captures of white noise, which fills the pupil, at several distances",
    ),
    "camera": (
        "an effect that overrides `image`, which changes the picture that the camera collects",
        "a capture with all lasers off, and the same pattern at several exposures and positions of the camera",
    ),
}


def suggest_for(place: str) -> str:
    """A sentence on what to do about an error that lives at a place, one of the places of `free_maps`."""
    effect, captures = _SUGGESTIONS[place]
    return f"Write {effect} ({_HOW}). More of it would be seen in {captures}."
