"""A page in the browser shows what `holoview render` shows, measures what the metrics measure, and is only data."""

from __future__ import annotations

import base64
import io
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

import holoview as hv
from holoview.holograms.metrics.fidelity import psnr_linear_srgb
from holoview.holograms.metrics.likeness import OtherPlanes, luminance_contrast
from holoview.holograms.metrics.speckle import speckle_contrast
from holoview.holograms.targets.focal_stack import Target
from holoview.light.colour import COLOUR_SPACES, SRGB_TO_XYZ, fitting_stops, srgb_decode
from holoview.light.gpu.device import Device
from holoview.viewer.document.measurements import measure_region
from holoview.viewer.page.page import export_html, read_page
from tests.chromium import Browser, needs_chromium, pixels
from tests.explored import explored
from tests.page.pages import WEBGPU, claims_of, drag_right, open_page, page_pixels, set_state, webgpu_browser

EYE = {"pupil": "2 mm", "pupil_x": "0.3 mm"}
REGION = (20, 12, 40, 30)
pytestmark = pytest.mark.gpu


@dataclass(frozen=True)
class Written:
    """Pages, the holograms in them, and a target."""

    folder: Path
    first: hv.Hologram
    second: hv.Hologram
    eye: hv.Hologram
    target: Target
    stripes: Target

    @property
    def page(self) -> Path:
        return self.folder / "two.html"

    @property
    def eye_page(self) -> Path:
        return self.folder / "eye.html"


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory, device: Device) -> Written:
    """A page with two holograms and a target, and one of an eye."""
    folder = tmp_path_factory.mktemp("pages with space")
    rng = np.random.default_rng(5)
    system = hv.load("holochrome-8").with_(shape=[48, 64])
    first, second = (hv.Hologram(_in_8_bits(hv.random_drive(system, seed=seed)), system) for seed in (1, 2))
    seen = system.with_(eye=EYE)
    eye = hv.Hologram(hv.random_drive(seen, seed=3), seen)
    planes = tuple(system.planes_m.tolist())
    seen_of_first = hv.simulate(system, first.drive, planes=planes, backend="torch").rgb
    shown = 0.6 * np.clip(seen_of_first, 0, 1) * rng.uniform(0.7, 1.3, (len(planes), 96, 128, 1))  # as the first shows
    target = Target(np.clip(shown, 0, 1).astype(np.float32), planes, "light of the first")
    bars = np.kron(np.array([0.1, 0.6] * 4), np.ones(16))  # dark and light, too wide for a blur to take them away
    stripes = Target(np.broadcast_to(bars[:, None], (len(planes), 96, 128, 3)).astype(np.float32), planes, "stripes")
    pages = Written(folder, first, second, eye, target, stripes)
    both = {"one </script><b>": first, "two": second}
    export_html(pages.page, both, target=target, title="Two & more", note="<i>plain</i>", region=REGION)
    export_html(pages.eye_page, {"eye": eye})
    export_html(folder / "other.html", {"two": second}, target=stripes, region=REGION)
    return pages


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Chromium with WebGPU on the processor."""
    with webgpu_browser() as browser:
        yield browser


def _in_8_bits(drive: np.ndarray) -> np.ndarray:
    """The drive in 255ths of the stroke."""
    return np.rint(drive * np.float32(255)) / np.float32(255)


def _laser_off(system: hv.System, *off: int) -> hv.System:
    amplitudes = system.amplitudes.copy()
    amplitudes[:, list(off)] = 0.0
    return system.edit({"amplitudes": amplitudes})


def _moved(system: hv.System, wavelength: int, to_m: float) -> hv.System:
    wavelengths = system.wavelengths_m.copy()
    wavelengths[wavelength] = to_m
    return system.edit({"wavelengths": wavelengths, "amplitudes": system.amplitudes})


def _is_equal(shown: np.ndarray, hologram: hv.Hologram, system: hv.System, plane_m: float) -> None:
    """Within 1 of 255 in 99.9 % of the samples: float32 sums differ in their order between devices."""
    view = hv.simulate(system, hologram.drive, planes=[plane_m], backend="torch64")
    difference = np.abs(shown.astype(int) - view.srgb8[0].astype(int)).max(axis=-1)
    assert shown.std() > 5
    assert np.mean(difference <= 1) >= 0.999


@needs_chromium
def test_the_page_shows_what_render_shows(browser: Browser, written: Written) -> None:
    system, lasers = written.first.system, [True] * 8
    page = open_page(browser, written.page)
    _is_equal(page_pixels(page), written.first, system, 10e-3)
    moved = [*system.wavelengths_m.tolist()]
    moved[2] = 520e-9
    states: list[tuple[dict[str, Any], hv.System, float]] = [
        ({"plane_m": 9.7e-3}, system, 9.7e-3),
        ({"plane_m": 11.9e-3}, system, 11.9e-3),
        ({"lasers": [True, False, True, False, *lasers[4:]]}, _laser_off(system, 1, 3), 11.9e-3),
        ({"lasers": lasers, "gap_m": 2.3e-3}, system.with_(gap="2.3 mm"), 11.9e-3),
        ({"gap_m": 0.0, "plane_m": 8.1e-3}, system.with_(gap="0 mm"), 8.1e-3),
        ({"gap_m": 2e-3, "wavelengths_m": moved}, _moved(system, 2, 520e-9), 8.1e-3),
        ({"wavelengths_m": system.wavelengths_m.tolist(), "plane_m": 10e-3}, system, 10e-3),
    ]
    for changes, expected, plane_m in states:
        set_state(page, **changes)
        _is_equal(page_pixels(page), written.first, expected, plane_m)
    set_state(page, powers=[2.0, *[1.0] * 6, 0.25])
    powers = system.amplitudes * np.array([2.0, *[1.0] * 6, 0.25])
    _is_equal(page_pixels(page), written.first, system.edit({"amplitudes": powers}), 10e-3)
    set_state(page, view="hologram 2", powers=[1.0] * 8)
    _is_equal(page_pixels(page), written.second, system, 10e-3)
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
def test_an_eye_sees_on_the_page_what_it_sees_in_render(browser: Browser, written: Written) -> None:
    system = written.eye.system
    page = open_page(browser, written.eye_page)
    _is_equal(page_pixels(page), written.eye, system, 10e-3)
    for changes, eye in (
        ({"pupil_m": 3e-3}, {**EYE, "pupil": "3 mm"}),
        ({"pupil_x_m": -5e-4, "pupil_y_m": 2e-4}, {"pupil": "3 mm", "pupil_x": "-0.5 mm", "pupil_y": "0.2 mm"}),
        ({"chromatic": False}, {"pupil": "3 mm", "pupil_x": "-0.5 mm", "pupil_y": "0.2 mm", "chromatic": False}),
    ):
        set_state(page, eye=changes)
        _is_equal(page_pixels(page), written.eye, system.with_(eye=eye), 10e-3)
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
@pytest.mark.parametrize("eye", [None, EYE], ids=["no eye", "an eye"])
def test_with_effects_planes_gaps_and_lasers_are_the_nominal_ones(
    browser: Browser, tmp_path: Path, eye: dict[str, str] | None
) -> None:
    """The page names planes, gap and lasers as the bench does, and shows the light where and of what it really is."""
    effects = {
        "distance": {"distance_error": "0.6 mm"},
        "gap": {"gap_error": "-0.3 mm"},
        "second_line": {"share": 0.3, "offset": "6 nm"},
        "laser_power": {"exponent": 0.2},
    }
    lasers = {"wavelengths": ["460 nm", "530 nm", "620 nm"], "amplitudes": [[1.0, 1.5, 2.0]]}
    system = hv.load("holochrome-8").edit({"shape": [24, 32], "planes": ["9 mm", "11 mm"], **lasers})
    system = system.edit({"effects": effects, "eye": eye})
    hologram = hv.Hologram(_in_8_bits(hv.random_drive(system, seed=6)), system)
    page = open_page(browser, export_html(tmp_path / "effects.html", hologram, plane_m=9e-3))
    assert page.inner_text("#gap-value") == "2.000 mm"
    assert page.locator("#laser-rows .laser").count() == 3
    _is_equal(page_pixels(page), hologram, system, 9e-3)
    set_state(page, plane_m=11e-3, gap_m=2.4e-3)
    _is_equal(page_pixels(page), hologram, system.with_(gap="2.4 mm"), 11e-3)
    set_state(page, gap_m=2e-3, lasers=[True, False, True])
    _is_equal(page_pixels(page), hologram, _laser_off(system, 1), 11e-3)
    message = page.evaluate("() => window.holoview.set({ powers: [1, 0.5, 1] }).catch(error => String(error))")
    assert "doesn't rise in proportion" in message
    low = page.evaluate("() => Number(document.getElementById('gap').min)")
    assert 0.3e-3 <= low <= 0.6e-3, "a gap can't be shorter than nothing"
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
def test_the_page_measures_what_the_metrics_measure(browser: Browser, written: Written) -> None:
    page = open_page(browser, written.page)
    box = dict(zip(("x", "y", "width", "height"), REGION, strict=True))
    found = page.evaluate("region => window.holoview.measure(region)", box)
    whole = page.evaluate("() => window.holoview.measure()")
    view = hv.simulate(written.first.system, written.first.drive, planes=[10e-3], backend="torch64")
    raw = speckle_contrast(view.xyz[0, ..., 1], REGION)
    codes = np.rint(255 * hv_srgb(written.target.stack[2]))
    contrast = luminance_contrast(view.xyz[0, ..., 1], REGION, srgb_decode(codes / 255)).pattern.contrast
    assert found["contrast"] == pytest.approx(contrast.contrast, rel=1e-4) and found["divided"]
    assert found["raw_contrast"] == pytest.approx(raw.contrast, rel=1e-4)
    assert found["mean"] == pytest.approx(raw.mean, rel=1e-4)
    assert found["samples"] == contrast.n_pixels == sum(found["histogram"])
    expected = psnr_linear_srgb(view.rgb[0], srgb_decode(codes / 255)).mean_db
    assert whole["psnr_db"] == pytest.approx(expected, abs=2e-3)
    measured = measure_region(view.xyz[0], REGION, written.target.stack[2])  # as the viewer does
    shown = measured.contrast
    assert shown is not None
    said = claims_of(page)
    assert "the structure of the target divided out" in said
    assert f"{shown:.3f} ± {measured.standard_error:.3f} in the file, {contrast.contrast:.3f} computed here" in said
    # the page's target has 8 bits: rounding by 1/2 of 255 changes tones by 1 %, and their ratios' spread by far less
    assert contrast.contrast == pytest.approx(shown, rel=5e-3)
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
def test_a_contrast_is_withheld_where_the_target_is_not_shown(browser: Browser, written: Written) -> None:
    page = open_page(browser, written.folder / "other.html")
    box = dict(zip(("x", "y", "width", "height"), REGION, strict=True))
    found = page.evaluate("region => window.holoview.measure(region)", box)
    view = hv.simulate(written.second.system, written.second.drive, planes=[10e-3], backend="torch64")
    known = measure_region(view.xyz[0], REGION, written.stripes.stack[2])
    assert found["contrast"] is None is known.contrast and not found["divided"]
    assert "doesn't show the target" in found["withheld"] and "doesn't show the target" in known.withheld
    assert found["raw_contrast"] == pytest.approx(known.raw_contrast, rel=1e-4)
    assert "withheld in the file, withheld computed here" in claims_of(page)
    set_state(page, plane_m=9.7e-3)  # between the planes of the target, which is out of focus there
    between = page.evaluate("region => window.holoview.measure(region)", box)
    assert between["contrast"] is None and "psnr_db" not in between
    assert between["withheld"].startswith("the page holds the target at 9.000 mm")
    assert browser.close_pages() == []


@pytest.fixture(scope="module")
def judging(browser: Browser, written: Written) -> Iterator[tuple[Browser, Any]]:
    """A browser with a page whose functions are asked; it has no WebGPU, as nobody looks at the page's image."""
    with browser.another() as plain:
        page = plain.open(written.page.as_uri(), 1200, 900)
        page.evaluate("() => window.holoview.ready.catch(() => {})")
        yield plain, page


