"""Random damage to valid files of every kind, and random values for every option."""

from __future__ import annotations

import argparse
import base64
import json
import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from holoview.evidence.study.runner import ResultStore
from holoview.evidence.study.study import StudyJob
from tests.fuzz.corpus import TORCH
from tests.fuzz.field_files import read_field
from tests.fuzz.trial import Case
from tests.fuzz.valid_files import small_system, valid, write

Random = np.random.Generator

_VALUES = (
    *("0", "1", "-1", "2", "3", "7", "16", "1e300", "-1e300", "1e-320", "nan", "inf", "-inf", "1e38", "0.5", "65536"),
    *("99999999999999999999", "2147483648", '""', '"a"', "[]", "{}", "[1, 2]", "[[1]]", "true", '"8 um"', '"3 mm"'),
    *('"1e99 mm"', '"-3 mm"', '"\\u0000"', '"é"', '"\\u001b[31m"', '"../../x"', "[nan]", "1979-05-27", "{a = 1}"),
)
_JSON_VALUES = (
    None,
    "",
    "a",
    -1,
    0,
    3,
    1e300,
    10**30,
    2**31,
    True,
    [],
    {},
    [1, 2],
    [[1]],
    {"a": 1},
    "1" * 5000,
    "\x00",
)
_NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")


def _flip(data: bytearray, rng: Random) -> None:
    for _ in range(int(rng.integers(1, 9))):
        data[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))


def _extreme(data: bytearray, rng: Random) -> None:
    """Some bytes in a row become those of an extreme number."""
    words = (b"\xff", b"\0\0\0\0", b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\xff\xff\xff\x7f", bytes(8), b"\xff" * 8)
    word = words[int(rng.integers(len(words)))]
    at = int(rng.integers(len(data)))
    data[at : at + len(word)] = word


def _early(data: bytearray, rng: Random) -> None:
    """As `_extreme`, in the first 256 bytes, where headers are."""
    head = bytearray(data[:256])
    _extreme(head, rng)
    data[:256] = head


def _truncate(data: bytearray, rng: Random) -> None:
    del data[int(rng.integers(len(data))) :]


def _repeat(data: bytearray, rng: Random) -> None:
    first, last = sorted(int(n) for n in rng.integers(len(data), size=2))
    data[last:last] = data[first:last]


def _remove(data: bytearray, rng: Random) -> None:
    at = int(rng.integers(len(data)))
    del data[at : at + int(rng.integers(1, 65))]


def _change_number(data: bytearray, rng: Random) -> None:
    """A number that is written as text becomes another value."""
    found = list(_NUMBER.finditer(bytes(data[:20000])))
    if found:
        match = found[int(rng.integers(len(found)))]
        data[match.start() : match.end()] = _VALUES[int(rng.integers(len(_VALUES)))].encode()


_DAMAGES: tuple[Callable[[bytearray, Random], None], ...] = (
    *(_flip, _extreme, _early, _truncate, _repeat, _remove, _change_number, _change_number),
)

PLANNED = ("measure", "rig.toml", "--plan", "plan.toml", "--dry-run", "-o", "o.h5")
"""Reads a rig and a plan, and opens no device."""

COMMANDS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "presets": ("picture", "bench.toml", ("render", "bench.toml", *TORCH)),
    "PNG": ("picture", "picture.png", ("optimise", "bench.toml", "picture.png", "--iterations=1", "--json")),
    "JPEG": ("picture", "picture.jpg", ("optimise", "bench.toml", "picture.jpg", "--iterations=1", "--json")),
    "TIFF": ("picture", "picture.tif", ("optimise", "bench.toml", "picture.tif", "--iterations=1", "--json")),
    "pages": ("picture", "pages.tif", ("optimise", "bench.toml", "pages.tif", "--iterations=1", "--json")),
    "EXR": ("picture", "picture.exr", ("optimise", "bench.toml", "picture.exr", "--iterations=1", "--json")),
    "arrays": (
        *("picture", "depth.npy"),
        ("optimise", "bench.toml", "picture.png", "--depth=depth.npy", "--iterations=1", "--json"),
    ),
    "patterns": ("pattern", "pattern.png", ("render", "bench.toml", "--slm1", "pattern.png", *TORCH)),
    "holograms": ("hologram", "hologram.safetensors", ("render", "--hologram", "hologram.safetensors", *TORCH)),
    "checkpoints": (
        *("checkpoint", "checkpoint.safetensors"),
        ("optimise", "bench.toml", "picture.png", "--iterations=3", "--resume=checkpoint.safetensors", "--json"),
    ),
    "maps": ("maps", "maps.safetensors", ("render", "calibrated.toml", *TORCH)),
    "captures": ("captures", "captures.h5", ("captures", "check", "captures.h5", "--json")),
    "tables": ("folder", "captures.csv", ("captures", "import", ".", "-o", "o.h5")),
    "benches": ("folder", "bench.toml", ("captures", "import", ".", "-o", "o.h5")),
    "sweeps": ("sweep", "sweep.csv", ("calibrate", "lut", "sweep.csv", "--json")),
    "rigs": ("rig", "rig.toml", PLANNED),
    "plans": ("rig", "plan.toml", PLANNED),
    "exposure tables": (
        *("rig", "exposures.csv"),
        ("measure", "rig.toml", "--plan", "exposures.csv", "--dry-run", "-o", "o.h5"),
    ),
    "placements": ("rig", "rig.placement.toml", ("rig", "show", "rig.toml")),
    "known placements": (
        *("rig", "rig.placement.toml"),
        ("diagnose", "captures.h5", "--known", "rig.placement.toml", "--workers=1", "--time=1s", "--json=o.json"),
    ),
}
"""For each family the kind of valid files, the one that is damaged, and the command that reads it."""


