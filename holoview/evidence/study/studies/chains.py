"""Displays beside HoloChrome's: a static mask in place of its second modulator, and an amplitude modulator behind it; a
phase modulator with a coarse amplitude modulator alone; binary amplitudes in many frames; two phase modulators side by
side.

All displays of these studies are optimised by the loop of chains, so that they differ in their elements alone.
"""

from __future__ import annotations

import tempfile
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.evidence.study.charts import bar_chart, bar_panels
from holoview.evidence.study.hologram_study import (
    CONTRADICTS,
    QUICK_SIZE,
    REPRODUCES,
    SHOWN,
    HologramStudy,
    case_jobs,
    gain_claim,
    hologram_metrics,
    job_target,
    mean_by_case,
    mean_number,
    optimise_job,
    paired_gains,
    result_pictures,
    result_table,
    target_picture,
)
from holoview.evidence.study.study import (
    QUICK,
    TARGETS,
    Claim,
    Findings,
    JobResult,
    Results,
    StatusCallback,
    StudyFigure,
    StudyJob,
    StudyScale,
    format_size,
)
from holoview.holograms.optimise.learned_mask import ENOUGH_PICTURES, learn_mask
from holoview.holograms.optimise.parallel import resolve_torch_device
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.targets.picture import Picture, read_picture
from holoview.holograms.targets.target import target_for
from holoview.holograms.view import View, simulate
from holoview.light.colour import to_srgb8
from holoview.light.model import preset
from holoview.light.model.system import System

_LASERS = {3: "simultaneous", 8: "holochrome-8", 16: "holochrome-16"}
_RANGE_M = (9e-3, 11e-3)
_PITCH_M, _STROKE_M, _GAP_M = 8e-6, 825e-9, 2e-3
_COARSE = 8  # pixels of the phase modulators along a side of one of the amplitude modulator
_EYEBOX = 0.03
_CONTRAST_STROKE_M, _CONTRAST_PLANE_M = 665e-9, 6e-3
_CONTRAST_GAIN_DB = 31.0  # arXiv 2410.19347: up to so much over phase alone
_SEED_OF_MASK = 1

ROW, SIDE, COMPLEX = "two in a row", "two side by side", "complex modulator"
ONE, TWO, RANDOM, LEARNED, COARSE = (
    "one modulator",
    "two modulators",
    "random mask",
    "learned mask",
    "two and amplitude",
)


