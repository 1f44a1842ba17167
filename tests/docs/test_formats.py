"""The page of file formats names every format that the program writes, with its version."""

from __future__ import annotations

import re

from docs._hooks.repository import ROOT


def test_the_page_has_the_formats_of_the_program() -> None:
    source = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "holoview").rglob("*.py"))
    written = set(re.findall(r'"(holoview-[a-z-]+)",\s+(?:version=)?"?(\d+)\b', source))
    rows = re.findall(r"^\|(.*)\|(.*)\|(.*)\|(.*)\|$", (ROOT / "docs/formats.md").read_text(encoding="utf-8"), re.M)
    promised = {(name, row[2].strip()) for row in rows for name in re.findall(r"`(holoview-[a-z-]+)`", row[1])}
    assert len(written) > 10 and written == promised
