"""A report on holograms for a reviewer: one page for the screen that prints to two sheets of A4, and the same as JSON.

Pictures, all numbers with their standard errors and methods, claims with verdicts, instrument, observer, bench, seeds,
versions and the command that makes it again. The page loads nothing; with a live hologram it holds that page too.
"""

from __future__ import annotations

import base64
import hashlib
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from holoview.bench.captures.speckle_meter import NO_METER, MeasuredHologram, Meter, measure_hologram
from holoview.evidence.study.charts import correlation_figure, data_uri, scatter_figure, speckle_figure
from holoview.evidence.study.claims import NEEDS, OF_SPECKLE, QUANTITIES, JudgedClaim, NumberClaim, judge_claim
from holoview.evidence.study.display_contrast import DisplayContrast
from holoview.evidence.study.hologram_sheets import print_style
from holoview.evidence.study.report import version_summary
from holoview.holograms.hologram import Hologram
from holoview.holograms.metrics.colour_speckle import WHITE_CD_M2, ColourSpeckle
from holoview.holograms.metrics.fidelity import psnr_linear_srgb
from holoview.holograms.metrics.image_quality import EyeboxUniformity, eyebox_uniformity_of
from holoview.holograms.metrics.sharpness import BlackBesideWhite, Mtf, black_beside_white, target_mtf
from holoview.holograms.metrics.speckle import target_luminance
from holoview.holograms.metrics.speckle_measurement import STRUCTURE_COUNTS, SpeckleMeasurement, visibility
from holoview.holograms.targets.target_source import TargetSource
from holoview.holograms.view import View
from holoview.light.colour import fitting_stops, to_srgb8
from holoview.light.engine.light_budget import place_words, told_light
from holoview.light.model.derived_numbers import info_rows
from holoview.light.model.focus import plane_label
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.light.numerics.sampling import Region
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.figures import figure_bytes, new_figure

FORMAT, VERSION = "holoview-report", 1

_WIDEST_PX = 900
_BENCH_HEADINGS = ("bench", "eye", "effects")
_FURTHER_ROWS = ("étendue", "square stop of relay 1", "square stop of relay 2", "iris of relay 1", "iris of relay 2")
_CHART_DPI = 170
_LEAST_TOLD = 5e-4  # of the light
_METHODS = (
    "± is one standard error. Contrast in the manner of IEC 62906-5-2:2016, colour speckle in that of "
    "IEC 62906-5-4:2018, which are written for laser projection. "
    "Errors of N_eff and of ratios of light are from the scatter between 8 × 8 blocks, those of the MTF from the "
    "speckle beside the target, or groups of rows of an edge. PSNR, the eyebox and shares of light are computed of the "
    "hologram as a whole, not of a sample, and have no standard error. "
    "A claim within two standard errors of its limit is undecided."
)
_THRESHOLDS = (
    "Thresholds: still, Roelandt et al., Opt. Express 22, 23965 (2014), 40 observers; "
    "moving, Verschaffelt et al., Sci. Rep. 5, 14105 (2015), 186 observers."
)


