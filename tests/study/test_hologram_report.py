"""`holoview report`: its page holds every number, loads nothing, prints to two sheets, and its claims have verdicts."""

from __future__ import annotations

import html
import json
import re
import shlex
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

import holoview as hv
from holoview.commands import cli
from holoview.evidence.study.claims import QUANTITIES, judge_claim, parse_claim
from holoview.evidence.study.hologram_report import ReviewedHologram, report_html, review_hologram
from holoview.holograms.metrics.sharpness import BlackBesideWhite, ContrastRatio, Mtf
from holoview.util.errors import UserError
from tests.chromium import Browser, check_document, needs_chromium
from tests.page.pages import webgpu_browser

SHAPE = (48, 64)
REGION = (16, 12, 32, 24)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A hologram that shows a picture, one of random patterns, and the report on the first, with the live page."""
    folder = tmp_path_factory.mktemp("report")
    system = hv.load("holochrome-8").with_(shape=list(SHAPE))
    y, x = np.mgrid[:96, :128]
    tones = np.stack([80 + x // 2, 60 + y, np.full(x.shape, 120)], axis=-1) * (x > 24 + y / 6)[..., None]
    Image.fromarray(tones.astype(np.uint8)).save(folder / "picture.png")
    *_, last = hv.iterate(system, hv.target_for(system, folder / "picture.png").stack, hv.Settings(iterations=30))
    last.best.save(folder / "one.safetensors")
    hv.Hologram(hv.random_drive(system, 1), system).save(folder / "two.safetensors")
    claims = ("--claim", "C < 0.9", "--claim", "PSNR > 40 dB", "--claim", "C_red > 10 %")
    names = (str(folder / "one.safetensors"), "--target", str(folder / "picture.png"))
    assert cli.main(["report", *names, *claims, "--live", "-o", str(folder / "r.html")]) == 0
    return folder


def _table(folder: Path) -> dict[str, Any]:
    return dict(json.loads((folder / "r.json").read_text(encoding="utf-8")))


def test_page_and_json_hold_the_number_of_contrast(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = [str(folder / "one.safetensors"), "--target", str(folder / "picture.png")]
    assert cli.main(["contrast", *names, "--json"]) == 0
    known = json.loads(capsys.readouterr().out)
    (found,) = _table(folder)["holograms"]
    for key in ("contrast", "standard_error", "raw_contrast", "one_by_one_contrast", "n_eff_correlation"):
        assert found[key] == known[key]
    page = (folder / "r.html").read_text(encoding="utf-8")
    error = found["standard_error"]
    places = 1 - int(np.floor(np.log10(error)))
    assert f"{found['contrast']:.{places}f} ± {error:.{places}f}" in page
    assert [claim["verdict"] for claim in found["claims"]] == ["holds", "doesn't hold", "holds"]
    for words in ("holds", "in the manner of IEC 62906-5-2", "Roelandt", "holoview report", "in the zero order"):
        assert words in page
    assert "conform" not in page


def test_all_that_a_report_owes_is_in_its_json(folder: Path) -> None:
    table = _table(folder)
    assert table["format"] == "holoview-report" and table["version"] == 1
    assert {"bench", "seeds", "command", "versions", "title"} <= set(table)
    (found,) = table["holograms"]
    assert re.fullmatch("[0-9a-f]{64}", found["sha256"])
    assert found["psnr_db"] < 40 and found["eyebox"]["uniformity"] > 0 and found["black_beside_white"]["ratio"] > 0
    assert sum(found["light_budget"].values()) == pytest.approx(1.0, abs=1e-5)
    assert "holoview " in table["versions"] and "'C < 0.9'" in table["command"]


@pytest.mark.long
def test_the_command_makes_the_same_report_again(folder: Path, tmp_path: Path) -> None:
    words = _table(folder)["command"].split(" -o ")[0]
    assert cli.main([*shlex.split(words)[1:], "-o", str(tmp_path / "again.html")]) == 0
    again = json.loads((tmp_path / "again.json").read_text(encoding="utf-8"))
    first = _table(folder)
    assert again["holograms"] == first["holograms"]


def _with_error(found: dict[str, Any], name: str) -> str:
    """A contrast ratio of a report as the page has it."""
    value, error = found[f"{name}_contrast"], found[f"{name}_standard_error"]
    places = max(0, 1 - int(np.floor(np.log10(error))))
    return f"{value:.{places}f} ± {error:.{places}f}"


@pytest.mark.long
def test_sharpness_contrast_ratios_and_the_observer_are_in_it(folder: Path, tmp_path: Path) -> None:
    one, picture = str(folder / "one.safetensors"), str(folder / "picture.png")
    options = (
        "--contrast-ratio",
        "3",
        "--edge",
        "14,20,40,40",
        "--observer",
        "age 70, field 4",
        "--region",
        "0,0,128,96",
    )
    claims = ("--claim", "CR_sequential > 1", "--claim", "MTF50 > 0.001")
    assert cli.main(["report", one, "--target", picture, *options, *claims, "-o", str(tmp_path / "r.html")]) == 0
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    (found,) = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))["holograms"]
    ratios = ", ".join(_with_error(found, name) + " : 1" for name in ("sequential", "checkerboard"))
    assert found["sequential_contrast"] > 1 and ratios in page
    assert (found["mtf"] is None) == bool(found["no_mtf"]) and found["no_mtf"] in html.unescape(page)
    assert len(found["mtf_of_edge"]) == len(hv.load_hologram(one).system.planes_m)
    assert found["observer"] == "age 70, field 4" and "Observer: age 70, field 4" in page
    assert found["contrast"] != _table(folder)["holograms"][0]["contrast"]
    assert next(claim["verdict"] for claim in found["claims"]) == "holds"


@pytest.mark.long
def test_a_picture_is_as_sharp_as_itself(folder: Path, tmp_path: Path) -> None:
    """Against what it shows, as numbers in a file, a hologram's MTF is 1, its contrast 0, its PSNR that of rounding."""
    one, own = str(folder / "one.safetensors"), str(tmp_path / "own.exr")
    assert cli.main(["render", one, "-o", own]) == 0
    assert cli.main(["report", one, "--target", own, "-o", str(tmp_path / "r.html")]) == 0
    (found,) = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))["holograms"]
    assert np.allclose(found["mtf"]["mtf"], 1.0, atol=1e-4) and found["mtf"]["half_cycles_a_sample"] is None
    assert found["contrast"] < 1e-4 and found["psnr_db"] > 100
    assert f"above a half to {found['mtf']['cycles_a_sample'][-1]:.3g}" in (tmp_path / "r.html").read_text("utf-8")


