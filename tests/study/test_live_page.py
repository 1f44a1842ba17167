"""`--live`: holograms of a study are kept, and a page has those of the first target and seed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import holoview as hv
from holoview.evidence.study.hologram_study import write_live_page
from holoview.evidence.study.runner import ResultStore
from holoview.evidence.study.study import JobResult, StudyJob
from holoview.util.errors import UserError
from holoview.viewer.page.page import read_page

SETTINGS = {"scheme": "holochrome-8", "target": "still-life", "shape": [12, 16], "planes": 1, "depth": False}


def _job(seed: int, scheme: str = "holochrome-8") -> StudyJob:
    return StudyJob("schemes", f"{scheme} {seed}", SETTINGS | {"seed": seed, "scheme": scheme})


def _result(seed: int) -> JobResult:
    system = hv.load("holochrome-8").with_(shape=[12, 16], propagation="periodic", planes=["10 mm"])
    return JobResult({"psnr_db": 20.0}, {}, hv.Hologram(hv.random_drive(system, seed=seed), system))


def test_a_store_keeps_holograms_if_asked_and_does_jobs_again_that_lack_them(tmp_path: Path) -> None:
    result, plain, keeping = _result(1), ResultStore(tmp_path), ResultStore(tmp_path, keeps_holograms=True)
    plain.save(_job(1), result)
    loaded = plain.load(_job(1))
    assert loaded is not None and loaded.hologram is None
    assert keeping.load(_job(1)) is None
    keeping.save(_job(1), result)
    kept = keeping.load(_job(1))
    assert kept is not None and kept.hologram is not None and result.hologram is not None
    assert np.array_equal(kept.hologram.drive, result.hologram.drive)
    keeping.save(_job(2), JobResult({"x": 1.0}))
    assert keeping.load(_job(2)) == JobResult({"x": 1.0})


def test_the_page_has_the_holograms_of_the_first_seed(tmp_path: Path) -> None:
    jobs = [(_job(0), _result(0)), (_job(0, "simultaneous"), _result(5)), (_job(1), _result(1))]
    write_live_page(tmp_path / "live.html", "Schemes", jobs)
    found = read_page(tmp_path / "live.html")
    assert list(found) == ["holochrome-8 0", "simultaneous 0"]
    with pytest.raises(UserError, match="no job kept a hologram"):
        write_live_page(tmp_path / "none.html", "Schemes", [(_job(0), JobResult({}))])
