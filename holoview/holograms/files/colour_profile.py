"""The colour space that a picture file states: an ICC profile, or the chunks cICP, gAMA and cHRM of a PNG file.

A profile of a display (ICC.1:2022, 8.3.3) has a curve for each channel, and a matrix to XYZ relative to the white of
the connection space, D50. The white is adapted to that of sRGB, D65, in Bradford's cone space, so that white stays
white. Profiles of tables, as of scanners and of some cameras, are evaluated by littleCMS (Pillow's ImageCms) on a
lattice of their signals, between whose nodes is interpolated.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageCms

from holoview.light.colour import COLOUR_SPACES, D65_WHITE, XYZ_TO_SRGB, bt2020_decode, rgb_to_xyz, srgb_decode

_D50_WHITE = np.array([0.9642, 1.0, 0.8249])
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
"""XYZ to the sharpened cone responses of the Bradford adaptation (Lam 1985; ICC.1:2010, annex E)."""

_MOST_BYTES, _MOST_TAGS = 4 << 20, 200
_PARAMETERS = (1, 3, 4, 5, 7)  # of the five kinds of curves by formula
_SAMPLES = np.linspace(0.0, 1.0, 256)
_ALIKE = 2e-3  # of the light: half a step of 8 bits near white is 0.0045
_PNG_GAMMA, _LINEAR = 0.45455, 8
_BT709_CURVES = (1, 6, 14, 15)  # of H.273; BT.2020 shares it

Curve = NDArray[np.float64]
"""Light at equidistant signals from 0 to 1, to be interpolated."""


@dataclass(frozen=True, eq=False)
class ColourProfile:
    """title: in words. matrix: (3, 3) from linear channels to linear sRGB; None of grey. curves: of each channel.

    lattice: (red, green, blue, 3) in place of both: the signal of a wide colour space at equidistant signals.
    """

    title: str
    matrix: NDArray[np.float64] | None
    curves: tuple[Curve, ...]
    lattice: NDArray[np.float64] | None = None

    @property
    def is_srgb(self) -> bool:
        """Whether it means the same colours as sRGB."""
        if self.lattice is not None:
            return False
        has_curves = all(np.abs(_at(curve, _SAMPLES) - srgb_decode(_SAMPLES)).max() < _ALIKE for curve in self.curves)
        return has_curves and (self.matrix is None or bool(np.abs(self.matrix - np.eye(3)).max() < 5 * _ALIKE))

    def linear_srgb(self, signal: NDArray[np.float64]) -> NDArray[np.float64]:
        """Linear sRGB (y, x, 1 or 3) of signals from 0 to 1, negative where a colour lies outside sRGB."""
        if self.lattice is not None:
            three = np.broadcast_to(signal, (*signal.shape[:2], 3))  # grey is of equal channels
            return _in_lattice(self.lattice, three) ** _WIDE_GAMMA @ _WIDE_TO_SRGB.T
        curves = self.curves if len(self.curves) == signal.shape[-1] else self.curves[:1] * signal.shape[-1]
        light = np.stack([_at(curve, signal[..., i]) for i, curve in enumerate(curves)], axis=-1)
        return light @ self.matrix.T if self.matrix is not None and signal.shape[-1] == 3 else light


def _at(curve: Curve, signal: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.interp(signal, np.linspace(0.0, 1.0, len(curve)), curve)


def icc_profile(data: bytes) -> ColourProfile | None:
    """The profile of red, green and blue or of grey, None for others and for damaged ones."""
    try:
        return _icc_profile(data) or _table_profile(data)
    except (struct.error, ValueError, KeyError, IndexError, OSError, ImageCms.PyCMSError):
        return None


def _icc_profile(data: bytes) -> ColourProfile | None:
    if data[20:24] != b"XYZ " or data[36:40] != b"acsp":
        return None
    tags = _tags(data)
    title = _text(tags.get(b"desc", b""))
    if data[16:20] == b"GRAY":
        return ColourProfile(title, None, (_curve(tags[b"kTRC"]),))
    if data[16:20] != b"RGB " or b"rXYZ" not in tags or b"A2B0" in tags:  # which counts before the matrix
        return None
    columns = [np.array(struct.unpack(">3i", tags[name][8:20])) / 65536 for name in (b"rXYZ", b"gXYZ", b"bXYZ")]
    matrix = XYZ_TO_SRGB @ to_d65(_D50_WHITE) @ np.stack(columns, axis=1)
    return ColourProfile(title, matrix, tuple(_curve(tags[name]) for name in (b"rTRC", b"gTRC", b"bTRC")))


def _tags(data: bytes) -> dict[bytes, bytes]:
    (count,) = struct.unpack(">I", data[128:132])
    tags = {}
    for entry in range(min(count, _MOST_TAGS)):
        name, offset, size = struct.unpack(">4sII", data[132 + 12 * entry : 144 + 12 * entry])
        tags[name] = data[offset : offset + size]
    return tags


# --- profiles of tables -----------------------------------------------------------------------------------------------


_NODES = 18  # each way: their signals, 0, 15, 30 … 255, are whole numbers, as littleCMS takes them from Pillow
_WIDE, _WIDE_GAMMA = COLOUR_SPACES["rec2020"].chromaticities, 2.0
_WIDE_TO_SRGB = XYZ_TO_SRGB @ rgb_to_xyz(_WIDE)


def _table_profile(data: bytes) -> ColourProfile | None:
    """A profile of red, green and blue by tables. littleCMS gives 8 bits of a wide colour space, half a level off."""
    if data[16:20] != b"RGB " or data[36:40] != b"acsp" or b"A2B0" not in (tags := _tags(data)):
        return None
    codes = np.arange(_NODES, dtype=np.uint8) * np.uint8(255 // (_NODES - 1))
    nodes = np.stack(np.meshgrid(codes, codes, codes, indexing="ij"), axis=-1).reshape(_NODES, -1, 3)
    source, wide = (ImageCms.ImageCmsProfile(io.BytesIO(profile)) for profile in (data, _wide_profile()))
    relative = ImageCms.Intent.RELATIVE_COLORIMETRIC
    transform = ImageCms.buildTransform(source, wide, "RGB", "RGB", relative)
    seen = ImageCms.applyTransform(Image.fromarray(nodes), transform)
    assert seen is not None
    lattice = np.asarray(seen).reshape(_NODES, _NODES, _NODES, 3) / 255.0
    return ColourProfile(_text(tags.get(b"desc", b"")), None, (), lattice)


def _in_lattice(lattice: NDArray[np.float64], signal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values (…, 3) between the nodes of a lattice, linear along each axis. signal: (…, 3) from 0 to 1."""
    at = np.clip(signal, 0.0, 1.0) * (_NODES - 1)
    first = np.minimum(at.astype(np.intp), _NODES - 2)
    share = at - first
    total = np.zeros(signal.shape)
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(np.array(corner) == 1, share, 1 - share), axis=-1)
        red, green, blue = np.moveaxis(first + corner, -1, 0)
        total += weight[..., None] * lattice[red, green, blue]
    return total