@pytest.mark.long
def test_a_hologram_without_an_edge_gets_a_sentence(folder: Path, tmp_path: Path) -> None:
    """Random patterns have no edge, which is no reason to measure nothing of them; a region outside stops all."""
    names = ["holochrome-8", "--set", "shape=[48,64]"]
    assert cli.main(["report", *names, "--edge", "14,20,40,40", "-o", str(tmp_path / "r.html")]) == 0
    (found,) = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))["holograms"]
    assert found["contrast"] > 0 and any("no_edge" in row for row in found["mtf_of_edge"])
    said = next(row["no_edge"] for row in found["mtf_of_edge"] if "no_edge" in row)
    assert said in (tmp_path / "r.html").read_text(encoding="utf-8")
    assert cli.main(["report", *names, "--edge", "140,20,400,40", "-o", str(tmp_path / "r.html")]) == 2


@pytest.mark.long
def test_a_withheld_contrast_has_no_verdict(folder: Path, tmp_path: Path) -> None:
    names = [str(folder / f"{name}.safetensors") for name in ("one", "two")]
    more = ("--target", str(folder / "picture.png"), "--claim", "C < 0.9", "--region", "10,10,100,80")
    assert cli.main(["report", *names, *more, "-o", str(tmp_path / "r.html")]) == 0
    one, two = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))["holograms"]
    assert one["withheld"] is None and one["contrast"] is not None
    assert two["contrast"] is None and "doesn't show the target" in two["withheld"]
    assert [claim["verdict"] for claim in (*one["claims"], *two["claims"])] == ["holds", "not measured"]
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "the contrast is withheld" in page and html.unescape(page).count(two["withheld"]) == 1


