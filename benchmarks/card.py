"""What only a graphics card can answer, in one run with a time limit, as one report.

    python -m benchmarks.card [-o out/card] [--minutes 5] [--dry-run]
    python -m benchmarks.card --question [-o out/card] [--minutes 600]

The first call runs the measurements in an order of value, each as a command of its own with a limit; where the time
ends, the report holds what there is. The second optimises holograms for every setting of the question whether a second
modulator gains the paper's 5.3 dB; each result is a line of `question.jsonl`, so that a further call goes on. With
--dry-run all sizes are small: it shows that every command runs, on any adapter, and its figures mean nothing.
"""

from __future__ import annotations

import argparse
import itertools
import json
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.common import append_line, markdown_table, read_lines
from holoview.util.file_writer import write_file
from holoview.util.files import data_dir

HOLOVIEW = (sys.executable, "-m", "holoview")
SCENES = ("still-life", "night", "resolution")
LASERS = {3: "simultaneous", 8: "holochrome-8", 16: "holochrome-16"}
PAPERS_GAIN_DB = 5.3
_TAIL = 300  # characters of what a command printed before it failed


@dataclass(frozen=True)
class Step:
    """A command whose output is a measurement. limit_s: it is stopped then. json: whether it prints JSON, not text."""

    name: str
    limit_s: float
    command: tuple[str, ...]
    json: bool = True


@dataclass(frozen=True)
class Scale:
    """Sizes (samples, x by y) and numbers of a run on a card, or of a dry run."""

    size: str = "1024x768"
    largest: str = "4096x2160"
    shape: str = "[384,512]"
    lasers: str = "8,16"
    rounds: int = 15
    iterations: int = 3000
    events: int = 24

    @classmethod
    def dry(cls) -> Scale:
        """As small as possible."""
        return cls("64x48", "96x64", "[24,32]", "1,3", 1, 4, 1)


def steps(scale: Scale) -> list[Step]:
    """The measurements in an order of value, without those of the question."""
    size, rounds = ("--size", scale.size), ("--rounds", str(scale.rounds))
    bench = (*HOLOVIEW, "bench", "holochrome-8")
    return [
        Step("frame and edits", 60, (*bench, *size, *rounds, "--json")),
        Step("frame, fields of 16 bits", 40, (*bench, *size, *rounds, "--half", "--json")),
        Step("largest frame", 60, (*bench, "--size", scale.largest, "--rounds", "3", "--json")),
        Step(
            "images a second in the viewer",
            40,
            (sys.executable, "-m", "benchmarks.viewer", "--events", str(scale.events), "--shape", _by(scale.shape)),
            json=False,
        ),
        Step(
            "strategies, stages, optimiser and power",
            150,
            (*bench, "--report", "{out}", "--size", scale.size, "--lasers", scale.lasers, *rounds, "--json"),
        ),
    ]


def question(scale: Scale) -> Iterator[dict[str, Any]]:
    """The settings of the question: one and two modulators in turn, so that pairs are complete early."""
    for seed, scene, stops, lasers in itertools.product((0, 1), SCENES, ("", "-open"), LASERS):
        for loss in ("linear-srgb", "srgb"):
            for free in (
                ("patterns,amplitudes", "patterns,amplitudes,wavelengths") if lasers > 3 else ("patterns,amplitudes",)
            ):
                for modulators in (2, 1):
                    yield {
                        "preset": f"{LASERS[lasers]}{'-1slm' if modulators == 1 else ''}{stops}",
                        "lasers": lasers,
                        "modulators": modulators,
                        "stops": not stops,
                        "scene": scene,
                        "seed": seed,
                        "loss": loss,
                        "free": free,
                        "iterations": scale.iterations,
                    }


def optimise_command(setting: dict[str, Any], scale: Scale, output: Path) -> tuple[str, ...]:
    """The command of a setting."""
    picture = data_dir("assets") / f"{setting['scene']}.png"
    depth = picture.with_name(f"{picture.stem}-depth.png")
    return (
        *(*HOLOVIEW, "optimise", setting["preset"], str(picture), "--set", f"shape={scale.shape}"),
        *(("--depth", str(depth)) if depth.exists() else ()),
        *("--loss", setting["loss"], "--free", setting["free"], "--seed", str(setting["seed"])),
        *("--iterations", str(setting["iterations"]), "--eyebox", "0.03", "--json", "-o", str(output)),
    )


def run(step: Step, limit_s: float, output: Path) -> dict[str, Any]:
    """The result of a measurement, or why there is none; and the seconds it took."""
    started = time.monotonic()
    command = [word.format(out=output / "report") if "{" in word else word for word in step.command]
    entry: dict[str, Any] = {"name": step.name, "command": " ".join(command[1:])}
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=min(step.limit_s, limit_s), check=False)
    except subprocess.TimeoutExpired:
        return entry | {"stopped_after_s": round(time.monotonic() - started, 1)}
    entry["seconds"] = round(time.monotonic() - started, 2)
    if done.returncode:
        return entry | {"failed": done.stderr.strip()[-_TAIL:]}
    return entry | {"result": json.loads(done.stdout) if step.json else done.stdout}


