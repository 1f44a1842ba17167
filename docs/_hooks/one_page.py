"""`make docs PAGE=docs/x.md` builds one page anew into the site that is there, in seconds; all others stay as they are.

Its links are checked as those of the whole manual are. Titles of other pages in the navigation are those of mkdocs.yml,
and the search finds the page as it was, until the manual is built as a whole.
"""

from __future__ import annotations

import logging
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from mkdocs.commands.build import build
from mkdocs.config import load_config
from mkdocs.structure.files import Files

from docs._hooks import links, reference
from docs._hooks.repository import ROOT, page_of

ONLY = "only"
"""Key of `extra` in the configuration of mkdocs: the place of the page that is built."""
_INDEX = "search/search_index.json"


def keep_others(files: Files, only: str) -> None:
    """Has mkdocs take all pages but one as unchanged; pictures are copied where they have changed."""
    for file in files.documentation_pages():
        file.is_modified = _never if file.src_uri != only else _always  # type: ignore[method-assign]
    if files.get_file_from_path(only) is None:
        raise SystemExit(f"{only} is no page of the manual")


def made_before() -> Iterator[tuple[str, str]]:
    """The pages of the reference without their contents, which stay as they are on the disk."""
    return ((page, "") for page in (*reference.modules(), reference.PYTHON, reference.COMMAND_LINE))


def _never() -> bool:
    return False


def _always() -> bool:
    return True


def main(name: str) -> int:
    """Builds the page of a Markdown file of the repository; returns the exit code."""
    began, path = time.monotonic(), Path(name).resolve()
    if not path.is_file() or not path.is_relative_to(ROOT) or path.suffix != ".md":
        print(f"PAGE={name}: isn't a Markdown file of this repository", file=sys.stderr)
        return 2
    inside = path.relative_to(ROOT)
    page = inside.relative_to("docs").as_posix() if inside.parts[0] == "docs" else page_of(inside.as_posix())
    if broken := links.mistakes(path, ROOT):
        print("\n".join(broken), file=sys.stderr)
        return 1
    config = load_config(str(ROOT / "mkdocs.yml"))
    config.extra[ONLY] = page
    site = Path(config.site_dir)
    written = Path(os.path.relpath(site / Path(page).with_suffix(".html")))
    if not (site / "index.html").is_file():
        print("there is no site yet: make docs builds it as a whole", file=sys.stderr)
        return 1
    index = site / _INDEX
    kept = index.read_bytes() if index.is_file() else None
    logging.getLogger("mkdocs").setLevel(logging.ERROR)  # the links were checked above
    print(f"building {written} …", flush=True)
    build(config, dirty=True)
    if kept is not None:
        index.write_bytes(kept)
    print(f"{written}: built in {time.monotonic() - began:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
