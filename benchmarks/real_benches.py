"""Draws benches that are as bad as real ones, by a program of its own, and how `holoview diagnose` names their causes.

    python -m benchmarks.real_benches make out/benches --seed 1 --count 20
    python -m benchmarks.real_benches make out/benches --seed 1 --count 20 --families single none --size 512
    python -m benchmarks.real_benches run out/benches/*.json -o out/real_benches.jsonl --options --workers 2
    python -m benchmarks.real_benches table out/real_benches.jsonl

The families: `real` benches have several large faults at once — a beam of 0.3 to 1 of the modulator anywhere on it,
1 to 10 rad of aberration with a shift of the picture, strokes of 0.4 to 1.5, light that isn't modulated, a saturated
zero order, stray light, dust, focal lengths wrong by up to 1 %, an axis anywhere — with cameras of 8 bits whose gain
nobody knows, and 1 to 4 pictures; `single` ones have one of these causes on an otherwise good bench, `none` have none.
Kinds: a Fourier bench as one picture and its pattern (PNG, which `captures import` takes), a Fourier bench as a capture
file, and the near field of one and of two modulators.

`benchmarks.plain_light` computes the light: nothing of holoview takes part but, in other processes, the commands that
are measured. The truth is in NAME.json, which they never see. A named cause is right if it describes a drawn one; a
cause that has nothing to do with a drawn one is a certain error.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from benchmarks.common import append_line, count_of, markdown_table, read_lines
from benchmarks.plain_light import Beam, Bench, Sensor, centred, hologram_levels, smooth_levels, zernike_sum
from benchmarks.real_sizes import run as run_diagnosis

FAMILIES = ("real", "single", "none")
KINDS = ("picture", "fourier", "near", "near-two")
SIDES = (64, 128, 256, 384, 512, 768, 1024)
"""Of modulators, pixels along the longer side."""


@dataclass(frozen=True)
class Truth:
    """A cause that was drawn. right: effects that describe it. akin: effects that describe a part of it, or the same
    light to first order: neither right nor wrong. places: where free maps may see it. is_wanted: whether a diagnosis
    should name it."""

    right: tuple[str, ...]
    akin: tuple[str, ...] = ()
    places: tuple[str, ...] = ("source", "modulator 1")
    is_wanted: bool = True


TRUTHS = {
    "beam": Truth(("beam", "source_profile", "source_field")),
    "wave": Truth(("slm_flatness", "beam"), ("tilt", "camera_alignment", "distance", "aberration1", "aberration2")),
    "shift": Truth(("tilt", "camera_alignment"), ("beam",), ("source", "modulator 1", "camera")),
    "stroke": Truth(("stroke",), ("lut", "dispersion", "lut_dispersion"), ("modulator 1", "modulator 2")),
    "zero_order": Truth(("undiffracted",), ("polarisation",), ("modulator 1", "modulator 2", "source")),
    "stray": Truth(("ambient", "camera_black"), ("polarisation",), ("camera",)),
    "scale": Truth(("camera_alignment",), ("wavelength_offset", "distance"), ("camera",)),
    "dust": Truth((), ("source_profile", "beam", "slm1_stuck"), is_wanted=False),
    "blur": Truth(("camera_blur",), ("motion_blur", "source_extent"), ("camera",)),
    "distance": Truth(("distance",), ("aberration2", "stage", "plane_errors"), ("relay 2",)),
    "gap": Truth(("gap",), ("aberration1",), ("relay 1",)),
    "second": Truth(("slm_alignment",), (), ("modulator 2",)),
}

_FOUND_UNASKED = {("shift", "picture")}
"""Causes that are none on a kind of bench: nobody states where the axis of an imported picture is."""


# --- drawing ----------------------------------------------------------------------------------------------------------


@dataclass
class Drawn:
    """A bench, what its owner believes of it, and its session. stated: of the file, as attributes of the format.

    saturated: share of the picture's pixels that the zero order and the brightest speckle saturate.
    """

    name: str
    family: str
    kind: str
    bench: Bench
    sensor: Sensor
    stated: dict[str, float]
    patterns: str
    pictures: int
    saturated: float
    wavelengths_m: tuple[float, ...]
    causes: dict[str, Any] = field(default_factory=dict)


def draw(seed: int, family: str, kind: str, largest: int) -> Drawn:
    """The bench of a seed. largest: modulator pixels along the longer side, at most."""
    rng = np.random.default_rng((seed, FAMILIES.index(family), KINDS.index(kind)))
    side = int(rng.choice([s for s in SIDES if largest / 4 <= s <= largest] or [largest]))
    shape = (side * 3 // 4, side)
    is_far = kind in ("picture", "fourier")
    wavelength_m = float(rng.choice([450e-9, 520e-9, 532e-9, 633e-9]))
    pitch_m = float(rng.choice([8e-6, 12.5e-6, 36e-6])) if is_far else 8e-6
    stroke_m, stated = 1.0 * wavelength_m, {"opd_range": wavelength_m}
    if is_far:
        camera_pitch_m = float(rng.choice([3.45e-6, 5.86e-6]))
        period_px = side * (rng.uniform(1.5, 2.2) if side <= 512 else rng.uniform(1.1, 1.4))
        camera = (round(0.68 * period_px), round(0.92 * period_px))
        focal_m = period_px * pitch_m * camera_pitch_m / wavelength_m
        bench = Bench(shape, camera, pitch_m, camera_pitch_m, stroke_m, focal_length_m=focal_m)
        stated["focal_length"] = focal_m
    else:
        camera_pitch_m, distance_m = pitch_m / 2, float(rng.uniform(3e-3, 8e-3))
        gap_m = float(rng.uniform(0.5e-3, 2e-3)) if kind == "near-two" else None
        camera = (shape[0] * 3 // 2, shape[1] * 3 // 2)
        bench = Bench(shape, camera, pitch_m, camera_pitch_m, stroke_m, distance_m=distance_m, gap_m=gap_m)
        stated |= {"distance": distance_m} | ({"gap": gap_m} if gap_m else {})
    pictures = 1 if kind == "picture" else int(rng.integers(1, 5))
    lines = (wavelength_m, wavelength_m + 60e-9) if not is_far and pictures == 4 else (wavelength_m,)
    gain, read_counts = float(np.exp(rng.uniform(np.log(4), np.log(60)))), float(rng.uniform(0.5, 1.5))
    sensor = Sensor(8, gain, gain * read_counts, float(rng.integers(2, 8)))
    stated |= {"electrons_per_count": gain, "read_noise": gain * read_counts, "axis_y": 0.0, "axis_x": 0.0}
    patterns = str(rng.choice(["blobs", "lines", "spots"])) if is_far else "smooth"
    drawn = Drawn(
        f"{family}-{kind}-{seed}",
        family,
        kind,
        bench,
        sensor,
        stated,
        patterns,
        pictures,
        0.0005 if family != "real" else float(rng.uniform(0.002, 0.02)),
        lines,
    )
    if family == "none":
        return drawn
    names = _possible(kind)
    if family == "single":
        names = [str(rng.choice([n for n in names if TRUTHS[n].is_wanted]))]
    for name in names:
        if family == "single" or name in ("beam", "wave", "stroke") or rng.random() < 0.5:
            _spoil(drawn, name, rng)
    if family == "real":
        believed = float(np.exp(rng.uniform(np.log(0.4), np.log(2.5))))  # of a gain that nobody has measured
        drawn.stated["electrons_per_count"] *= believed
        drawn.stated["read_noise"] *= believed
    return drawn


def _possible(kind: str) -> list[str]:
    names = ["beam", "wave", "shift", "stroke", "zero_order", "stray", "dust"]
    if kind in ("picture", "fourier"):
        return [*names, "scale"] if kind == "fourier" else names
    return [*names, "blur", "distance", *(["gap", "second"] if kind == "near-two" else [])]


def _spoil(drawn: Drawn, name: str, rng: np.random.Generator) -> None:
    """Puts a cause into the bench, and writes it down."""
    bench = drawn.bench
    size: Any
    if name == "beam":
        half, is_disc = min(bench.shape) / 2, rng.random() < 0.5
        radius = half * float(rng.uniform(0.3, 1.0))
        beam = Beam(
            radius,
            float(rng.choice([8.0, 20.0])) if is_disc else 2.0,
            tuple(float(v) for v in rng.uniform(-0.3, 0.3, 2) * (2 * half - radius)),
            float(rng.uniform(0.85, 1.18)) if rng.random() < 0.5 else 1.0,
        )
        bench, size = replace(bench, beam=beam), {"radius_px": radius, "edge": beam.edge, "centre_px": beam.centre}
    elif name == "wave":
        bench, size = _aberrated(bench, rng, rng.uniform(1, 10))
    elif name == "shift":
        moved = rng.uniform(-1, 1, 2) * (20 if bench.focal_length_m else 3)
        size = {"camera_px": moved.tolist()}
        if bench.focal_length_m:
            period_px = drawn.wavelengths_m[0] * bench.focal_length_m / (bench.pitch_m * bench.camera_pitch_m)
            bench = replace(bench, tilt=tuple((moved / period_px).tolist()))
        else:
            bench = replace(bench, axis_px=tuple(moved.tolist()))
    elif name == "stroke":
        size = float(rng.choice([rng.uniform(0.4, 0.85), rng.uniform(1.15, 1.5)]))
        bench = replace(bench, stroke_m=bench.stroke_m * size)
    elif name == "zero_order":
        share, turn = float(rng.uniform(0.05, 0.25)), float(rng.uniform(-1, 1))
        fill = float(rng.uniform(0.88, 0.97)) if bench.focal_length_m else 1.0
        bench, size = (
            replace(bench, unmodulated=share * np.exp(1j * turn), fill=fill),
            {"amplitude": share, "fill": fill},
        )
    elif name == "stray":
        stray = (float(rng.uniform(3, 20)), *(float(v) for v in rng.uniform(-2, 2, 2)))
        drawn.sensor, size = replace(drawn.sensor, stray=stray), {"counts": stray}
    elif name == "dust":
        spots = [
            (*(float(v) for v in rng.uniform(-0.3, 0.3, 2) * min(bench.shape)), float(rng.uniform(0.01, 0.03)) * side)
            for side in [bench.shape[1]] * int(rng.integers(1, 5))
        ]
        bench, size = replace(bench, dust=tuple(spots)), {"discs": len(spots)}
    elif name == "scale":
        size = float(rng.choice([-1, 1]) * rng.uniform(0.002, 0.01))
        drawn.stated["focal_length"] *= 1 + size
    elif name == "blur":
        size = float(rng.uniform(0.6, 1.5))
        bench = replace(bench, blur_px=size)
    elif name == "distance":
        size = float(rng.choice([-1, 1]) * rng.uniform(0.02, 0.08)) * bench.distance_m
        bench = replace(bench, distance_m=bench.distance_m + size)
    elif name == "gap":
        assert bench.gap_m is not None
        size = float(rng.choice([-1, 1]) * rng.uniform(0.05, 0.2)) * bench.gap_m
        bench = replace(bench, gap_m=bench.gap_m + size)
    else:
        size = (rng.integers(1, 6, 2) * rng.choice([-1, 1], 2) / 4).tolist()
        bench = replace(bench, second_px=tuple(size))
    drawn.bench, drawn.causes[name] = bench, size


def _aberrated(bench: Bench, rng: np.random.Generator, peak_to_valley: float) -> tuple[Bench, dict[str, Any]]:
    """A wavefront of so many radians from its lowest to its highest, over the beam."""
    orders = [(2, 0), (2, 2), (2, -2), (3, 1), (3, -1), (3, 3), (3, -3), (4, 0)]
    weights = rng.normal(0, 1, len(orders)) * np.array([1, 0.4, 0.4, 0.8, 0.8, 0.2, 0.2, 0.3])
    radius = bench.beam.radius if bench.beam else math.hypot(*bench.shape) / 2
    terms = dict(zip(orders, weights.tolist(), strict=True))
    y, x = centred(201)[:, None] / 100, centred(201)[None, :] / 100
    inside = zernike_sum(terms, y, x)[y**2 + x**2 <= 1]
    terms = {key: value * peak_to_valley / float(np.ptp(inside)) for key, value in terms.items()}
    told = {f"{n},{m}": value for (n, m), value in terms.items()}
    return replace(bench, wave=terms, wave_radius_px=radius), {"rad_peak_to_valley": peak_to_valley, "rad_rms": told}


# --- measuring --------------------------------------------------------------------------------------------------------


def measure(drawn: Drawn, folder: Path, seed: int) -> Path:
    """Takes the pictures and writes NAME.h5, or NAME.png with NAME-mask.png, and the truth. Its path."""
    rng, bench, where = np.random.default_rng((seed, 1)), drawn.bench, folder / drawn.name
    if drawn.kind == "picture" and drawn.family == "real":
        # The picture isn't centred on the zero order; the capture file of the other kind states where it is.
        bench = replace(bench, axis_px=tuple((rng.uniform(-0.15, 0.15, 2) * bench.camera).tolist()))
    elif drawn.kind == "fourier":
        stated = rng.uniform(-0.15, 0.15, 2) * bench.camera
        bench = replace(bench, axis_px=tuple(stated.tolist()))
        drawn.stated["axis_y"], drawn.stated["axis_x"] = (float(s) * bench.camera_pitch_m for s in stated)
    wavelength = np.resize(drawn.wavelengths_m, drawn.pictures)
    modulators = 2 if bench.gap_m is not None else 1
    levels, images = [], []
    for k in range(drawn.pictures):
        shown = [_pattern(drawn, rng, k) for _ in range(modulators)]
        light = bench.picture(shown, float(wavelength[k]))
        full = 2**drawn.sensor.bits - 1 - drawn.sensor.black
        gain = full / float(np.quantile(light, 1 - drawn.saturated))
        if k == 0:
            first_gain = gain  # all pictures of a session are exposed alike
        levels.append(shown)
        images.append(drawn.sensor.counts(rng, light * first_gain))
    truth = {
        "bench": drawn.name,
        "family": drawn.family,
        "kind": drawn.kind,
        "shape": bench.shape,
        "pictures": drawn.pictures,
        "patterns": drawn.patterns,
        "hidden": drawn.causes,
        "import": _import_options(drawn) if drawn.kind == "picture" else [],
    }
    where.with_suffix(".json").write_text(json.dumps(truth))
    if drawn.kind == "picture":
        Image.fromarray(images[0].astype(np.uint8)).save(where.with_suffix(".png"))
        Image.fromarray(levels[0][0]).save(folder / f"{drawn.name}-mask.png")
    else:
        _write(where.with_suffix(".h5"), drawn, np.array(levels), np.stack(images), wavelength)
    return where.with_suffix(".json")


def _pattern(drawn: Drawn, rng: np.random.Generator, k: int) -> NDArray[np.uint8]:
    if drawn.patterns == "smooth":
        return smooth_levels(rng, drawn.bench.shape, (3.0, 1.5, 5.0, 2.0)[k % 4])
    return hologram_levels(rng, drawn.bench.shape, drawn.patterns)


def _import_options(drawn: Drawn) -> list[str]:
    bench = drawn.bench
    assert bench.focal_length_m is not None
    about_m = bench.focal_length_m * (1.01 if drawn.family == "real" else 1.0)
    lengths = {
        "wavelength": drawn.wavelengths_m[0],
        "pitch": bench.pitch_m,
        "camera-pitch": bench.camera_pitch_m,
        "focal-length": about_m,
    }
    return [text for name, metres in lengths.items() for text in (f"--{name}", f"{metres * 1e6:.6g}um")]


def _write(
    path: Path, drawn: Drawn, levels: NDArray[np.uint8], images: NDArray[np.uint16], wavelength: NDArray[np.float64]
) -> None:
    """The capture file, as a laboratory would from the format's description."""
    bench, stated, count = drawn.bench, drawn.stated, len(images)
    with h5py.File(path, "w") as h5:
        h5.attrs.update(format="holoview-captures", version=1)
        for number in range(levels.shape[1]):
            slm = h5.create_group(f"slm{number + 1}")
            slm["levels"] = levels[:, number]
            slm.attrs.update(pitch=bench.pitch_m, num_levels=bench.num_levels, opd_range=stated["opd_range"])
        h5["camera/images"] = images
        h5["camera"].attrs.update(
            pitch=bench.camera_pitch_m,
            bit_depth=drawn.sensor.bits,
            black_level=drawn.sensor.black,
            electrons_per_count=stated["electrons_per_count"],
            read_noise=stated["read_noise"],
        )
        geometry = h5.create_group("geometry")
        if bench.focal_length_m is None:
            geometry.attrs.update(iris2_na=bench.iris)
        else:
            h5["camera"].attrs.update(axis_y=stated["axis_y"], axis_x=stated["axis_x"])
            geometry.attrs.update(focal_length=stated["focal_length"])
        if "gap" in stated:
            geometry.attrs.update(gap=stated["gap"], iris1_na=bench.iris)
        h5["wavelength"], h5["distance"] = wavelength, np.full(count, stated.get("distance", 0.0))
        h5["power"], h5["exposure"] = np.ones(count), np.full(count, 0.01)


