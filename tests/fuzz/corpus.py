"""Hostile and clumsy inputs that once ended badly: each is to be refused in one line, or to give a finite result."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

from tests.fuzz.trial import Case
from tests.fuzz.valid_files import BENCH, valid, write

Files = dict[str, bytes]
TORCH = ("--backend", "torch", "--json")


def files_case(family: str, name: str, files: Files, *arguments: str) -> Case:
    """A case of files with the contents given."""
    return Case(family, name, lambda folder: write(folder, files), arguments)


# --- text ------------------------------------------------------------------------------------------------------------


def presets() -> Iterator[Case]:
    deep = {
        "brackets": "a = " + "[" * 5000 + "]" * 5000,
        "tables": "a = " + "{a=" * 3000 + "1" + "}" * 3000,
        "dotted keys": ".".join("a" * 20000) + " = 1",
        "dotted in a known table": "relay2." + ".".join("a" * 20000) + " = 1",
        "dotted table": "[" + ".".join("a" * 20000) + "]",
    }
    texts = {f"deep {name}": text for name, text in deep.items()}
    texts |= {
        "huge integer": BENCH.replace("levels = 16", "levels = 1" + "0" * 400),
        "huge integer, hexadecimal": BENCH.replace("levels = 16", "levels = 0x1" + "0" * 9000),
        "huge integer as number": "gap = 1" + "0" * 400 + "\n" + BENCH,
        "huge integer in a list": BENCH.replace("[[1.0, 0.5]]", "[[1" + "0" * 5000 + ", 1]]"),
        "integer of 5000 digits": "gap = 1" + "0" * 5000 + "\n" + BENCH,
        "name isn't text": BENCH.replace('"small"', "7"),
        "name with NUL": BENCH.replace('"small"', r'"a\u0000b"'),
        "base isn't text": "base = 7",
        "base with NUL": r'base = "a\u0000b.toml"',
        "base is a list": 'base = ["holochrome-8"]',
        "base too long": f'base = "{"a" * 5000}.toml"',
        "effects isn't a table": "effects = 3\n" + BENCH,
        "effect isn't a table": BENCH + "[effects]\ngap = 3\n",
        "effect unknown": BENCH + "[effects.nosuch]\na = 3\n",
        "file of maps isn't text": BENCH + "[effects.calibrated]\nfile = 3\n",
        "file of maps with NUL": BENCH + '[effects.calibrated]\nfile = "a\\u0000b"\n',
        "file of maps is a list": BENCH + '[effects.calibrated]\nfile = ["a"]\n',
        "modulators is a table": BENCH.replace("[[modulators]]", "[modulators]"),
        "modulators is text": 'modulators = "two"\n' + BENCH.split("[[modulators]]")[0],
        "frames of nothing": BENCH.replace("[[1.0, 0.5]]", "[]\nframes = 2"),
        "frames huge": "frames = 1048576\n" + BENCH,
        "count huge": BENCH.replace('["3 mm"]', '{first = "1 mm", last = "2 mm", count = 1048576}'),
        "grid isn't numbers": BENCH + '[source]\ngrid = 3\nspacing = "1 mrad"\n',
        "spacing infinite": BENCH + "[source]\ngrid = [3, 3]\nspacing = inf\n",
        "spacing huge": BENCH + '[source]\ngrid = [3, 3]\nspacing = "1e300 rad"\n',
        "pitch infinite": BENCH.replace('"8 um"', "inf"),
        "pitch NaN": BENCH.replace('"8 um"', "nan"),
        "exponent huge": BENCH.replace('"8 um"', '"1e999999999 um"'),
        "digits many": BENCH.replace('"8 um"', '"' + "8" * 5000 + ' um"'),
        "digits small": BENCH.replace('"8 um"', '"0.' + "0" * 5000 + '8 um"'),
        "date": BENCH.replace('"3 mm"', "1979-05-27"),
        "not text": "\x00\x01\x02",
        "wide": BENCH.replace("shape = [12, 16]", "shape = [16384, 16384]"),
        "negative zero": BENCH.replace('"3 mm"', '"-0 mm"'),
        "sequence deep": 'amplitudes = "white"\nsequence = [[[1]]]\n' + BENCH.replace("amplitudes = [[1.0, 0.5]]", ""),
        "amplitudes nested": BENCH.replace("[[1.0, 0.5]]", "[[[1.0]], [0.5]]"),
        "zernike of a huge index": BENCH + '[relay2.zernike]\nZ99999999999999999999 = "1 nm"\n',
        "zernike of a long index": BENCH + "[relay2.zernike]\nZ" + "9" * 5000 + ' = "1 nm"\n',
        "levels many": BENCH.replace("levels = 16", f"levels = {list(range(3))}"),
        "iris tiny": BENCH + "[relay2]\niris_na = 1e-5\n",
        "stuck many": BENCH + f"[effects.slm1_stuck]\ncolumns = {[1e300]}\n",
    }
    for name, text in texts.items():
        files = {"p.toml": text.encode()}
        yield files_case("presets", name, files, "render", "p.toml", *TORCH)
    yield files_case("presets", "not UTF-8", {"p.toml": b"\xff\xfe\x00"}, "render", "p.toml", *TORCH)
    chain = {f"{n}.toml": f'base = "{n + 1}.toml"'.encode() for n in range(1500)} | {"1500.toml": BENCH.encode()}
    yield files_case("presets", "base chain of 1500", chain, "info", "0.toml")
    cycle = {f"{n}.toml": f'base = "{(n + 1) % 10}.toml"'.encode() for n in range(10)}
    yield files_case("presets", "base cycle of 10", cycle, "info", "0.toml")


HOSTILE = ("nan", "inf", "-inf", "1e300", "-1e300", "1e-320", "9" * 23, "9" * 5000, "", "\x00", "0")
"""Texts in place of a number."""


OPTIMISE_ONCE = ("optimise", "bench.toml", "picture.png", "--iterations", "1", "--json")
DIAGNOSE = ("diagnose", "captures.h5", "--workers", "1", "--time", "1s")


def options() -> Iterator[Case]:
    """Values of options that no command expects."""
    yield from _options_of_optimise()
    yield from _keys_of_a_bench()
    yield from _options_of_render()
    for value in HOSTILE:
        yield from _options_of_captures(value)
    for known in ("gap.gap_error=0.1mm", "slm_alignment.shift_x=1um"):  # of a second modulator, which isn't there
        yield files_case("options", f"--known {known}", valid("captures"), *DIAGNOSE, "--known", known)
    yield from _names_of_files()


def _options_of_optimise() -> Iterator[Case]:
    bench = valid("picture")
    flags = ("brightness", "saturation", "eyebox", "margin", "iterations", "step", "until-psnr", "time", "seed")
    flags += ("checkpoint-every", "plane-weights", "wavelength-spacing", "at", "near", "pupils", "region")
    for flag in flags:
        for value in HOSTILE:
            yield files_case("options", f"--{flag} {value[:20]!r}", bench, *OPTIMISE_ONCE, f"--{flag}={value}")
    for value in ("nan,0,4,4", "0,0,inf,4", "0,0,9999999999999999999999,4", "1e3,0,4,4", "²,0,4,4", "0,0,4"):
        yield files_case("options", f"--region {value}", bench, *OPTIMISE_ONCE, f"--region={value}")
    for pair in (("nan", "700"), ("inf", "inf"), ("-1e300", "1e300"), ("440", "1e-320")):
        yield files_case("options", f"--wavelength-range {pair}", bench, *OPTIMISE_ONCE, "--wavelength-range", *pair)


def _keys_of_a_bench() -> Iterator[Case]:
    bench, further = valid("picture"), ("[16384,16384]", "{a=1}", "[[[[1]]]]", "[" * 3000, "true", "1" + "0" * 500)
    for key in ("gap", "shape", "frames", "upsample", "pitch", "planes", "levels", "eye", "source", "effects", "name"):
        for value in (*HOSTILE, *further, '"\\u0000"'):
            arguments = ("render", "bench.toml", "--set", f"{key}={value}", *TORCH)
            yield files_case("options", f"--set {key}={value[:20]!r}", bench, *arguments)
    long = ("a" * 70000 + "=1", ".".join("a" * 5000) + "=1", "relay2." * 2000 + "a=1")
    for text in (*long, "modulators.99999999999999.pitch=1"):
        yield files_case("options", f"--set {text[:20]}", bench, "render", "bench.toml", "--set", text, *TORCH)


def _options_of_render() -> Iterator[Case]:
    bench = valid("picture")
    for value in HOSTILE:
        for flag in ("exposure", "plane", "random"):
            arguments = ("render", "bench.toml", f"--{flag}={value}", *TORCH)
            yield files_case("options", f"--{flag} {value[:20]!r}", bench, *arguments)


def _options_of_captures(value: str) -> Iterator[Case]:
    """Of `captures`, `diagnose` and `calibrate`."""
    captures, bench, shown = valid("captures"), valid("picture"), repr(value[:20])
    plan = ("captures", "plan", "captures.h5", "--json")
    for flag in ("power", "exposure"):
        yield files_case("options", f"plan --{flag} {shown}", captures, *plan, f"--{flag}", "0.1", value)
    yield files_case("options", f"plan --headroom {shown}", captures, *plan, f"--headroom={value}")
    show = ("captures", "show", "captures.h5", "-o", "o.png")
    yield files_case("options", f"show --most {shown}", captures, *show, f"--most={value}")
    make = ("captures", "make", "bench.toml", "-o", "o.h5", "--each", "1")
    flags = ("exposure-jitter", "prnu", "camera-jitter", "wavelength-jitter", "finer", "each")
    for flag in (*flags, "camera-pitch", "focal-length"):
        yield files_case("options", f"make --{flag} {shown}", bench, *make, f"--{flag}={value}")
    yield files_case("options", f"make --camera-shape {shown}", bench, *make, "--camera-shape", value, "16")
    for flag in ("finer", "padding", "points") if value in ("nan", "9" * 23, "0", "") else ():
        yield files_case("options", f"diagnose --{flag} {shown}", captures, *DIAGNOSE, f"--{flag}={value}")
    for known in (f"distance.distance_error={value}", f"nosuch.parameter={value}"):
        yield files_case("options", f"--known {known[:30]!r}", captures, *DIAGNOSE, "--known", known)
    calibrate = ("calibrate", "captures.h5", "-o", "o.toml", "--epochs=1")
    for flag in ("batch", "rate", "held-out", "pixels-a-node", *(["epochs"] if value != "0" else [])):
        yield files_case("options", f"calibrate --{flag} {shown}", captures, *calibrate, f"--{flag}={value}")


def _names_of_files() -> Iterator[Case]:
    commands: dict[str, Callable[[str], tuple[str, ...]]] = {
        "picture": lambda path: ("optimise", "bench.toml", path, "--iterations", "1"),
        "preset": lambda path: ("info", path),
        "hologram": lambda path: ("render", "--hologram", path),
        "captures": lambda path: ("captures", "check", path),
        "sweep": lambda path: ("calibrate", "lut", path),
        "import": lambda path: ("captures", "import", path, "-o", "o.h5"),
        "depth": lambda path: (*OPTIMISE_ONCE, "--depth", path),
        "resume": lambda path: (*OPTIMISE_ONCE, "--resume", path),
        "pattern": lambda path: ("render", "bench.toml", "--slm1", path, *TORCH),
    }
    for path in ("a\x00b", "a" * 5000, "/dev/null", "/dev/zero", "."):
        for what, command in commands.items():
            yield files_case("options", f"{what} {path[:20]!r}", valid("picture"), *command(path))


# --- what isn't a plain file -----------------------------------------------------------------------------------------

READERS: dict[str, tuple[str, ...]] = {
    "preset.toml": ("info", "preset.toml"),
    "picture.png": ("optimise", "bench.toml", "picture.png", "--iterations", "1"),
    "depth.npy": ("optimise", "bench.toml", "p.png", "--depth", "depth.npy", "--iterations", "1"),
    "checkpoint.safetensors": ("optimise", "bench.toml", "p.png", "--resume", "checkpoint.safetensors"),
    "start.safetensors": ("optimise", "bench.toml", "p.png", "--start", "start.safetensors"),
    "hologram.safetensors": ("render", "--hologram", "hologram.safetensors", *TORCH),
    "pattern.png": ("render", "bench.toml", "--slm1", "pattern.png", *TORCH),
    "maps.safetensors": ("render", "bench.toml", "--effects", "calibrated.file=maps.safetensors", *TORCH),
    "captures.h5": ("captures", "check", "captures.h5"),
    "sweep.csv": ("calibrate", "lut", "sweep.csv"),
    "effects.py": ("render", "bench.toml", "--effects", "effects.py", *TORCH),
    "hologram-to-export.safetensors": ("export", "hologram-to-export.safetensors", "-o", "out"),
    "contrast.png": ("contrast", "contrast.png"),
}
"""A command for each kind of input file, by the file's name."""


