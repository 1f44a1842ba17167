"""Every study at a tiny size: its jobs run, something is found, and the report holds all of it."""

from __future__ import annotations

import csv
import re
from functools import partial
from html.parser import HTMLParser
from pathlib import Path

import pytest
from PIL import Image

from holoview.bench.diagnose.pipeline import diagnose
from holoview.evidence.study import hologram_study as work
from holoview.evidence.study import study
from holoview.evidence.study.hologram_study import CONTRADICTS, DIRECTION_ONLY, LARGER, REPRODUCES, SHOWN, judge_gain
from holoview.evidence.study.report import format_claims, write_report
from holoview.evidence.study.runner import ResultStore, run_jobs
from holoview.evidence.study.studies import chains, contrast_ratio, eye, model_vs_capture, pupil, studies_by_name
from holoview.evidence.study.study import Findings
from holoview.light.model.effects import registry as effects
from holoview.util.files import data_dir
from tests.chromium import check_document, needs_chromium

TINY = study.StudyScale("tiny", (16, 16), 2, 1, ("still-life",), 2)
VERDICTS = {REPRODUCES, LARGER, DIRECTION_ONLY, CONTRADICTS, SHOWN}
CHI2_TOLERANCE = 0.18
"""5 σ of χ²/n, σ = √(2/n): 6 pairs of wavelength and plane, at least a capture of 16 x 16 pixels of each held out."""
LONG_GAP = "gap 0.1 mm long"
VOID = {"meta", "img", "br", "link", "input", "hr"}
PICTURED = {
    "binary-amplitude",
    "coarse-amplitude",
    "dynamic-fourier",
    "etendue-expander",
    "high-contrast",
    "michelson-complex",
    "schemes",
    "wavelength-count",
    "multisource",
    "gamut",
    "defocus",
    "contrast",
    "contrast-ratio",
    "eye",
    "eye-spacing",
    "model-vs-capture",
    "observers",
    "pupil",
    "static-mask",
}


QUICK = {"memory-effect"}
"""A study that takes seconds, since it optimises nothing; wavelength-count optimises schemes, in half a minute."""


class _Page(HTMLParser):
    """Tags that are open, what each table holds, and every address that the page names."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.addresses: list[str] = []
        self.tables: list[list[int]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [value or "" for key, value in attrs if key in ("src", "href", "srcset", "action")]
        if tag == "img":
            assert dict(attrs)["alt"]
        if tag == "table":
            self.tables.append([])
        if tag == "tr":
            self.tables[-1].append(0)
        if tag in ("td", "th"):
            self.tables[-1][-1] += 1
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def small_assets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The shipped scenes, small: reading them takes most of the time otherwise."""
    folder = tmp_path_factory.mktemp("assets")
    for name in ("still-life", "still-life-depth", "night"):
        with Image.open(data_dir("assets") / f"{name}.png") as picture:
            picture.resize((64, 48), Image.Resampling.NEAREST).save(folder / f"{name}.png")
    return folder


