"""The patterns of the elements of a bench: by their names, each checked against its element."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from holoview.light.model.elements import ComplexModulator
from holoview.light.model.system import System
from holoview.util.errors import UserError, suggest_matches

_HAIR = 1e-6  # above a modulus of 1: rounding of complex64


def chain_drives(system: System, drive: Any) -> dict[str, Any]:
    """The patterns (frame, y, x) of a chain by the names of the elements that show them.

    drive: a mapping by name, or a list in the order of the elements; of one such element also its patterns alone. Each
    is an array or a tensor (frame, y, x), or (y, x) of all frames: 0…1, of a complex modulator complex of modulus 0…1.
    Raises UserError, with the element's name, for patterns that don't fit.
    """
    shapes, of_complex = system.drive_shapes, complex_names(system)
    found = _by_name(drive, list(shapes))
    return {name: _checked(found[name], name, shape, name in of_complex) for name, shape in shapes.items()}


def complex_names(system: System) -> set[str]:
    """The names of the elements whose patterns are complex."""
    named = zip(system.element_names, system.elements, strict=True)
    return {name for name, element in named if isinstance(element, ComplexModulator)}


def drive_fits(system: System, drive: Any) -> bool:
    """Whether an array, or of a chain a mapping of arrays by name, has the shapes and kinds that a bench shows."""
    if not system.is_chain:
        return not isinstance(drive, Mapping) and tuple(drive.shape) == system.drive_shape
    if not isinstance(drive, Mapping):
        return False
    of_complex = {name for name, patterns in drive.items() if np.iscomplexobj(patterns)}
    shapes = {name: patterns.shape for name, patterns in drive.items()}
    return of_complex == complex_names(system) and shapes == system.drive_shapes


def short_drive(system: System, drive: Any) -> Any:
    """The drive of a bench of the short form, (frame, modulator, y, x), also from a list or mapping of its elements."""
    if not isinstance(drive, Mapping | list | tuple) or system.is_field or _is_nested(drive):
        return drive
    shapes = system.drive_shapes
    found = _by_name(drive, list(shapes))
    return np.stack([_checked(found[name], name, shape, False) for name, shape in shapes.items()], axis=1)


def _is_nested(drive: Any) -> bool:
    """Whether a list holds plain numbers, nested, as of one array."""
    return isinstance(drive, list | tuple) and not any(hasattr(entry, "shape") for entry in drive)


def _by_name(drive: Any, names: list[str]) -> dict[str, Any]:
    """Patterns by name. Raises UserError for missing and unknown names, and for a list of another length."""
    if isinstance(drive, Mapping):
        unknown = [name for name in drive if name not in names]
        if unknown:
            remedy = suggest_matches(str(unknown[0]), names)
            raise UserError("drive", f'"{unknown[0]}"', expected=f"elements: {', '.join(names)}", remedy=remedy)
        missing = [name for name in names if name not in drive]
        if missing:
            raise UserError("drive", f'none for "{missing[0]}"', expected=f"patterns of {', '.join(names)}")
        return dict(drive)
    if isinstance(drive, list | tuple):
        if len(drive) != len(names):
            raise UserError("drive", f"{len(drive)} patterns", expected=f"one for each of {', '.join(names)}")
        return dict(zip(names, drive, strict=True))
    if len(names) != 1:
        raise UserError("drive", "one array", expected=f"a list or a mapping of patterns: {', '.join(names)}")
    return {names[0]: drive}


def _checked(values: Any, name: str, shape: tuple[int, int, int], is_complex: bool) -> Any:
    """Patterns (frame, y, x) of an element. Raises UserError unless they fit it."""
    where = f"drive of {name}"
    patterns = values if hasattr(values, "detach") else np.asarray(values)
    host = patterns.detach().cpu().numpy() if hasattr(patterns, "detach") else patterns
    if host.dtype.kind not in ("fciub" if is_complex else "fiub"):
        expected = "complex numbers" if is_complex else "real numbers, 0 to 1"
        raise UserError(where, f"values of type {host.dtype}", expected=expected)
    if tuple(host.shape) == shape[1:]:
        patterns, host = patterns[None], host[None]
    if tuple(host.shape) == (1, *shape[1:]) and shape[0] > 1:
        patterns = patterns.expand(shape) if hasattr(patterns, "expand") else np.broadcast_to(patterns, shape)
    elif tuple(host.shape) != shape:
        raise UserError(where, f"an array of shape {tuple(host.shape)}", expected=f"(frame, y, x) = {shape}")
    size = np.abs(host) if is_complex else host
    low, high = float(size.min()), float(size.max())
    if not (low >= 0.0 and high <= (1.0 + _HAIR if is_complex else 1.0)):
        what = "modulus" if is_complex else "values"
        raise UserError(where, f"{what} from {low:g} to {high:g}", expected="0 to 1")
    return patterns
