"""Finds the studies: each file in `studies/` holds one as `STUDY`."""

from __future__ import annotations

import pkgutil
from functools import cache
from importlib import import_module

from holoview.study import studies
from holoview.study.study import Study
from holoview.util.errors import UserError, suggest_matches


@cache
def studies_by_name() -> dict[str, Study]:
    """Every study, by name."""
    modules = (import_module(f"{studies.__name__}.{info.name}") for info in pkgutil.iter_modules(studies.__path__))
    instances: list[Study] = [module.STUDY for module in modules]
    return {study.name: study for study in sorted(instances, key=lambda study: study.name)}


def find_study(name: str) -> Study:
    """The study of a name. Raises UserError with similar names."""
    if name not in studies_by_name():
        known = ", ".join(studies_by_name())
        raise UserError(f'study "{name}"', "unknown", expected=known, remedy=suggest_matches(name, studies_by_name()))
    return studies_by_name()[name]