@dataclass(frozen=True, eq=False)
class ReviewedHologram:
    """What is reported of a hologram.

    name, digest: of its file. system: its bench, without the instrument. measured: of a region, by the instrument.
    plane: in words. picture: (y, x, 3) 8-bit sRGB of what an observer sees without the instrument, brightened by
    `stops`; wanted: of its target. psnr_db: of the same; black: beside white; mtf: of the region, against the
    target, or why it isn't known, "" without a target; edge: of an edge at each plane, for programs. display:
    contrast ratios of its bench. eyebox: of the bench; None of a field. light, behind: as of `told_light`.
    """

    name: str
    digest: str
    system: System
    measured: MeasuredHologram
    plane: str
    picture: NDArray[np.uint8]
    stops: float
    wanted: NDArray[np.uint8] | None
    psnr_db: float | None
    black: BlackBesideWhite | None
    eyebox: EyeboxUniformity | None
    light: Mapping[str, float]
    region: Region
    mtf: Mtf | str = ""
    edge: Sequence[dict[str, Any]] = ()
    display: DisplayContrast | None = None
    behind: Mapping[str, float] = field(default_factory=dict)

    @property
    def values(self) -> dict[str, tuple[float, float | None]]:
        """The values of `QUANTITIES` that were measured, with their standard errors where they are known."""
        found = self.measured.found
        values: dict[str, tuple[float, float | None]] = {}
        if not found.withheld:
            values["C"] = (found.luminance.contrast, found.luminance.standard_error)
        values |= {f"C_{name}": (of.contrast, of.standard_error) for name, of in found.groups.items()}
        if found.lasers:
            values["N_eff"] = (found.patterns_of_correlation, found.pattern_errors[1])
        if found.colour is not None:
            values["colour_area"] = (found.colour.area, found.colour.area_error)
        if self.psnr_db is not None:
            values["PSNR"] = (self.psnr_db, None)
        if self.black is not None:
            values["CR"] = (self.black.ratio, self.black.standard_error)
        if self.display is not None:
            values["CR_sequential"] = (self.display.sequential.value, self.display.sequential.standard_error)
            values["CR_checkerboard"] = (self.display.checkerboard.value, self.display.checkerboard.standard_error)
        if isinstance(self.mtf, Mtf) and np.isfinite(self.mtf.half):
            values["MTF50"] = (self.mtf.half, self.mtf.half_error if np.isfinite(self.mtf.half_error) else None)
        if self.eyebox is not None:
            values["uniformity"] = (self.eyebox.uniformity, None)
        if self.light:
            values["picture_light"] = (self.light["picture"], None)
        return values

    @property
    def is_raw(self) -> bool:
        """Whether the structure of a picture counts in the speckle: it came from a file, and no target divides it."""
        return bool(self.digest) and not self.measured.found.has_target

    def judge(self, claims: Sequence[NumberClaim]) -> list[JudgedClaim]:
        """The claims beside these values."""
        is_rough = self.measured.found.luminance.has_few_grains
        return [judge_claim(claim, self.values, self.is_raw, is_rough) for claim in claims]

    def as_json(self, claims: Sequence[NumberClaim]) -> dict[str, Any]:
        """For programs."""
        found = self.measured.found
        eyebox = None
        if self.eyebox is not None:
            eyebox = {"uniformity": self.eyebox.uniformity, "variation": self.eyebox.coefficient_of_variation}
        return {
            "name": self.name,
            "sha256": self.digest,
            "plane": self.plane,
            "region": list(self.region),
            "mean_luminance": found.mean,
            "pixels": found.pixels,
            **found.as_json(),
            "meter": self.measured.reading.as_json(),
            "notes": [*_withheld_notes(found), *found.notes],
            "psnr_db": self.psnr_db,
            "black_beside_white": None if self.black is None else self.black.as_json(),
            "sequential_contrast": None if self.display is None else self.display.sequential.value,
            "sequential_standard_error": None if self.display is None else self.display.sequential.standard_error,
            "checkerboard_contrast": None if self.display is None else self.display.checkerboard.value,
            "checkerboard_standard_error": None if self.display is None else self.display.checkerboard.standard_error,
            "mtf": self.mtf.as_json(self.measured.view.degrees_per_sample) if isinstance(self.mtf, Mtf) else None,
            "no_mtf": "" if isinstance(self.mtf, Mtf) else self.mtf,
            "mtf_of_edge": list(self.edge),
            "observer": self.system.observer,
            "eyebox": eyebox,
            "light_budget": dict(self.light) or None,
            **({"light_behind_elements": dict(self.behind)} if self.behind else {}),
            "claims": [
                {"claim": of.claim.text, "value": of.value, "standard_error": of.error, "verdict": of.verdict}
                for of in self.judge(claims)
            ],
        }


