"""The pages as a site: every page has its chapter, and `make docs` builds without a network."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from html.parser import HTMLParser
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote

import pytest

ROOT = Path(__file__).parents[2]
EXTRA = ("sphinx", "myst_parser", "furo", "sphinxcontrib.mermaid")

# As `make docs` calls it, on a computer without a network.
WITHOUT_NETWORK = """
import socket, sys
def unreachable(*_given, **_named):
    raise OSError("there is no network")
socket.getaddrinfo = socket.create_connection = unreachable
socket.socket.connect = socket.socket.connect_ex = unreachable
from sphinx.cmd.build import main
sys.exit(main(sys.argv[1:]))
"""


def chapters() -> dict[str, tuple[str, ...]]:
    for node in ast.parse((ROOT / "conf.py").read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "CHAPTERS":
            return dict(ast.literal_eval(node.value))
    raise AssertionError("conf.py has no CHAPTERS")


def is_installed() -> bool:
    return all(find_spec(name.partition(".")[0]) and find_spec(name) for name in EXTRA)


def test_every_page_is_in_one_chapter() -> None:
    listed = [page for pages in chapters().values() for page in pages]
    pages = sorted(path.stem for path in (ROOT / "docs").glob("*.md"))
    assert sorted(listed) == sorted([*pages, "decisions/index"])


class Links(HTMLParser):
    """What an HTML page refers to, and the places in it that can be referred to."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.places: set[str] = set()
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        del tag
        for name, value in attributes:
            if name == "id" and value:
                self.places.add(value)
            elif name in ("href", "src") and value:
                self.links.append(value)


@pytest.mark.skipif(not is_installed(), reason="needs the extra `docs`: pip install -e '.[docs]'")
def test_the_site_is_built_without_a_network_and_its_links_lead_somewhere(tmp_path: Path) -> None:
    words = ["-W", "--keep-going", "-q", "-d", str(tmp_path / "state"), str(ROOT)]
    site = tmp_path / "site"
    built = subprocess.run(
        [sys.executable, "-c", WITHOUT_NETWORK, *words, str(site)],
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert built.returncode == 0, built.stderr
    sources = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    pages = {source.relative_to(ROOT).with_suffix(".html") for source in sources}
    assert {page for page in pages if not (site / page).is_file()} == set()
    assert "README.html" in (site / "index.html").read_text(encoding="utf-8")
    read = {site / page: Links(site / page) for page in pages}
    broken = []
    for page, found in read.items():
        for link in found.links:
            name, _, place = unquote(link).partition("#")
            if re.match(r"[a-z]+:", name):
                continue
            target = (page.parent / name.partition("?")[0]).resolve() if name else page
            there = target.exists() and (
                not place or target not in read or place in read[target].places
            )
            if not there:
                broken.append(f"{page.relative_to(site)}: {link}")
    assert not broken


def test_make_builds_it_in_the_same_way() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert re.search(r"(?m)^\t\$\(BIN\)/sphinx-build -W --keep-going -q \. out/docs$", makefile)
