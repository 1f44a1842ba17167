"""Measured numbers: contrasts, photographs, captures, observers, profiles, decoders; files and options that don't fit.

Pictures of a pixel, black ones, of numbers that aren't, of other sizes than their targets and dark pictures; observers
that nobody is; damaged profiles in pictures, and damaged files of every format that a decoder reads.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from typing import TypeVar

import h5py
import numpy as np
import tifffile
from numpy.typing import NDArray
from PIL import Image, ImageCms

from tests.fuzz.corpus import TORCH, Files, files_case
from tests.fuzz.mutations import damage
from tests.fuzz.trial import Case
from tests.fuzz.valid_files import valid

Random = np.random.Generator
T = TypeVar("T")

_SIZE, _SIZES = (24, 32), ((1, 1), (1, 7), (2, 2), (3, 50), (90, 64))
_REGIONS = ("0,0,2,2", "3,3,8,8", "0,0,32,24", "5,5,1,9", "2,9,20,1")
_WRONG_REGIONS = ("0,0,1,1", "0,0,24,32", "-1,0,4,4", "30,20,9,9", "0,0,0,0", "a")
_CLAIMS = ("C < 0.4", "PSNR > 20 dB", "MTF50 > 0.1", "picture_light > 1 %", "N_eff ≥ 3", "colour_area < 1e-3")
_WRONG_CLAIMS = ("", "C", "C < nan", "C < 1e999", "K < 1", "C = 1", "C < 0.4" * 20)
_NUMBERS, _WRONG_NUMBERS = ("0.5", "1", "3", "65"), ("0", "-1", "1e-300", "1e300", "nan", "inf", "65536", "")


def _pick(rng: Random, among: Sequence[T]) -> T:
    return among[int(rng.integers(len(among)))]


def _mostly(rng: Random, right: Sequence[T], wrong: Sequence[T]) -> T:
    """One of the right ones, or in one of ten cases of the wrong ones."""
    return _pick(rng, wrong if rng.random() < 0.1 else right)


def _pixels(rng: Random, size: tuple[int, int] = _SIZE) -> NDArray[np.float64]:
    """A picture (y, x, 3) in 0 to 1 of one of many kinds; six in ten are of speckle."""
    shape = (*size, 3)
    kinds: tuple[Callable[[], NDArray[np.float64]], ...] = (
        lambda: rng.exponential(0.2, shape),
        lambda: np.repeat(rng.exponential(0.2, (*shape[:2], 1)), 3, axis=2),
        lambda: np.zeros(shape),
        lambda: np.ones(shape),
        lambda: np.eye(*shape[:2])[..., None] * np.ones(3),
        lambda: (rng.random(shape) > 0.99).astype(float),
        lambda: rng.random(shape) * [1, 0, 0],
        lambda: np.kron(rng.random((3, 4, 1)), np.ones((8, 8, 3)))[: shape[0], : shape[1]],
    )
    return np.clip(_pick(rng, kinds[:2] if rng.random() < 0.6 else kinds)(), 0, 1)


def _picture(rng: Random, size: tuple[int, int]) -> tuple[str, bytes]:
    """The suffix and the content of a picture's file."""
    pixels, stream = _pixels(rng, _mostly(rng, (size,), _SIZES)), io.BytesIO()
    suffix = _mostly(rng, ("png", "tif", "f.tif"), ("npy", "jpg"))
    grey = pixels[..., 1]
    if suffix == "png":
        Image.fromarray((255 * pixels).astype(np.uint8)).save(stream, "PNG")
    elif suffix == "jpg":
        Image.fromarray((255 * pixels).astype(np.uint8)).save(stream, "JPEG")
    elif suffix == "tif":
        tifffile.imwrite(stream, (float(_pick(rng, (1, 255, 4095, 20000))) * grey).astype(np.uint16))
    else:
        values = grey * float(_mostly(rng, (1.0, 1e-30, 1e30), (1e-44, 3e38, -1.0)))
        if rng.random() < 0.1:
            values.flat[int(rng.integers(values.size))] = float(_pick(rng, (np.nan, np.inf, -np.inf, -1.0)))
        if suffix == "npy":
            np.save(stream, values)
        else:
            with np.errstate(over="ignore"):
                tifffile.imwrite(stream, values.astype(np.float32))
    return suffix.removeprefix("f."), stream.getvalue()


