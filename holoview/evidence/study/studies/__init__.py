"""The studies: each file holds those of one question as `STUDIES`.

schemes           colour schemes; the number of wavelengths; wavelengths beside source directions; free wavelengths
                  beside fixed ones, their number and spacing; saturated colours
modulators        one modulator or two, and what the gain of the second depends on; levels of the modulators; two frames
                  of two lasers, in turn or together
contrast_ratio    how black black is by the number of wavelengths, with one and two modulators
chains            a static mask in place of the second modulator, random and learned; a coarse amplitude modulator;
                  binary amplitudes; two phase modulators side by side
etendue           a static mask of finer pixels; an amplitude modulator in the Fourier plane of several coherent sources
speckle           speckle contrast by the number of wavelengths, on the retina, and its memory effect
eye               through a human eye with chromatic aberration, and the best spacing of wavelengths for it
pupil             a pupil beside the axis, small and large; penalty on an unevenly lit eyebox
accommodation     whether the display drives the eye's focus; through focus, beside incoherent light
model_vs_capture  predicted captures before and after a diagnosis
"""

from __future__ import annotations

import pkgutil
from functools import cache
from importlib import import_module

from holoview.evidence.study.study import Study
from holoview.util.errors import UserError, suggest_matches


@cache
def studies_by_name() -> dict[str, Study]:
    """Every study, by name."""
    modules = (import_module(f"{__name__}.{info.name}") for info in pkgutil.iter_modules(__path__))
    instances: list[Study] = [study for module in modules for study in module.STUDIES]
    return {study.name: study for study in sorted(instances, key=lambda study: study.name)}


def find_study(name: str) -> Study:
    """The study of a name. Raises UserError with similar names."""
    if name not in studies_by_name():
        known = ", ".join(studies_by_name())
        raise UserError(f'study "{name}"', "unknown", expected=known, remedy=suggest_matches(name, studies_by_name()))
    return studies_by_name()[name]