@pytest.fixture
def tiny(small_assets: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing that takes long: small fields, a small scene, two benches whose only suspect is the gap, few pupils."""
    monkeypatch.setattr(study, "MIN_SPECKLE_SHAPE", TINY.shape)
    monkeypatch.setattr(work, "data_dir", lambda kind: small_assets)
    benches = {name: model_vs_capture.BENCHES[name] for name in ("as designed", LONG_GAP)}
    monkeypatch.setattr(model_vs_capture, "BENCHES", benches)
    monkeypatch.setattr(model_vs_capture, "diagnose", partial(diagnose, effects=[effects.listed_effects()["gap"]]))
    monkeypatch.setattr(eye, "_SCHEMES", {name: eye._SCHEMES[name] for name in ("simultaneous", "holochrome-8")})
    monkeypatch.setattr(eye, "_PUPILS_MM", (eye._PUPIL_MM,))
    monkeypatch.setattr(eye, "_SPACINGS_NM", eye._SPACINGS_NM[::4])
    monkeypatch.setattr(chains, "TARGETS", ("still-life", "night"))
    monkeypatch.setattr(contrast_ratio, "_SCENES", ("still-life", "night"))
    monkeypatch.setattr(pupil, "_PLACES_MM", pupil._PLACES_MM[:3])


@pytest.mark.usefixtures("tiny")
@pytest.mark.parametrize(
    "name",
    [name if name in QUICK else pytest.param(name, marks=pytest.mark.explores) for name in sorted(studies_by_name())],
)
def test_a_study_runs_and_reports(name: str, tmp_path: Path) -> None:
    study = studies_by_name()[name]
    jobs = study.jobs(TINY, 0)
    assert len({job.label for job in jobs}) == len(jobs)
    assert all(job.study == (study.kind or name) and job.revision == study.revision for job in jobs)
    findings = study.analyse(run_jobs(study, jobs, ResultStore(tmp_path / "jobs")))
    assert findings.rows and findings.claims and findings.plots
    assert bool(findings.pictures) == (name in PICTURED)
    assert {claim.verdict for claim in findings.claims} <= VERDICTS
    assert all((claim.verdict == SHOWN) == (claim.published == "") for claim in findings.claims)
    assert len(format_claims(findings.claims)) == len(findings.claims) + 1
    _check_report(write_report(tmp_path, study, TINY, 0, findings), findings)


@pytest.mark.long
@needs_chromium
@pytest.mark.usefixtures("tiny")
def test_a_browser_shows_a_report_without_an_error(tmp_path: Path) -> None:
    study = studies_by_name()["wavelength-count"]
    findings = study.analyse(run_jobs(study, study.jobs(TINY, 0), ResultStore(tmp_path / "jobs")))
    check_document(write_report(tmp_path, study, TINY, 0, findings))


def _check_report(path: Path, findings: Findings) -> None:
    text, page = path.read_text(encoding="utf-8"), _Page()
    page.feed(text)
    page.close()
    assert page.open == []
    assert len(page.addresses) == len(findings.plots) + len(findings.pictures)
    assert all(address.startswith("data:image/png;base64,") for address in page.addresses)
    assert not re.search(r"https?:|url\(|@import|<script", text)
    columns = len(findings.rows[0])
    assert page.tables == [[4] * (len(findings.claims) + 1), [columns] * (len(findings.rows) + 1)]
    with (path.parent / "numbers.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    wanted = [{key: "" if value is None else str(value) for key, value in row.items()} for row in findings.rows]
    assert rows == wanted
    figures = {f"{plot.name}.{kind}" for plot in findings.plots for kind in ("png", "pdf")}
    pictures = {f"{picture.name}.png" for picture in findings.pictures}
    assert figures | pictures <= {file.name for file in path.parent.iterdir()}


@pytest.mark.long
@pytest.mark.usefixtures("tiny")
def test_a_gap_that_is_diagnosed_predicts_captures_down_to_their_noise() -> None:
    study = studies_by_name()["model-vs-capture"]
    job = next(job for job in study.jobs(TINY, 0) if job.settings["bench"] == LONG_GAP)
    numbers = study.run_job(job.settings, lambda note: None).numbers
    assert numbers["chi2_before"] > 2.0
    assert numbers["chi2_after"] == pytest.approx(1.0, abs=CHI2_TOLERANCE)
    assert numbers["psnr_db_after"] > numbers["psnr_db_before"]
    found = re.fullmatch(r"The gap is ([\d.]+) mm, not 2 mm\.", numbers["named"])
    assert found and float(found[1]) == pytest.approx(2.1, abs=0.01)  # a tenth of what is wrong


@pytest.mark.parametrize(
    ("found", "verdict"),
    [
        (4.0, REPRODUCES),
        (3.0, REPRODUCES),
        (7.0, LARGER),
        (2.9, DIRECTION_ONLY),
        (0.3, CONTRADICTS),
        (-1.0, CONTRADICTS),
    ],
)
def test_a_gain_of_4_db_reproduces_from_three_quarters_to_half_as_much_again(found: float, verdict: str) -> None:
    assert judge_gain(found, 4.0) == verdict