def _wide_profile() -> bytes:
    """The bytes of a display profile (ICC.1:2022) of `_WIDE` primaries under D50."""
    columns = (np.linalg.inv(to_d65(_D50_WHITE)) @ rgb_to_xyz(_WIDE)).T
    curve = b"curv\0\0\0\0" + struct.pack(">IHxx", 1, round(_WIDE_GAMMA * 256))
    tags = {name: _xyz_tag(column) for name, column in zip((b"rXYZ", b"gXYZ", b"bXYZ"), columns, strict=True)}
    tags |= {b"wtpt": _xyz_tag(_D50_WHITE)} | dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), curve)
    place = 132 + 12 * len(tags)
    table = b""
    for name, content in tags.items():
        table += name + struct.pack(">II", place, len(content))
        place += len(content)
    head = struct.pack(">I4sI4s4s4s12x4s28x", place, b"lcms", 0x04300000, b"mntr", b"RGB ", b"XYZ ", b"acsp")
    head += _xyz_tag(_D50_WHITE)[8:]
    return head.ljust(128, b"\0") + struct.pack(">I", len(tags)) + table + b"".join(tags.values())


def _xyz_tag(xyz: NDArray[np.float64]) -> bytes:
    return b"XYZ \0\0\0\0" + struct.pack(">3i", *(round(float(x) * 65536) for x in xyz))


def to_d65(white: NDArray[np.float64]) -> NDArray[np.float64]:
    """The matrix (3, 3) that takes XYZ under a white, of Y = 1, to XYZ under D65, in Bradford's cone space."""
    gains = (_BRADFORD @ D65_WHITE) / (_BRADFORD @ white)
    matrix: NDArray[np.float64] = np.linalg.solve(_BRADFORD, gains[:, None] * _BRADFORD)
    return matrix