@pytest.mark.long
def test_the_page_loads_nothing(folder: Path, tmp_path: Path) -> None:
    assert cli.main(["report", str(folder / "one.safetensors"), "-o", str(tmp_path / "plain.html")]) == 0
    text = (tmp_path / "plain.html").read_text(encoding="utf-8")
    assert "<script" not in text and "default-src 'none'" in html.unescape(text)
    assert not re.search(r"https?:|@import", text)
    check_document(tmp_path / "plain.html")


@pytest.fixture(scope="module")
def browser() -> Any:
    """Chromium with WebGPU on the processor."""
    with webgpu_browser() as browser:
        yield browser


@pytest.mark.long
@needs_chromium
def test_it_prints_to_two_sheets_and_the_hologram_in_it_is_live(browser: Browser, folder: Path, tmp_path: Path) -> None:
    page = browser.open((folder / "r.html").as_uri(), 1000, 1300)
    frame = page.frame_locator("iframe")
    frame.locator("#claims").wait_for()
    content = next(of for of in page.frames if of != page.main_frame)
    content.evaluate("() => window.holoview.ready")
    content.wait_for_function("() => document.getElementById('claims').textContent.includes('computed here')")
    (found,) = _table(folder)["holograms"]
    number, error = f"{found['contrast']:.3f}", f"{found['standard_error']:.3f}"
    said = frame.locator("#claims").inner_text()
    assert f"{number} ± {error} in the file, {number} computed here" in said
    assert f"{found['psnr_db']:.1f} dB in the file, {found['psnr_db']:.1f} dB computed here" in said
    page.pdf(path=str(tmp_path / "r.pdf"), prefer_css_page_size=True)
    assert _sheets(tmp_path / "r.pdf") == 2
    more = ("--target", str(folder / "picture.png"), "--meter", "iec", "--claim", "C < 0.4")
    for count in (2, 3, 4):
        names = [str(folder / f"{name}.safetensors") for name in ("one", "two", "one", "two")[:count]]
        assert cli.main(["report", *names, *more, "-o", str(tmp_path / "some.html")]) == 0
        other = browser.open((tmp_path / "some.html").as_uri(), 1000, 1300)
        other.pdf(path=str(tmp_path / "some.pdf"), prefer_css_page_size=True)
        assert _sheets(tmp_path / "some.pdf") == 2, f"{count} holograms"
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
@pytest.mark.parametrize("count", [1, 2, 4])
def test_any_report_prints_to_two_sheets(browser: Browser, tmp_path: Path, count: int) -> None:
    """Long names, notes, claims, edges and commands, 16 lasers and a bench with much to say of it: type shrinks."""
    system = hv.load("holochrome-16").with_(shape=list(SHAPE), eye={})
    one = review_hologram("one.safetensors", "0" * 64, hv.Hologram(hv.random_drive(system, 1), system), 0.01, REGION)
    wanted = np.zeros((*SHAPE, 3), np.uint8)
    plain = [replace(one, name=f"{n}.safetensors", psnr_db=17.0 + n, wanted=wanted) for n in range(count)]
    reading = replace(one.measured.reading, notes=[f"{n}: " + "what was not as it should be " * 6 for n in range(9)])
    edge = [{"plane": f"{n} mm", "no_edge": "no slanted edge in these samples " * 2} for n in range(11)]
    long = [
        replace(of, name=f"{'long-name-' * 7}{of.name}", edge=edge, measured=replace(one.measured, reading=reading))
        for of in plain
    ]
    wide = [replace(of, name=letters * 40) for of in plain for letters in ("全", "WM")][:count]  # as wide as high
    claims = [parse_claim(f"C < 0.{n}") for n in range(10, 26)]
    sizes = []
    for number, (reviewed, told, words) in enumerate(((plain, claims[:2], 30), (long, claims, 700), (wide, claims, 9))):
        command, file = "holoview report " + "x/y " * words, tmp_path / f"{number}.html"
        file.write_text(report_html(reviewed, told, title="t" * words, command=command, seeds={}), encoding="utf-8")
        page = browser.open(file.as_uri(), 703, 1000)  # 186 mm, inside the margins
        page.pdf(path=str(tmp_path / "r.pdf"), prefer_css_page_size=True)
        assert _sheets(tmp_path / "r.pdf") == 2
        page.emulate_media(media="print")
        sizes.append(page.eval_on_selector_all(".sheet", "all => all.map(of => of.getBoundingClientRect().height)"))
    a_sheet = 275 / 25.4 * 96
    assert all(0.4 * a_sheet < height <= a_sheet for height in np.ravel(sizes)), sizes
    assert browser.close_pages() == []


