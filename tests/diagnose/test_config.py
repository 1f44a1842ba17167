"""Every setting states its unit and evidence, and the manual states the same values."""

from __future__ import annotations

import ast
import dataclasses
import pickle
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest

from holoview.bench.diagnose import intervals, judge, nuisances, power_law, rivals, screening
from holoview.bench.diagnose.config import SearchConfig

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "holoview" / "bench" / "diagnose"
PAGES = ("diagnosis.md", "diagnosis-evidence.md")
MANUAL = "\n".join((ROOT / "docs" / page).read_text(encoding="utf-8") for page in PAGES)
CONFIG = SearchConfig()


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
    for name, text in _fields(ast.parse((PACKAGE / "config.py").read_text(encoding="utf-8")))
    if text or not name.startswith(("SearchConfig", "SamplingConfig"))
}


@pytest.mark.parametrize("name", DOCUMENTED)
def test_every_setting_states_its_unit_and_its_evidence(name: str) -> None:
    assert re.match(r"\[[^\]]+\] [A-Z…]", DOCUMENTED[name]), "a unit in brackets, then a sentence"
    assert re.search(r"Evidence:\s+\S", DOCUMENTED[name])


def test_all_settings_are_in_the_tree() -> None:
    groups = [group for f in dataclasses.fields(CONFIG) if dataclasses.is_dataclass(group := getattr(CONFIG, f.name))]
    found = {f"{type(group).__name__}.{f.name}" for group in groups for f in dataclasses.fields(group)}
    assert found == {name for name in DOCUMENTED if not name.startswith("SearchConfig")}


def test_a_configuration_cannot_be_changed_and_can_be_sent_to_a_process() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        CONFIG.verdict.min_delta_chi2 = 1.0  # type: ignore[misc]
    assert pickle.loads(pickle.dumps(CONFIG)) == CONFIG == SearchConfig()


def test_the_table_of_thresholds_has_the_values_of_the_configuration() -> None:
    section = MANUAL.partition("## Thresholds")[2].partition("\n## ")[0]
    rows = [line for line in section.splitlines() if line.startswith("|")][2:]
    assert len(rows) >= 7
    for row in rows:
        stated = re.findall(r"`([\w.]+)\.(\w+)` = ([\d.]+)", row)
        assert stated, f"no settings in the row {row}"
        for group, name, value in stated:
            holder = import_module(f"holoview.bench.diagnose.{group}") if name.isupper() else getattr(CONFIG, group)
            assert getattr(holder, name) == float(value), f"{group}.{name}"


@pytest.mark.parametrize(
    "sentence",
    [
        f"drift by up to {nuisances.DRIFT_STEP_M * nuisances.DRIFT_STEPS * 1e9:.1f} nm",
        f"residuals below {screening.TANGENT_MAX_ERROR:.0%}".replace("%", " %"),
        f"Beyond {screening.LOCAL_MAX_ERROR:.0%}".replace("%", " %"),
        f"After {CONFIG.budget.max_fields:,} fields".replace(",", " "),
        f"Δχ² > {CONFIG.verdict.min_delta_chi2:g} on held-out captures",
        f"< {judge.JITTER_EXCESS:g}, or what chance exceeds",
        f"excess ≤ {CONFIG.verdict.explained_excess:.2f}",
        f"χ²/n > {judge.FLOOR_CHI2:g}, Δχ² > {CONFIG.verdict.min_delta_chi2:g}",
        f"gains spread by > {power_law.MIN_SPREAD:.1%}".replace("%", " %"),
        f"{intervals.MODEL_ACCURACY:.1%} of the value is added".replace("%", " %"),
        f"rises by less than {CONFIG.verdict.min_delta_chi2:g}",
        f"canonical correlation of {rivals.MIN_CORRELATION:g} or more",
        f"{100 * intervals.LEVEL:.0f} % interval",
    ],
)
def test_the_text_has_the_values_of_the_configuration(sentence: str) -> None:
    assert sentence in " ".join(MANUAL.split())