def _files(rng: Random, *names: str) -> tuple[Files, list[str]]:
    """Pictures by their names, with a suffix of their format; sometimes one of the others, damaged, or missing."""
    files, found, size = dict[str, bytes](), list[str](), _mostly(rng, (_SIZE,), _SIZES)
    for name in names:
        suffix, content = _picture(rng, size)
        file = f"{name}.{suffix}"
        if rng.random() < 0.03:
            content = bytes(damage(bytearray(content), rng))
        if rng.random() > 0.01:
            files[file] = content
        found.append(file)
    return files, found


def _contrast(rng: Random) -> Case:
    files, (picture, target) = _files(rng, "picture", "target")
    arguments = ["contrast", picture, "--json"]
    for chance, option in (
        (0.5, ["--region", _mostly(rng, _REGIONS, _WRONG_REGIONS)]),
        (0.7, ["--target", _pick(rng, (target, target, picture))]),
        (0.3, ["--align"]),
        (0.3, ["--linear"]),
        (0.1, ["--edge", _mostly(rng, _REGIONS, _WRONG_REGIONS)]),
        (0.7, ["--jpeg"]),
        (0.03, ["--framing", _pick(rng, ("fit", "crop:0,0,9", "crop:nan,0"))]),
    ):
        arguments += option if rng.random() < chance else []
    return files_case("contrast", " ".join(arguments), files, *arguments)


def _hologram(rng: Random) -> Case:
    """A hologram of 24 × 32 samples beside targets, through pupils and instruments, in `contrast` and `report`."""
    files, (target, depth) = _files(rng, "target", "depth")
    first = _pick(rng, ("bench.toml", "hologram.safetensors"))
    command = _pick(rng, (["contrast", first], ["contrast", first], ["report", first, "-o", "r.html"]))
    claims = [["--claim", _mostly(rng, _CLAIMS, _WRONG_CLAIMS)] for _ in range(2)] * (command[0] == "report")
    further = [["hologram.safetensors"], ["--title", "x" * 3000]] * (command[0] == "report")
    camera = ["camera", "--f-number", _mostly(rng, ("16", "60"), ("0", "nan", "0.7")), "--pixel"]
    pupils = [["--pupils", _mostly(rng, ("2mm", "1,3mm"), ("0mm", "nan", "90mm", ""))]] * (command[0] == "contrast")
    options = [
        (0.7, ["--target", _pick(rng, (target, target, "picture.png"))]),
        (0.3, ["--depth", _pick(rng, (depth, target))]),
        (0.5, ["--region", _mostly(rng, _REGIONS, _WRONG_REGIONS)]),
        (0.5, ["--set", "eye={}"]),
        (0.2, ["--plane", _mostly(rng, ("10mm", "8mm"), ("0mm", "nan", "-1mm", "1e300mm"))]),
        (0.1, ["--edge", _mostly(rng, _REGIONS, _WRONG_REGIONS)]),
        (0.3, ["--meter", *_pick(rng, (["eye"], ["iec"], [*camera, _mostly(rng, ("4um", "9um"), ("0um", "1m"))]))]),
        *((0.4, given) for given in claims),
        *((0.2, given) for given in further),
        *((0.5, given) for given in pupils),
        *((0.3, ["--align"]) for _ in pupils),
    ]
    options.sort(key=lambda pair: pair[1][0].startswith("--"))  # names of files stand before options
    arguments = [*command, *(part for chance, option in options if rng.random() < chance for part in option), "--json"]
    return files_case(
        "measured holograms", " ".join(arguments), valid("picture") | valid("hologram") | files, *arguments
    )


