"""Files outside docs/ that pages link to, as pages of the site.

On a repository's page `../presets/mine.toml` is a file beside docs/; a site has pages only. So whatever a page links to
outside docs/ becomes a page here, and the link is rewritten to it: Markdown as it is, other text in a block of code, a
folder as a list, a picture as a picture, and a module of the package as its page of the reference.
"""

from __future__ import annotations

import posixpath
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from docs._hooks.links import Link, links_of

ROOT = Path(__file__).resolve().parents[2]
DOCS = "docs"
README = "README.md"
MIRROR = "repository"
MODULES = "reference/modules"
ALWAYS = ("CONTRIBUTING.md", "CHANGELOG.md", "LICENSE")
"""Files that get a page wherever they exist, linked or not."""
_PICTURES = {".png", ".jpg", ".jpeg", ".svg", ".gif"}
_LANGUAGES = {".py": "python", ".toml": "toml", ".wgsl": "rust", ".sh": "sh", ".yml": "yaml", ".csv": "text"}


def page_of(path: str) -> str:
    """The site's page or file for a path of the repository, both with / and relative to their roots."""
    place = PurePosixPath(path)
    if path == README:
        return "index.md"
    if place.is_relative_to(DOCS):
        inside = place.relative_to(DOCS).as_posix()
        return inside if (ROOT / path).is_file() else f"{MIRROR}/{path}/index.md"
    if (ROOT / path).is_dir():
        return page_of(f"{path}/{README}") if (ROOT / path / README).is_file() else f"{MIRROR}/{path}/index.md"
    if place.suffix == ".py" and place.parts[0] == "holoview":
        return module_page(path)
    return f"{MIRROR}/{path}" if place.suffix in (".md", *_PICTURES) else f"{MIRROR}/{path}.md"


def module_page(path: str) -> str:
    """The page of a module's reference, for its file's path."""
    place = PurePosixPath(path).with_suffix("")
    if place.name == "__init__":
        place = place.parent / "index"
    return f"{MODULES}/{place}.md"


def source_of(page: str) -> str:
    """The repository's Markdown file that a page of the site was made from; the inverse of `page_of` for those."""
    if page == "index.md":
        return README
    prefix = f"{MIRROR}/"
    return page.removeprefix(prefix) if page.startswith(prefix) else f"{DOCS}/{page}"


def rewritten(text: str, page: str) -> str:
    """A page's text with the links of its repository file turned into links between pages."""
    source = source_of(page)
    pieces, end = [], 0
    for link in links_of(text):
        pieces += [text[end : link.start], _on_site(link, source, page)]
        end = link.end
    return "".join([*pieces, text[end:]])


def _on_site(link: Link, source: str, page: str) -> str:
    if link.is_external or not link.path:
        return link.target
    path = _path_of(link, source)
    if not (ROOT / path).exists():
        return link.target  # the build's own validation says so
    anchor = f"#{link.anchor}" if link.anchor and path.endswith(".md") else ""
    return posixpath.relpath(page_of(path), posixpath.dirname(page) or ".") + anchor


def _path_of(link: Link, source: str) -> str:
    return posixpath.normpath(posixpath.join(posixpath.dirname(source), link.path))


def mirrored() -> Iterator[str]:
    """Paths of the repository outside docs/ that need a page: those linked, and those that these link to in turn."""
    waiting = [README, *(name for name in ALWAYS if (ROOT / name).is_file())]
    waiting += [path.relative_to(ROOT).as_posix() for path in sorted((ROOT / DOCS).rglob("*.md"))]
    seen = set(waiting)
    while waiting:
        path = waiting.pop()
        if page_of(path).startswith(f"{MIRROR}/") or path == README:
            yield path
        if path.endswith(".md"):
            text = (ROOT / path).read_text(encoding="utf-8")
            linked = {_path_of(link, path) for link in links_of(text) if link.path and not link.is_external}
            new = sorted(one for one in linked - seen if not one.startswith("..") and (ROOT / one).exists())
            waiting += [_with_readme(one) for one in new]
            seen |= set(new)


def _with_readme(path: str) -> str:
    """A folder's README, where it has one: its page stands for the folder."""
    readme = f"{path}/{README}"
    return readme if (ROOT / readme).is_file() else path


def content_of(path: str) -> str | None:
    """The Markdown of a mirrored file's page; None for a picture, which is copied."""
    file = ROOT / path
    if file.is_dir():
        names = sorted(
            f"- `{one.name}{'/' if one.is_dir() else ''}`" for one in file.iterdir() if one.name[0] not in "._"
        )
        return "\n".join([f"# {path}/", "", *names, ""])
    if file.suffix in _PICTURES:
        return None
    text = file.read_text(encoding="utf-8")
    if file.suffix == ".md":
        return text
    return f"# {path}\n\n````{_LANGUAGES.get(file.suffix, 'text')}\n{text.rstrip()}\n````\n"
