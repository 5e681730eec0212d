"""The documentation as a site: `make docs` builds it from the pages as they stand.

README and papers are pages of it too, so that every link between them holds on a forge, in the
wheel and here.  Nothing is fetched to build it.
"""

import re
from pathlib import Path

from sphinx.application import Sphinx

ROOT = Path(__file__).parent
PAPERS = ("CONTRIBUTING", "CHANGELOG", "SECURITY")
# In the order in which a newcomer wants them; every page is in one of these, or the build fails.
CHAPTERS = {
    "Fly": (
        "operator", "outdoors", "point", "page", "sites", "hardware", "autopilots", "optitrack",
        "sensors", "safety", "modes",
    ),
    "Look up": ("files", "parameters", "logs"),
    "Understand": (
        "theory", "margins", "experiments", "aims", "campaigns", "gym", "search",
        "identification", "performance",
    ),
    "Change": ("architecture", "decisions/index", "mutants"),
}  # fmt: skip

project = "tgl_soar"
extensions = ["myst_parser", "sphinxcontrib.mermaid"]
root_doc = "README"
include_patterns = ["README.md", *(f"{name}.md" for name in PAPERS), "docs/**.md"]
source_suffix = {".md": "markdown"}
myst_heading_anchors = 4  # as forges make them
myst_fence_as_directive = ["mermaid"]
html_theme = "furo"
html_title = "tgl_soar"
html_copy_source = False
suppress_warnings = ["myst.header"]  # generated tables stand two levels below their page


def _contents(caption: str, pages: tuple[str, ...] | list[str]) -> str:
    return f"\n```{{toctree}}\n:hidden:\n:caption: {caption}\n\n" + "\n".join(pages) + "\n```\n"


def _for_a_site(_app: Sphinx, name: str, source: list[str]) -> None:
    """What a site needs and a forge would show as odd text: places by name, and chapters."""
    source[0] = re.sub(r'(?m)^<a id="(\w+)"></a>$', r"(\1)=", source[0])
    if name == root_doc:
        for caption, pages in CHAPTERS.items():
            source[0] += _contents(caption, [f"docs/{page}" for page in pages])
        source[0] += _contents("Papers", PAPERS)
    elif name == "docs/decisions/index":
        found = sorted(path.stem for path in (ROOT / "docs" / "decisions").glob("*.md"))
        source[0] += _contents("Decisions", [page for page in found if page != "index"])


def _front_door(app: Sphinx, error: Exception | None) -> None:
    """Who opens the folder lands on the README."""
    if error is None:
        page = '<!doctype html><meta http-equiv="refresh" content="0; url=README.html">'
        (Path(app.outdir) / "index.html").write_text(page + "\n", encoding="utf-8")


def setup(app: Sphinx) -> None:
    app.connect("source-read", _for_a_site)
    app.connect("build-finished", _front_door)