def damaged(family: str, rng: Random) -> Case:
    """A case of a family: a valid file with one to three kinds of damage."""
    kind, file, arguments = COMMANDS[family]
    return Case(family, f"{family} {int(rng.integers(1 << 30))}", _preparation(kind, file, rng), arguments)


def damaged_session(rng: Random) -> Case:
    """A saved session with damage to its JSON or an object; what can't be read is to be left out."""
    files = sorted(valid("session"))
    file = files[int(rng.integers(len(files)))]

    def read() -> None:
        from holoview.viewer.document.archive import read_session

        read_session(Path("session"))

    return Case("sessions", file, _preparation("session", file, rng), call=read)


def damaged_job(rng: Random) -> Case:
    """The result of a study's job with damage; it is to be read, or to be done again."""
    files = sorted(valid("job"))
    file = files[int(rng.integers(len(files)))]

    def read() -> None:
        job = StudyJob("probe", "probe", {})
        object.__setattr__(job, "key", "job")
        ResultStore(Path()).load(job)

    return Case("jobs", file, _preparation("job", file, rng), call=read)


def damaged_virtual_bench(rng: Random) -> Case:
    """What a virtual bench really is, with damage; a bench reads it in a process of its own."""

    def read() -> None:
        from holoview.bench.rig import read_rig
        from holoview.bench.rig.virtual.server import read_virtual_settings

        read_virtual_settings(read_rig("rig.toml"))

    return Case("virtual benches", "hidden.toml", _preparation("rig", "hidden.toml", rng), call=read)


def damaged_web_page(rng: Random) -> Case:
    """A hologram as a web page, with damage to its text, its JSON or its unpacked data, opened by a link at random."""
    data = valid("web page")["page.html"]
    damages = (_damaged_json, _damaged_data, lambda data, rng: bytes(damage(bytearray(data), rng)))
    page = damages[int(rng.integers(len(damages)))](data, rng)
    keys = ("plane", "gap", "laser1", "power2", "wavelength1", "pupil", "view", "x", "")
    parts = [f"{keys[int(rng.integers(len(keys)))]}={_WORDS[int(rng.integers(len(_WORDS)))]}" for _ in range(2)]
    link = f"page.html#{'&'.join(parts)}" if rng.random() < 0.3 else "page.html"

    def read() -> None:
        from holoview.viewer.document.file_loader import read_content

        read_content(link, small_system())

    return Case("web pages", link[:80], lambda folder: write(folder, {"page.html": page}), call=read)


def _damaged_json(data: bytes, rng: Random) -> bytes:
    """A value anywhere in the page's document becomes another one, or is missing."""

    def edit(text: bytes) -> bytes:
        document = json.loads(text)
        place: Any = document
        while True:
            keys = list(place) if isinstance(place, dict) else range(len(place))
            key = keys[int(rng.integers(len(keys)))]
            if isinstance(place[key], dict | list) and place[key] and rng.random() < 0.8:
                place = place[key]
                continue
            if rng.random() < 0.2:
                del place[key]
            else:
                place[key] = _JSON_VALUES[int(rng.integers(len(_JSON_VALUES)))]
            return json.dumps(document).encode()

    return _with_part(data, b"holoview-page", edit)


def _damaged_data(data: bytes, rng: Random) -> bytes:
    """The binary data, unpacked, damaged and packed again."""

    def edit(text: bytes) -> bytes:
        return base64.b64encode(zlib.compress(damage(bytearray(zlib.decompress(base64.b64decode(text))), rng)))

    return _with_part(data, b"holoview-data-0", edit)


def _with_part(data: bytes, part: bytes, edit: Callable[[bytes], bytes]) -> bytes:
    """A page with the text of one of its elements edited."""
    start = data.index(b'id="' + part + b'">') + len(part) + 6
    end = data.index(b"</script>", start)
    return data[:start] + edit(data[start:end]) + data[end:]


