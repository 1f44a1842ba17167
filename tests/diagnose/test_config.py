"""Every setting states its unit and evidence, the manual states the same values, and no module has its own settings."""

from __future__ import annotations

import ast
import dataclasses
import pickle
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from holoview.diagnose.config import SearchConfig

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "holoview" / "diagnose"
MANUAL = "\n".join(
    (ROOT / "docs" / name).read_text(encoding="utf-8") for name in ("diagnosis.md", "diagnosis-evidence.md")
)
CONFIG = SearchConfig()

NOT_SETTINGS = {
    "display_gain._GAMMA",  # of a display
    "extended_model._PITCH_TOLERANCE",  # rounding of a file
    "one_picture._FAR_FIELD_WIDTHS",  # physics of a beam
    "picture_limit._COMPLEX64",  # bytes of a number
    "picture_limit._STEP",  # in which a size is found
    "plots._DPI",  # style of the figures
    "plots._SIGMAS",
    "shared_arrays._ALIGNMENT",  # of memory
    "shared_arrays._MIN_BYTES",
    "worker_pool._LARGE_BYTES",  # of memory
    "worker_pool._POLL_S",  # in which Ctrl-C is noticed
}


def _fields(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """(class.field, text after it) of the dataclasses of a module."""
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            following = [*node.body[1:], ast.Pass()]
            for statement, after in zip(node.body, following, strict=True):
                if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
                    text = after.value.value if isinstance(after, ast.Expr) else ""
                    yield f"{node.name}.{statement.target.id}", text


DOCUMENTED = {
    name: text
    for path in sorted((PACKAGE / "config").glob("*.py"))
    if path.name != "__init__.py"
    for name, text in _fields(ast.parse(path.read_text(encoding="utf-8")))
}


@pytest.mark.parametrize("name", DOCUMENTED)
def test_every_setting_states_its_unit_and_its_evidence(name: str) -> None:
    assert re.match(r"\[[^\]]+\] [A-Z…]", DOCUMENTED[name]), "a unit in brackets, then a sentence"
    assert re.search(r"Evidence:\s+\S", DOCUMENTED[name])


def test_all_settings_are_in_the_tree() -> None:
    found = {f"{type(group).__name__}.{f.name}" for group in _groups() for f in dataclasses.fields(group)}
    assert found == set(DOCUMENTED)


def _groups() -> Iterator[object]:
    for field in dataclasses.fields(CONFIG):
        group = getattr(CONFIG, field.name)
        yield group
        yield from (v for f in dataclasses.fields(group) if dataclasses.is_dataclass(v := getattr(group, f.name)))


def test_a_configuration_cannot_be_changed_and_can_be_sent_to_a_process() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        CONFIG.verdict.min_delta_chi2 = 1.0  # type: ignore[misc]
    assert pickle.loads(pickle.dumps(CONFIG)) == CONFIG == SearchConfig()


def test_the_table_of_thresholds_has_the_values_of_the_configuration() -> None:
    section = MANUAL.partition("## Thresholds")[2].partition("\n## ")[0]
    rows = [line for line in section.splitlines() if line.startswith("|")][2:]
    assert len(rows) >= 7
    for row in rows:
        stated = re.findall(r"`(\w+)\.(\w+)` = ([\d.]+)", row)
        assert stated, f"no settings in the row {row}"
        for group, name, value in stated:
            assert getattr(getattr(CONFIG, group), name) == float(value), f"{group}.{name}"


@pytest.mark.parametrize(
    "sentence",
    [
        f"drift by up to {CONFIG.laser_drift.step_m * CONFIG.laser_drift.steps * 1e9:.1f} nm",
        f"residuals below {CONFIG.screening.tangent_max_error:.0%}".replace("%", " %"),
        f"Beyond {CONFIG.screening.local_max_error:.0%}".replace("%", " %"),
        f"After {CONFIG.budget.max_fields:,} fields".replace(",", " "),
        f"Δχ² > {CONFIG.verdict.min_delta_chi2:g} on held-out captures",
        f"< {CONFIG.verdict.jitter_excess:g}, or within {CONFIG.verdict.chance_sigmas:g} σ",
        f"excess ≤ {CONFIG.verdict.explained_excess:.2f}",
        f"χ²/n > {CONFIG.selection.floor_chi2:g}, Δχ² > {CONFIG.verdict.min_delta_chi2:g}",
        f"gains spread by > {CONFIG.power_law.min_spread:.1%}".replace("%", " %"),
        f"{CONFIG.intervals.model_accuracy:.1%} of the value is added".replace("%", " %"),
        f"rises by less than {CONFIG.verdict.min_delta_chi2:g}",
        f"canonical correlation of {CONFIG.confounders.min_correlation:g} or more",
        f"{100 * CONFIG.intervals.level:.0f} % interval",
    ],
)
def test_the_text_has_the_values_of_the_configuration(sentence: str) -> None:
    assert sentence in " ".join(MANUAL.split())


def _numeric_constants(path: Path) -> Iterator[str]:
    """Names that a module assigns at its top level from an expression with a number in it."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        targets = (
            node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
        )
        value = getattr(node, "value", None)
        numbers = (
            [n for n in ast.walk(value) if isinstance(n, ast.Constant) and type(n.value) in (int, float)]
            if value
            else []
        )
        if numbers:
            yield from (f"{path.stem}.{n.id}" for t in targets for n in ast.walk(t) if isinstance(n, ast.Name))


def test_no_module_has_settings_of_its_own() -> None:
    assert {name for path in PACKAGE.glob("*.py") for name in _numeric_constants(path)} == NOT_SETTINGS
