"""Writes a report as Markdown: tables for people, what a graphics card should reach, and all numbers as JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from holoview.evidence.benchmark.report_run import (
    AMPLITUDES,
    FRAME,
    FRAME_PARITY,
    FRAMES,
    GAP,
    IN_A_ROW,
    OPTIMISER,
    PARITY,
    POWER,
    PROBE,
    QUALITY,
    SCRUB,
    TORCH,
    TUNING,
    VIEWER,
    parts_ms,
)

FRAME_GOAL_MS, SHARE_GOAL, IMAGES_GOAL_PER_S = 1.0, 0.5, 60.0
"""A frame of 8 λ at 1024 × 768 samples on a card such as an H100, the share of a copy's bandwidth, images a second."""
GOAL_SIZE, GOAL_WAVELENGTHS = [1024, 768], 8

Case = Mapping[str, Any]


@dataclass(frozen=True)
class Goal:
    """A goal in words, what was measured in words, and whether it is met; None where it wasn't measured."""

    text: str
    measured: str
    is_met: bool | None


def share_of_copy(case: Case, copy_bandwidth: float | None) -> float | None:
    """Share of a copy's bandwidth that a case's frame reaches by the device's clock; None where either is unknown."""
    if copy_bandwidth is None or "device_ms" not in case or not case["device_ms"][FRAME]:
        return None
    share: float = case["frame_bytes"] / (1e-3 * case["device_ms"][FRAME]) / copy_bandwidth
    return share


def goals(
    cases: Sequence[Case], copy_bandwidth: float | None, viewer: Sequence[Case], stages: Sequence[Case]
) -> list[Goal]:
    """The goals with what the results of a report say about them. stages: errors and what is allowed, by stage."""
    chosen = [case for case in cases if case["size"] == GOAL_SIZE and case["wavelengths"] == GOAL_WAVELENGTHS]
    return [_stages_goal(stages), _frame_goal(chosen), _share_goal(chosen, copy_bandwidth), _viewer_goal(viewer)]


def _stages_goal(stages: Sequence[Case]) -> Goal:
    text = "each stage as exact as rounding allows"
    if not stages:
        return Goal(text, "not measured", None)
    ratio, name = max((entry["error"] / entry["allowed"], name) for bench in stages for name, entry in bench.items())
    return Goal(text, f"{name}: {ratio:.2f} of what is allowed", ratio <= 1)


def _frame_goal(chosen: Sequence[Case]) -> Goal:
    text = f"8 λ at 1024 × 768 in at most {FRAME_GOAL_MS:g} ms"
    if not chosen:
        return Goal(text, "not measured", None)
    best = min(chosen, key=lambda case: case["median_ms"][FRAME])
    alone, row = best["median_ms"][FRAME], best["median_ms"][IN_A_ROW]
    device = f", {best['device_ms'][FRAME]:.3g} ms by the device's clock" if "device_ms" in best else ""
    how = f"{best['strategy']}, {best['per_dispatch']} λ in a dispatch"
    return Goal(text, f"{alone:.3g} ms alone, {row:.3g} ms in a row{device} ({how})", alone <= FRAME_GOAL_MS)


def _share_goal(chosen: Sequence[Case], copy_bandwidth: float | None) -> Goal:
    text = f"at least {SHARE_GOAL:.0%} of a copy's bandwidth there"
    shares = [share for case in chosen if (share := share_of_copy(case, copy_bandwidth)) is not None]
    if not shares:
        return Goal(text, "not measured", None)
    return Goal(text, f"{max(shares):.0%}", max(shares) >= SHARE_GOAL)


def _viewer_goal(viewer: Sequence[Case]) -> Goal:
    text = f"{IMAGES_GOAL_PER_S:g} images a second while a plane is scrubbed in the viewer"
    if not viewer:
        return Goal(text, "not measured", None)
    rate = viewer[0]["scrub_images_per_s"]
    return Goal(text, f"{rate:.3g}", rate >= IMAGES_GOAL_PER_S)


# --- the report ---


Values = dict[str, Any]
_ANSWER = {True: "yes", False: "**no**", None: ""}
_MIB = 2**20
_LIMITS = (
    "max-buffer-size",
    "max-storage-buffer-binding-size",
    "max-compute-invocations-per-workgroup",
    "max-compute-workgroup-storage-size",
    "max-compute-workgroups-per-dimension",
    "max-storage-buffers-per-shader-stage",
)
_METHOD = """\
Times are medians of wall times in ms, from recording the commands to the end of their execution. All jobs of a row ran
in turn. "frame" is everything from the light source to XYZ; "in a row" is a frame of several that are waited for once.
"host" is the processor time in which a frame is recorded and submitted. "device" is the sum of the device's own times
of all compute passes (timestamps), without gaps between them. "plane", "gap" and "lasers" are edits, from the edit to
XYZ. "copy" is the share of the bandwidth of a copy that a frame reaches by the device's clock. Counted are the bytes
that the kernels must read and write: the fields between kernels, patterns, intensities and XYZ, but not what a strategy
moves between the passes of one transform. A field that fits into the device's cache is not limited by its memory, so
the share can exceed 100 %. Grids aren't padded; patterns are random."""