def _sheets(pdf: Path) -> int:
    return len(re.findall(rb"/Type\s*/Page\b", pdf.read_bytes()))


@pytest.mark.parametrize(
    ("text", "quantity", "comparison", "limit"),
    [
        ("C < 0.4", "C", "<", 0.4),
        ("C<=40%", "C", "<=", 0.4),
        ("PSNR ≥ 25 dB", "PSNR", "≥", 25.0),
        ("colour_area < 1.6e-3", "colour_area", "<", 1.6e-3),
    ],
)
def test_claims_are_read(text: str, quantity: str, comparison: str, limit: float) -> None:
    claim = parse_claim(text)
    assert (claim.quantity, claim.comparison, claim.limit) == (quantity, comparison, pytest.approx(limit))


@pytest.mark.parametrize("text", ["", "C", "C < ", "C < x", "K < 1", "C = 1", "C < 1..2", "C < 1; rm", "C < 0.4" * 20])
def test_what_is_no_claim_is_refused(text: str) -> None:
    with pytest.raises(UserError, match="--claim"):
        parse_claim(text)


@pytest.mark.parametrize(
    ("text", "verdict"),
    [("C < 0.5", "holds"), ("C < 0.3", "doesn't hold"), ("C < 0.41", "undecided"), ("PSNR > 1", "not measured")],
)
def test_a_claim_within_two_standard_errors_is_undecided(text: str, verdict: str) -> None:
    assert judge_claim(parse_claim(text), {"C": (0.4, 0.01), "N_eff": (6.0, None)}).verdict == verdict
    assert set(QUANTITIES) >= {"C", "PSNR", "N_eff"}


@pytest.mark.parametrize(
    ("text", "verdict"),
    [
        ("C < 0.5", "holds"),
        ("C ≤ 0.5", "holds"),
        ("C < 0.3", "undecided"),
        ("C > 0.3", "undecided"),
        ("C > 0.5", "undecided"),
        ("N_eff > 5", "holds"),
        ("N_eff >= 7", "undecided"),
        ("N_eff < 7", "undecided"),
        ("PSNR > 20", "doesn't hold"),
    ],
)
def test_a_raw_value_is_a_bound_that_bears_out_a_claim_from_one_side(text: str, verdict: str) -> None:
    values = {"C": (0.4, 0.01), "N_eff": (6.0, None), "PSNR": (15.0, None)}
    assert judge_claim(parse_claim(text), values, is_raw=True).verdict == verdict
    is_of_light = text.startswith("PSNR")
    assert judge_claim(parse_claim(text), values, is_rough=True).verdict == (verdict if is_of_light else "undecided")


@pytest.fixture(scope="module")
def reviewed() -> ReviewedHologram:
    """Random patterns with ratios, patterns and a sharpness that know their errors."""
    system = hv.load("holochrome-8").with_(shape=list(SHAPE))
    hologram = hv.Hologram(hv.random_drive(system, 1), system)
    return replace(
        review_hologram("random patterns", "", hologram, 0.01, REGION),
        black=BlackBesideWhite(30.0, 2.0, 100, 0.02),
        display=SimpleNamespace(sequential=ContrastRatio(20.0, 1.0), checkerboard=ContrastRatio(10.0, 0.5)),  # type: ignore[arg-type]
        mtf=Mtf(np.array([0.0, 0.1, 0.2]), np.array([1.0, 0.7, 0.3]), float("nan"), 0.01),
    )


