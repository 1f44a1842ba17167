"""`holoview study NAME`: reproduces a figure of the HoloChrome paper, with the numbers behind it, as a report."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from holoview.commands.arguments import add_fields, given_fields, parse_samples, parse_seed, whole
from holoview.commands.console import print_stderr, progress_bar
from holoview.commands.output_files import add_output_folder, hold_outputs
from holoview.evidence.study.hologram_study import HologramStudy, write_live_page
from holoview.evidence.study.report import format_claims, write_report
from holoview.evidence.study.runner import ExecutionTarget, ResultStore, run_jobs
from holoview.evidence.study.studies import find_study, studies_by_name
from holoview.evidence.study.study import QUICK, SCALES, Study, StudyScale
from holoview.holograms.metrics.perceptual_scores import PERCEPTUAL_SCORES
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.figures import require_matplotlib
from holoview.util.file_writer import make_folder
from holoview.util.processes import exit_code_of

_LIVE = "live.html"


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    parser.add_argument("name", nargs="?", help="the study; see --list")
    parser.add_argument("--list", action="store_true", help="the studies, a line each")
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--quick", dest="scale", action="store_const", const="quick", help="small: within three minutes")
    size.add_argument("--full", dest="scale", action="store_const", const="full", help="the paper's size: hours")
    size.add_argument("--scale", choices=tuple(SCALES), help="middle: between the two, several seeds (default)")
    parser.add_argument("--seed", metavar="N", type=parse_seed, default=0, help="first seed of what is random")
    parser.add_argument("--shape", metavar="ROWSxCOLUMNS", help="pixels of the modulators, instead of the scale's")
    add_fields(parser, StudyScale, "iterations", "seeds", "targets", "eyebox")
    parser.add_argument(
        "--pupils", metavar="LIST", help="diameters of the pupils that look, e.g. 2,3,4mm (eye, pupil, retinal-speckle)"
    )
    parser.add_argument(
        "--scores",
        nargs="*",
        choices=tuple(PERCEPTUAL_SCORES),
        help="perceptual scores, instead of all that are installed; none after it: PSNR alone (eye, pupil)",
    )
    parser.add_argument(
        "--live", action="store_true", help="also a page on which any browser computes the holograms again: live.html"
    )
    add_output_folder(
        parser, "--jobs", is_shared=True, metavar="DIR", help="folder of finished jobs, which studies can share"
    )
    add_output_folder(parser, "-o", "--output", metavar="DIR", help="folder for the report; out/study-NAME")
    add_workers(parser)


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Adds --workers and --scheduler; see `execution_target`."""
    parser.add_argument(
        "--workers", metavar="N", type=whole(1, 1024), default=1, help="processes of this machine that share the work"
    )
    parser.add_argument("--scheduler", metavar="ADDRESS", help="a Dask scheduler's address: tcp://host:8786")


def run(args: argparse.Namespace) -> int:
    """Runs the jobs that aren't done yet, writes the report and prints the findings. Ctrl-C keeps finished jobs."""
    if args.list:
        width = max(map(len, studies_by_name()))
        for study in studies_by_name().values():
            print(f"{study.name:<{width}}  {study.title}")
        return 0
    if args.name is None:
        raise UserError("study", "which one?", expected=", ".join(studies_by_name()), remedy="`holoview study --list`")
    study = find_study(args.name)
    scale = _scale(args, study)
    if args.live and not isinstance(study, HologramStudy):
        raise UserError("--live", f"with the study {study.name}", expected="a study that optimises holograms")
    target = execution_target(args)
    require_matplotlib(f"the report of the study {study.name}")
    folder = args.output or Path("out") / f"study-{study.name}"
    hold_outputs(args, [folder])
    make_folder(folder)
    jobs, started = study.jobs(scale, args.seed), time.monotonic()
    store = ResultStore(args.jobs or folder / "jobs", keeps_holograms=args.live)
    try:
        with progress_bar(study.name) as progress:
            results = run_jobs(study, jobs, store, target, progress)
    except KeyboardInterrupt as error:
        done = sum(store.load(job) is not None for job in jobs)
        print_stderr(
            f"interrupted: {done} of {len(jobs)} jobs are done and kept in {store.folder}; run it again for the rest"
        )
        return exit_code_of(error)
    findings = study.analyse(results)
    if args.live:
        write_live_page(folder / _LIVE, study.title, results)
    path = write_report(folder, study, scale, args.seed, findings, _LIVE if args.live else "")
    print(
        f"{study.title}\n{scale.name}: {study.describe_size(scale)}; "
        f"{len(jobs)} jobs in {time.monotonic() - started:.0f} s"
    )
    print("\n".join(["", *format_claims(findings.claims), ""]) if findings.claims else "")
    for note in (*findings.notes, *([study.quick_note] if scale.name == QUICK.name else [])):
        print(note)
    print(f"report: {path}")
    return 0


def _scale(args: argparse.Namespace, study: Study) -> StudyScale:
    """The scale with what the arguments change of it. Raises UserError for arguments that the study doesn't have."""
    for option in ("pupils", "scores"):
        if getattr(args, option) is not None and option not in study.options:
            having = ", ".join(name for name, other in studies_by_name().items() if option in other.options)
            raise UserError(f"--{option}", f"the study {study.name} doesn't have it", expected=f"one of {having}")
    pupils_m = None if args.pupils is None else sorted(set(units.parse_several(args.pupils, "--pupils")))
    expected = "rows and columns, such as 192x256"
    shape = None if args.shape is None else parse_samples(args.shape, 2, "--shape", expected, "x")
    changes = given_fields(args, StudyScale, {"name": None, "shape": shape, "pupils_m": pupils_m})
    return SCALES[args.scale or "middle"].with_changes(**changes)


def execution_target(args: argparse.Namespace) -> ExecutionTarget:
    """Where --workers and --scheduler let jobs run. Raises UserError for both."""
    if args.scheduler is not None and args.workers > 1:
        raise UserError("--workers with --scheduler", "contradict each other", expected="one of them")
    return ExecutionTarget(args.workers, args.scheduler)