def _light(rng: Random) -> Case:
    """A damaged file of light, measured, compared, or as a target."""
    names = [f"light.{suffix}" for suffix in ("npz", "npy", "exr", "tif")]
    name, other = _pick(rng, names), _pick(rng, names)
    files = valid("light") | valid("hologram") | valid("picture")
    if rng.random() < 0.9:
        files |= {name: bytes(damage(bytearray(files[name]), rng))}
    arguments = _pick(
        rng,
        (
            ["contrast", name],
            ["contrast", name, "--edge", "0,0,16,16"],
            ["compare", name, other],
            ["compare", name, "hologram.safetensors"],
            ["contrast", "hologram.safetensors", "--target", name],
            ["report", "hologram.safetensors", "--target", name, "-o", "r.html"],
        ),
    )
    return files_case("files of light", " ".join(arguments), files, *arguments, "--json")


def _photograph(rng: Random) -> Case:
    files, (picture, dark, again, other) = _files(rng, "picture", "dark", "again", "other")
    arguments = ["contrast", picture]
    if rng.random() < 0.3:
        wrong = ("638nm", "638,638nm", "1nm,2nm", "nan,1nm", "")
        arguments += [other, "--lasers", _mostly(rng, ("638,450nm", "460nm,532nm"), wrong)]
    for chance, option in (
        (1.0, _pick(rng, (["--dark", dark], ["--black", _mostly(rng, _NUMBERS, _WRONG_NUMBERS)], ["--dark", picture]))),
        (0.6, ["--gain", _mostly(rng, _NUMBERS, _WRONG_NUMBERS)]),
        (0.3, ["--read-noise", _mostly(rng, _NUMBERS, _WRONG_NUMBERS)]),
        (0.3, ["--repeat", _pick(rng, (again, picture))]),
        (1.0, [_mostly(rng, ("--linear",), ("--encoded",))]),
        (0.7, ["--saturation", _mostly(rng, ("keep", "undo"), ("refuse", "what"))]),
        (0.1, ["--together", again]),
        (0.3, ["--target", other]),
        (0.4, ["--region", _mostly(rng, _REGIONS, _WRONG_REGIONS)]),
        (0.5, ["--jpeg"]),
    ):
        arguments += option if rng.random() < chance else []
    return files_case("photographs", " ".join(arguments), files, *arguments, "--json")