@pytest.mark.parametrize("quantity", ["N_eff", "CR", "CR_sequential", "CR_checkerboard", "MTF50"])
def test_claims_on_ratios_patterns_and_sharpness_know_their_errors(reviewed: ReviewedHologram, quantity: str) -> None:
    """Within two standard errors they are undecided, on the page and in JSON; beyond, they have a verdict."""
    value, error = reviewed.values[quantity]
    assert error is not None and error > 0
    claims = [parse_claim(f"{quantity} > {value - sigmas * error:.6f}") for sigmas in (1, 3, -3)]
    assert [of.verdict for of in reviewed.judge(claims)] == ["undecided", "holds", "doesn't hold"]
    table = reviewed.as_json(claims)
    assert [claim["standard_error"] for claim in table["claims"]] == [error] * 3
    assert (table["sequential_standard_error"], table["mtf"]["half_standard_error"]) == (1.0, 0.01)
    page = report_html([reviewed], claims, title="", command="", seeds={})
    for words in ("20.0 ± 1.0 : 1, 10.00 ± 0.50 : 1", "15.00 ± 0.30 : 1", "0.150 ± 0.010 cycles a sample"):
        assert words in page
    assert "not of a sample, and have no standard error" in page


def test_two_pixels_decide_no_claim(folder: Path, tmp_path: Path) -> None:
    options = ("--claim", "C < 4", "--region", "0,0,2,1", "-o", str(tmp_path / "r.html"))
    assert cli.main(["report", str(folder / "one.safetensors"), *options]) == 0
    (found,) = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))["holograms"]
    assert [claim["verdict"] for claim in found["claims"]] == ["undecided"]
    assert ", from too few grains)" in (tmp_path / "r.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["one.safetensors", "-o", "r.txt"], ".html"),
        (["one.safetensors", "-o", "r.html", "--claim", "C is low"], "--claim"),
        (["one.safetensors", "-o", "r.html", "--region", "0,0,1,1"], "two or more pixels with light"),
        (["one.safetensors", "-o", "r.html", "--region", "100,0,90,90"], "inside the image"),
        (["missing.safetensors", "-o", "r.html"], "missing.safetensors"),
        (["one.safetensors"] * 5 + ["-o", "r.html"], "at most 4"),
        (["one.safetensors", "-o", "one.html", "--set", "gap=1mm"], "the bench that it was made for"),
    ],
)
def test_mistakes_are_named(
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "one.safetensors").write_bytes((folder / "one.safetensors").read_bytes())
    assert cli.main(["report", *arguments]) == 2
    err = capsys.readouterr().err
    assert said in err and err.count("\n") == 1
    assert not list(tmp_path.glob("*.html")) and not list(tmp_path.glob("*.json"))


@pytest.mark.long
def test_a_contrast_without_a_target_is_named_raw(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The structure of a picture counts in it; random patterns have none."""
    claim = ("--claim", "C < 4", "-o", str(tmp_path / "raw.html"))
    assert cli.main(["report", str(folder / "one.safetensors"), *claim]) == 0
    told = capsys.readouterr().out
    assert "one.safetensors: raw speckle contrast" in told
    assert "structure of a picture counts as speckle here" in told
    assert ", raw)" in (tmp_path / "raw.html").read_text(encoding="utf-8")
    against = ("--claim", "C > 0.001", *claim[2:])
    assert cli.main(["report", str(folder / "one.safetensors"), *against]) == 0
    assert ", raw: needs a target)" in (tmp_path / "raw.html").read_text(encoding="utf-8")
    assert json.loads((tmp_path / "raw.json").read_text())["holograms"][0]["claims"][0]["verdict"] == "undecided"
    capsys.readouterr()
    assert cli.main(["report", "holochrome-8", "--set", "shape=[24,32]", *claim]) == 0
    assert "raw speckle" not in capsys.readouterr().out
    assert ", raw)" not in (tmp_path / "raw.html").read_text(encoding="utf-8")