def report_markdown(data: Values) -> str:
    """The report of `ReportRun.data`."""
    machine = data["machine"]
    sections = [
        [f"# holoview bench: {machine['adapter']['name']}", "", *_head(data)],
        ["## Goals of a graphics card", "", *_goals(data)],
        ["## Machine", "", *_machine(machine)],
        ["## Stages beside torch in complex128", "", *_stages(data)],
        ["## Copies and submissions", "", *_probe(data)],
        ["## Frames and edits, ms", "", _METHOD, *_frames(data)],
        ["## Strategies of the transforms", "", *_strategies(data)],
        ["## Beside torch on the processor", "", *_beside_torch(data)],
        ["## An iteration of the optimiser", "", *_optimiser(data)],
        ["## Time to a good hologram", "", *_quality(data)],
        ["## Viewer", "", *_viewer(data)],
        ["## Power", "", *_power(data)],
        ["## Not measured", "", *_problems(data)],
        [
            "<details><summary>All numbers as JSON</summary>",
            "",
            "```json",
            json.dumps(data, indent=1, ensure_ascii=False),
            "```",
            "",
            "</details>",
        ],
    ]
    return "\n\n".join("\n".join(lines) for lines in sections) + "\n"


def results(data: Values, section: str) -> list[Values]:
    """The results of a section, without measurements that failed."""
    return [entry["result"] for entry in data["results"].get(section, []) if "result" in entry]


def _table(header: Sequence[str], rows: Sequence[Sequence[str]], words: int = 1) -> list[str]:
    """Lines of a table whose first columns hold words and the others numbers; a remark if it has no rows."""
    if not rows:
        return ["Not measured."]
    rule = ["---"] * words + ["---:"] * (len(header) - words)
    return [f"| {' | '.join(cells)} |" for cells in (header, rule, *rows)]


def _number(value: float | None, digits: int = 3) -> str:
    """A value with some significant digits, without an exponent below 100 000; a dash for what isn't known."""
    if value is None:
        return "–"
    return f"{value:.0f}" if 100 <= abs(value) < 1e5 else f"{value:.{digits}g}"


def _copy_bandwidth(data: Values) -> float | None:
    probes = results(data, PROBE)
    return probes[0]["copy_bandwidth"] if probes else None


# --- sections -------------------------------------------------------------------------------------------------------


def _head(data: Values) -> list[str]:
    software = ", ".join(f"{name} {number}" for name, number in data["machine"]["versions"].items())
    end = "" if data["is_complete"] else "; **interrupted: not everything was measured**"
    return [f"{data['preset']}, {data['begun']}, {software}; {data['rounds']} rounds{end}"]


def _goals(data: Values) -> list[str]:
    found = goals(results(data, FRAMES), _copy_bandwidth(data), results(data, VIEWER), results(data, PARITY))
    return _table(["goal", "measured", "met"], [[goal.text, goal.measured, _ANSWER[goal.is_met]] for goal in found], 3)


def _machine(machine: Values) -> list[str]:
    adapter, cuda = machine["adapter"], machine["cuda"]
    memory = "unknown" if machine["memory_bytes"] is None else f"{machine['memory_bytes'] / 2**30:.1f} GiB"
    rows = [
        ["adapter", f"{adapter['name']} ({adapter['kind']}), {adapter['backend']}"],
        ["driver", adapter["driver"]],
        ["other adapters", "; ".join(machine["adapters"][1:]) or "none"],
        ["processor", f"{machine['processor']}, {machine['cores']} cores, {memory}"],
        ["system", machine["platform"]],
        ["torch", f"{machine['torch_threads']} threads, CUDA: {cuda['name'] if cuda else 'none'}"],
        *([name, f"{machine['limits'][name]:,}".replace(",", " ")] for name in _LIMITS if name in machine["limits"]),
        ["features used", ", ".join(machine["features"]["used"]) or "none"],
        ["features of the adapter", ", ".join(machine["features"]["all"])],
    ]
    return _table(["", ""], rows, 2)


