"""Links and headings of Markdown: where a link leads, which anchors a page has, and what is wrong with either.

The site's build and `tests/docs/test_links.py` use the same rules, so that a link holds on a repository's page and on
the site. A heading's anchor is the one that repository pages make: lower case, no punctuation, a hyphen for each space.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, urlsplit

_FENCE = re.compile(r"^([ \t]*)(`{3,}|~{3,})[^\n]*\n.*?(?:^[ \t]*\2[`~]*[ \t]*$|\Z)", re.MULTILINE | re.DOTALL)
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_CODE = re.compile(r"(?<!`)(`+)(?!`)(.+?)(?<!`)\1(?!`)", re.DOTALL)
_TARGET = re.compile(r"""\]\(\s*<?(?P<inline>[^)\s>]+)>?(?:\s+"[^"]*")?\s*\)"""
                     r"""|^\[[^\]]+\]:\s*<?(?P<defined>[^\s>]+)"""
                     r"""|\b(?:href|src)="(?P<html>[^"]+)\"""", re.MULTILINE)  # fmt: skip
_HEADING = re.compile(r"^(#{1,6})[ \t]+(.+?)[ \t]*#*[ \t]*$", re.MULTILINE)
_ANCHOR = re.compile(r"""<a\s+(?:id|name)="([^"]+)\"|\{[^}\n]*#([\w-]+)[^}\n]*\}""")


@dataclass(frozen=True)
class Link:
    """A link's target as it is written, and the characters start … end of the text that hold it."""

    target: str
    start: int
    end: int

    @property
    def is_external(self) -> bool:
        """Whether it leads to another host, or to no file at all (mailto:)."""
        return bool(urlsplit(self.target).scheme) or self.target.startswith("//")

    @property
    def path(self) -> str:
        """The path, without the anchor; empty for a link within the page."""
        return unquote(self.target.partition("#")[0])

    @property
    def anchor(self) -> str:
        """The anchor, without its #."""
        return unquote(self.target.partition("#")[2])


def links_of(text: str) -> Iterator[Link]:
    """The links and pictures of a Markdown text, in their order, those in code and comments left out."""
    for match in _TARGET.finditer(_without_code(text)):
        group = str(match.lastgroup)
        yield Link(text[match.start(group) : match.end(group)], match.start(group), match.end(group))


def anchors_of(text: str) -> set[str]:
    """The anchors of a Markdown text: of its headings, numbered where they repeat, and those that it sets itself."""
    found: set[str] = set()
    plain = _blanked(_blanked(text, _FENCE), _COMMENT)
    for match in _HEADING.finditer(plain):
        slug, number = slugify(re.sub(r"\s*\{[^}]*\}$", "", match[2])), 0
        anchor = slug
        while anchor in found:
            number += 1
            anchor = f"{slug}-{number}"
        found.add(anchor)
    return found | {match[1] or match[2] for match in _ANCHOR.finditer(plain)}


def slugify(heading: str, separator: str = "-") -> str:
    """The anchor of a heading, as repository pages make it."""
    shown = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", heading)
    kept = re.sub(r"[^\w\- ]", "", shown.strip().lower())
    return kept.replace(" ", separator)


def mistakes(page: Path, root: Path) -> list[str]:
    """What is wrong with the links of a Markdown file inside the folder `root`, in words; nothing where all is well."""
    text = page.read_text(encoding="utf-8")
    return [
        f"{page.relative_to(root)}:{text.count(chr(10), 0, link.start) + 1}: {link.target}: {wrong}"
        for link in links_of(text)
        if (wrong := _mistake(link, page, root))
    ]


def _mistake(link: Link, page: Path, root: Path) -> str:
    if link.is_external:
        parts = urlsplit(link.target)
        is_web = parts.scheme in ("http", "https") and "." in parts.netloc
        return "" if is_web or parts.scheme == "mailto" else "isn't a web address"
    if link.path.startswith("/"):
        return "is absolute; write it relative to the page"
    target = (page.parent / link.path).resolve() if link.path else page
    if not target.is_relative_to(root):
        return "lies outside the repository"
    if not target.exists():
        return "doesn't exist"
    if link.anchor and target.suffix == ".md" and link.anchor not in anchors_of(target.read_text(encoding="utf-8")):
        return "there is no such heading"
    return ""


def _without_code(text: str) -> str:
    """The text with spaces in place of code and comments, so that places in it stay what they were."""
    for pattern in (_FENCE, _COMMENT, _CODE):
        text = _blanked(text, pattern)
    return text


def _blanked(text: str, pattern: re.Pattern[str]) -> str:
    return pattern.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), text)
