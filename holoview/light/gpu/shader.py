"""Links WGSL files and generated WGSL, and maps the line numbers of compiler errors back to these files.

A file includes another one by a comment on a line of its own, so that it stays valid WGSL:

    //#include "lib/complex.wgsl"

Names are relative to the folder `shaders`, not to the including file. Each file is linked once.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.light.numerics.sampling import round_up
from holoview.util.files import data_dir

_INCLUDE = re.compile(r'^\s*//#include\s+"([^"]+)"\s*$')
_LOCATION = re.compile(r"(?<=┌─ ).*:(\d+):(\d+)")
_BUFFER = re.compile(
    r"^@group\((\d+)\) @binding\((\d+)\) var<(uniform|storage, ?read|storage, ?read_write)>", re.MULTILINE
)
_TEXELS = re.compile(r"^@group\((\d+)\) @binding\((\d+)\) var \w+: texture_storage_2d<rg32float, read>;", re.MULTILINE)
_BINDING = re.compile(r"^@group\(", re.MULTILINE)
_BUFFER_TYPES = {"uniform": "uniform", "storage,read": "read-only-storage", "storage,read_write": "storage"}
TEXEL_FORMAT = "rg32float"
TEXELS = "texels"
"""The type of a binding that reads complex numbers as texels, beside WebGPU's types of buffers."""
_GUTTER = re.compile(r"^ *(\d+)(?= │)", re.MULTILINE)


class ShaderError(RuntimeError):
    """A shader doesn't link or compile, which is a bug and not a user's mistake. `file` and `line` locate it."""

    def __init__(self, message: str, file: str, line: int) -> None:
        super().__init__(message)
        self.file, self.line = file, line


@dataclass(frozen=True)
class GeneratedWgsl:
    """WGSL text that isn't read from a file; `name` takes the place of the file name in errors."""

    name: str
    text: str


@dataclass(frozen=True)
class ShaderSource:
    """Linked WGSL. `origins` holds the (file, line) of each line of `text`."""

    label: str
    text: str
    origins: tuple[tuple[str, int], ...] = field(compare=False, repr=False)

    def source_location(self, line: int) -> tuple[str, int]:
        """File and line of line `line` of the linked text, counted from 1."""
        return self.origins[min(max(line, 1), len(self.origins)) - 1]

    def bindings(self) -> dict[int, dict[int, str]] | None:
        """WebGPU's buffer type, or `TEXELS`, by group and binding of all that is declared, used or not.

        None if the shader binds anything else, such as another texture.
        """
        declarations = [*_BUFFER.findall(self.text), *((*place, TEXELS) for place in _TEXELS.findall(self.text))]
        if len(declarations) != len(_BINDING.findall(self.text)):
            return None
        groups: dict[int, dict[int, str]] = {}
        for group, binding, kind in declarations:
            groups.setdefault(int(group), {})[int(binding)] = _BUFFER_TYPES.get(kind.replace(" ", ""), kind)
        return groups


@lru_cache(maxsize=256)
def link(*parts: str | GeneratedWgsl, label: str = "", root: Path | None = None) -> ShaderSource:
    """Concatenate shader files (relative to `root`, by default the folder `shaders`) and generated text, in order.

    A file that is named or included several times appears once, before its first use. The label is the last part's
    name unless it is given. Raises ShaderError if a file is missing or lies outside the folder.
    """
    linker = _Linker(root or data_dir("shaders"))
    for part in parts:
        if isinstance(part, GeneratedWgsl):
            linker.add_text(part.name, part.text)
        else:
            linker.add_file(part, included_by=(part, 0))
    last = parts[-1] if parts else "nothing"
    name = label or (last.name if isinstance(last, GeneratedWgsl) else last)
    return ShaderSource(name, "\n".join(linker.lines) + "\n", (*linker.origins, (name, 0)))


class _Linker:
    """Collects lines and their origins while it follows the includes."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._linked: set[str] = set()
        self.lines: list[str] = []
        self.origins: list[tuple[str, int]] = []

    def add_file(self, name: str, included_by: tuple[str, int]) -> None:
        path = os.path.normpath(self._root / name)  # which asks the disk nothing, as `resolve` does
        if path in self._linked:
            return
        self._linked.add(path)
        try:
            if not Path(path).is_relative_to(self._root):
                raise FileNotFoundError(path)
            text = _read(path)
        except (FileNotFoundError, IsADirectoryError) as error:
            file, line = included_by
            raise ShaderError(f"{file}:{line}: no shader file '{name}' in {self._root}", file, line) from error
        self.add_text(name, text)

    def add_text(self, name: str, text: str) -> None:
        if "#include" not in text:
            lines = text.splitlines()
            self.lines += lines
            self.origins += [(name, number) for number in range(1, len(lines) + 1)]
            return
        for number, line in enumerate(text.splitlines(), start=1):
            directive = _INCLUDE.match(line)
            if directive:
                self.add_file(directive[1], included_by=(name, number))
            else:
                self.lines.append(line)
                self.origins.append((name, number))


@lru_cache(maxsize=64)
def _read(path: str) -> str:
    """The text of a file, which is read once: a frame links the same few files into many shaders."""
    return Path(path).read_text(encoding="utf-8")


def compile_error(source: ShaderSource, message: str) -> ShaderError:
    """A ShaderError with a compiler's `message`, in which positions in the linked text become file and line."""
    location = _LOCATION.search(message)
    if location is None:
        return ShaderError(f"{source.label}: {message.strip()}", source.label, 0)
    file, line = source.source_location(int(location[1]))
    lines = source.text.splitlines()
    quoted = lines[min(int(location[1]), len(lines)) - 1].strip()

    def original_location(match: re.Match[str]) -> str:
        name, number = source.source_location(int(match[1]))
        return f"{name}:{number}:{match[2]}"

    def original_line(match: re.Match[str]) -> str:
        return str(source.source_location(int(match[1]))[1])

    located = _LOCATION.sub(original_location, _GUTTER.sub(original_line, message))
    return ShaderError(f"{file}:{line}: {quoted}\n{located.strip()}", file, line)


# --- structs shared with Python ---------------------------------------------------------------------------------------

# Layouts follow WGSL's rules for the uniform address space, which are valid for storage buffers too: a vec3 or vec4 is
# aligned to 16 bytes, a vec2 to 8 bytes, and the elements of an array have a stride of a multiple of 16 bytes.


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