def _stages(data: Values) -> list[str]:
    benches = results(data, PARITY)
    rows = []
    for stage in dict.fromkeys(name for bench in benches for name in bench):
        errors = [bench[stage]["error"] for bench in benches if stage in bench]
        allowed = next(bench[stage]["allowed"] for bench in benches if stage in bench)
        rows.append([stage, f"{max(errors):.2g}", f"{allowed:.2g}", _ANSWER[max(errors) <= allowed]])
    text = [f"The greatest relative L2 error of {len(benches)} benches, each stage on the same input as torch.", ""]
    frames = [
        [f"{entry['size'][0]} × {entry['size'][1]}", entry["strategy"], f"{entry['error']:.2g}"]
        for entry in results(data, FRAME_PARITY)
    ]
    whole = ["", "Relative L2 error of the intensity of a whole frame of one wavelength:", ""]
    return [
        *text,
        *_table(["stage", "error", "allowed", "holds"], rows),
        *whole,
        *_table(["size", "strategy", "error"], frames, 2),
    ]


def _probe(data: Values) -> list[str]:
    rows = [
        row
        for probe in results(data, PROBE)
        for row in (
            [
                f"copying {probe['copy_bytes'] / _MIB:.0f} MiB by command",
                f"{probe['copy_command'] / 1e9:.4g} GB/s read and written",
            ],
            ["the same by a shader", f"{probe['copy_shader'] / 1e9:.4g} GB/s"],
            ["an empty submission and waiting for it", f"{1e6 * probe['submission_s']:.3g} µs"],
            ["the check before each, whether the device is there", f"{1e6 * probe['check_s']:.3g} µs"],
            ["a dispatch that does nothing, after another", f"{1e6 * probe['dispatch_s']:.3g} µs"],
        )
    ]
    return _table(["", "measured"], rows)


def _frames(data: Values) -> Iterator[str]:
    """A table for each size."""
    if not data["sizes"]:
        yield from ["", "A chain of elements is timed at its own size, beside torch, below."]
    bandwidth = _copy_bandwidth(data)
    columns = ["λ", "strategy", "λ in a dispatch", "frame", "in a row", "host", "device", "copy"]
    columns += ["plane", "plane, device", "gap", "lasers", "MB moved", "MiB held"]
    for size in data["sizes"]:
        cases = [case for case in results(data, FRAMES) if case["size"] == size]
        yield from ["", f"### {size[0]} × {size[1]}", ""]
        rows = [_frame_row(case, bandwidth) for case in cases]
        yield from _table(columns, rows, 2)
        yield from _parts(cases)


def _parts(cases: Sequence[Values]) -> Iterator[str]:
    """A table of the device times of a frame's kernels; nothing where they aren't known."""
    known = [(case, parts) for case in cases if (parts := parts_ms(case))]
    if known:
        rows = [
            [str(case["wavelengths"]), case["strategy"], str(case["per_dispatch"]), *map(_number, parts.values())]
            for case, parts in known
        ]
        yield from ["", "Device times of the kernels, ms, as differences of the edits' device times:", ""]
        yield from _table(["λ", "strategy", "λ in a dispatch", *known[0][1]], rows, 2)


def _frame_row(case: Values, bandwidth: float | None) -> list[str]:
    wall, device = case["median_ms"], case.get("device_ms", {})
    share = share_of_copy(case, bandwidth)
    times = [wall[FRAME], wall[IN_A_ROW], case["host_ms"], device.get(FRAME)]
    edits = [wall[SCRUB], device.get(SCRUB), wall.get(GAP), wall[AMPLITUDES]]
    return [
        str(case["wavelengths"]),
        case["strategy"],
        str(case["per_dispatch"]),
        *map(_number, times),
        "–" if share is None else f"{share:.0%}",
        *map(_number, edits),
        _number(case["frame_bytes"] / 1e6),
        _number(case["memory_bytes"] / _MIB),
    ]


def _strategies(data: Values) -> list[str]:
    rows = []
    for tuning in results(data, TUNING):
        names = dict.fromkeys([*tuning["seconds"], *tuning["compile_seconds"], *tuning["refused"]])
        for name in names:
            seconds, compiling = tuning["seconds"].get(name), tuning["compile_seconds"].get(name)
            rows.append(
                [
                    f"{tuning['size'][0]} × {tuning['size'][1]}",
                    name + " (chosen)" * (name == tuning["chosen"]),
                    _number(None if seconds is None else 1e3 * seconds),
                    _number(compiling),
                    tuning["refused"].get(name, ""),
                ]
            )
    return _table(["size", "strategy", "an FFT and its inverse, ms", "compiling both, s", "refused"], rows, 2)


