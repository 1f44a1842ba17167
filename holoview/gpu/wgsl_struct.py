"""WGSL structs shared with Python: one definition gives the declaration, the byte layout and the packing.

Layouts follow WGSL's rules for the uniform address space, which are valid for storage buffers too: a vec3 or vec4 is
aligned to 16 bytes, a vec2 to 8 bytes, and the elements of an array have a stride of a multiple of 16 bytes.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.gpu.rounding import round_up

_SCALARS = {"u32": np.uint32, "i32": np.int32, "f32": np.float32}
_VECTOR_ALIGNMENT = {2: 8, 3: 16, 4: 16}
_VECTOR = re.compile(r"vec([234])<(u32|i32|f32)>")
_SHORT_VECTOR = re.compile(r"vec([234])([uif])")
_ARRAY = re.compile(r"array<\s*(.+?)\s*,\s*(\d+)\s*>")
_ARRAY_ALIGNMENT = 16


class WgslStruct:
    """A WGSL struct of scalars (u32, i32, f32), vectors (vec2<f32> or vec2f, …) and arrays of vec4.

    `fields` are (name, WGSL type) in order. `dtype` is the same layout as a numpy dtype, including padding, so that an
    array of it has the bytes of an array of the struct in a shader. `size` is in bytes. Raises ValueError for a type
    that a uniform buffer can't hold.
    """

    def __init__(self, name: str, fields: Sequence[tuple[str, str]]) -> None:
        self.name = name
        self.fields = tuple(fields)
        names, formats, offsets = [], [], []
        end, widest = 0, 4
        for field_name, wgsl_type in self.fields:
            dtype, alignment = _layout(wgsl_type)
            offset = round_up(end, alignment)
            names.append(field_name)
            formats.append(dtype)
            offsets.append(offset)
            end, widest = offset + dtype.itemsize, max(widest, alignment)
        if not names or len(set(names)) != len(names):
            raise ValueError(f"struct {name}: expected fields with names of their own, got {names}")
        self.size = round_up(end, widest)
        self.dtype: np.dtype[np.void] = np.dtype(
            {"names": names, "formats": formats, "offsets": offsets, "itemsize": self.size}
        )

    @property
    def wgsl(self) -> str:
        """The WGSL declaration, `struct Name { … }`."""
        members = "".join(f"    {name}: {wgsl_type},\n" for name, wgsl_type in self.fields)
        return f"struct {self.name} {{\n{members}}}\n"

    def pack(self, **values: Any) -> bytes:
        """The bytes of one struct. Raises ValueError unless `values` names each field once."""
        return self.pack_array([values])

    def pack_array(self, items: Iterable[Mapping[str, Any]]) -> bytes:
        """The bytes of an array of structs, each from a mapping of its fields."""
        rows = list(items)
        packed = np.zeros(len(rows), self.dtype)
        expected = {name for name, _ in self.fields}
        for index, values in enumerate(rows):
            if set(values) != expected:
                wrong = sorted(set(values) ^ expected)
                raise ValueError(f"struct {self.name}: missing or unknown fields {wrong}; expected {sorted(expected)}")
            for name, value in values.items():
                packed[name][index] = self._checked(name, value)
        return packed.tobytes()

    def _checked(self, name: str, value: Any) -> NDArray[Any]:
        """`value` as an array, or ValueError: numpy's assignment would broadcast a scalar or truncate a float."""
        array, dtype = np.asarray(value), self.dtype[name]
        if array.shape != dtype.shape:
            raise ValueError(f"{self.name}.{name}: expected the shape {dtype.shape}, got {array.shape}")
        if dtype.base.kind in "iu" and array.dtype.kind not in "iub":
            raise ValueError(f"{self.name}.{name}: expected whole numbers, got {array.dtype}")
        return array


def _layout(wgsl_type: str) -> tuple[np.dtype[Any], int]:
    """The numpy dtype of a WGSL type, and its alignment in bytes."""
    if wgsl_type in _SCALARS:
        return np.dtype(_SCALARS[wgsl_type]), 4
    vector = _VECTOR.fullmatch(wgsl_type) or _SHORT_VECTOR.fullmatch(wgsl_type)
    if vector:
        scalar = vector[2] if vector[2] in _SCALARS else f"{vector[2]}32"
        count = int(vector[1])
        return np.dtype((_SCALARS[scalar], (count,))), _VECTOR_ALIGNMENT[count]
    array = _ARRAY.fullmatch(wgsl_type)
    if array:
        element, _ = _layout(array[1])
        if element.itemsize % _ARRAY_ALIGNMENT:
            raise ValueError(f"{wgsl_type}: elements of a uniform array must be multiples of 16 bytes, as vec4 is")
        return np.dtype((element.base, (int(array[2]), *element.shape))), _ARRAY_ALIGNMENT
    raise ValueError(f"{wgsl_type}: expected u32, i32, f32, a vector of them, or an array of vec4")