def matrix_of_primaries(chromaticities: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """The matrix (3, 3) from linear light of other primaries to linear sRGB, which maps their white to D65.

    chromaticities: (x, y) of red, green, blue and white. SMPTE RP 177 gives the matrix to XYZ. None for primaries that
    lie on a line, or can't make the white.
    """
    corners = np.column_stack([chromaticities, 1 - chromaticities.sum(axis=1)])
    primaries, white = corners[:3].T, corners[3]
    if not np.isfinite(corners).all() or abs(np.linalg.det(primaries)) < 1e-6 or white[1] <= 0:
        return None
    white = white / white[1]
    matrix: NDArray[np.float64] = XYZ_TO_SRGB @ to_d65(white) @ (primaries * np.linalg.solve(primaries, white))
    return matrix


def _curve(tag: bytes) -> Curve:
    """A curve by a table, an exponent or a formula (ICC.1:2022, 10.6 and 10.18)."""
    if tag[:4] == b"curv":
        (count,) = struct.unpack(">I", tag[8:12])
        if count == 0:
            return np.array([0.0, 1.0])
        table = np.array(struct.unpack(f">{count}H", tag[12 : 12 + 2 * count]), dtype=np.float64)
        return _power(float(table[0]) / 256) if count == 1 else table / 65535
    if tag[:4] != b"para":
        raise ValueError("another kind of curve")
    (kind,) = struct.unpack(">H", tag[8:10])
    size = _PARAMETERS[kind]
    values = np.array(struct.unpack(f">{size}i", tag[12 : 12 + 4 * size])) / 65536
    g, a, b, c, d, e, f = (1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    g = float(values[0])
    if kind == 0:
        return _power(g)
    if kind in (1, 2):  # the formula holds above −b/a; below, the light is c
        a, b = map(float, values[1:3])
        e = f = float(values[3]) if kind == 2 else 0.0
        d = -b / a
    else:
        a, b, c, d = map(float, values[1:5])
        e, f = map(float, values[5:7]) if kind == 4 else (0.0, 0.0)
    x = np.linspace(0.0, 1.0, 4097)
    return np.where(x >= d, np.maximum(a * x + b, 0.0) ** g + e, c * x + f)


def _power(exponent: float) -> Curve:
    return np.asarray(np.linspace(0.0, 1.0, 4097) ** exponent)


def _text(tag: bytes) -> str:
    if tag[:4] == b"mluc":
        size, offset = struct.unpack(">II", tag[20:28])
        text = tag[offset : offset + min(size, 200)].decode("utf-16-be", "ignore")
    else:
        text = tag[12:112].split(b"\0")[0].decode("latin-1")
    return "".join(character for character in text if character.isprintable()) or "without a name"


def png_profile(chunks: Iterable[tuple[bytes, bytes]]) -> tuple[ColourProfile | None, str]:
    """The colour space that the chunks of a PNG file state, None if none does, and a remark where it can't be applied.

    cICP counts before iCCP, this before sRGB, and this before gAMA and cHRM (PNG, third edition, 4.3).
    """
    found: Mapping[bytes, bytes] = dict(chunks)
    if b"cICP" in found:
        return _of_code_points(found[b"cICP"])
    if b"iCCP" in found:
        packed = found[b"iCCP"].partition(b"\0")[2][1:]
        try:
            profile = icc_profile(zlib.decompressobj().decompress(packed, _MOST_BYTES))
        except zlib.error:
            profile = None
        return profile, "" if profile else UNREAD_PROFILE
    if b"sRGB" in found or not (b"gAMA" in found or b"cHRM" in found):
        return None, ""
    return _of_gamma(found), ""


UNREAD_PROFILE = "embedded colour profile ignored: taken as sRGB"


def _of_code_points(content: bytes) -> tuple[ColourProfile | None, str]:
    if len(content) != 4:
        return None, ""
    primaries, transfer = content[:2]
    space = next((space for space in COLOUR_SPACES.values() if space.code_points[0] == primaries), None)
    signal = np.linspace(0.0, 1.0, 4097)
    curve = {13: srgb_decode(signal), _LINEAR: signal}.get(transfer)
    if transfer in _BT709_CURVES:
        curve = bt2020_decode(signal)
    if space is None or curve is None:
        return None, f"its colour space (H.273 code points {primaries}, {transfer}) is ignored: taken as sRGB"
    return ColourProfile(space.title, XYZ_TO_SRGB @ rgb_to_xyz(space.chromaticities), (curve,) * 3), ""


def _of_gamma(found: Mapping[bytes, bytes]) -> ColourProfile | None:
    """The exponent and the primaries; the exponent of sRGB stands for its curve."""
    exponent = struct.unpack(">I", found[b"gAMA"])[0] / 1e5 if len(found.get(b"gAMA", b"")) == 4 else _PNG_GAMMA
    if not 0.1 <= exponent <= 10:
        return None
    is_usual = abs(exponent / _PNG_GAMMA - 1) < 0.02
    curve = np.asarray(srgb_decode(np.linspace(0, 1, 4097))) if is_usual else _power(1 / exponent)
    matrix = np.eye(3)
    if len(found.get(b"cHRM", b"")) == 32:
        numbers = np.array(struct.unpack(">8I", found[b"cHRM"])) / 1e5
        own = matrix_of_primaries(np.roll(numbers.reshape(4, 2), -1, axis=0))
        if own is None:
            return None
        matrix = own
    return ColourProfile(f"gamma {1 / exponent:.3g} and primaries of its own", matrix, (curve,) * 3)
