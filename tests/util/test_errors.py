"""User errors: where; found; expected; remedy, in one line."""

from __future__ import annotations

import copy

import pytest

from holoview.util.errors import UserError, suggest_matches


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (
            UserError("gap", "-1 mm", expected="at least 0 mm", remedy="raise it"),
            "gap: -1 mm; expected at least 0 mm; raise it",
        ),
        (UserError("gap", "is missing", remedy='e.g. "2 mm"'), 'gap: is missing; e.g. "2 mm"'),
        (UserError("gap", "-1 mm", expected="at least 0 mm"), "gap: -1 mm; expected at least 0 mm"),
        (UserError("gap", "is missing"), "gap: is missing"),
        (UserError("", "no adapter", remedy="install a driver"), "no adapter; install a driver"),
    ],
)
def test_the_message_names_place_finding_expectation_and_remedy_in_this_order(error: UserError, message: str) -> None:
    assert str(error) == message


def test_a_user_error_is_a_value_error_whose_parts_can_be_read() -> None:
    error = UserError("gap", "-1 mm", expected="at least 0 mm", remedy="raise it")
    assert isinstance(error, ValueError)
    assert (error.where, error.found, error.expected, error.remedy) == ("gap", "-1 mm", "at least 0 mm", "raise it")


def test_an_error_seen_from_further_out_keeps_everything_but_its_place() -> None:
    inner = UserError("iris_na", "2", expected="at most 1", remedy="a sine")
    outer = inner.inside("relay2.").inside("bench.toml: ")
    assert str(outer) == "bench.toml: relay2.iris_na: 2; expected at most 1; a sine"
    assert inner.where == "iris_na"


def test_the_known_words_nearest_to_a_typing_error_are_offered() -> None:
    assert suggest_matches("iriss", ["iris", "gap", "planes"]) == "did you mean iris?"
    assert suggest_matches("relay", ["relay2", "relay1", "gap"]) == "did you mean relay2 or relay1?"


def test_all_known_words_are_listed_in_order_when_none_is_near() -> None:
    assert suggest_matches("zzz", ["planes", "gap"]) == "known: gap, planes"


def test_no_more_than_three_words_are_offered() -> None:
    assert suggest_matches("key", [f"key{i}" for i in range(9)]).count(" or ") == 2


def test_passes_from_one_process_to_another() -> None:
    error = UserError("gap", "-1 mm", expected="0 or more", remedy="turn it round")
    passed = copy.copy(error)  # by __reduce__, as pickle does it
    assert (str(passed), passed.where, passed.remedy) == (str(error), "gap", "turn it round")


def test_a_message_is_bounded_whatever_a_file_holds() -> None:
    error = UserError("f", "a" * 10**6, expected="b", remedy="c")
    assert len(str(error)) < 4100
    assert str(error).endswith("a …; expected b; c")