def review_hologram(
    name: str,
    digest: str,
    hologram: Hologram,
    plane_m: float,
    region: Region,
    target: TargetSource | None = None,
    meter: Meter = NO_METER,
    edge: Sequence[dict[str, Any]] = (),
    display: DisplayContrast | None = None,
) -> ReviewedHologram:
    """Measures a hologram for a report. Arguments and errors as of `measure_hologram`.

    name, digest: of its file. edge, display: as of `ReviewedHologram`.
    """
    measured = measure_hologram(hologram, plane_m, region, target, meter)
    plain = measured if not meter.name else measure_hologram(hologram, plane_m, region, target)
    system, view = hologram.system, plain.view
    stops = round(fitting_stops(view.xyz), 1) if system.is_field else 0.0
    wanted, psnr_db, black = None, None, None
    if plain.target is not None:
        wanted = to_srgb8(plain.target)
        psnr_db = float(psnr_linear_srgb(view.rgb[0], plain.target).mean_db)
        known = target_luminance(plain.target)
        black = None if known is None else black_beside_white(view.xyz[0, ..., 1], known)
    behind, light = told_light(make_plan(system, [plane_m]), hologram.drive)
    return ReviewedHologram(
        name=name,
        digest=digest,
        system=system,
        measured=measured,
        plane=plane_label(system, plane_m),
        picture=view.exposed(stops).srgb8[0],
        stops=stops,
        wanted=wanted,
        psnr_db=psnr_db,
        black=black,
        eyebox=None if system.is_field else eyebox_uniformity_of(hologram),
        light=light,
        behind=behind,
        region=region,
        mtf=_mtf_of(measured, region, is_whole=meter.camera is not None),
        edge=edge,
        display=display,
    )


def _mtf_of(measured: MeasuredHologram, region: Region, *, is_whole: bool) -> Mtf | str:
    """The MTF of a region of the view against the target, or why there is none; "" without a target that is shown."""
    if measured.target is None or measured.found.withheld or is_whole:  # a camera's pixels aren't the view's samples
        return ""
    known = target_luminance(measured.target)
    try:
        return "" if known is None else target_mtf(measured.view.xyz[0, ..., 1], known, region)
    except UserError as error:
        return error.found


# --- the page ---------------------------------------------------------------------------------------------------------


def report_html(
    reviewed: Sequence[ReviewedHologram],
    claims: Sequence[NumberClaim],
    *,
    title: str,
    command: str,
    seeds: Mapping[str, int],
    live: str = "",
) -> str:
    """The page of a report.

    command: that makes it again. seeds: of everything that is drawn, in words. live: a page with the holograms to
    embed.
    """
    folder = files(__package__)
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)
    environment.filters["symbols"] = units.with_symbols
    template = environment.from_string(folder.joinpath("hologram_report.html").read_text(encoding="utf-8"))
    charts = [chart for one in reviewed for chart in _charts(one, len(reviewed) == 1)]
    context = {
        "title": title,
        "holograms": [_hologram_context(one) for one in reviewed],
        "names": [one.name.removesuffix(".safetensors") for one in reviewed],
        "charts": charts,
        "fills_charts": len(reviewed) == 1 and len(charts) % 2 == 1,
        "notes": _by_name(reviewed, _notes),
        "rows": _number_rows(reviewed),
        "claims": _claim_rows(reviewed, claims),
        "lasers": _by_hologram(reviewed, _laser_table),
        "light": _by_hologram(reviewed, _light_table),
        "visibility": _by_hologram(reviewed, _visibility_table),
        "bench": _bench_rows(reviewed),
        "command": command,
        "texts": {
            "methods": _METHODS,
            "thresholds": _THRESHOLDS,
            "instrument": " ".join(_by_name(reviewed, _instrument)),
            "foot": f"{version_summary()}. Seeds: {', '.join(f'{what} {seed}' for what, seed in seeds.items())}. "
            "The same numbers for programs are in the JSON file beside this page.",
        },
    }
    style = folder.joinpath("hologram_report.css").read_text(encoding="utf-8") + print_style(context)
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode("ascii")
    policy = f"default-src 'none'; style-src 'sha256-{digest}'; img-src data:; base-uri 'none'; form-action 'none'"
    own = "" if live else policy  # a live page brings its own
    return template.render(context, policy=own, style=Markup(style), live=live)


