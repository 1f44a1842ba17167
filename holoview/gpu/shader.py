"""Links WGSL files and generated WGSL, and maps the line numbers of compiler errors back to these files.

A file includes another one by a comment on a line of its own, so that it stays valid WGSL:

    //#include "lib/complex.wgsl"

Names are relative to the folder `shaders`, not to the including file. Each file is linked once.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

from holoview.util.files import data_dir

_INCLUDE = re.compile(r'^\s*//#include\s+"([^"]+)"\s*$')
_LOCATION = re.compile(r"(?<=┌─ ).*:(\d+):(\d+)")
_BUFFER = re.compile(
    r"^@group\((\d+)\) @binding\((\d+)\) var<(uniform|storage, ?read|storage, ?read_write)>", re.MULTILINE
)
_BINDING = re.compile(r"^@group\(", re.MULTILINE)
_BUFFER_TYPES = {"uniform": "uniform", "storage,read": "read-only-storage", "storage,read_write": "storage"}
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

    def buffer_bindings(self) -> dict[int, dict[int, str]] | None:
        """WebGPU's buffer type by group and binding of all declared buffers, used or not.

        None if the shader binds anything but buffers, such as a texture.
        """
        declarations = _BUFFER.findall(self.text)
        if len(declarations) != len(_BINDING.findall(self.text)):
            return None
        groups: dict[int, dict[int, str]] = {}
        for group, binding, kind in declarations:
            groups.setdefault(int(group), {})[int(binding)] = _BUFFER_TYPES[kind.replace(" ", "")]
        return groups


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
        self._root = root.resolve()
        self._linked: set[Path] = set()
        self.lines: list[str] = []
        self.origins: list[tuple[str, int]] = []

    def add_file(self, name: str, included_by: tuple[str, int]) -> None:
        path = (self._root / name).resolve()
        if path in self._linked:
            return
        self._linked.add(path)
        if not path.is_relative_to(self._root) or not path.is_file():
            file, line = included_by
            raise ShaderError(f"{file}:{line}: no shader file '{name}' in {self._root}", file, line)
        self.add_text(name, path.read_text(encoding="utf-8"))

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
