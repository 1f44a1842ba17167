"""Hooks of `mkdocs build`: pages that are made, links that leave docs/, a check that pages load nothing from afar."""

from __future__ import annotations

import logging
import re
import time
from collections.abc import Iterator

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.nav import Navigation
from mkdocs.structure.pages import Page

from docs._hooks import links, live, one_page, reference, repository

_HOST = r'"((?:https?:)?//[^"]+)"'
_LOADED = re.compile(
    rf"<(?:script|img|iframe|source)\b[^>]*\bsrc={_HOST}"
    rf'|<link\b[^>]*\brel="(?:stylesheet|preconnect|preload)"[^>]*\bhref={_HOST}'
)


_LOG = logging.getLogger("mkdocs.hooks.build")
_REPORT_S = 3.0  # between two lines of progress


class _Progress:
    """Says now and then how many of the pages are built: reading all modules takes minutes."""

    def __init__(self, total: int) -> None:
        self._done, self._total, self._said_s = 0, total, time.monotonic()

    def page(self, name: str) -> None:
        """Counts a page that is going to be built."""
        self._done += 1
        if time.monotonic() - self._said_s >= _REPORT_S:
            self._said_s = time.monotonic()
            _LOG.info("page %d of %d: %s", self._done, self._total, name)


def on_nav(nav: Navigation, config: MkDocsConfig, files: Files) -> Navigation:
    """Counts the pages."""
    config.extra["progress"] = _Progress(len(files.documentation_pages()))
    return nav


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Completes the navigation by what isn't listed by hand: modules, and pages of the repository's own files."""
    config.mdx_configs["toc"] = {**config.mdx_configs.get("toc", {}), "slugify": links.slugify}
    for section in config.nav or []:
        if "Reference" in section:
            section["Reference"].append({"Modules": reference.modules_nav()})
        if "Development" in section:
            names = [name for name in repository.ALWAYS if (repository.ROOT / name).is_file()]
            section["Development"] += [{_title(name): repository.page_of(name)} for name in names]
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the pages that are made; where one page alone is built, without what takes long."""
    only = config.extra.get(one_page.ONLY)
    for page, text in _made() if only is None else one_page.made_before():
        files.append(File.generated(config, page, content=text))
    for path in repository.mirrored():
        page, content = repository.page_of(path), repository.content_of(path)
        if content is None:
            files.append(File.generated(config, page, abs_src_path=str(repository.ROOT / path)))
        else:
            files.append(File.generated(config, page, content=content))
    if only is not None:
        one_page.keep_others(files, only)
    return files


def _made() -> Iterator[tuple[str, str]]:
    """The pages of the reference and the live holograms, with their contents."""
    yield from reference.modules().items()
    yield reference.PYTHON, reference.python()
    _LOG.info("asking every command for its help …")
    yield reference.COMMAND_LINE, reference.command_line()
    _LOG.info("computing the live holograms …")
    yield from live.pages().items()


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turns links to files of the repository into links between pages."""
    config.extra["progress"].page(page.file.src_uri)
    if page.file.src_uri.startswith("reference/"):
        return markdown
    markdown = repository.rewritten(markdown, page.file.src_uri)
    if page.file.src_uri == live.GALLERY:
        return live.with_gallery(markdown)
    return live.embedded(markdown) if page.is_homepage else markdown


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """Refuses a page that loads anything from another host."""
    if found := _LOADED.search(output):
        raise PluginError(f"{page.file.src_uri} loads {found[1] or found[2]}; a page must need no other host")
    return output


def _title(name: str) -> str:
    return {"LICENSE": "Licence"}.get(name, name.partition(".")[0].capitalize())