def report_json(
    reviewed: Sequence[ReviewedHologram],
    claims: Sequence[NumberClaim],
    *,
    title: str,
    command: str,
    seeds: Mapping[str, int],
) -> dict[str, Any]:
    """The report for programs."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "title": title,
        "holograms": [one.as_json(claims) for one in reviewed],
        "bench": {row["name"]: row["text"] for row in _bench_rows(reviewed)},
        "seeds": dict(seeds),
        "command": command,
        "versions": version_summary(),
    }


def _hologram_context(one: ReviewedHologram) -> dict[str, Any]:
    """What the template shows of a hologram by itself."""
    digest = f", SHA-256 {one.digest[:16]}…" if one.digest else ""
    stops = f"; shown {one.stops:+.1f} stops brighter" if one.stops else ""
    region = "{2} × {3} samples at ({0}, {1})".format(*one.region)
    return {
        "name": one.name,
        "heading": f"{one.name}{digest}, at {one.plane}; measured region {region}{stops}",
        "caption": f"{one.name}, as an observer sees it; the frame is the measured region",
        "picture": _picture_uri(one.picture, one.region),
        "aspect": one.picture.shape[0] / one.picture.shape[1],
        "wanted": "" if one.wanted is None else _picture_uri(one.wanted, one.region),
    }


def _charts(one: ReviewedHologram, is_alone: bool) -> list[dict[str, Any]]:
    """The charts of a hologram, named where there are several."""
    found = one.measured.found
    charts = [("Region, and its histogram beside the laws of speckle", speckle_figure(found.pattern), (6.0, 2.7))]
    if found.colour is not None:
        charts.append(("Colours of the region, with the 95 % ellipses", scatter_figure(found), (6.0, 2.7)))
    if is_alone and len(found.lasers) > 1:
        draw = correlation_figure([laser.name for laser in found.lasers], found.correlation)
        charts.append(("Correlation between the lasers' patterns", draw, (3.4, 2.7)))
    name = "" if is_alone else f"{one.name}: "
    return [
        {"caption": name + caption, "uri": _chart_uri(draw, size), "aspect": size[1] / size[0]}
        for caption, draw, size in charts
    ]


def _by_name(reviewed: Sequence[ReviewedHologram], say: Callable[[ReviewedHologram], Sequence[str]]) -> list[str]:
    """Sentences on each hologram; those that hold for some of several begin with their names."""
    sentences = dict[str, list[str]]()
    for one in reviewed:
        for sentence in say(one):
            sentences.setdefault(sentence, []).append(one.name)
    return [
        sentence if len(names) == len(reviewed) else f"{', '.join(names)}: {sentence}"
        for sentence, names in sentences.items()
    ]


def _notes(one: ReviewedHologram) -> list[str]:
    found = one.measured.found
    raw = [STRUCTURE_COUNTS] if one.is_raw and not found.withheld else []
    return [*raw, *_withheld_notes(found), *one.measured.reading.notes, *found.notes]


def _instrument(one: ReviewedHologram) -> list[str]:
    return [f"{one.measured.reading.words}. Observer: {_observer(one.system)}."]


def _withheld_notes(found: SpeckleMeasurement) -> list[str]:
    return [f"the speckle contrast is withheld: {found.withheld}"] if found.withheld else []


def _by_hologram(
    reviewed: Sequence[ReviewedHologram], rows_of: Callable[[ReviewedHologram], dict[str, str]]
) -> list[_Row]:
    """Rows that each hologram has by name, side by side; a dash where one lacks it."""
    tables = [rows_of(one) for one in reviewed]
    names = dict.fromkeys(name for table in tables for name in table)
    return [(name, [table.get(name, "–") for table in tables], "") for name in names]


def _laser_table(one: ReviewedHologram) -> dict[str, str]:
    return {
        of.name: f"{_percent(of.luminance_share)}; {_value(of.estimate.contrast, of.estimate.standard_error)}"
        for of in one.measured.found.lasers
    }


def _light_table(one: ReviewedHologram) -> dict[str, str]:
    words = {place: place_words(place, is_chain=one.system.is_chain) for place in one.light}
    return {words[place]: _percent(share) for place, share in one.light.items() if share > _LEAST_TOLD}


def _visibility_table(one: ReviewedHologram) -> dict[str, str]:
    return {
        f"{of.what}: {_percent(of.threshold)}": f"{_percent(of.contrast)}, {of.verdict}"
        for of in visibility(one.measured.found)
    }


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def _observer(system: System) -> str:
    words = {"eye": "2° cone fundamentals (CIE 170-1:2006)", "cie1931": "CIE 1931, 2°", "mono": "a flat response"}
    return words.get(system.observer, system.observer)


def _chart_uri(draw: Any, size_in: tuple[float, float]) -> str:
    figure = new_figure(size_in)
    draw(figure)
    return data_uri(figure_bytes(figure, dpi=_CHART_DPI))


def _picture_uri(pixels: NDArray[np.uint8], region: Region) -> str:
    """A picture (y, x, 3) with the edge of a region, as a WebP in a data URI."""
    image = Image.fromarray(np.ascontiguousarray(pixels))
    scale = max(1, round(_WIDEST_PX / image.width))
    if scale > 1:
        image = image.resize((image.width * scale, image.height * scale), Image.Resampling.NEAREST)
    x, y, width, height = (scale * n for n in region)
    draw = ImageDraw.Draw(image)
    for grow, shade in ((0, "white"), (1, "black")):
        draw.rectangle((x - grow, y - grow, x + width - 1 + grow, y + height - 1 + grow), outline=shade)
    if image.width > 2 * _WIDEST_PX:
        image = image.resize((_WIDEST_PX, round(image.height * _WIDEST_PX / image.width)), Image.Resampling.BOX)
    out = io.BytesIO()
    image.save(out, "WEBP", quality=90)
    return f"data:image/webp;base64,{base64.b64encode(out.getvalue()).decode('ascii')}"


def _plain(value: float, digits: int = 3) -> str:
    """A number to so many digits, without a power of ten where it is neither large nor small."""
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if 1000 <= abs(value) < 1e6 else text


def _value(value: float, error: float | None = None, digits: int = 3) -> str:
    """A number with its standard error in words, to the error's second digit."""
    if error is None or error <= 0:
        return _plain(value, digits)
    places = max(0, min(6, 1 - int(np.floor(np.log10(error)))))
    return f"{value:.{places}f} ± {error:.{places}f}"