def special_files() -> Iterator[Case]:
    makers: dict[str, Callable[[Path], object]] = {
        "FIFO": os.mkfifo,
        "folder": Path.mkdir,
        "device": lambda path: path.symlink_to("/dev/zero"),
        "link to itself": lambda path: path.symlink_to(path.name),
        "link to nothing": lambda path: path.symlink_to("nothing"),
        "empty file": Path.touch,
        "no permission": lambda path: (path.touch(), path.chmod(0)),
        "zeros": lambda path: path.write_bytes(bytes(4096)),
        "text": lambda path: path.write_text("hello\n" * 40, encoding="utf-8"),
    }
    for kind, make in makers.items():
        for name, arguments in READERS.items():

            def prepare(folder: Path, name: str = name, make: Callable[[Path], object] = make) -> None:
                write(folder, {"bench.toml": BENCH.encode(), "p.png": valid("picture")["picture.png"]})
                make(folder / name)

            if not (name == "effects.py" and kind in ("no permission", "empty file")):
                yield Case("special files", f"{kind} as {name}", prepare, arguments)
    for name in ("captures.csv", "bench.toml", "seen0.png", "sent1.png"):
        for kind in ("FIFO", "folder", "device"):

            def in_folder(folder: Path, name: str = name, make: Callable[[Path], object] = makers[kind]) -> None:
                write(folder, {key: value for key, value in valid("folder").items() if key != name})
                make(folder / name)

            yield Case(
                "special files", f"{kind} as {name} of a folder", in_folder, ("captures", "import", ".", "-o", "o.h5")
            )