@needs_chromium
@pytest.mark.parametrize(
    "how",
    explored(
        [
            *("right", "blurred", "displaced", "up", "mirrored", "tone curve", "something else", "another plane"),
            *("another plane, known to be none", "an object", "a bright sample"),
        ],
        ["right", "blurred", "tone curve", "another plane"],
    ),
)
def test_the_page_judges_a_contrast_as_python_does(judging: tuple[Browser, Any], how: str) -> None:
    """A drawn scene with gamma-law speckle beside a target of 8-bit codes: the same contrast, blur and sentence."""
    (plain, page), rng = judging, np.random.default_rng(4)
    codes = np.kron(rng.integers(40, 230, (8, 12)), np.ones((9, 8))).astype(np.uint8)
    linear = srgb_decode(codes / 255.0)
    light = ndimage.gaussian_filter(linear, 2.0) if how == "blurred" else linear.copy()
    light = np.roll(light, 4, axis=1) if how == "displaced" else light**0.4 if how == "tone curve" else light
    light = np.roll(light, (-1, 2), axis=(0, 1)) if how == "up" else light[:, ::-1] if how == "mirrored" else light
    other = ndimage.gaussian_filter(codes, (0, 6))
    light = srgb_decode(other / 255.0) if how.startswith("another plane") else light
    light[20:40, 30:60] = 2.0 if how == "something else" else light[20:40, 30:60]
    light[30:44, 40:54] *= 1.7 if how == "an object" else 1.0
    row, column = np.argwhere(linear[10:60, 10:80] == linear[10:60, 10:80].max())[0] + 10
    light[row, column] *= 1000.0 if how == "a bright sample" else 1.0  # in the dark, division by the target would tell
    y = (light * ndimage.uniform_filter(rng.gamma(4, 0.25, light.shape), 3)).astype(np.float32)
    region, are_mistakable = (5, 4, 80, 60), how == "another plane"
    xyz, target, blurred = (np.repeat(of[..., None], 4, axis=-1) for of in (y, codes, other))
    found = page.evaluate(
        """d => {
            const [target, other] = [d.codes, d.other].map(of => targetOf(Uint8Array.from(of), d.width, d.luminance))
            return speckle(Float32Array.from(d.xyz), d.width, d.region, target, [["at 12 mm", other]], d.areMistakable)
        }""",
        {
            "xyz": xyz.ravel().tolist(),
            "codes": target.ravel().tolist(),
            "other": blurred.ravel().tolist(),
            "width": y.shape[1],
            "region": dict(zip(("x", "y", "width", "height"), region, strict=True)),
            "luminance": SRGB_TO_XYZ[1].tolist(),
            "areMistakable": are_mistakable,
        },
    )
    pictures = [np.repeat(of[..., None], 3, axis=-1) for of in (linear, srgb_decode(other / 255.0))]
    known = luminance_contrast(y, region, pictures[0], others=OtherPlanes({"at 12 mm": pictures[1]}, are_mistakable))
    assert [found[key] for key in ("withheld", "doubt", "blur_px")] == [known.withheld, known.doubt, known.blur_px]
    is_stated = how in ("right", "blurred", "another plane, known to be none", "a bright sample")
    assert bool(known.withheld) != is_stated
    assert ("further than speckle does" in known.withheld) == (how == "an object")
    assert known.doubt.startswith("another target fits better: at 12 mm") == how.endswith("none")
    assert ("contrast of 1 at most" in known.doubt) == (how == "a bright sample")
    if not known.withheld:
        assert found["contrast"] == pytest.approx(known.estimate.contrast, rel=1e-9)
    assert plain.problems == []


