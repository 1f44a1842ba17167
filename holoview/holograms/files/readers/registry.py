"""The reader of a file: chosen by the file's first bytes, among built-in readers and those of installed packages.

A package adds a reader by an entry point of the group `holoview.readers`, whose object is a `Reader` or a class of one:

    [project.entry-points."holoview.readers"]
    ours = "our_package.module:OurReader"

Readers of other packages are asked before the built-in ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import cache, partial
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from holoview.holograms.files.readers.binary_dump import BinaryReader
from holoview.holograms.files.readers.contents import HEAD_BYTES, Contents, Load, Reader, Window
from holoview.holograms.files.request import ReadRequest
from holoview.util.errors import UserError
from holoview.util.files import read_bytes
from holoview.util.reader_process import Answer, in_child

GROUP = "holoview.readers"
_BUILT_IN = (
    "numpy_file:NpyReader",
    "numpy_file:NpzReader",
    "matlab5:Matlab5Reader",
    "hdf5_file:Hdf5Reader",
    "tiff_file:TiffReader",
    "exr_file:ExrReader",
    "picture_file:PictureReader",
    "openholo:OpenHoloReader",
    "safetensors_reader:SafetensorsReader",
    "torch_file:TorchReader",
    "text_table:TextReader",
)
"""Module and class of each reader, in the order in which they are asked. They are imported when a file is read."""

_IN_CHILD = frozenset({"MATLAB 5", "HDF5", "TIFF", "OpenEXR", "picture"})
"""Names of the readers whose libraries run in a child process: their code in C and C++ has ended the process."""

EXPECTED = "a hologram's file"


@cache
def all_readers() -> tuple[Reader, ...]:
    """Readers of other packages, then the built-in ones. Raises UserError for one that can't be loaded."""
    found = []
    for entry in entry_points(group=GROUP):
        try:
            made = entry.load()
            found.append(made() if isinstance(made, type) else made)
        except Exception as error:  # another package's code
            remedy = f"update or remove the package {entry.dist.name if entry.dist else entry.value}"
            raise UserError(f"reader {entry.name}", f"can't be loaded: {error}", remedy=remedy) from error
    for place in _BUILT_IN:
        module, _, name = place.partition(":")
        found.append(getattr(import_module(f"{__package__}.{module}"), name)())
    return tuple(found)


def reader_for(path: Path, request: ReadRequest) -> Reader:
    """The first reader that recognises the file's content; the reader of dumps if the request states a file's layout.

    Raises UserError when the file is missing, empty or no regular file, or no reader recognises it.
    """
    head = read_bytes(path, EXPECTED, most=HEAD_BYTES, missing="check the name and the folder")
    if not head:
        raise UserError(str(path), "the file is empty", expected=EXPECTED)
    if request.binary is not None:
        return BinaryReader()
    for reader in all_readers():
        if reader.recognises(head):
            return reader
    named = [reader.name for reader in all_readers() if path.suffix.lower() in reader.suffixes]
    found = f"isn't a {named[0]} file, as its name says" if named else "has no format that is known"
    known = ", ".join(reader.name for reader in all_readers())
    raise UserError(str(path), found, expected=known, remedy="for a dump of plain numbers, state its layout")


def is_readable(path: Path) -> bool:
    """Whether a reader recognises the file's content."""
    try:
        reader_for(path, ReadRequest())
    except UserError:
        return False
    return True


@contextmanager
def open_file(path: Path, request: ReadRequest) -> Iterator[tuple[Reader, Contents]]:
    """The contents of a file and the reader that opened it; arrays are read inside the block.

    Raises UserError for any fault of the file, also when an array is loaded.
    """
    reader = reader_for(path, request)
    with ExitStack() as stack:
        if reader.name in _IN_CHILD:
            ask = stack.enter_context(in_child(str(path), path, partial(_answers, reader, path, request)))
        else:
            ask = stack.enter_context(_answers(reader, path, request))
        contents: Contents = ask(None)
        arrays = tuple(replace(array, load=_asking(ask, index)) for index, array in enumerate(contents.arrays))
        yield reader, replace(contents, arrays=arrays)


@contextmanager
def _answers(reader: Reader, path: Path, request: ReadRequest) -> Iterator[Answer]:
    """Answers None with the contents, whose arrays can't load, and the index of an array and a window with numbers."""
    with ExitStack() as stack:
        with _naming_file(path, reader):
            contents = stack.enter_context(reader.open(path, request))

        def answer(wanted: tuple[int, Window] | None) -> Contents | NDArray[Any]:
            if wanted is None:
                arrays = tuple(replace(array, load=_cannot_load) for array in contents.arrays)
                return replace(contents, arrays=arrays)
            with _naming_file(path, reader):
                return contents.arrays[wanted[0]].load(wanted[1])

        yield answer


def _cannot_load(window: Window) -> NDArray[Any]:
    raise NotImplementedError


def _asking(ask: Answer, index: int) -> Load:
    def load(window: Window) -> NDArray[Any]:
        values: NDArray[Any] = ask((index, window))
        return values

    return load


@contextmanager
def _naming_file(path: Path, reader: Reader) -> Iterator[None]:
    """Turns the exceptions of a reader and of its libraries into a UserError that names the file."""
    try:
        yield
    except UserError:
        raise
    except (MemoryError, RecursionError) as error:
        raise UserError(str(path), "needs more memory than there is", expected=EXPECTED) from error
    except Exception as error:  # each library raises exceptions of its own
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        found = f"the {reader.name} data is truncated or damaged ({reason})"
        raise UserError(str(path), found, remedy="save or copy the file again") from error
