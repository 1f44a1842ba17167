"""Radiance HDR pictures as targets: their light, their primaries and exposure, and damaged files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from holoview.holograms.targets.picture import read_picture
from holoview.light.colour import COLOUR_SPACES, XYZ_TO_SRGB, rgb_to_xyz
from holoview.util.errors import UserError

SHAPE = (5, 20)


def _rgbe(light: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Mantissas and exponents (y, x, 4), rounded to nearest."""
    _, exponent = np.frexp(light.max(axis=-1) * (256 / 255.5))
    mantissas = np.rint(light * np.exp2(8.0 - exponent)[..., None])
    codes = np.concatenate([mantissas, (exponent + 128)[..., None]], axis=-1).astype(np.uint8)
    codes[light.max(axis=-1) == 0] = 0
    return codes


def _runs(line: NDArray[np.uint8]) -> bytes:
    """A line (x, 4) packed: each component in runs where neighbours are equal, else number by number."""
    out = bytes([2, 2, len(line) >> 8, len(line) & 255])
    for component in line.T:
        if (component == component[0]).all():
            out += bytes([128 + len(component), component[0]])
        else:
            out += bytes([len(component), *component])
    return out


def _file(path: Path, codes: NDArray[np.uint8], head: str = "", packed: bool = True) -> Path:
    rows, columns = codes.shape[:2]
    body = b"".join(map(_runs, codes)) if packed else codes.tobytes()
    text = f"#?RADIANCE\n{head}FORMAT=32-bit_rle_rgbe\n\n-Y {rows} +X {columns}\n"
    path.write_bytes(text.encode() + body)
    return path


def _light() -> NDArray[np.float64]:
    light = np.exp2(np.random.default_rng(0).uniform(-6, 6, (*SHAPE, 1))) * np.random.default_rng(1).random((*SHAPE, 3))
    light[0, 0] = 0
    light[1] = light[1, 0]
    return light


@pytest.mark.parametrize("packed", [True, False])
def test_light_is_read_to_the_digits_of_the_file(packed: bool, tmp_path: Path) -> None:
    light = _light()
    picture = read_picture(_file(tmp_path / "a.hdr", _rgbe(light), packed=packed))
    # half a step of the mantissa, which has 8 bits of the brightest channel
    bound = np.maximum(light.max(axis=-1, keepdims=True) / 255, 1e-12)
    assert (np.abs(picture.rgb - light) <= bound).all()
    assert not picture.rgb[0, 0].any()
    assert any("taken as those of sRGB" in note for note in picture.notes)


def test_exposure_and_primaries_are_undone(tmp_path: Path) -> None:
    codes, p3 = _rgbe(_light()), COLOUR_SPACES["p3"].chromaticities
    plain = read_picture(_file(tmp_path / "a.hdr", codes)).rgb
    exposed = read_picture(_file(tmp_path / "b.hdr", codes, "EXPOSURE=2\nEXPOSURE=2\n")).rgb
    np.testing.assert_array_equal(exposed, plain / 4)
    stated = " ".join(f"{x:g} {y:g}" for x, y in (*p3, (0.3127, 0.3290)))
    wide = read_picture(_file(tmp_path / "c.hdr", codes, f"PRIMARIES={stated}\n"))
    expected = plain.astype(np.float64) @ (XYZ_TO_SRGB @ rgb_to_xyz(p3)).T
    np.testing.assert_allclose(wide.rgb, expected, rtol=1e-5, atol=1e-5 * float(plain.max()))
    assert any("own primaries" in note for note in wide.notes)


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (lambda d: d[:-3], "truncated or damaged"),
        (lambda d: d.replace(b"-Y 5 +X 20", b"+X 20 -Y 5"), "another layout"),
        (lambda d: d.replace(b"rle_rgbe", b"rle_xyze"), "XYZE"),
        (lambda d: d.replace(b"-Y 5 ", b"-Y 999999 ").replace(b"+X 20", b"+X 999999"), "pixels"),
        (lambda d: d.replace(b"\n\n", b"\nEXPOSURE=0\n\n"), "truncated or damaged"),
        (lambda d: d.replace(b"\n\n", b"\nPRIMARIES=1 2 x\n\n"), "truncated or damaged"),
        (lambda d: d[:80] + b"\xff" * len(d), "truncated or damaged"),
    ],
)
def test_damaged_and_other_files_are_one_sentence(change: object, found: str, tmp_path: Path) -> None:
    file = _file(tmp_path / "a.hdr", _rgbe(_light()))
    file.write_bytes(change(file.read_bytes()))  # type: ignore[operator]
    with pytest.raises(UserError, match=found):
        read_picture(file)
