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


def options() -> Iterator[Case]:
    hostile = (
        "nan",
        "inf",
        "-inf",
        "1e300",
        "-1e300",
        "1e-320",
        "99999999999999999999999",
        "9" * 5000,
        "",
        "\x00",
        "0",
    )
    bench = valid("picture")
    optimise = ("optimise", "bench.toml", "picture.png", "--iterations", "1", "--json")
    flags = ("brightness", "saturation", "eyebox", "margin", "iterations", "step", "until-psnr", "time", "seed")
    flags += ("checkpoint-every", "plane-weights", "wavelength-spacing", "at", "near", "pupils", "region")
    for flag in flags:
        for value in hostile:
            yield files_case("options", f"--{flag} {value[:20]!r}", bench, *optimise, f"--{flag}={value}")
    for value in ("nan,0,4,4", "0,0,inf,4", "0,0,9999999999999999999999,4", "1e3,0,4,4", "²,0,4,4", "0,0,4"):
        yield files_case("options", f"--region {value}", bench, *optimise, f"--region={value}")
    for pair in (("nan", "700"), ("inf", "inf"), ("-1e300", "1e300"), ("440", "1e-320")):
        yield files_case("options", f"--wavelength-range {pair}", bench, *optimise, "--wavelength-range", *pair)
    for key in ("gap", "shape", "frames", "upsample", "pitch", "planes", "levels", "eye", "source", "effects", "name"):
        for value in (
            *hostile,
            "[16384,16384]",
            "{a=1}",
            "[[[[1]]]]",
            "[" * 3000,
            "true",
            "1" + "0" * 500,
            '"\\u0000"',
        ):
            arguments = ("render", "bench.toml", "--set", f"{key}={value}", *TORCH)
            yield files_case("options", f"--set {key}={value[:20]!r}", bench, *arguments)
    for text in (
        "a" * 70000 + "=1",
        ".".join("a" * 5000) + "=1",
        "relay2." * 2000 + "a=1",
        "modulators.99999999999999.pitch=1",
    ):
        yield files_case("options", f"--set {text[:20]}", bench, "render", "bench.toml", "--set", text, *TORCH)
    for value in hostile:
        yield files_case(
            "options", f"--exposure {value[:20]!r}", bench, "render", "bench.toml", f"--exposure={value}", *TORCH
        )
        yield files_case(
            "options", f"--plane {value[:20]!r}", bench, "render", "bench.toml", f"--plane={value}", *TORCH
        )
        yield files_case(
            "options", f"--random {value[:20]!r}", bench, "render", "bench.toml", f"--random={value}", *TORCH
        )
    captures = valid("captures")
    plan = ("captures", "plan", "captures.h5", "--json")
    for value in hostile:
        for flag in ("power", "exposure"):
            yield files_case("options", f"plan --{flag} {value[:20]!r}", captures, *plan, f"--{flag}", "0.1", value)
        yield files_case("options", f"plan --headroom {value[:20]!r}", captures, *plan, f"--headroom={value}")
        show = ("captures", "show", "captures.h5", "-o", "o.png")
        yield files_case("options", f"show --most {value[:20]!r}", captures, *show, f"--most={value}")
        make = ("captures", "make", "bench.toml", "-o", "o.h5", "--each", "1")
        for flag in (
            "exposure-jitter",
            "prnu",
            "camera-jitter",
            "wavelength-jitter",
            "finer",
            "each",
            "camera-pitch",
            "focal-length",
        ):
            yield files_case("options", f"make --{flag} {value[:20]!r}", bench, *make, f"--{flag}={value}")
        yield files_case("options", f"make --camera-shape {value[:20]!r}", bench, *make, "--camera-shape", value, "16")
        diagnose = ("diagnose", "captures.h5", "--workers", "1", "--time", "1s")
        for flag in ("finer", "padding", "points"):
            if value in ("nan", "99999999999999999999999", "0", ""):
                yield files_case(
                    "options", f"diagnose --{flag} {value[:20]!r}", captures, *diagnose, f"--{flag}={value}"
                )
        for known in (f"distance.distance_error={value}", f"nosuch.parameter={value}"):
            yield files_case("options", f"--known {known[:30]!r}", captures, *diagnose, "--known", known)
        calibrate = ("calibrate", "captures.h5", "-o", "o.toml")
        for flag in ("batch", "rate", "held-out", "pixels-a-node", "epochs"):
            if not (flag == "epochs" and value in ("0",)):
                yield files_case(
                    "options",
                    f"calibrate --{flag} {value[:20]!r}",
                    captures,
                    *calibrate,
                    "--epochs=1",
                    f"--{flag}={value}",
                )
    for known in ("gap.gap_error=0.1mm", "slm_alignment.shift_x=1um"):  # of a second modulator, which isn't there
        yield files_case("options", f"--known {known}", captures, *diagnose, "--known", known)
    for path in ("a\x00b", "a" * 5000, "/dev/null", "/dev/zero", "."):
        yield files_case(
            "options", f"picture {path[:20]!r}", bench, "optimise", "bench.toml", path, "--iterations", "1"
        )
        yield files_case("options", f"preset {path[:20]!r}", bench, "info", path)
        yield files_case("options", f"hologram {path[:20]!r}", bench, "render", "--hologram", path)
        yield files_case("options", f"captures {path[:20]!r}", bench, "captures", "check", path)
        yield files_case("options", f"sweep {path[:20]!r}", bench, "calibrate", "lut", path)
        yield files_case("options", f"import {path[:20]!r}", bench, "captures", "import", path, "-o", "o.h5")
        yield files_case("options", f"depth {path[:20]!r}", bench, *optimise, "--depth", path)
        yield files_case("options", f"resume {path[:20]!r}", bench, *optimise, "--resume", path)
        yield files_case("options", f"pattern {path[:20]!r}", bench, "render", "bench.toml", "--slm1", path, *TORCH)


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
