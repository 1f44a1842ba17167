"""The reference is made of what exists: public names, modules, commands; and docstrings come out as Markdown."""

from __future__ import annotations

from typing import Any

import holoview
from docs._hooks import reference
from docs._hooks.docstrings import to_markdown


def test_every_public_name_is_there() -> None:
    assert {*reference.public_names(), "__version__"} == set(holoview.__all__)


def test_every_module_has_a_page_and_a_place_in_the_navigation() -> None:
    def leaves(nav: Any) -> set[str]:
        if isinstance(nav, str):
            return {nav}
        return set().union(*map(leaves, nav.values() if isinstance(nav, dict) else nav))

    pages = reference.modules()
    assert leaves(reference.modules_nav()) == set(pages)
    assert (
        pages["reference/modules/holoview/index.md"].split("---\n")[-1].startswith("\n# `holoview`\n\n::: holoview\n")
    )


def test_commands_are_found() -> None:
    text = "usage: x\n\npositional arguments:\n  COMMAND\n    view        see it\n    optimise (optimize)\n"
    text += "                find it\n    long-one    last\n\noptions:\n  -h\n"
    assert reference._commands(text) == ["view", "optimise", "long-one"]


def test_prose_is_escaped_but_for_code_and_emphasis() -> None:
    assert to_markdown("Takes a_b * c_ of `x_y`, *Speckle* [p] <q>.") == (
        r"Takes a\_b \* c\_ of `x_y`, *Speckle* \[p\] \<q>."
    )


def test_columns_and_formulas_keep_their_shape() -> None:
    assert (
        to_markdown("One.\n\nplan   numbers\nview   what is seen")
        == "One.\n\n```text\nplan   numbers\nview   what is seen\n```"
    )
    assert to_markdown("    PSNR = 10·log10(1 / MSE)   dB").startswith("```text\n")
    assert to_markdown("    a = hv.load('x')\n    b = a") == "```python\n    a = hv.load('x')\n    b = a\n```"


def test_examples_at_a_prompt_keep_their_shape() -> None:
    assert to_markdown("One.\n\n>>> a_b = 2\n>>> a_b\n2") == "One.\n\n```pycon\n>>> a_b = 2\n>>> a_b\n2\n```"


def test_lines_that_explain_names_are_a_list() -> None:
    text = "What it is.\n\nshape: of a_b\nand more. step (x, y): how far.\nlast, next: two.\nRaises UserError for none."
    assert to_markdown(text) == (
        "What it is.\n\n- `shape`: of a\\_b and more. step (x, y): how far.\n- `last, next`: two.\n\n"
        "Raises UserError for none."
    )