def _beside_torch(data: Values) -> Iterator[str]:
    for found in results(data, TORCH):
        yield f"{found['size'][0]} × {found['size'][1]}, {found['wavelengths']} λ."
        yield ""
        bars = [[bar["name"], _number(bar["value"]), _number(bar["bar"]), bar["unit"]] for bar in found["bars"]]
        yield from _table(["", "value", "bar", "unit"], bars)
        yield ""
        jobs = [
            [name, *(_number(job[key]) for key in ("median_ms", "minimum_ms"))] for name, job in found["jobs"].items()
        ]
        yield from _table(["ms", "median", "least"], jobs)
    if not results(data, TORCH):
        yield "Not measured."


def _optimiser(data: Values) -> Iterator[str]:
    for found in results(data, OPTIMISER):
        (columns, rows), median = found["size"], found["median_ms"]
        yield f"{columns} × {rows}, {found['wavelengths']} λ, {found['planes']} planes, {found['threads']} threads."
        yield ""
        lines = [
            [name, _number(time), _number(median["cpu"] / time) if "cpu" in median else "–", f"{loss[-1]:.6g}"]
            for (name, time), loss in zip(median.items(), (found["losses"][name] for name in median), strict=True)
        ]
        yield from _table(["torch device", "ms", "times as fast as the processor", "loss after 3 iterations"], lines)
        yield from (f"\n{name}: {reason}" for name, reason in found["failures"].items())
        yield ""
        yield from _table(
            ["a hologram's way to the shaders", "ms"], [[n, _number(t)] for n, t in found["handover_ms"].items()]
        )
    if not results(data, OPTIMISER):
        yield "Not measured."


def _quality(data: Values) -> Iterator[str]:
    for found in results(data, QUALITY):
        (columns, rows), reached = found["size"], "not reached"
        yield f"{columns} × {rows}, {found['wavelengths']} λ, {found['planes']} planes, {found['threads']} threads."
        yield f"The goal is {found['goal_db']:.2f} dB, in runs of {found['long']} iterations at most."
        yield ""
        lines = [
            [name, f"{found[f'{key}long_db']:.2f}", str(found[f"{key}iterations"] or reached)]
            + [_number(found[f"{key}{time}"]) for time in ("seconds", "cpu_seconds")]
            for name, key in (("holoview", ""), (f"Adam, {found['adam_step_rad']:g} rad", "adam_"))
        ]
        yield from _table(["", "long run, dB", "iterations", "s", "processor, s"], lines)
        yield ""
        yield f"holoview ÷ Adam: {reached if found['ratio'] is None else _number(found['ratio'])}."
    if not results(data, QUALITY):
        yield "Not measured."


def _viewer(data: Values) -> list[str]:
    rows = [
        row
        for found in results(data, VIEWER)
        for row in (
            [f"window of {found['window'][0]} × {found['window'][1]} pixels alone", _number(found["window_ms"])],
            ["change of the focal plane, to its first image", _number(found["scrub_ms"])],
            ["the same, to the full image", _number(found["full_ms"])],
            ["images a second while scrubbing", _number(found["scrub_images_per_s"])],
        )
    ]
    return _table(["off screen, each image read back", "ms"], rows)


def _power(data: Values) -> list[str]:
    found = next(iter(results(data, POWER)), None)
    if not found:
        return ["Not measured." if found is None else "Unknown: nvidia-smi isn't there, or tells none of this adapter."]
    rows = [
        ["at rest", f"{_number(found['rest_w'])} W"],
        ["frames in a row", f"{_number(found['load_w'])} W of {_number(found['limit_w'])} W"],
        [
            "a frame",
            f"{_number(1e3 * found['energy_per_frame_j'])} mJ at {_number(found['frames_per_s'])} frames a second",
        ],
        ["clocks", f"{_number(found['clock_mhz'], 4)} MHz, memory {_number(found['memory_clock_mhz'], 4)} MHz"],
        ["temperature", f"{_number(found['temperature_c'])} °C"],
    ]
    return _table(["", f"{found['readings']} readings"], rows)


def _problems(data: Values) -> list[str]:
    """Refused measurements with the reason, and failed ones with the text of the error."""
    lines: list[str] = []
    for section, entries in data["results"].items():
        lines += [f"- {section}, {entry['title']}: {entry['refused']}" for entry in entries if "refused" in entry]
        for entry in (entry for entry in entries if "failed" in entry):
            lines += [f"- {section}, {entry['title']} failed:", "", "```text", entry["failed"].rstrip(), "```"]
    if not data["is_complete"]:
        lines.append("- what comes after the last of these results: interrupted")
    return lines or ["Nothing is missing."]
