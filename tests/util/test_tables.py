"""Keys and values of tables from unknown sources are checked, and each error names its place."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from holoview.light.model.fields import Integer, Number
from holoview.util.errors import UserError
from holoview.util.tables import check_keys, read_record, read_table, record_from_table

TYPES = {"gap": Number("mm"), "each": Integer()}


@dataclass(frozen=True)
class Settings:
    steps: int
    rate: float = 0.1
    planes: tuple[float, ...] = ()
    name: str | None = None

    def __post_init__(self) -> None:
        if self.steps < 1:
            raise UserError("steps", f"{self.steps}", expected="at least 1")


def test_values_are_read_in_the_order_of_the_table() -> None:
    assert list(read_table({"each": 3, "gap": "2 mm"}, TYPES, "plan.toml: ", required=["gap"]).items()) == [
        ("each", 3),
        ("gap", 2e-3),
    ]


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"gab": "2 mm"}, r"plan.toml: gab: unknown key; did you mean gap\?"),
        ({"gap": "2 mm", "each": 0}, "plan.toml: each: 0; expected a whole number from 1 to 1048576"),
        ({"each": 3}, "plan.toml: gap: is missing; expected a distance"),
    ],
)
def test_wrong_tables_are_refused(table: dict[str, object], message: str) -> None:
    with pytest.raises(UserError, match=f"^{message}$"):
        read_table(table, TYPES, "plan.toml: ", required=["gap"], expected="a distance")


def test_errors_name_the_noun() -> None:
    check_keys(["camera"], TYPES | {"camera": Integer()})
    with pytest.raises(UserError, match=r"^bench: camra: unknown table; did you mean camera"):
        check_keys(["camra"], ["camera", "slm1"], "bench: ", noun="table")


def test_a_record_is_read_by_its_annotations() -> None:
    read = read_record(Settings, '{"steps": 2, "rate": 1, "planes": [1, 2.5], "name": null}', "here", "settings")
    assert read == Settings(2, 1.0, (1.0, 2.5), None)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("{}", "here: steps"),
        ('{"steps": 2, "more": 1}', "here: more"),
        ('{"steps": true}', "here: steps"),
        ('{"steps": 0}', "here: steps"),
        ('{"steps": 2, "planes": [1, "2"]}', r"here: planes\[1\]"),
        ("[1]", "here"),
        ("{", "here"),
    ],
)
def test_wrong_records_are_refused(text: str, place: str) -> None:
    with pytest.raises(UserError, match=f"^{place}: "):
        read_record(Settings, text, "here", "settings")


@dataclass(frozen=True)
class Job:
    settings: Settings
    lasers: frozenset[int] = frozenset()
    title: str = ""


def test_a_table_is_read_with_the_tables_and_sets_inside_it() -> None:
    table = {"settings": {"steps": 3}, "lasers": [2, 0, 2], "colour": 7}
    read = record_from_table(Job, table, "job: ", skips_unknown=True, title="given")
    assert read == Job(Settings(3), frozenset({0, 2}), "given")
    with pytest.raises(UserError, match=r"^job: colour: unknown key"):
        record_from_table(Job, table, "job: ")


@pytest.mark.parametrize(
    ("table", "place"),
    [
        ({"settings": {"steps": 0}}, r"settings\.steps: 0"),
        ({"settings": {"steps": "3"}}, r"settings\.steps: '3'"),
        ({"settings": 3}, "settings: 3"),
        ({"settings": {"steps": 3}, "lasers": ["x"]}, "lasers: 'x'"),
        ({"settings": {"steps": 3}, "lasers": 0}, "lasers: 0"),
    ],
)
def test_a_wrong_value_inside_a_table_is_refused_with_its_place(table: dict[str, object], place: str) -> None:
    with pytest.raises(UserError, match=f"^job: {place}; expected "):
        record_from_table(Job, table, "job: ")