# --- running and judging ----------------------------------------------------------------------------------------------


def run(truth: Path, options: list[str], limit_s: float) -> dict[str, Any]:
    """One diagnosis by the command line, with `captures import` before it where there is a picture."""
    capture_file, told = truth.with_suffix(".h5"), json.loads(truth.read_text(encoding="utf-8"))
    began = time.monotonic()
    if told["import"]:
        picture, mask = truth.with_suffix(".png"), truth.with_name(f"{truth.stem}-mask.png")
        command = [sys.executable, "-m", "holoview", "captures", "import", str(picture), "--pattern", str(mask)]
        command += [*told["import"], "-o", str(capture_file)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            refused = {"verdict": "not imported", "code": done.returncode, "why": done.stderr[-500:], "pss_gb": 0.0}
            return {**told, **refused, "seconds": time.monotonic() - began, "cpu_seconds": 0.0}
    imported_s = time.monotonic() - began
    result = run_diagnosis(capture_file, options, limit_s)
    return {**result, "import_seconds": imported_s}


@dataclass(frozen=True)
class Judged:
    """What a diagnosis was worth. beside: causes that were named beside the truth. place: whether the places of what
    stayed unexplained hold a drawn cause; None where it isn't said."""

    named: tuple[str, ...]
    missed: tuple[str, ...]
    beside: tuple[str, ...]
    place: bool | None


def judge(line: dict[str, Any]) -> Judged:
    """Of a line of `run`."""
    truths, named = {name: TRUTHS[name] for name in line["hidden"]}, line.get("named", [])
    allowed = {effect for truth in truths.values() for effect in (*truth.right, *truth.akin)}
    found = [name for name, truth in truths.items() if set(truth.right) & set(named)]
    missed = [
        n for n, t in truths.items() if t.is_wanted and n not in found and (n, line["kind"]) not in _FOUND_UNASKED
    ]
    places = {place for truth in truths.values() for place in truth.places}
    lives_in = line.get("lives_in") or []
    where = bool(places & set(lives_in)) if line.get("verdict") == "unexplained" and lives_in else None
    return Judged(tuple(found), tuple(missed), tuple(e for e in named if e not in allowed), where)


def table(lines: Sequence[dict[str, Any]]) -> str:
    """Tables by family, kind and size, by cause, and every bench."""
    judged = [(line, judge(line)) for line in lines]
    groups: dict[str, list[tuple[dict[str, Any], Judged]]] = {}
    for line, one in judged:
        groups.setdefault(f"{line['family']}, {line['kind']}, {line['shape'][1]} px", []).append((line, one))
    header = ["benches", "count", "wanted named", "beside the truth", "`consistent`", "`unexplained` (right place)"]
    header += ["s: median (most)", "GB, most"]
    rows = [[name, *_cells(own)] for name, own in sorted(groups.items())]
    parts = [markdown_table(header, [*rows, ["all", *_cells(judged)]]), _by_cause(judged)]
    each = [
        [
            line["bench"],
            ", ".join(line["hidden"]),
            line.get("verdict", "failed"),
            ", ".join(line.get("named", [])),
            ", ".join(one.beside),
            " → ".join(f"{c:.3g}" for c in line.get("chi2", [])),
            f"{line['seconds']:.0f}",
        ]
        for line, one in judged
    ]
    parts.append(markdown_table(["bench", "drawn", "verdict", "named", "beside", "χ²/n", "s"], each))
    return "\n\n".join(parts)


def _by_cause(judged: Sequence[tuple[dict[str, Any], Judged]]) -> str:
    rows = []
    for name, truth in TRUTHS.items():
        own = [one for line, one in judged if name in line["hidden"]]
        if own and truth.is_wanted:
            rows.append([name, str(len(own)), str(sum(name in one.named for one in own))])
    return markdown_table(["cause", "drawn", "named"], rows)


def _cells(own: Sequence[tuple[dict[str, Any], Judged]]) -> list[str]:
    wanted = sum(len(one.missed) + sum(TRUTHS[n].is_wanted for n in one.named) for _, one in own)
    found = sum(TRUTHS[n].is_wanted for _, one in own for n in one.named)
    unexplained = [one for line, one in own if line.get("verdict") == "unexplained"]
    seconds = [line["seconds"] for line, _ in own]
    return [
        str(len(own)),
        f"{found} of {wanted}",
        str(sum(len(one.beside) for _, one in own)),
        str(sum(line.get("verdict") == "consistent" for line, _ in own)),
        f"{len(unexplained)} ({sum(bool(one.place) for one in unexplained)})",
        f"{np.median(seconds):.0f} ({max(seconds):.0f})",
        f"{max(line['pss_gb'] for line, _ in own):.1f}",
    ]


def main() -> None:
    """Make benches, diagnose them, or print the tables of the runs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parts = parser.add_subparsers(dest="part", required=True)
    make = parts.add_parser("make")
    make.add_argument("folder", type=Path)
    make.add_argument("--seed", type=int, default=1, help="of the first bench")
    make.add_argument("--count", type=count_of, default=1, help="of each family and kind")
    make.add_argument("--families", nargs="+", choices=FAMILIES, default=FAMILIES)
    make.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    make.add_argument("--size", type=count_of, default=512, help="most modulator pixels along a side")
    do = parts.add_parser("run")
    do.add_argument("truths", type=Path, nargs="+", help="NAME.json")
    do.add_argument("-o", "--output", type=Path, required=True)
    do.add_argument("--limit", type=float, default=math.inf, help="seconds after which a diagnosis is stopped")
    do.add_argument("--options", nargs=argparse.REMAINDER, default=[], help="of holoview diagnose; the last argument")
    show = parts.add_parser("table")
    show.add_argument("files", type=Path, nargs="+")
    args = parser.parse_args()
    if args.part == "make":
        args.folder.mkdir(parents=True, exist_ok=True)
        for seed in range(args.seed, args.seed + args.count):
            for family in args.families:
                for kind in args.kinds:
                    print(measure(draw(seed, family, kind, args.size), args.folder, seed), flush=True)
    elif args.part == "run":
        for truth in args.truths:
            append_line(args.output, run(truth, args.options, args.limit))
            print(table(read_lines(args.output)[-1:]).splitlines()[-1], flush=True)
    else:
        print(table([line for path in args.files for line in read_lines(path)]))


if __name__ == "__main__":
    main()