def chain_of(display: str, lasers: int, shape: tuple[int, int], planes: int, mask: Path | None = None) -> System:
    """A display of `lasers` wavelengths; mask: the file of a learned one (values 0…1 of the stroke).

    The patterns of phase modulators are shared by the only frame, which changes nothing but the optimiser: it is the
    one of chains for all displays.
    """
    pixels = {"pitch": _PITCH_M, "shape": list(shape), "stroke": _STROKE_M}
    phase = pixels | {"kind": "phase", "shared": True}
    gap = {"kind": "space", "distance": _GAP_M, "square": "first order of slm"}
    second = {
        TWO: phase | {"name": "second"},
        COARSE: phase | {"name": "second"},
        RANDOM: pixels | {"kind": "mask", "name": "second", "pattern": "random", "seed": _SEED_OF_MASK},
        LEARNED: pixels | {"kind": "mask", "name": "second", "file": str(mask)},
    }
    elements: list[Any] = [phase | {"name": "slm"}]
    if display in second:
        elements += [gap, second[display]]
    if display == COARSE:
        coarse = [-(-n // _COARSE) for n in shape]
        amplitude = {"kind": "amplitude", "name": "coarse", "pitch": _COARSE * _PITCH_M, "shape": coarse}
        elements += [gap, amplitude | {"shared": True}]
    elements.append({"kind": "space", "square": "first order of slm"})
    base, edits = preset.load(_LASERS[lasers]), {"propagation": "periodic"}
    if display == COARSE:
        edits["planes_from"] = "second"  # the picture stays where it is without the amplitude modulator
    planes_m = np.linspace(*_RANGE_M, planes) if planes > 1 else np.array([sum(_RANGE_M) / 2])
    system = System(
        base.wavelengths_m, base.amplitudes, elements=tuple(elements), planes_m=planes_m, observer=base.observer
    )
    return system.edit(edits)


def training_stacks(system: System, count: int, leave_out: str) -> list[NDArray[np.float32]]:
    """Focal stacks of `count` flat pictures that aren't the target `leave_out`.

    They are made of the other pictures that are part of holoview, by mirroring and by cutting out a half.
    """
    others, stacks = [name for name in TARGETS if name != leave_out], []
    for number in range(count):
        way, which = divmod(number, len(others))
        light = read_picture(target_picture(others[which])).rgb
        rows, columns = (n // 2 for n in light.shape[:2])
        cut = light[::-1, ::-1] if way & 1 else light
        if way >= 2:
            row, column = ((way - 2) // 2 % 2) * rows, ((way - 2) // 4 % 2) * columns
            cut = cut[row : row + rows, column : column + columns]
        stacks.append(target_for(system, Picture(np.ascontiguousarray(cut), others[which])).stack)
    return stacks


class ChainStudy(HologramStudy):
    """A study of displays that are chains: their PSNR, eyebox and light."""

    displays: tuple[str, ...]
    lasers: tuple[int, ...]

    @abstractmethod
    def system_of(self, settings: Mapping[str, Any], status: StatusCallback, folder: Path) -> System:
        """The display of a job. folder: for files that it needs until the job ends."""

    @abstractmethod
    def claims(self, results: Results, lasers: int) -> list[Claim]:
        """What is said of the displays of so many lasers."""

    def numbers(self, view: View, target: NDArray[np.floating]) -> dict[str, float]:
        """Further numbers of a job, by name."""
        return {}

    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        with tempfile.TemporaryDirectory() as folder:
            system = self.system_of(settings, status, Path(folder))
            target = job_target(system, settings, system.planes_m)
            state = optimise_job(system, target, settings, status)
            hologram = state.best
            view = simulate(hologram.system, hologram.drive, backend="torch")
            # light: of that of the lasers on the field, which the loop of the short form doesn't tell
            light = view.intensity.mean(axis=(0, 2, 3)).sum() * system.frames / hologram.system.amplitudes.sum()
            numbers = hologram_metrics(hologram, view, target) | self.numbers(view, np.asarray(target))
            numbers |= {"light": float(light), "seconds": state.seconds}
        middle = len(target) // 2
        pictures = {"shown": view.srgb8[middle], "wanted": to_srgb8(np.asarray(target[middle]))}
        return JobResult(numbers, pictures)

    def analyse(self, results: Results) -> Findings:
        counts = sorted({job.settings["lasers"] for job, _ in results})
        cases = [{"lasers": lasers, "display": display} for lasers in counts for display in self.displays]
        labels = [_label(case["lasers"], case["display"]) for case in cases]
        others = mean_by_case(results, ("speckle_contrast", "eyebox_variation"), cases)
        return Findings(
            rows=result_table(results, "lasers", "display"),
            claims=[claim for lasers in counts for claim in self.claims(results, lasers)],
            plots=[
                StudyFigure(
                    "psnr", "PSNR of linear sRGB, mean over targets and seeds", _psnr_chart(results, labels, cases)
                ),
                StudyFigure("others", "Speckle and eyebox; small is good", bar_panels(labels, others)),
                StudyFigure("light", "Share of the lasers' light in the picture", _light_chart(results, labels, cases)),
            ],
            pictures=result_pictures(results),
        )


class _StaticMask(ChainStudy):
    name = "static-mask"
    title = "A static mask in place of HoloChrome's second modulator"
    summary = (
        "The second modulator's gain, and how much of it a static phase mask keeps in its place: a random one, and one "
        "learned from pictures that don't contain the target."
    )
    quick_note = f"{QUICK_SIZE}, 3 and 8 wavelengths, and a mask learned from four pictures."
    kind = "static-mask"
    revision = 2
    displays: tuple[str, ...] = (ONE, TWO, RANDOM, LEARNED)
    lasers: tuple[int, ...] = (3, 8, 16)

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        is_quick = scale.shape[0] <= QUICK.shape[0]
        pictures = {"pictures": 4 if is_quick else ENOUGH_PICTURES}
        cases = {
            _label(lasers, display): {
                "scheme": _label(lasers, display),
                "lasers": lasers,
                "display": display,
                "eyebox": scale.eyebox or _EYEBOX,
                **(pictures if display == LEARNED else {}),
            }
            for lasers in self.lasers
            for display in self.displays
            if not (is_quick and lasers > 8)
        }
        return case_jobs(self, cases, scale, seed)

    def system_of(self, settings: Mapping[str, Any], status: StatusCallback, folder: Path) -> System:
        mask = folder / "mask.npy"
        if settings["display"] == LEARNED:
            two = chain_of(TWO, settings["lasers"], tuple(settings["shape"]), settings["planes"])
            np.save(mask, learned_pattern(two, "second", settings, status))
        return chain_of(settings["display"], settings["lasers"], tuple(settings["shape"]), settings["planes"], mask)

    def claims(self, results: Results, lasers: int) -> list[Claim]:
        """The second modulator's gain, and the share of it that each mask keeps."""
        gains = {
            display: paired_gains(results, _case(lasers, display), _case(lasers, ONE), "psnr_db")
            for display in self.displays
            if display != ONE
        }
        whole = float(gains[TWO].mean())
        out = [Claim(f"{lasers} λ: the second modulator's gain", "", _gain_words(results, lasers, TWO, gains), SHOWN)]
        for display in (RANDOM, LEARNED):
            kept = float(gains[display].mean()) / whole if whole > 0 else float("nan")
            share = f"{kept:.0%} of it" if whole > _LEAST_GAIN_DB else "no share: there is too little to keep"
            words = f"{_gain_words(results, lasers, display, gains)}: {share}"
            out.append(Claim(f"{lasers} λ: a {display} in its place", "", words, SHOWN))
        return out


class _CoarseAmplitude(_StaticMask):
    name = "coarse-amplitude"
    title = "A coarse amplitude modulator behind HoloChrome"
    summary = (
        f"An amplitude modulator of {_COARSE} times coarser pixels, 2 mm behind the second modulator: what it gains, "
        "and the light that it takes away."
    )
    quick_note = f"{QUICK_SIZE}."
    kind = "coarse-amplitude"
    displays = (ONE, TWO, COARSE)
    lasers = (8,)

    def claims(self, results: Results, lasers: int) -> list[Claim]:
        gains = {COARSE: paired_gains(results, _case(lasers, COARSE), _case(lasers, TWO), "psnr_db")}
        light = {display: mean_number(results, "light", **_case(lasers, display)) for display in (TWO, COARSE)}
        words = f"{_gain_words(results, lasers, COARSE, gains)}; light {light[TWO]:.0%} → {light[COARSE]:.0%}"
        return [Claim(f"{lasers} λ: an amplitude modulator behind the second modulator", "", words, SHOWN)]


class _FlatStudy(ChainStudy):
    """Displays of three lasers that shine in turn, and a flat picture of much black."""

    quick_note = f"{format_size(QUICK.shape, 1)[0]}, {QUICK.iterations} iterations; night, flat."
    lasers = (3,)

    def describe_size(self, scale: StudyScale) -> str:
        return _flat(scale).description

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        return case_jobs(self, flat_cases(self.displays, scale.eyebox or _EYEBOX), _flat(scale), seed)


class _HighContrast(_FlatStudy):
    name = "high-contrast"
    title = "High contrast by a coarse amplitude modulator"
    summary = (
        f"A phase modulator alone, and with an amplitude modulator of {_COARSE} times coarser pixels 2 mm behind it, "
        "without stops and with those of the first order."
    )
    kind = "high-contrast"
    revision = 1
    displays = tuple(
        f"{display}, {stop}" for stop in ("no stop", "first order") for display in ("phase", "and amplitude")
    )

    def system_of(self, settings: Mapping[str, Any], status: StatusCallback, folder: Path) -> System:
        display, shape = settings["display"], tuple(settings["shape"])
        pixels = {"kind": "phase", "name": "phase", "pitch": _PITCH_M, "shape": shape, "stroke": _CONTRAST_STROKE_M}
        elements: list[Any] = [pixels]
        if display.startswith("and amplitude"):
            coarse = {"pitch": _COARSE * _PITCH_M, "shape": [-(-n // _COARSE) for n in shape]}
            elements += [{"kind": "space", "distance": _GAP_M}, {"kind": "amplitude", "name": "coarse", **coarse}]
        elements.append({"kind": "space", **({"square": "first order of phase"} if "first" in display else {})})
        base = preset.load("high-contrast")
        changes = {"elements": elements, "planes_from": "phase", "planes": [_CONTRAST_PLANE_M]}
        return base.edit(changes | {"propagation": "periodic"})

    def claims(self, results: Results, lasers: int) -> list[Claim]:
        reason = "a night scene at two samples a pixel; at one, without higher orders, and on black the gain is larger"
        return [
            gain_claim(
                results,
                f"a coarse amplitude modulator behind the phase modulator, {stop}",
                _CONTRAST_GAIN_DB,
                {"display": f"and amplitude, {stop}"},
                {"display": f"phase, {stop}"},
                reason=reason,
            )
            for stop in ("no stop", "first order")
        ] + [light_claim(results, lasers, self.displays)]


class _BinaryAmplitude(_FlatStudy):
    name = "binary-amplitude"
    title = "Binary amplitudes in many frames"
    summary = (
        "A display of amplitudes, continuous and binary, in one frame and in eight of each colour, through one half of "
        "the first order."
    )
    kind = "binary-amplitude"
    revision = 1
    displays = ("amplitude, 3 frames", "binary, 3 frames", "binary, 24 frames")

    def system_of(self, settings: Mapping[str, Any], status: StatusCallback, folder: Path) -> System:
        display, base = settings["display"], preset.load("binary-amplitude")
        levels = 2 if display.startswith("binary") else None
        frames = int(display.split(", ")[1].removesuffix(" frames"))
        amplitude, *behind = base.elements
        elements = (replace(amplitude, shape=tuple(settings["shape"]), levels=levels), *behind)  # type: ignore[call-arg]
        return base.edit({"elements": elements, "amplitudes": base.amplitudes[:frames], "propagation": "periodic"})

    def claims(self, results: Results, lasers: int) -> list[Claim]:
        continuous, single, many = ({"display": display} for display in self.displays)
        return [
            gain_claim(results, "one binary frame of each colour beside one of amplitudes", None, single, continuous),
            gain_claim(results, "eight binary frames of each colour beside one", None, many, single),
            gain_claim(results, "eight binary frames of each colour beside one of amplitudes", None, many, continuous),
            light_claim(results, lasers, self.displays),
        ]


class _Michelson(_FlatStudy):
    name = "michelson-complex"
    title = "Two phase modulators side by side"
    summary = (
        "A phase modulator alone, two in a row 2 mm apart, two side by side whose light a beam splitter adds, and one "
        "complex modulator."
    )
    kind = "michelson-complex"
    revision = 1
    displays = (ONE, ROW, SIDE, COMPLEX)

    def system_of(self, settings: Mapping[str, Any], status: StatusCallback, folder: Path) -> System:
        pixels = {"pitch": _PITCH_M, "shape": tuple(settings["shape"])}
        first = pixels | {"kind": "phase", "name": "first", "stroke": _CONTRAST_STROKE_M}
        second = first | {"name": "second"}
        stop = {"kind": "space", "square": "first order of first"}
        before: dict[str, list[Any]] = {
            ONE: [first],
            ROW: [first, stop | {"distance": _GAP_M}, second],
            SIDE: [first, second | {"beside": "first"}],
            COMPLEX: [pixels | {"kind": "complex", "name": "first"}],
        }
        elements = [*before[settings["display"]], stop]
        changes = {"elements": elements, "planes": [_CONTRAST_PLANE_M], "propagation": "periodic"}
        return preset.load("high-contrast").edit(changes)

    def claims(self, results: Results, lasers: int) -> list[Claim]:
        one, row, side, whole = ({"display": display} for display in self.displays)
        beside = gain_claim(results, "two side by side beside a complex modulator", None, side, whole)
        is_equal = abs(float(paired_gains(results, side, whole, "psnr_db").mean())) <= _EQUAL_DB
        beside = replace(beside, published="any complex field", verdict=REPRODUCES if is_equal else CONTRADICTS)
        if not is_equal:
            beside = replace(beside, reason="they show the same fields; so many iterations don't find them")
        return [
            gain_claim(results, "two side by side beside one", None, side, one),
            gain_claim(results, "two in a row beside one", None, row, one),
            beside,
            light_claim(results, lasers, self.displays),
        ]


_EQUAL_DB = 0.5  # within which displays are equal, as of other studies


def flat_cases(displays: Iterable[str], eyebox: float) -> dict[str, dict[str, Any]]:
    """A case of each display, of three lasers and a picture without depth."""
    shared = {"lasers": 3, "depth": False, "eyebox": eyebox}
    return {display: {"scheme": display, "display": display, **shared} for display in displays}


def _flat(scale: StudyScale) -> StudyScale:
    """The scale with one dark picture in one plane."""
    return replace(scale, targets=("night",), planes=1)


def light_claim(results: Results, lasers: int, displays: Sequence[str]) -> Claim:
    """The light that each display leaves in the picture."""
    light = {display: mean_number(results, "light", **_case(lasers, display)) for display in displays}
    return Claim("light in the picture", "", "; ".join(f"{name} {share:.1%}" for name, share in light.items()), SHOWN)


_LEAST_GAIN_DB = 0.2
"""A second modulator's gain below which its parts are lost in the scatter of seeds."""


def learned_pattern(
    system: System, name: str, settings: Mapping[str, Any], status: StatusCallback
) -> NDArray[np.float32]:
    """The mask in place of an element of this name, learned from pictures without the target."""
    stacks = training_stacks(system, settings["pictures"], settings["target"])
    options = Settings(iterations=settings["iterations"], seed=settings["seed"], eyebox=settings["eyebox"])
    for state in learn_mask(system, stacks, options, name, device=resolve_torch_device()):
        status(f"mask {state.iteration}/{state.iterations}, {state.psnr_db.mean():.1f} dB")
    return state.mask


def _label(lasers: int, display: str) -> str:
    return f"{lasers} λ, {display}"


def _case(lasers: int, display: str) -> dict[str, Any]:
    return {"lasers": lasers, "display": display}


def _gain_words(results: Results, lasers: int, display: str, gains: Mapping[str, NDArray[np.float64]]) -> str:
    values = gains[display]
    spread = f" (spread {np.ptp(values):.2f})" if len(values) > 1 else ""
    eyebox = mean_number(results, "eyebox_variation", **_case(lasers, display))
    return f"{values.mean():+.2f} dB{spread}, eyebox variation {eyebox:.2f}"


def _psnr_chart(results: Results, labels: list[str], cases: list[dict[str, Any]]) -> Any:
    return bar_chart(labels, mean_by_case(results, ("psnr_db",), cases), "PSNR (dB)")


def _light_chart(results: Results, labels: list[str], cases: list[dict[str, Any]]) -> Any:
    light = {"light in the picture": [mean_number(results, "light", **case) for case in cases]}
    return bar_chart(labels, light, "share of the lasers' light")


STUDIES = (_StaticMask(), _CoarseAmplitude(), _HighContrast(), _BinaryAmplitude(), _Michelson())
