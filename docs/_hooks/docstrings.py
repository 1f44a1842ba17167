"""Docstrings as Markdown, for the reference: a griffe extension.

Docstrings of the package are plain prose. Columns and indented lines keep their shape in a block of code, lines that
begin with `name: ` become a list, examples at a prompt (`>>>`) keep their shape, and characters that Markdown would
take for its own are escaped. What `described_field(…)` states of a field in its default becomes the field's docstring,
and the default what a reader would call so.
"""

from __future__ import annotations

import ast
import re
from typing import Any

import griffe

_CODE = re.compile(r"(`+[^`]+`+)")
_EMPHASIS = re.compile(r"(?<![\w*])(\*{1,2}[^\s*][^*\n]*?\*{1,2})(?![\w*])")
_COLUMNS = re.compile(r"\S {2,}\S")
_KEY = re.compile(r"((?:\w+(?: \([^)]*\))?(?:, )?)+): ")


def to_markdown(text: str) -> str:
    """A docstring's text as Markdown."""
    return "\n\n".join(_paragraph(part) for part in re.split(r"\n[ \t]*\n", text.strip("\n")))


def _paragraph(text: str) -> str:
    lines = text.split("\n")
    if text.lstrip().startswith(("```", "- ", "* ", "| ", "#")):
        return text
    if text.lstrip().startswith(">>> "):
        return f"```pycon\n{text}\n```"
    if _is_drawn(lines):
        return f"```{_language(text)}\n{text}\n```"
    if sum(bool(_KEY.match(line)) for line in lines) >= 2:
        return _listed(lines)
    return _escaped(text)


def _is_drawn(lines: list[str]) -> bool:
    """Whether the lines' own arrangement says something: columns, indented formulas, code."""
    columns = sum(bool(_COLUMNS.search(line)) for line in lines)
    return lines[0].startswith("   ") or columns >= 2 or any(line.startswith("    ") for line in lines)


def _language(text: str) -> str:
    lines = text.split("\n")
    margin = min(len(line) - len(line.lstrip()) for line in lines if line.strip())
    try:
        tree = ast.parse("\n".join(line[margin:] for line in lines))
    except SyntaxError:
        return "text"
    is_code = any(isinstance(node, ast.Assign | ast.For | ast.Import | ast.ImportFrom) for node in tree.body)
    return "python" if is_code else "text"


def _listed(lines: list[str]) -> str:
    """Lines that explain names, as a list; a sentence that begins a line with "Raises" ends it."""
    out: list[str] = []
    for line in lines:
        if match := _KEY.match(line):
            gap = [""] if not out or not out[-1].startswith("- ") else []
            out += [*gap, f"- `{match[1]}`: {_escaped(line[match.end() :])}"]
        elif line.startswith(("Raises ", "Returns ")):
            out += ["", _escaped(line)]
        elif out:
            out[-1] += " " + _escaped(line)
        else:
            out.append(_escaped(line))
    return "\n".join(out).strip("\n")


def _escaped(text: str) -> str:
    """Prose with Markdown's own characters escaped, but for code and emphasis."""
    return "".join(part if i % 2 else _escaped_prose(part) for i, part in enumerate(_CODE.split(text)))


def _escaped_prose(text: str) -> str:
    parts = _EMPHASIS.split(text)
    return "".join(part if i % 2 else re.sub(r"([\\*_<\[\]$~^])", r"\\\1", part) for i, part in enumerate(parts))


class Prose(griffe.Extension):
    """Turns every docstring into Markdown once its object is known."""

    def on_object(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        """Rewrites the docstring in place, first made from `described_field(…)` where there is none."""
        if obj.docstring is None and isinstance(obj, griffe.Attribute):
            _describe(obj)
        if obj.docstring is not None:
            obj.docstring.value = to_markdown(obj.docstring.value)


def _text_of(argument: Any) -> str:
    """The text of an argument that is one, with … where it is computed; "" for any other argument."""
    if isinstance(argument, griffe.ExprKeyword):
        return ""
    node = ast.parse(str(argument), mode="eval").body
    if isinstance(node, ast.JoinedStr):
        return "".join(str(part.value) if isinstance(part, ast.Constant) else "…" for part in node.values)
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def _describe(attribute: griffe.Attribute) -> None:
    """Takes text and default of a field from its `described_field(type, "text", default=…)`."""
    call = attribute.value
    if not isinstance(call, griffe.ExprCall) or str(call.function) != "described_field":
        return
    texts = [text for one in call.arguments if (text := _text_of(one))]
    named = {one.name: one.value for one in call.arguments if isinstance(one, griffe.ExprKeyword)}
    attribute.value = named.get("default")
    if texts:
        unit = re.search(r"""\bNumber\(["'](\w+)["']""", str(call.arguments[0]))
        written = f" Written in {unit[1]}." if unit else ""
        attribute.docstring = griffe.Docstring(f"{texts[0]}{written}", parent=attribute)