@cache
def _captures_in_sets() -> bytes:
    """A capture file whose lasers show equal patterns."""
    stream = io.BytesIO(valid("captures")["captures.h5"])
    with h5py.File(stream, "r+") as h5:
        levels = h5["slm1/levels"]
        levels[len(levels) // 2 :] = levels[: len(levels) // 2]
    return stream.getvalue()


def _captures(rng: Random) -> Case:
    """A capture file, at times damaged, with options that mean nothing to it among others."""
    name, content = "captures.h5", _captures_in_sets()
    files = {name: bytes(damage(bytearray(content), rng)) if rng.random() < 0.3 else content}
    arguments = ["contrast", name, "--json"]
    for chance, option in (
        (0.5, ["--region", _mostly(rng, _REGIONS, _WRONG_REGIONS)]),
        (0.5, ["--observer", _mostly(rng, ("eye", "mono", "age 70, field 4"), ("age 5", "nobody", "x.csv"))]),
        (0.3, ["--scatter", "s.png"]),
        (0.1, _pick(rng, (["--plot", "p.png"], ["--meter", "eye"], ["--gain", "2"], ["--set", "eye={}"]))),
    ):
        arguments += option if rng.random() < chance else []
    return files_case("measured captures", " ".join(arguments), files, *arguments)


def _observer(rng: Random) -> Case:
    rows = "".join(f"{nm},{','.join(f'{v:.4f}' for v in rng.random(3))}\n" for nm in range(380, 781, 20))
    table = bytes(damage(bytearray(f"nm,l,m,s\n{rows}".encode()), rng))
    number = partial(_pick, rng, ("5", "20", "80", "99", "-3", "nan", "1e300", "", "32.5", "1", "10", "101"))
    who = _pick(
        rng,
        (
            *("eye", "cie1931", "mono", "nobody", "", "cones.csv", "cones.csv", "cones.csv", "missing.csv"),
            *(f"age {number()}", f"age {number()}, field {number()}", f"person {number()}", f"field {number()}"),
        ),
    )
    command = _pick(rng, (["render", "bench.toml", *TORCH], ["contrast", "bench.toml", "--json"]))
    arguments = [*command, f"--observer={who}"]
    return files_case("observers", " ".join(arguments), valid("picture") | {"cones.csv": table}, *arguments)


def _profile(rng: Random) -> Case:
    """A picture whose embedded profile is damaged, or is none."""
    profile = bytearray(ImageCms.ImageCmsProfile(ImageCms.createProfile(_pick(rng, ("sRGB", "LAB", "XYZ")))).tobytes())
    content = bytes(damage(profile, rng)) if rng.random() < 0.8 else rng.bytes(int(rng.integers(0, 400)))
    kind, mode, stream = _pick(rng, ("PNG", "JPEG", "TIFF", "WEBP")), _pick(rng, ("RGB", "RGB", "L")), io.BytesIO()
    Image.fromarray((255 * np.resize(_pixels(rng), (24, 32, 3))).astype(np.uint8)).convert(mode).save(
        stream, kind, icc_profile=content
    )
    name = f"p.{kind.lower()}"
    arguments = _pick(
        rng,
        (
            ("contrast", name, "--json", "--jpeg"),
            ("optimise", "bench.toml", name, "--iterations=1", "--json"),
            ("compare", name, "picture.png", "--json"),
        ),
    )
    return files_case("profiles", " ".join(arguments), valid("picture") | {name: stream.getvalue()}, *arguments)


@cache
def _encoded() -> dict[str, bytes]:
    """Pictures and animations of the formats that a decoder reads, as far as this machine writes them."""
    pictures = [Image.fromarray(np.random.default_rng(n).integers(0, 256, (24, 32, 3), dtype=np.uint8)) for n in (1, 2)]
    alpha, found = pictures[0].copy(), dict[str, bytes]()
    alpha.putalpha(128)
    for kind in ("WEBP", "AVIF", "GIF", "PNG", "HEIF"):
        for name, images in (("still", pictures[:1]), ("moving", pictures), ("alpha", [alpha])):
            stream = io.BytesIO()
            try:
                images[0].save(stream, kind, save_all=len(images) > 1, append_images=images[1:])
            except (KeyError, OSError):  # no encoder here
                continue
            found[f"{name}.{kind.lower()}"] = stream.getvalue()
    return found


def _decoder(rng: Random) -> Case:
    """A damaged file of a decoder, perhaps under the name of another format."""
    name = _pick(rng, list(_encoded()))
    data = bytes(damage(bytearray(_encoded()[name]), rng)) if rng.random() < 0.95 else _encoded()[name]
    name = name if rng.random() < 0.9 else f"{name.split('.')[0]}.{_pick(rng, ('webp', 'avif', 'gif', 'heic', 'png'))}"
    arguments = _pick(
        rng,
        (
            ("optimise", "bench.toml", name, "--iterations=1", "--json"),
            ("contrast", name, "--json"),
            ("info", name, "--json"),
            ("optimise", "bench.toml", "picture.png", "--depth", name, "--iterations=1", "--json"),
        ),
    )
    return files_case("decoders", " ".join(arguments), valid("picture") | {name: data}, *arguments)


MAKERS: dict[str, Callable[[Random], Case]] = {
    "contrast": _contrast,
    "measured holograms": _hologram,
    "files of light": _light,
    "photographs": _photograph,
    "measured captures": _captures,
    "observers": _observer,
    "profiles": _profile,
    "decoders": _decoder,
}


def measured_cases(seed: int, families: Sequence[str] | None = None) -> Iterator[Case]:
    """Cases without end, the families in turn; all families if None."""
    rng = np.random.default_rng([seed, 9])
    while True:
        for family, make in MAKERS.items():
            if families is None or family in families:
                yield make(rng)