def run_question(scale: Scale, output: Path, deadline: float) -> None:
    """Optimises what `question.jsonl` lacks, until the deadline (of `time.monotonic`)."""
    lines = output / "question.jsonl"
    known = {_key(row) for row in read_lines(lines)} if lines.exists() else set()
    waiting = [setting for setting in question(scale) if _key(setting) not in known]
    for number, setting in enumerate(waiting, start=1):
        left = deadline - time.monotonic()
        if left <= 0:
            print(f"{len(waiting) - number + 1} settings are left; the same call goes on", file=sys.stderr)
            return
        hologram = output / "hologram.safetensors"
        entry = run(Step(setting["preset"], left, optimise_command(setting, scale, hologram)), left, output)
        hologram.unlink(missing_ok=True)
        if "result" not in entry:
            print(f"{setting['preset']}: {entry.get('failed', 'stopped by the limit')}", file=sys.stderr)
            continue
        kept = {key: entry["result"][key] for key in ("psnr_db", "speckle_contrast", "eyebox_variation", "seconds")}
        append_line(lines, setting | kept)
        print(
            f"{number}/{len(waiting)} {setting['preset']} {setting['scene']}: {kept['psnr_db']:.2f} dB", file=sys.stderr
        )


def gains(rows: Sequence[dict[str, Any]]) -> list[tuple[dict[str, Any], float]]:
    """The gain (dB) of the second modulator in each setting that was optimised with one and with two."""
    by_setting: dict[str, dict[int, dict[str, Any]]] = {}
    for row in rows:
        apart = {key: row[key] for key in ("lasers", "stops", "scene", "seed", "loss", "free", "iterations")}
        by_setting.setdefault(json.dumps(apart), {})[row["modulators"]] = row
    pairs = [pair for pair in by_setting.values() if set(pair) == {1, 2}]
    return [(pair[2], pair[2]["psnr_db"] - pair[1]["psnr_db"]) for pair in pairs]


def question_table(rows: Sequence[dict[str, Any]]) -> str:
    """The gains by lasers, stops, loss and what is free: mean, least, greatest, over scenes and seeds."""
    by_case: dict[tuple[Any, ...], list[float]] = {}
    for row, gain in gains(rows):
        by_case.setdefault((row["lasers"], row["stops"], row["loss"], row["free"]), []).append(gain)
    cells = [
        [
            f"{lasers} λ, {'first order' if stops else 'no stops'}, {loss}, {free}",
            *(f"{value:.2f}" for value in (sum(found) / len(found), min(found), max(found))),
            str(len(found)),
        ]
        for (lasers, stops, loss, free), found in by_case.items()
    ]
    header = (f"gain of modulator 2, dB (the paper's: {PAPERS_GAIN_DB})", "mean", "least", "greatest", "pairs")
    return markdown_table(header, cells)


def report_text(data: dict[str, Any]) -> str:
    """The report for people: what was measured, what failed, bars, and the question."""
    lines = [f"# A run on {data['card'] or 'an adapter without nvidia-smi'}", ""]
    if data["dry_run"]:
        lines += ["A dry run at small sizes: every command ran, the figures mean nothing.", ""]
    for entry in data["steps"]:
        lines += [f"## {entry['name']}", "", f"`{entry['command']}`", ""]
        result = entry.get("result")
        if result is None:
            lines.append(entry.get("failed") or f"stopped after {entry['stopped_after_s']} s")
        elif isinstance(result, str):
            lines.append(f"```\n{result.strip()}\n```")
        elif "bars" in result:
            bars = [[bar["name"], f"{bar['value']:.3g} {bar['unit']}", f"{bar['aim']:g}"] for bar in result["bars"]]
            lines += [f"on {result['adapter']['name']}", "", markdown_table(("", "measured", "aim"), bars)]
        else:
            numbers = {key: value for key, value in result.items() if isinstance(value, int | float | str)}
            lines.append(markdown_table(("", "value"), [[key, f"{value}"] for key, value in numbers.items()]))
        lines.append("")
    if data["question"]:
        lines += ["## The second modulator's gain", "", question_table(data["question"]), ""]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Measure, and write report.json and report.md."""
    args = _parser().parse_args(arguments)
    scale = Scale.dry() if args.dry_run else Scale()
    output: Path = args.output
    output.mkdir(parents=True, exist_ok=True)
    deadline = time.monotonic() + 60 * args.minutes
    data: dict[str, Any] = {"dry_run": args.dry_run, "card": _card(), "steps": [], "question": []}

    def write() -> None:
        lines = output / "question.jsonl"
        data["question"] = read_lines(lines) if lines.exists() else []
        write_file(output / "report.json", json.dumps(data, indent=1).encode())
        write_file(output / "report.md", report_text(data).encode())

    for step in [] if args.question else steps(scale):
        left = deadline - time.monotonic()
        if left <= 0:
            break
        print(f"{step.name} …", file=sys.stderr)
        data["steps"].append(run(step, left, output))
        write()
    run_question(scale, output, deadline)
    write()
    print(report_text(data))
    failed = [entry["name"] for entry in data["steps"] if "failed" in entry]
    if failed:
        print(f"card: failed: {', '.join(failed)}; see {output / 'report.md'}", file=sys.stderr)
    return 1 if failed else 0


def _by(shape: str) -> str:
    rows, columns = shape.strip("[]").split(",")
    return f"{columns}x{rows}"


def _key(setting: dict[str, Any]) -> str:
    names = ("preset", "scene", "seed", "loss", "free", "iterations")
    return json.dumps([setting[name] for name in names])


def _card() -> str:
    """The card and its driver as nvidia-smi names them; empty without it."""
    try:
        done = subprocess.run(
            ["nvidia-smi", "--query-gpu=name,driver_version", "--format=csv,noheader"],
            capture_output=True,
            text=True,
            timeout=10,
            check=False,
        )
    except OSError:
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.card", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/card"), help="a folder (out/card)")
    parser.add_argument("--minutes", type=float, default=5.0, help="of the whole run (5)")
    parser.add_argument("--question", action="store_true", help="only the gain of the second modulator; goes on")
    parser.add_argument("--dry-run", action="store_true", help="small sizes, on any adapter")
    return parser


if __name__ == "__main__":
    sys.exit(main())
