"""Every link in the pages leads somewhere."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_CODE = re.compile(r"```.*?```|`[^`\n]*`", re.DOTALL)
_HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)
_NAMED = re.compile(r'<a id="([^"]+)">')


def anchors(page: Path) -> set[str]:
    """The places of a page that can be linked to: its headings, and what has a name."""
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    headings = {
        re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-")
        for heading in _HEADING.findall(text)
    }
    return headings.union(_NAMED.findall(text))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_relative_link_and_picture_is_there(page: Path) -> None:
    broken = []
    for link in _LINK.findall(_CODE.sub("", page.read_text())):
        if re.match(r"[a-z]+:", link):
            continue
        name, _, anchor = link.partition("#")
        target = page.parent / name if name else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            broken.append(link)
    assert not broken, f"{page.relative_to(ROOT)}: {broken}"


# Programs and sources of others, by the names that those have.
OF_OTHERS = {"mavlogdump.py", "modules/datalink/mavlink.c"}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_file_in_the_source_that_a_page_names_is_there(page: Path) -> None:
    """By its path from the clone, from the package, or (a page) from the manual."""
    named = set(
        re.findall(r"`((?:[\w-]+/)*[\w.-]*\w\.(?:py|c|toml|service|jsonl))`", page.read_text())
    )
    of_a_place = {"airframe.toml", "site.toml", "tgl-soar.service"}  # made by `tgl-soar init`
    places = (ROOT, ROOT / "src" / "tgl_soar", ROOT / "docs")
    missing = [
        name
        for name in sorted(named - OF_OTHERS - of_a_place)
        if not any((place / name).is_file() for place in places)
    ]
    assert not missing
