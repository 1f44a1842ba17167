"""The arrays of light that holoview wrote as .npz or .npy, before they are checked (`light_file`).

A .npz has them by name. A .npy has the intensity, which `np.load` reads, and behind it in the same file the others in
the order of `LIGHT_ARRAYS`, as `np.save` writes several arrays into an open file.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from holoview.util.errors import UserError
from holoview.util.files import opened_file
from holoview.util.plain_arrays import open_npz, read_npy_arrays, read_npy_header, read_npz_array

LIGHT_ARRAYS = ("intensity", "about", "xyz", "rgb", "wavelengths_m", "planes_m")
"""The arrays of light in a .npz file, and, in this order, in a .npy file."""

_EXPECTED = "light that holoview wrote"
_SAYS_SO = b'"holoview light 1"'
_HEAD_BYTES = 512  # behind the first array of a .npy, within which the text begins


def is_npy_of_light(path: Path) -> bool:
    """Whether a text that says so stands behind the first array of a .npy file."""
    with opened_file(path, _EXPECTED) as file:
        try:
            header = read_npy_header(file, os.fstat(file.fileno()).st_size, str(path))
        except UserError:  # which its reader will tell
            return False
        file.seek(header.offset + header.nbytes)
        return _SAYS_SO in file.read(_HEAD_BYTES)


def light_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of light in a .npz or .npy file, by their names.

    Raises UserError where one is damaged or too large, ValueError and others for files of other contents.
    """
    with opened_file(path, _EXPECTED) as file:
        is_archive = file.read(2) == b"PK"
        file.seek(0)
        if not is_archive:
            return dict(zip(LIGHT_ARRAYS, read_npy_arrays(path, file), strict=True))
        with open_npz(path, file) as archive:
            members = {member.filename.removesuffix(".npy"): member for member in archive.infolist()}
            return {name: read_npz_array(path, archive, members[name]) for name in LIGHT_ARRAYS if name in members}
