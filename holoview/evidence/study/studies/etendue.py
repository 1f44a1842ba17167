"""Displays of more étendue than their modulator has: a static mask of finer pixels; an amplitude modulator in the
Fourier plane of several coherent sources.

The eyebox is the first order of the finest pixels, for all displays of a study, and is evened out alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.evidence.study.hologram_study import (
    CONTRADICTS,
    DIRECTION_ONLY,
    QUICK_SIZE,
    REPRODUCES,
    case_jobs,
    gain_claim,
    mean_number,
    paired_gains,
)
from holoview.evidence.study.studies.chains import ChainStudy, flat_cases, learned_pattern, light_claim
from holoview.evidence.study.study import (
    QUICK,
    Claim,
    Results,
    StatusCallback,
    StudyJob,
    StudyScale,
)
from holoview.holograms.metrics.fidelity import psnr_linear_srgb
from holoview.holograms.optimise.learned_mask import ENOUGH_PICTURES
from holoview.holograms.view import View
from holoview.light.model import preset
from holoview.light.model.chain import focal_lengths_m
from holoview.light.model.system import System

_EYEBOX = 0.03
_FINE_M, _PLANE_M = 8e-6, 6e-3
_STROKE_M, _MASK_STROKE_M = 665e-9, 650e-9
_FACTORS = (2, 4)  # along a side: 4 and 16 times the light by direction
_SAMPLES = 2  # of a fine pixel along a side
_PUBLISHED_DB = 29.0  # Nature Communications 15, 2907: 64 times, at what the retina resolves
_NATIVE, _FLAT, _RANDOM, _LEARNED = "fine modulator", "no mask", "random mask", "learned mask"

_SOURCES = 3  # along a side
_PICTURE_M = 3e-3
_OPEN, _STATIC, _DYNAMIC = "open", "static mask", "dynamic"


class _EtendueExpander(ChainStudy):
    name = "etendue-expander"
    title = "A static mask of finer pixels behind a phase modulator"
    summary = (
        "A phase modulator of pixels 2 and 4 times as wide as those of a static phase mask behind it, which is random, "
        "or learned from pictures that don't contain the target; without one; and a modulator of the fine pixels."
    )
    quick_note = f"{QUICK_SIZE.replace(f'{QUICK.planes} planes', 'one plane')}, and a mask learned from four pictures."
    kind = "etendue-expander"
    revision = 1
    lasers = (3,)
    displays = (
        f"{_NATIVE}, 1 x",
        *(f"{mask}, {factor} x" for factor in _FACTORS for mask in (_FLAT, _RANDOM, _LEARNED)),
    )

    def describe_size(self, scale: StudyScale) -> str:
        return replace(scale, planes=1).description

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        pictures = 4 if scale.shape[0] <= QUICK.shape[0] else ENOUGH_PICTURES
        cases = {
            display: case | ({"pictures": pictures} if display.startswith(_LEARNED) else {})
            for display, case in flat_cases(self.displays, scale.eyebox or _EYEBOX).items()
        }
        return case_jobs(self, cases, replace(scale, planes=1), seed)

    def system_of(self, settings: Mapping[str, Any], status: StatusCallback, folder: Path) -> System:
        mask, factor = _parts(settings["display"])
        shape = _whole_shape(settings["shape"])
        if mask == _NATIVE:
            return _expander(shape, 1, None)
        values = np.zeros(shape, np.float32)
        if mask == _RANDOM:
            values = np.random.default_rng(settings["seed"]).random(shape, np.float32)
        if mask == _LEARNED:
            learning = _expander(shape, factor, {"kind": "phase", "shared": True})
            values = learned_pattern(learning, "mask", settings, status)
        np.save(folder / "mask.npy", values)
        return _expander(shape, factor, {"kind": "mask", "file": str(folder / "mask.npy")})

    def numbers(self, view: View, target: NDArray[np.floating]) -> dict[str, float]:
        side = _SAMPLES * max(_FACTORS)
        seen, wanted = (_block_means(np.asarray(rgb, np.float64), side) for rgb in (view.rgb, target))
        return {"coarse_db": psnr_linear_srgb(seen, wanted).mean_db}

    def claims(self, results: Results, lasers: int) -> list[Claim]:
        out = []
        for factor in _FACTORS:
            flat, random, learned = ({"display": f"{mask}, {factor} x"} for mask in (_FLAT, _RANDOM, _LEARNED))
            words = f"{factor**2} x the étendue"
            out += [
                gain_claim(results, f"{words}: a random mask beside none", None, random, flat),
                gain_claim(results, f"{words}: a learned mask beside none", None, learned, flat),
                gain_claim(results, f"{words}: a learned mask beside a random one", None, learned, random),
            ]
        return [*out, _published_claim(results), light_claim(results, lasers, self.displays)]


def _published_claim(results: Results) -> Claim:
    """The paper's PSNR beside that of the widest expansion, of the means over the modulator's own pixels."""
    factor = max(_FACTORS)
    learned, flat = ({"display": f"{mask}, {factor} x"} for mask in (_LEARNED, _FLAT))
    found = mean_number(results, "coarse_db", **learned)
    gain = float(paired_gains(results, learned, flat, "coarse_db").mean())
    verdict = REPRODUCES if found >= _PUBLISHED_DB else DIRECTION_ONLY if gain > 0 else CONTRADICTS
    words = f"{found:.1f} dB at {factor**2} x, {gain:+.2f} dB over no mask"
    what = "a learned mask, of what is resolved (means over the modulator's own pixels)"
    reason = "in the near field, with few pictures to learn from, and beside an even eyebox"
    return Claim(what, f"> {_PUBLISHED_DB:.0f} dB at 64 x", words, verdict, "" if verdict == REPRODUCES else reason)


def _parts(display: str) -> tuple[str, int]:
    """The mask of a display, and how many of its pixels lie along a side of the modulator's."""
    mask, factor = display.removesuffix(" x").split(", ")
    return mask, int(factor)