_Row = tuple[str, list[str], str]


def _number_rows(reviewed: Sequence[ReviewedHologram]) -> list[_Row]:
    """The table of numbers: a quantity, its value of each hologram, and its method."""
    found = [one.measured.found for one in reviewed]
    method = "σ/μ of luminance ÷ target" if any(of.has_target for of in found) else "σ/μ of luminance, raw: no target"
    rows: list[_Row] = [
        (
            "Speckle contrast C",
            ["withheld" if of.withheld else _value(of.luminance.contrast, of.luminance.standard_error) for of in found],
            f"{method}; error from the independent grains",
        ),
        (
            "independent grains",
            [f"{of.luminance.grains.count:.0f}" for of in found],
            "area ÷ Σρ², ρ the autocorrelation",
        ),
    ]
    if any(of.has_target or of.withheld for of in found):
        rows.append(("C with the picture's structure", [f"{of.raw_contrast:.3f}" for of in found], "σ/μ, raw"))
    for name in ("blue", "green", "red"):
        groups = [of.groups.get(name) for of in found]
        if any(groups):
            words = ["–" if of is None else _value(of.contrast, of.standard_error) for of in groups]
            rows.append((f"C of {name}", words, "luminance of its lasers"))
    if any(of.lasers for of in found):
        rows += _laser_rows(found)
    rows += _picture_rows(reviewed)
    return rows