def hv_srgb(linear: np.ndarray) -> np.ndarray:
    """The sRGB signal of linear light."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)


@pytest.mark.long
@needs_chromium
def test_a_link_holds_the_state(browser: Browser, written: Written) -> None:
    page = open_page(browser, written.page, "#plane=9.7mm&laser3=off&power1=0.5")
    state = page.evaluate("() => window.holoview.state")
    assert state["plane_m"] == pytest.approx(9.7e-3)
    assert state["lasers"] == [True, True, False, *[True] * 5]
    assert state["powers"][0] == 0.5
    shown = page_pixels(page)
    page.keyboard.press("ArrowRight")
    page.wait_for_function("() => location.hash.includes('plane=9.74mm')")
    other = open_page(browser, written.page, page.evaluate("() => location.hash"))
    assert other.evaluate("() => window.holoview.state.lasers[2]") is False
    assert (page_pixels(other) != shown).any()
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
def test_a_state_that_cannot_be_gets_a_sentence(browser: Browser, written: Written) -> None:
    page = open_page(browser, written.page)
    for says, changes in {
        "plane_m: expected metres from": {"plane_m": 1.0},
        "for each laser": {"lasers": [True]},
        "gap_m": {"gap_m": None},
        "colour: expected one of": {"colour": 1},
        "others: expected": {"others": {"2": {"lasers": [True]}}},
        "eye": {"eye": {"pupil_m": 1e-3}},
    }.items():
        said = page.evaluate("changes => window.holoview.set(changes).then(() => '', error => error.message)", changes)
        assert says in said
    assert browser.close_pages() == []


NOT_TO_BE_FOLLOWED = {
    "#plane=9.7": "a length with its unit",
    "#plane=1kg": "a length with its unit",
    "#plane=9mm&laser12=off": "a laser that the hologram has",
    "#laser2=maybe": "on or off",
    "#region=1,2,3": "region=x,y,width,height",
    "#region=100,0,60,20": "samples inside the image",
    "#view=hologram-7": "hologram 1, hologram 2",
    "#constructor=1": "one of plane, gap",
    "#plane=%": "a length with its unit",
    "#nonsense": "for example #plane=9.7mm",
    "#plane=1m": "metres from",
}


@pytest.mark.long
@needs_chromium
def test_a_link_that_cannot_be_followed_says_so(browser: Browser, written: Written) -> None:
    """It stays said when the image is there, until the reader changes something: then the address is right again.

    With the first link the page is opened; to the others it is led, as opening it takes seconds.
    """
    page = open_page(browser, written.page, next(iter(NOT_TO_BE_FOLLOWED)))
    note = page.locator("#link-note")
    for link, says in NOT_TO_BE_FOLLOWED.items():
        page.evaluate("link => { location.hash = link }", link)
        page.wait_for_function("() => document.getElementById('link-note').textContent !== ''")
        page_pixels(page)
        assert note.inner_text().startswith("This link can't be followed: ") and says in note.inner_text(), link
        assert page.evaluate("() => window.holoview.state.plane_m") == pytest.approx(10e-3), link
        page.locator("#image").focus()
        page.keyboard.press("ArrowRight")
        page.wait_for_function("() => location.hash.startsWith('#plane=10.04mm')")
        assert note.inner_text() == "", link
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
def test_the_measured_region_is_in_the_link(browser: Browser, written: Written) -> None:
    page = open_page(browser, written.page, "#region=10,20,40,30")
    assert page.evaluate("() => window.holoview.state.region") == {"x": 10, "y": 20, "width": 40, "height": 30}
    page.wait_for_function("() => document.getElementById('region').textContent.startsWith('In the region')")
    page.locator("#image").click(position={"x": 200, "y": 200})  # a click without a drag measures the whole image
    page.wait_for_function("() => location.hash.includes('region=none')")
    other = open_page(browser, written.page, page.evaluate("() => location.hash"))
    other.wait_for_function("() => document.getElementById('region').textContent.startsWith('In the whole image')")
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
def test_what_is_measured_prints_and_keys_stay(browser: Browser, written: Written) -> None:
    page = open_page(browser, written.page, "#plane=9.7mm&laser3=off&power1=0.5&region=10,20,40,30")
    page.wait_for_function("() => document.getElementById('region').textContent.startsWith('In the region')")
    page.wait_for_function("() => !document.getElementById('region').classList.contains('old')")
    measured = page.inner_text("#region")
    assert not page.is_visible("#summary")
    page.emulate_media(media="print")
    printed = page.inner_text("body").replace("\u00a0", " ")
    assert page.is_visible("#summary") and not page.is_visible("#controls") and page.is_visible("footer kbd >> nth=0")
    state = "#plane=9.7mm&laser3=off&power1=0.5&region=10,20,40,30"
    for text in ("9.700 mm", "1: 460.0 nm 50 %", "nm off", "x 10, y 20, 40 × 30 samples", measured, state):
        assert text in printed
    assert len(re.findall(rb"/Type\s*/Page\b", page.pdf(format="A4"))) == 1  # sheet
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
def test_without_webgpu_all_holograms_are_seen_and_nothing_is_said_to_be_computed(
    browser: Browser, written: Written
) -> None:
    with browser.another() as plain:
        page = plain.open(written.page.as_uri() + "#plane=9.1mm&view=hologram-2&laser2=off", 900, 800)
        page.evaluate("() => window.holoview.ready.catch(() => {})")
        assert "has to be computed" in page.inner_text("#link-note")
        said = page.inner_text("body")
        assert "computed here" not in said and "Computed in this browser" not in said
        assert "in the file; not computed again here" in said and "rendered when the file was written" in said
        pictures = {}
        for name in ("two", "one </script><b>", "Target"):
            page.locator("#views button", has_text=name).click()
            assert page.locator("#views [aria-checked=true]").inner_text() == name
            pictures[name] = page.get_attribute("#stored", "src")
            assert page.get_attribute("#stored", "alt") == f"{name} at 9.000 mm, rendered before"
        assert len(set(pictures.values())) == 3
        assert page.locator("#views button").count() == 3, "a wipe has to be computed"
        assert plain.close_pages() == []


@pytest.mark.long
@needs_chromium
@pytest.mark.parametrize(
    "size", [(390, 800), (320, 640), (740, 360)], ids=["phone", "small phone", "phone on its side"]
)
def test_controls_are_large_enough_for_fingers(size: tuple[int, int], browser: Browser, written: Written) -> None:
    """WCAG 2.2, target size: 24 by 24 CSS pixels, of which none lies under another control."""
    page = open_page(browser, written.eye_page, "", *size)
    page.evaluate("() => document.querySelectorAll('details').forEach(each => (each.open = true))")
    found = page.eval_on_selector_all(
        "button, input, summary, [tabindex], a[href]",
        """all => all.filter(each => each.getClientRects().length && !each.closest("p")).map(each => {
            each.scrollIntoView({ block: "center" })
            const { left, top, width, height } = each.getBoundingClientRect()
            const inside = [-11, 11].flatMap(dx => [-11, 11].map(dy => [left + width / 2 + dx, top + height / 2 + dy]))
            const others = inside.map(([x, y]) => document.elementFromPoint(x, y)?.closest("button, input, summary, a"))
            const covered = others.filter(other => other && other !== each && !other.contains(each)).length
            return [each.tagName + " " + (each.id || each.textContent.trim() || each.type), width, height, covered]
        })""",
    )
    assert len(found) > 20
    assert [each for each in found if min(each[1:3]) < 24 or each[3]] == []
    assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
def test_lasers_are_told_apart_without_their_colours(browser: Browser, written: Written) -> None:
    """A number in each swatch, readable on its colour (WCAG 1.4.3), and the same numbers in the spectrum."""
    page = open_page(browser, written.page, "", 900, 800)
    swatches = page.locator(".laser .swatch").all_inner_texts()
    assert len(swatches) > 1 and swatches == [str(number + 1) for number in range(len(swatches))]
    drawn = page.locator("#spectrum text").all_text_contents()
    assert set(swatches) <= set(drawn) and {"L", "M", "S"} <= set(drawn)
    colours = page.eval_on_selector_all(
        ".laser .swatch", "all => all.map(getComputedStyle).map(style => [style.color, style.backgroundColor])"
    )
    assert min(_contrast(*pair) for pair in colours) >= 4.5
    assert browser.close_pages() == []


def _contrast(*colours: str) -> float:
    """The ratio of luminances of two CSS colours "rgb(r, g, b)", as WCAG defines it."""
    luminances = []
    for colour in colours:
        parts = np.array([float(part) for part in re.findall(r"[\d.]+", colour)[:3]]) / 255
        linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
        luminances.append(float(linear @ [0.2126, 0.7152, 0.0722]))
    return (max(luminances) + 0.05) / (min(luminances) + 0.05)


@pytest.mark.long
@needs_chromium
def test_without_webgpu_there_are_pictures_and_a_word_why(browser: Browser, written: Written) -> None:
    with browser.another() as plain:
        page = plain.open(written.page.as_uri(), 900, 800)
        said = page.evaluate("() => window.holoview.ready.then(() => '', error => error.message)")
        assert "WebGPU" in said
        assert said in page.inner_text("#message")
        assert page.is_visible("#stored")
        page.fill("#plane", "0")
        assert page.inner_text("#plane-value") == "9.000 mm"
        assert plain.close_pages() == []


@needs_chromium
def test_a_browser_that_knows_nothing_of_webgpu_shows_pictures(browser: Browser, written: Written) -> None:
    """As Firefox on Linux: not even the names of WebGPU's constants exist there."""
    names = ("GPUBufferUsage", "GPUShaderStage", "GPUMapMode")
    page = browser.open("about:blank", 900, 800)
    page.add_init_script(
        "Object.defineProperty(Navigator.prototype, 'gpu', { get: () => undefined });"
        + "".join(f"delete globalThis.{name};" for name in names)
    )
    page.goto(written.page.as_uri())
    assert "has no WebGPU" in page.evaluate("() => window.holoview.ready.then(() => '', error => error.message)")
    assert page.is_visible("#stored")
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
def test_a_page_needs_no_network(browser: Browser, written: Written) -> None:
    page = browser.open("about:blank", 900, 800)
    page.context.set_offline(True)
    page.goto(written.page.as_uri())
    page.evaluate("() => window.holoview.ready")
    assert page_pixels(page).std() > 5
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
def test_nothing_is_wider_than_the_page_and_nothing_is_loaded(browser: Browser, written: Written) -> None:
    page = open_page(browser, written.page)
    for width in (390, 800, 1600):
        page.set_viewport_size({"width": width, "height": 900})
        page.wait_for_function(f"() => window.innerWidth === {width}")
        assert page.evaluate("document.documentElement.scrollWidth") <= width
    loaded = page.evaluate("performance.getEntriesByType('resource').map(entry => entry.name)")
    assert [name[:60] for name in loaded if not name.startswith("data:")] == []
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
def test_the_canvas_shows_the_image_the_target_and_a_wipe(browser: Browser, written: Written, tmp_path: Path) -> None:
    page = open_page(browser, written.page)
    means = {}
    for view in ("hologram 1", "target", "wipe target", "wipe holograms"):
        set_state(page, view=view)
        assert page.get_attribute("#views [aria-checked=true]", "role") == "radio"
        means[view] = pixels(page, tmp_path)[150:550, 50:700]
    left, right = slice(None, 200), slice(-200, None)
    assert np.abs(means["wipe target"] - means["hologram 1"])[:, left].mean() < 2
    assert np.abs(means["wipe target"] - means["target"])[:, right].mean() < 2
    assert np.abs(means["target"] - means["hologram 1"]).mean() > 10
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
def test_a_hologram_of_other_wavelengths_has_lasers_of_its_own(
    browser: Browser, written: Written, tmp_path: Path
) -> None:
    system = hv.load("simultaneous").with_(shape=[48, 64])
    three = hv.Hologram(hv.random_drive(system, seed=6), system)
    file = export_html(tmp_path / "both.html", {"eight": written.first, "three": three})
    page = open_page(browser, file)
    assert page.locator("#lasers .laser:visible").count() == 8
    set_state(page, view="hologram 2")
    assert page.locator("#lasers .laser:visible").count() == 3
    page.locator("#lasers .laser:visible input[type=checkbox]").nth(1).uncheck()
    page.wait_for_function("() => location.hash.includes('laser2.2=off')")
    _is_equal(page_pixels(page), three, _laser_off(system, 1), 10e-3)
    other = open_page(browser, file, page.evaluate("() => location.hash"))
    assert other.evaluate("() => window.holoview.state.others['2'].lasers") == [True, False, True]
    set_state(other, view="hologram 1")
    _is_equal(page_pixels(other), written.first, written.first.system, 10e-3)
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
def test_a_quick_image_says_so_and_the_exact_one_follows(
    browser: Browser, written: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("holoview.viewer.page.frame_recording._QUICK_SAMPLES", 0)
    file = export_html(tmp_path / "quick.html", written.first)
    page = browser.open(file.as_uri(), 900, 800)
    said = page.evaluate("() => window.holoview.ready.then(() => document.getElementById('message').textContent)")
    assert said == "Quick image; the exact one follows …"
    system = written.first.system
    for plane_m in (10e-3, 9.3e-3):
        page.evaluate(_LATE)
        set_state(page, plane_m=plane_m)
        _is_equal(page_pixels(page), written.first, system, plane_m)
        assert page.inner_text("#message") == ""
        quick = page.evaluate(_QUICK_PIXELS)
        shown = np.array(quick, np.uint8).reshape(96, 128, 4)[..., :3]
        compact = system.with_(propagation="compact")
        view = hv.simulate(compact, written.first.drive, planes=[plane_m, 12e-3], backend="torch64")
        difference = np.abs(shown.astype(int) - view.srgb8[0].astype(int)).max(axis=-1)
        assert np.mean(difference <= 1) >= 0.999  # as `_is_equal`; the page's grid holds the farthest plane, 12 mm
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
def test_where_the_exact_image_of_a_plane_comes_soon_no_quick_one_is_computed_before(
    browser: Browser, written: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Quick images come first where it takes long, which the first exact image tells, and while one drags."""
    monkeypatch.setattr("holoview.viewer.page.frame_recording._QUICK_SAMPLES", 0)
    page = open_page(browser, export_html(tmp_path / "soon.html", written.first))
    counts = "() => ['quick', 'exact'].map(kind => window.holoview.viewer.times[kind].length)"
    page.evaluate("() => window.holoview.viewer.busy")
    assert page.evaluate(counts) == [1, 1]
    assert 0 < page.evaluate("() => window.holoview.viewer.planeMs") < np.inf
    page.evaluate(_LATE)
    set_state(page, plane_m=9e-3)
    assert page.evaluate(counts) == [2, 2]
    page.evaluate("() => { window.holoview.viewer.planeMs = 100 }")  # on a busy machine it may have been slow
    set_state(page, plane_m=9.3e-3)
    assert page.evaluate(counts) == [2, 3] and page.inner_text("#message") == ""
    _is_equal(page_pixels(page), written.first, written.first.system, 9.3e-3)
    page.evaluate(_LATE)
    set_state(page, plane_m=9.7e-3)
    assert page.evaluate(counts) == [3, 4]
    page.evaluate(_DRAG)
    assert page.evaluate(counts) == [4, 5]
    _is_equal(page_pixels(page), written.first, written.first.system, 11e-3)
    set_state(page, gap_m=2.3e-3)  # of which no light is kept
    assert page.evaluate(counts) == [5, 6]
    assert browser.close_pages() == []


_LATE = "async () => { const { viewer } = window.holoview; await viewer.busy; viewer.planeMs = 1e4 }"
_DRAG = """async () => {
    const { viewer, set } = window.holoview, { full } = viewer.holograms[0], update = full.update
    viewer.planeMs = 100
    let last = null
    full.update = function (...of) { // a change that comes while the exact image of the one before is computed
        full.update = update
        last = set({ plane_m: 11e-3 })
        return update.apply(full, of)
    }
    await set({ plane_m: 10.5e-3 })
    await last
}"""
_QUICK_PIXELS = "async () => [...await window.holoview.viewer.holograms[0].quick.rgba(PAGE.xyz_to_srgb, 0)]"


@pytest.mark.long
@needs_chromium
def test_a_wide_screen_is_shown_display_p3(browser: Browser, written: Written) -> None:
    with browser.another(*WEBGPU, "--force-color-profile=display-p3-d65") as wide:
        page = open_page(wide, written.page)
        assert "shown as Display P3" in page.inner_text("#speed")
        shown = np.array(page.evaluate(_CANVAS), np.uint8).reshape(96, 128, 4)[..., :3]
        assert wide.close_pages() == []
    view = hv.simulate(written.first.system, written.first.drive, planes=[10e-3], backend="torch64")
    linear = np.clip(view.xyz[0] @ COLOUR_SPACES["p3"].from_xyz.T, 0, 1)
    difference = np.abs(shown.astype(int) - np.rint(255 * hv_srgb(linear)).astype(int)).max(axis=-1)
    assert np.mean(difference <= 1) >= 0.999
    assert np.mean(np.abs(shown.astype(int) - view.srgb8[0].astype(int)).max(axis=-1) > 1) > 0.5  # it isn't sRGB


_CANVAS = """() => {
    const picture = window.holoview.viewer.pictures.get("hologram 1").getContext("2d")
    return [...picture.getImageData(0, 0, 128, 96, { colorSpace: "display-p3" }).data]
}"""


@pytest.mark.long
@needs_chromium
def test_the_drawing_shows_and_changes_the_numbers_of_the_state(browser: Browser, written: Written) -> None:
    """A drag of 30 of 300 pixels is a tenth of the range, an arrow a hundredth; and a length is typed."""
    page = open_page(browser, written.page)
    low, high = page.evaluate("() => PAGE.gap_range_m")
    gap, text = page.locator("#bench rect.part[aria-label=Gap]"), page.locator("#bench text[data-key=gap]")
    is_at = lambda gap_m: page.wait_for_function(f"() => Math.abs(window.holoview.state.gap_m - {gap_m}) < 1e-9")  # noqa: E731
    assert text.text_content() == "2 mm"
    drag_right(page, gap, 30)
    is_at(2e-3 + 0.1 * (high - low))
    page.keyboard.press("ArrowLeft")
    is_at(2e-3 + 0.09 * (high - low))
    assert page.evaluate("() => window.holoview.state.plane_m") == pytest.approx(10e-3)  # the key was the gap's
    page.keyboard.press("Enter")
    page.keyboard.type("3 m")
    page.keyboard.press("Escape")  # drops what was typed
    page.keyboard.press("Enter")
    page.keyboard.type("2500")
    set_state(page, exposure=1.0)  # an image that comes while one types
    page.keyboard.type(" um")
    page.keyboard.press("Enter")
    is_at(2.5e-3)
    set_state(page, exposure=0.0)
    assert text.text_content() == "2.5 mm"
    page.wait_for_function("() => location.hash.includes('gap=2.5mm')")
    _is_equal(page_pixels(page), written.first, written.first.system.with_(gap="2.5 mm"), 10e-3)
    set_state(page, plane_m=9.7e-3, lasers=[False] + [True] * 7)
    texts = page.locator("#bench text").all_text_contents()
    assert texts.count("9.7 mm") == 1 and {"5 focal planes", "7 of 8 lasers"} <= set(texts)
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
def test_what_the_drawing_cannot_change_is_said(browser: Browser, written: Written) -> None:
    page = open_page(browser, written.eye_page)
    note, message = page.locator("#part-note"), page.locator("#message")
    first = page.evaluate("() => window.holoview.state")
    page.locator("#bench rect.part[aria-label^='modulator 1']").focus()
    page.keyboard.press("Enter")
    assert note.inner_text().startswith("modulator 1, 64 × 48, ") and "can't be changed on a page" in note.inner_text()
    assert page.locator("#part-row").is_hidden()
    page.locator("#bench rect.part[aria-label=Pupil]").focus()
    page.keyboard.press("Enter")
    refused = {"3": "Pupil: expected a length with its unit", "3 m": "eye.pupil_m: expected metres from"}
    for typed, says in refused.items():
        page.locator("#part-length").fill(typed)
        page.keyboard.press("Enter")
        page.wait_for_function("says => document.getElementById('message').textContent.startsWith(says)", arg=says)
        assert page.locator("#part-length").input_value() == "2 mm"
    assert page.evaluate("() => window.holoview.state") == first
    page.locator("#part-length").press("Escape")
    assert page.evaluate("() => document.activeElement.getAttribute('aria-label')") == "Pupil"
    assert message.inner_text() != "" and browser.close_pages() == []


@pytest.mark.long
@needs_chromium
def test_dragging_measures_a_region_and_pointing_tells_values(browser: Browser, written: Written) -> None:
    page = open_page(browser, written.page)
    box = page.locator("#image").bounding_box()
    scale = min(box["width"] / 128, box["height"] / 96)
    left, top = box["x"] + (box["width"] - 128 * scale) / 2, box["y"] + (box["height"] - 96 * scale) / 2
    at = lambda x, y: (left + (x + 0.5) * scale, top + (y + 0.5) * scale)  # noqa: E731
    page.mouse.move(*at(30, 40))
    page.wait_for_function("() => document.getElementById('sample').textContent.startsWith('x 30, y 40: XYZ')")
    page.mouse.down()
    page.mouse.move(*at(60, 70), steps=3)
    page.mouse.up()
    view = hv.simulate(written.first.system, written.first.drive, planes=[10e-3], backend="torch64")
    codes = np.rint(255 * hv_srgb(written.target.stack[2]))
    target = srgb_decode(codes / 255)
    expected = luminance_contrast(view.xyz[0, ..., 1], (30, 40, 31, 31), target).pattern.contrast.contrast
    page.wait_for_function(f"() => document.getElementById('region').textContent.includes('contrast {expected:.3f}')")
    assert page.is_visible("#histogram") and page.locator("#histogram rect").count() == 32
    assert browser.close_pages() == []


def test_the_page_is_read_as_data(written: Written) -> None:
    read = read_page(written.page)
    assert list(read) == ["one </script><b>", "two"]
    for found, hologram in zip(read.values(), (written.first, written.second), strict=True):
        assert found.system == hologram.system
        assert np.array_equal(found.drive, hologram.drive)


def test_text_of_strangers_is_text(written: Written) -> None:
    text = written.page.read_text(encoding="utf-8")
    assert "<i>plain</i>" not in text and "&lt;i&gt;plain&lt;/i&gt;" in text
    assert text.count("<script") == 1 + 2 + 2 * 2  # the document, two programs, and two of data for each hologram
    policy = re.search(r'Content-Security-Policy" content="([^"]+)"', text)
    assert policy is not None and "default-src 'none'" in policy[1] and "unsafe" not in policy[1]


def _edited(text: str, edit: Any) -> str:
    """The text of a page with its document changed."""
    found = re.search(r'(id="holoview-page">)(.*?)(</script>)', text, re.DOTALL)
    assert found is not None
    page = json.loads(found[2])
    edit(page)
    return text[: found.start(2)] + json.dumps(page).replace("<", "\\u003c") + text[found.end(2) :]


@pytest.mark.long
@needs_chromium
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('id="holoview-frames-0">eN', 'id="holoview-frames-0">!!'),
        ('id="holoview-frames-0">', 'id="holoview-frames-0">AAAA'),
        ('id="holoview-data-0">eN', 'id="holoview-data-0">!!'),
        ('id="holoview-data-0">', 'id="another">'),
        ('"kind":"raw"', '"kind":"codes8"'),
    ],
)
def test_a_damaged_page_shows_pictures_and_says_why(
    browser: Browser, written: Written, tmp_path: Path, old: str, new: str
) -> None:
    damaged, text = tmp_path / "damaged.html", written.page.read_text(encoding="utf-8")
    assert old in text
    damaged.write_text(text.replace(old, new), encoding="utf-8")
    page = browser.open(damaged.as_uri(), 900, 800)
    said = page.evaluate("() => window.holoview.ready.then(() => '', error => error.message)")
    assert said and page.is_visible("#stored")
    assert page.inner_text("#message") != ""
    assert browser.close_pages() == []


@pytest.mark.parametrize(
    "edit",
    [
        lambda page: page.pop("holograms"),
        lambda page: page.update(holograms=[]),
        lambda page: page.update(version="2"),
        lambda page: page["holograms"][0].update(toml="import os"),
        lambda page: page["holograms"][0].update(patterns=[None]),
        lambda page: page["holograms"][0].update(patterns=[99, 99]),
        lambda page: page["holograms"][0]["contents"][0].update(kind="pickle"),
        lambda page: page["holograms"][0]["contents"][0].update(bytes=1 << 40),
        lambda page: page["holograms"][0]["contents"][0].update(offset=-8),
        lambda page: page["holograms"][0]["contents"][0].update(values=1),
    ],
)
def test_a_damaged_page_gets_a_sentence(written: Written, tmp_path: Path, edit: Any) -> None:
    damaged = tmp_path / "damaged.html"
    damaged.write_text(_edited(written.page.read_text(encoding="utf-8"), edit), encoding="utf-8")
    with pytest.raises(hv.UserError):
        read_page(damaged)


@pytest.mark.parametrize(
    "content", [b"", b"<html></html>", b"\xff\xfe", b'<script type="application/json" id="holoview-page">[]</script>']
)
def test_another_file_gets_a_sentence(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "other.html"
    file.write_bytes(content)
    with pytest.raises(hv.UserError):
        read_page(file)


def test_a_page_that_cannot_be_written_leaves_the_old_one(written: Written, tmp_path: Path) -> None:
    file = tmp_path / "page.html"
    file.write_text("old", encoding="utf-8")
    one, small = {"one": written.first}, written.first.system.with_(shape=[24, 32])
    two = one | {"small": hv.Hologram(hv.random_drive(small), small)}
    for holograms, options in ((two, {}), (one, {"region": (0, 0, 500, 5)}), (one, {"plane_m": 1.0}), ({}, {})):
        with pytest.raises(hv.UserError):
            export_html(file, holograms, backend="torch", **options)
    assert file.read_text(encoding="utf-8") == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]


def test_stored_pictures_are_those_of_the_planes(written: Written, tmp_path: Path) -> None:
    text = written.page.read_text(encoding="utf-8")
    page = json.loads(re.search(r'id="holoview-page">(.*?)</script>', text, re.DOTALL)[1])  # type: ignore[index]
    assert page["stored"]["planes_m"] == pytest.approx(written.first.system.planes_m.tolist())
    file = tmp_path / "plane.webp"
    file.write_bytes(base64.b64decode(page["stored"]["pictures"][0].split(",")[1]))
    with Image.open(file) as image:
        assert image.size == (128, 96)


def test_a_page_of_a_field_begins_with_the_exposure_that_render_chooses(tmp_path: Path) -> None:
    """A spot on a dark ground, whose mean luminance is fixed, so that the spot alone is far beyond white."""
    values = np.full((32, 40), 0.02, np.complex64)
    values[14:18, 18:22] = 1
    field = hv.load_field(values, pitch="8 um", wavelengths="532 nm", distance="0.1 mm")
    path = export_html(tmp_path / "spot.html", field, backend="torch")
    stops = fitting_stops(hv.simulate(field, backend="torch").xyz)
    data = re.search(r'id="holoview-page">(.*?)</script>', path.read_text(encoding="utf-8"), re.DOTALL)
    assert data is not None
    assert stops < -2 and json.loads(data[1])["exposure"] == round(stops, 1)


@pytest.mark.long
@needs_chromium
@pytest.mark.parametrize("size", [(390, 844), (718, 700), (1600, 500)])
def test_the_image_fills_its_frame_so_that_a_print_distorts_nothing(
    browser: Browser, written: Written, size: tuple[int, int]
) -> None:
    """A print gives the canvas another size: both have the image's aspect, within the rounding of a pixel."""
    page = open_page(browser, written.eye_page, "", *size)
    rows, columns = page.evaluate("PAGE.shape")
    for media in ("screen", "print"):
        page.emulate_media(media=media)
        box = page.evaluate(
            "(({ width, height }) => [width, height])(document.getElementById('frame').getBoundingClientRect())"
        )
        assert abs(box[0] - box[1] * columns / rows) <= 1, (media, box)


@pytest.mark.long
@needs_chromium
def test_no_dark_line_stands_beside_the_image_whatever_the_width(
    browser: Browser, written: Written, tmp_path: Path
) -> None:
    """A white target on a white page: wherever the frame ends within a pixel, nothing of it is dark."""
    white = replace(written.target, stack=np.ones_like(written.target.stack))
    export_html(tmp_path / "white.html", {"two": written.second}, target=white)
    page = open_page(browser, tmp_path / "white.html", "", 390, 844)
    for width in (390, 391, 393, 412):
        page.set_viewport_size({"width": width, "height": 844})
        set_state(page, view="target")
        for shift in (0, 0.25, 0.5, 0.75):
            page.eval_on_selector("header", f"header => {{ header.style.paddingBottom = '{shift}px' }}")
            box = page.locator("#frame").bounding_box()
            shown = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"))
            rows = slice(int(box["y"]), int(box["y"] + box["height"]) + 2)
            assert shown[rows].min() > 240, (width, shift)


@pytest.mark.long
@needs_chromium
def test_a_drawing_that_is_cut_says_that_it_scrolls_and_is_whole_in_print(browser: Browser, written: Written) -> None:
    page = open_page(browser, written.eye_page, "", 390, 800)
    assert page.locator("#scrolls").is_visible()
    page.emulate_media(media="print")
    assert not page.locator("#scrolls").is_visible()
    right = page.eval_on_selector("#bench svg", "svg => svg.getBoundingClientRect().right")
    assert right <= page.evaluate("() => document.documentElement.clientWidth")
    page.emulate_media(media="screen")
    page.set_viewport_size({"width": 2400, "height": 900})
    page.wait_for_function("() => document.getElementById('scrolls').hidden")
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
def test_without_webgpu_a_page_of_one_hologram_has_no_empty_box_and_says_that_its_drawing_scrolls(
    browser: Browser, written: Written
) -> None:
    with browser.another() as plain:
        page = plain.open(written.eye_page.as_uri(), 390, 800)
        page.evaluate("() => window.holoview.ready.catch(() => {})")
        assert page.locator("#scrolls").is_visible()
        boxes = page.locator("#controls fieldset").all()
        assert all(box.locator("input, button").count() for box in boxes if box.is_visible())
        assert plain.close_pages() == []