def _whole_shape(shape: list[int]) -> tuple[int, int]:
    """The mask's pixels (y, x), a whole number of those of the widest modulator."""
    rows, columns = (max(1, n // max(_FACTORS)) * max(_FACTORS) for n in shape)
    return rows, columns


def _expander(shape: tuple[int, int], factor: int, mask: Mapping[str, Any] | None) -> System:
    """A phase modulator of `factor` times wider pixels than those of a mask right behind it. shape: of the mask."""
    fine = {"name": "mask", "pitch": _FINE_M, "shape": shape, "stroke": _MASK_STROKE_M}
    coarse = {"pitch": factor * _FINE_M, "shape": [n // factor for n in shape], "stroke": _STROKE_M}
    elements: list[Any] = [{"kind": "phase", "name": "phase", **coarse}]
    if mask is not None:
        elements.append(fine | dict(mask))
    elements.append({"kind": "space", "square": f"first order of {'phase' if mask is None else 'mask'}"})
    changes = {"elements": elements, "planes": [_PLANE_M], "upsample": factor * _SAMPLES, "propagation": "periodic"}
    return preset.load("high-contrast").edit(changes)


def _block_means(picture: NDArray[np.float64], side: int) -> NDArray[np.float64]:
    """The means (plane, y, x, 3) of the light of a picture over squares of `side` samples."""
    planes, rows, columns, channels = picture.shape
    return picture.reshape(planes, rows // side, side, columns // side, side, channels).mean(axis=(2, 4))


class _DynamicFourier(ChainStudy):
    name = "dynamic-fourier"
    title = "An amplitude modulator in the Fourier plane of several coherent sources"
    summary = (
        f"{_SOURCES} x {_SOURCES} plane waves that interfere on a phase modulator, whose Fourier plane is open, or "
        "holds a static random mask or an amplitude modulator; one frame of each colour, and three."
    )
    quick_note = f"{QUICK.shape[0] // 2} x {QUICK.shape[0] // 2} pixels, {QUICK.iterations} iterations; flat."
    kind = "dynamic-fourier"
    revision = 1
    lasers = (3,)
    displays = tuple(f"{there}, {frames} frames" for frames in (3, 9) for there in (_OPEN, _STATIC, _DYNAMIC))

    def describe_size(self, scale: StudyScale) -> str:
        side = _SOURCES * (scale.shape[0] // 2)  # twice as many samples, as of all studies
        return replace(scale, planes=1, shape=(side, side)).description

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        cases = flat_cases(self.displays, scale.eyebox or _EYEBOX)
        return case_jobs(self, cases, replace(scale, planes=1), seed)

    def system_of(self, settings: Mapping[str, Any], status: StatusCallback, folder: Path) -> System:
        there, frames = settings["display"].removesuffix(" frames").split(", ")
        base, count = preset.load("high-contrast"), settings["shape"][0] // 2
        fine, pitch_m = 2 * _SOURCES, _SOURCES * _FINE_M  # samples of a pixel along a side
        sources = np.zeros((_SOURCES, _SOURCES), np.float32)
        sources[_SOURCES // 2, _SOURCES // 2] = (
            1.0  # this comb is the sum of plane waves, one in the middle of each order
        )
        np.save(folder / "sources.npy", np.tile(sources, (count, count)))
        np.save(folder / "static.npy", np.random.default_rng(settings["seed"]).integers(0, 2, (count, count)) * 1.0)
        pixels = {"pitch": pitch_m, "shape": [count, count]}
        within = {
            _OPEN: [],
            _STATIC: [pixels | {"kind": "mask", "name": "filter", "file": str(folder / "static.npy")}],
            _DYNAMIC: [pixels | {"kind": "amplitude", "name": "filter"}],
        }
        wide = (count * fine, count * fine)
        least_m, _ = focal_lengths_m(wide, pitch_m / fine, pitch_m, base.wavelengths_m)
        comb = {"kind": "mask", "name": "sources", "pitch": _FINE_M, "file": str(folder / "sources.npy")}
        elements = [
            pixels | {"kind": "phase", "name": "phase", "stroke": _STROKE_M},
            comb,
            {"kind": "fourier", "name": "there", "focal_length": least_m},
            *within[there],
            {"kind": "fourier", "name": "back", "focal_length": least_m},
        ]
        lasers = np.tile(base.amplitudes, (int(frames) // len(base.amplitudes), 1))
        return base.edit({"elements": elements, "planes": [_PICTURE_M], "upsample": fine, "amplitudes": lasers})

    def claims(self, results: Results, lasers: int) -> list[Claim]:
        out = []
        for frames, words in ((3, "one frame of each colour"), (9, "three frames of each colour")):
            is_open, static, dynamic = (
                {"display": f"{there}, {frames} frames"} for there in (_OPEN, _STATIC, _DYNAMIC)
            )
            out += [
                gain_claim(results, f"{words}: an amplitude modulator beside a static mask", None, dynamic, static),
                gain_claim(results, f"{words}: an amplitude modulator beside an open plane", None, dynamic, is_open),
            ]
        few, many = {"display": f"{_DYNAMIC}, 3 frames"}, {"display": f"{_STATIC}, 9 frames"}
        fewer = gain_claim(results, "a third of the frames, beside a static mask", None, few, many)
        is_better = float(paired_gains(results, few, many, "psnr_db").mean()) > 0
        fewer = replace(fewer, published="better with fewer frames", verdict=REPRODUCES if is_better else CONTRADICTS)
        return [*out, fewer, light_claim(results, lasers, self.displays)]


STUDIES = (_EtendueExpander(), _DynamicFourier())