def _laser_rows(found: Sequence[SpeckleMeasurement]) -> list[_Row]:
    def words(say: Callable[[SpeckleMeasurement], str]) -> list[str]:
        return [say(of) if of.lasers else "–" for of in found]

    def colours(say: Callable[[ColourSpeckle], str], name: str = "colour") -> list[str]:
        return ["–" if (colour := getattr(of, name)) is None else say(colour) for of in found]

    rows: list[_Row] = [
        (
            "N_eff from powers, from correlation",
            words(
                lambda of: (
                    f"{_value(of.patterns_of_powers, of.pattern_errors[0])}, "
                    f"{_value(of.patterns_of_correlation, of.pattern_errors[1])}"
                )
            ),
            "(ΣP)²/ΣP²; with the correlations between lasers",
        ),
        (
            "1/√N, 1/√N_eff",
            words(lambda of: f"{len(of.lasers) ** -0.5:.3f}, {of.patterns_of_powers**-0.5:.3f}"),
            "of independent lasers: equal, and of these powers",
        ),
        (
            "(a) one by one, (b) together",
            words(lambda of: f"{of.one_by_one:.3f}, {of.luminance.contrast:.3f}"),
            "both ways of IEC 62906-5-4; (a) takes the lasers as independent",
        ),
    ]
    if any(of.colour is not None for of in found):
        rows += [
            ("mean u′, v′", colours(lambda of: f"{of.mean_uv[0]:.4f}, {of.mean_uv[1]:.4f}"), "CIE 1976"),
            (
                "95 % ellipse in u′v′",
                colours(lambda of: _area(of.area, of.area_error)),
                "5.991 π √det of the covariance (b)",
            ),
            (
                "the same by (a)",
                colours(lambda of: _area(of.area, None), "independent_colour"),
                "gamma laws of the lasers' contrasts, drawn",
            ),
            (
                "scatter in Jzazbz",
                colours(lambda of: f"{of.jzazbz_scatter:.4f}"),
                f"r.m.s., white {WHITE_CD_M2:g} cd/m²",
            ),
        ]
    return rows


def _area(area: float, error: float | None) -> str:
    scaled = (1e4 * area, None if error is None else 1e4 * error)
    return f"({_value(*scaled)})·10⁻⁴" if error else f"{_value(*scaled)}·10⁻⁴"


def _picture_rows(reviewed: Sequence[ReviewedHologram]) -> list[_Row]:
    rows: list[_Row] = []
    if any(one.psnr_db is not None for one in reviewed):
        words = ["–" if one.psnr_db is None else f"{one.psnr_db:.2f} dB" for one in reviewed]
        rows.append(("PSNR to the target", words, "linear sRGB, whole picture, fixed brightness"))
    if any(one.black is not None for one in reviewed):
        words = [
            "–" if one.black is None else _ratio_words(one.black.ratio, one.black.standard_error) for one in reviewed
        ]
        rows.append(("white over black beside it", words, "target above 50 %, below 1 % of its maximum"))
    if any(one.display is not None for one in reviewed):
        words = [
            "–"
            if one.display is None
            else ", ".join(
                _ratio_words(of.value, of.standard_error) for of in (one.display.sequential, one.display.checkerboard)
            )
            for one in reviewed
        ]
        rows.append(
            ("sequential, checkerboard contrast", words, "pictures optimised for the bench in its middle plane")
        )
    if any(one.mtf for one in reviewed):
        words = [_mtf_words(one.mtf, one.measured.view) if one.mtf else "–" for one in reviewed]
        rows.append(("MTF falls to a half at", words, "region against the target, all directions"))
    for number in range(max(len(one.edge) for one in reviewed)):
        words = [_edge_words(one.edge[number]) if number < len(one.edge) else "–" for one in reviewed]
        rows.append((f"MTF of the edge, {reviewed[0].edge[number]['plane']}", words, "slanted edge, ISO 12233"))
    if any(one.eyebox is not None for one in reviewed):
        words = [
            "–" if one.eyebox is None else f"{one.eyebox.uniformity:.3f}, {one.eyebox.coefficient_of_variation:.2f}"
            for one in reviewed
        ]
        rows.append(("eyebox: uniformity, variation", words, "darkest block over mean; deviation over mean"))
    return rows