def damaged_field(rng: Random) -> Case:
    """A hologram of another program, or the notes beside it, with damage."""
    files = sorted(valid("field"))
    file = files[int(rng.integers(len(files)))]
    name = file.removesuffix(".holoview.toml")
    return Case(
        "fields",
        f"{file} {int(rng.integers(1 << 30))}",
        _preparation("field", file, rng),
        call=partial(read_field, name),
    )


def _preparation(kind: str, file: str, rng: Random) -> Callable[[Path], None]:
    data = damage(bytearray(valid(kind)[file]), rng)
    return lambda folder: write(folder, valid(kind) | {file: bytes(data)})


def damage(data: bytearray, rng: Random) -> bytearray:
    """One to three kinds of damage, in place."""
    for _ in range(int(rng.integers(1, 4))):
        if data:
            _DAMAGES[int(rng.integers(len(_DAMAGES)))](data, rng)
    return data


# --- options ---------------------------------------------------------------------------------------------------------

_BENCH_KEYS = (
    *(
        "gap",
        "shape",
        "frames",
        "upsample",
        "pitch",
        "stroke",
        "levels",
        "planes",
        "wavelengths",
        "amplitudes",
        "padding",
    ),
    *("propagation", "observer", "eye", "source", "modulators", "relay2", "relay2.iris_na", "relay2.square", "name"),
    *(
        "relay2.aberration",
        "source.grid",
        "source.tilts",
        "eye.pupil",
        "eye.focus",
        "sampling",
        "effects",
        "description",
    ),
)
_WORDS = (
    *(value.strip('"') for value in _VALUES),
    *("", "\x00", "x" * 300, "1,2", "1x1:1mm", "0,0,4,4", "1e9,1"),
)


@cache
def _options() -> tuple[tuple[tuple[str, ...], str, int], ...]:
    """Every option that takes values, with the command before it and the number of values."""
    from holoview.commands.cli import _parser

    runs = {
        "render": ("render", "bench.toml", *TORCH),
        "optimise": ("optimise", "bench.toml", "picture.png", "--iterations=1", "--json"),
        "info": ("info", "bench.toml", "--json"),
        "contrast": ("contrast", "picture.png"),
    }
    found = []
    for command, run in runs.items():
        (subparsers,) = [a for a in _parser(command)._actions if isinstance(a, argparse._SubParsersAction)]
        for action in subparsers.choices[command]._actions:
            takes = action.option_strings and action.nargs != 0 and action.dest not in ("help", "adapter", "device")
            if takes and action.dest not in ("iterations", "output", "sharded", "time"):
                count = action.nargs if isinstance(action.nargs, int) else 1
                found.append((run, action.option_strings[-1], count))
    return tuple(found)


def random_option(rng: Random) -> Case:
    """A command with one option whose value is extreme, or with one key of the bench that is."""
    if rng.random() < 0.4:
        key, value = _BENCH_KEYS[int(rng.integers(len(_BENCH_KEYS)))], _VALUES[int(rng.integers(len(_VALUES)))]
        arguments: tuple[str, ...] = ("render", "bench.toml", *TORCH, "--set", f"{key}={value}")
    elif rng.random() < 0.4:
        arguments = ("render", "bench.toml", *TORCH, "--effects", _random_effect(rng))
    else:
        run, flag, count = _options()[int(rng.integers(len(_options())))]
        values = [_WORDS[int(rng.integers(len(_WORDS)))] for _ in range(count)]
        arguments = (*run, f"{flag}={values[0]}") if count == 1 else (*run, flag, *values)
    return Case("options", " ".join(arguments[2:])[:80], lambda folder: write(folder, valid("picture")), arguments)


def _random_effect(rng: Random) -> str:
    from holoview.light.model.effects.registry import listed_effects

    effects = list(listed_effects().values())
    effect = effects[int(rng.integers(len(effects)))]
    parameter = effect.parameters[int(rng.integers(len(effect.parameters)))]
    bounds = [f"{x:g}" for x in (parameter.low, parameter.high) if np.isfinite(x)]
    value = (*_VALUES, *bounds, *bounds)[int(rng.integers(len(_VALUES) + 2 * len(bounds)))]
    return f"{effect.id}.{parameter.name}={value}"


def random_cases(seed: int, families: Sequence[str] | None = None) -> Iterator[Case]:
    """Cases without end, the families in turn; all families if None."""
    rng = np.random.default_rng(seed)
    makers = [(family, partial(damaged, family, rng)) for family in COMMANDS]
    makers += [("sessions", partial(damaged_session, rng)), ("jobs", partial(damaged_job, rng))]
    makers += [("virtual benches", partial(damaged_virtual_bench, rng)), ("web pages", partial(damaged_web_page, rng))]
    makers += [("fields", partial(damaged_field, rng))] * 3
    makers += [("options", partial(random_option, rng))] * 3
    chosen = [make for family, make in makers if families is None or family in families]
    while True:
        for make in chosen:
            yield make()
