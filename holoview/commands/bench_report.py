"""`holoview bench --report DIR`: everything that is measured of an adapter, in one file that an issue can carry.

It stands beside `bench` because machines with a card may have torch, numpy and a few wheels only, and the arguments of
commands need more.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from holoview.commands.console import EXIT_FAILED, deferred_interrupt, print_stderr, progress_bar
from holoview.evidence.benchmark.report_run import VIEWER, ReportMeasurement, ReportOptions, ReportRun
from holoview.evidence.benchmark.report_text import report_markdown
from holoview.light.gpu.device import Device
from holoview.util.file_writer import make_folder, write_file

_WINDOW = (1280, 800)
_VIEWER_ROUNDS = 60


def write_report(device: Device, options: ReportOptions, folder: Path) -> int:
    """Measure a device, write the report into `folder`, print its path, and return the exit code.

    The file is written anew after each measurement, so that it has all results even if a driver ends the program.
    After Ctrl-C it has what was measured until then. Raises UserError if the folder can't be written to.
    """
    make_folder(folder)
    run = ReportRun(device, options)
    path = folder / report_name(run.data)
    measurements = measurements_of(run)
    _write(run, path)
    with deferred_interrupt("measurement") as interruption, progress_bar("bench") as show:
        for number, measurement in enumerate(measurements):
            show(number, len(measurements), f"{measurement.section}: {measurement.title}")
            run.make(measurement)
            _write(run, path)
            if interruption():
                break
        else:
            run.finish()
            _write(run, path)
            show(len(measurements), len(measurements), "")
    print(path)
    if not run.data["is_complete"]:
        return interruption.exit_code
    entries = [(section, entry) for section, entries in run.data["results"].items() for entry in entries]
    if failed := [f"{section}, {entry['title']}" for section, entry in entries if "failed" in entry]:
        print_stderr(f"failed, as the report says: {'; '.join(failed)}")
        return EXIT_FAILED
    return 0


def measurements_of(run: ReportRun) -> list[ReportMeasurement]:
    """All measurements of a report, in order."""
    return [*run.measurements(), _viewer(run.device, run.options)]


def report_name(data: dict[str, Any]) -> str:
    """The report's file name: the adapter and the time, in letters that any file system and any site takes."""
    adapter = re.sub(r"[^a-z0-9]+", "-", data["machine"]["adapter"]["name"].lower()).strip("-")
    begun = re.sub(r"[^0-9T]", "", data["begun"].partition("+")[0])
    return f"holoview-bench-{adapter or 'adapter'}-{begun}.md"


def _viewer(device: Device, options: ReportOptions) -> ReportMeasurement:
    """The measurement of the viewer, which needs the libraries of its window."""

    def measure() -> dict[str, Any]:
        from holoview.viewer.app.script import measure_frame_rate

        return measure_frame_rate(options.middle_system, device, _WINDOW, _VIEWER_ROUNDS, options.limit_s)

    return ReportMeasurement(VIEWER, "a scrub", measure)


def _write(run: ReportRun, path: Path) -> None:
    write_file(path, report_markdown(run.data))
