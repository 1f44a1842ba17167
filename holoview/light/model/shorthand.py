"""Expands shorthands of presets and edits (white balance, frames, a grid of sources) to plain fields of a `System`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from holoview.light.colour import observer_weights, white_amplitudes
from holoview.light.model.fields import Array, Integer, Number
from holoview.light.numerics.sampling import positions
from holoview.util import units
from holoview.util.errors import UserError


class SystemLike(Protocol):
    """The properties of the edited `System` on which shorthands depend."""

    @property
    def modulators(self) -> Sequence[Any]: ...

    @property
    def wavelengths_m(self) -> NDArray[np.float64]: ...

    @property
    def amplitudes(self) -> NDArray[np.float64]: ...

    @property
    def frames(self) -> int: ...

    @property
    def observer(self) -> str: ...


MODULATOR_KEYS = ("pitch", "shape", "stroke", "levels")
SAMPLING_KEYS = ("upsample", "propagation", "padding")
_FRAMES = Integer(1, 4096)
_SEQUENCE = Array(Number(low=0.0, high=1.0), axes=2)
_AMPLITUDES = Array(Number(low=0.0), axes=2)
_WAVELENGTHS = Array(Number("nm", low=100e-9, high=10e-6))


def expand_table(table: Mapping[str, Any]) -> dict[str, Any]:
    """A preset's table with its shorthands replaced by plain fields.

    amplitudes = "white": powers of the lasers whose mixture is D65.
    frames = 3: repeats the amplitudes.
    sequence = [[1, 0], [0, 1]]: with "white", which lasers are on in each frame.
    single = true: keeps the first modulator only.
    source.grid, source.spacing: a centred grid of directions.

    Raises UserError for shorthands that are wrong or contradict each other.
    """
    out = dict(table)
    single = out.pop("single", False)
    if not isinstance(single, bool):
        raise UserError("single", f"{single!r}", expected="true or false")
    if single:
        out = _first_modulator_only(out)
    frames, sequence = out.pop("frames", None), out.pop("sequence", None)
    if isinstance(out.get("amplitudes"), str) and out["amplitudes"] == "white" and "wavelengths" in out:
        wavelengths = _read_wavelengths(out["wavelengths"])
        lasers_on = _lasers_on(sequence, frames, len(wavelengths))
        out["amplitudes"] = _white(str(out.get("observer", "eye")), wavelengths, lasers_on)
    elif sequence is not None:
        raise UserError(
            "sequence", "without white balance", remedy='use it with amplitudes = "white", or give the table itself'
        )
    elif frames is not None and "amplitudes" in out:
        out["amplitudes"] = _repeated(out["amplitudes"], frames)
    if isinstance(out.get("source"), Mapping) and "grid" in out["source"]:
        out["source"] = _source_grid(out["source"])
    return out


def expand_edit(system: SystemLike, changes: Mapping[str, Any]) -> dict[str, Any]:
    """The changes of an edit with shorthands replaced by plain keys.

    `pitch`, `shape`, `stroke` and `levels` change every modulator; `upsample`, `propagation` and `padding` change the
    sampling; amplitudes = "white", `frames` and `source.grid` are as in presets. A gap of None, for one modulator,
    takes away relay 1, which would lie in it.
    """
    out: dict[str, Any] = {}
    if "gap" in changes and changes["gap"] is None and not any(key.startswith("relay1") for key in changes):
        out["relay1"] = {}
    for key, value in changes.items():
        if key in MODULATOR_KEYS:
            modulators = changes.get("modulators", system.modulators)
            count = len(modulators) if isinstance(modulators, list | tuple) else len(system.modulators)
            if not count:
                raise UserError(key, "of a chain of elements", expected=f"elements.NAME.{key}, of one of them")
            out |= {f"modulators.{i}.{key}": value for i in range(count)}
        elif key in SAMPLING_KEYS:
            out[f"sampling.{key}"] = value
        else:
            out[key] = value
    frames = out.pop("frames", None)
    if isinstance(out.get("source"), Mapping) and "grid" in out["source"]:
        out["source"] = _source_grid(out["source"])
    if isinstance(out.get("amplitudes"), str):
        wavelengths = _read_wavelengths(out.get("wavelengths", system.wavelengths_m))
        out["amplitudes"] = _white_amplitudes_of_edit(system, out, wavelengths, frames)
    elif frames is not None:
        out["amplitudes"] = _repeated(out.get("amplitudes", system.amplitudes), frames)
    return out


def _first_modulator_only(table: Mapping[str, Any]) -> dict[str, Any]:
    """The table with the first modulator alone, without the gap and the relay between two."""
    modulators = table.get("modulators")
    if not isinstance(modulators, list) or not modulators:
        raise UserError("modulators", f"{modulators!r}", expected="at least one [[modulators]] table")
    return {k: v for k, v in table.items() if k not in ("gap", "relay1")} | {"modulators": modulators[:1]}


def _white_amplitudes_of_edit(
    system: SystemLike, out: Mapping[str, Any], wavelengths: NDArray[np.float64], frames: Any
) -> NDArray[np.float64]:
    """Balanced amplitudes; the lasers stay on in the frames in which they were, where that is still possible."""
    if out["amplitudes"] != "white":
        raise UserError("amplitudes", f'"{out["amplitudes"]}"', expected='a table (frame, wavelength) or "white"')
    sequence = (system.amplitudes > 0).astype(float)
    if frames is not None or sequence.shape[1] != len(wavelengths) or not np.all(sequence.any(axis=0)):
        sequence = np.ones((system.frames if frames is None else _FRAMES.parse(frames, "frames"), len(wavelengths)))
    return _white(str(out.get("observer", system.observer)), wavelengths, sequence)


def _repeated(table: Any, frames: Any) -> NDArray[np.float64]:
    """Equal rows of amplitudes for a number of frames."""
    rows = _AMPLITUDES.parse(table, "amplitudes")
    assert rows is not None
    if len(rows) == 0 or np.any(rows != rows[0]):
        raise UserError(
            "frames",
            f"{frames!r} of different amplitudes",
            expected="frames with equal amplitudes",
            remedy="give the whole amplitude table instead",
        )
    return np.tile(rows[0], (_FRAMES.parse(frames, "frames"), 1))


def _read_wavelengths(value: Any) -> NDArray[np.float64]:
    wavelengths = _WAVELENGTHS.parse(value, "wavelengths")
    if wavelengths is None or len(wavelengths) == 0:
        raise UserError("wavelengths", "an empty list", expected="a list of at least one length")
    return wavelengths


def _white(observer: str, wavelengths: NDArray[np.float64], sequence: NDArray[np.float64]) -> NDArray[np.float64]:
    return white_amplitudes(observer_weights(observer, wavelengths), sequence)


def _lasers_on(sequence: Any, frames: Any, wavelengths: int) -> NDArray[np.float64]:
    """(frame, wavelength) of 0 and 1: which lasers are on in which frame; all in every frame without a sequence."""
    if sequence is None:
        return np.ones((1 if frames is None else _FRAMES.parse(frames, "frames"), wavelengths))
    table = _SEQUENCE.parse(sequence, "sequence")
    assert table is not None
    if table.ndim != 2 or table.shape[1] != wavelengths or (frames is not None and len(table) != frames):
        raise UserError("sequence", f"a table of shape {table.shape}", expected=f"(frames, {wavelengths}) of 0 and 1")
    return table


def _source_grid(source: Mapping[str, Any]) -> dict[str, Any]:
    """The table of a source with `grid = [rows, columns]` and `spacing` (an angle) as directions around the axis."""
    rest = {key: value for key, value in source.items() if key not in ("grid", "spacing")}
    if "directions" in rest or "spacing" not in source:
        raise UserError("source.grid", f"{source['grid']}", expected="grid and spacing together, and no directions")
    try:
        rows, columns = (Integer(1, 64).parse(n, "source.grid") for n in source["grid"])
    except (TypeError, ValueError) as error:
        raise UserError("source.grid", f"{source['grid']}", expected="[rows, columns]") from error
    spacing = units.parse(source["spacing"], "source.spacing", "angle")
    y, x = np.meshgrid(positions(rows, spacing), positions(columns, spacing), indexing="ij")
    return rest | {"directions": np.stack([y.ravel(), x.ravel()], axis=1)}