def _ratio_words(ratio: float, error: float | None) -> str:
    return f"{_value(ratio, error)} : 1"


def _mtf_words(mtf: Mtf | str, view: View) -> str:
    if isinstance(mtf, str):
        return mtf
    if not np.isfinite(mtf.half):
        return f"above a half to {mtf.cycles[-1]:.3g} cycles a sample"
    return _edge_words(mtf.as_json(view.degrees_per_sample))


def _edge_words(row: Mapping[str, Any]) -> str:
    if "no_edge" in row:
        return str(row["no_edge"])
    half, by_degree = row["half_cycles_a_sample"], row["half_cycles_a_degree"]
    if half is None:
        return "not below a half"
    return f"{_value(half, row['half_standard_error'])} cycles a sample" + (
        "" if by_degree is None else f", {by_degree:.3g} a degree"
    )


def _claim_rows(reviewed: Sequence[ReviewedHologram], claims: Sequence[NumberClaim]) -> list[dict[str, Any]]:
    """Each claim with its verdict on each hologram."""
    judged = [one.judge(claims) for one in reviewed]
    return [
        {
            "text": claim.text,
            "quantity": QUANTITIES[claim.quantity],
            "verdicts": [_verdict(of[place], one) for of, one in zip(judged, reviewed, strict=True)],
        }
        for place, claim in enumerate(claims)
    ]


def _verdict(judged: JudgedClaim, one: ReviewedHologram) -> dict[str, str]:
    """A verdict in words, with its value, which is named raw where the structure of a picture counts in it."""
    is_of_speckle, found = judged.claim.quantity in OF_SPECKLE, one.measured.found
    kinds = {"holds": "good", "doesn't hold": "bad"}
    value = NEEDS.get(judged.claim.quantity, "") if judged.value is None else _value(judged.value, judged.error)
    if is_of_speckle and judged.value is None and found.withheld:
        value = "the contrast is withheld"
    elif is_of_speckle and judged.value is not None and found.luminance.has_few_grains:
        value += ", from too few grains"
    elif is_of_speckle and judged.value is not None and one.is_raw:
        value += ", raw" if judged.verdict == "holds" else ", raw: needs a target"
    return {"value": value, "verdict": judged.verdict, "kind": kinds.get(judged.verdict, "open")}


def _bench_rows(reviewed: Sequence[ReviewedHologram]) -> list[dict[str, str]]:
    """The benches in a few rows, each with the names of the holograms where their benches differ."""
    texts = dict[str, dict[str, list[str]]]()
    for one in reviewed:
        for row in info_rows(one.system):
            if row.heading in _BENCH_HEADINGS or row.name in _FURTHER_ROWS:
                texts.setdefault(row.name, {}).setdefault(row.text, []).append(one.name)
    return [
        {
            "name": name,
            "text": "; ".join(t if len(of) == len(reviewed) else f"{', '.join(of)}: {t}" for t, of in by.items()),
        }
        for name, by in texts.items()
    ]
