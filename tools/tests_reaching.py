"""Which test files reach a module, by what imports what, the nearest first.

Nearer than by its imports is a test file that speaks of what is changed by name, or of what uses it
in the same module (`names_at`).
"""

from __future__ import annotations

import ast
import re
from collections import deque
from collections.abc import Sequence
from functools import cache
from pathlib import Path

PACKAGE = "tgl_soar"
# Short flights of everything that flies: wherever a change acts in flight, they notice.  What all
# experiments conclude, of flights that nobody flew, and what is sent over the wire, likewise.
FLIGHTS = Path("tests/sim/test_kept_flights.py")
KEPT = (
    Path("tests/analysis/experiments/test_conclusions.py"),
    Path("tests/onboard/test_kept_wire.py"),
    FLIGHTS,
)
JUST_BEFORE = 0.5  # imports away: after those that are nearest, before all others


class Imports:
    """What each file of a project imports of it, read from its source."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._files = {
            **_named(root / "src", f"{PACKAGE}/**/*.py"),
            **_named(root, "benchmarks/*.py"),
            **_named(root / "tools", "*.py"),
            # Tests import one another's helpers by their bare names.
            **{path.stem: path for path in sorted((root / "tests").rglob("*.py"))},
        }
        self._importers: dict[Path, set[Path]] = {}
        for path in self._files.values():
            for name in _imported(path):
                for imported in self._meant(name):
                    self._importers.setdefault(imported, set()).add(path)

    def _meant(self, name: str) -> list[Path]:
        """The files of a name; with a dot at its end, of all names that begin so."""
        if name.endswith("."):
            return [path for each, path in self._files.items() if each.startswith(name)]
        return [self._files[name]] if name in self._files else []

    def tests_of(self, path: Path, names: Sequence[str] = ()) -> list[Path]:
        """Test files that reach a file (relative paths): those that mirror it, then those nearest,
        then `KEPT`, then the others by the number of imports between, small ones first.

        names: of what is changed and of what uses it, the nearest first: a test file that speaks of
        the first counts as two imports nearer, of another as one.  The nearest are those that
        import the file and speak of what is changed: their tests cost less than flights do.
        """
        found = {self._root / path: 0}
        queue = deque(found)
        while queue:
            each = queue.popleft()
            for importer in self._importers.get(each, ()):
                if importer not in found:
                    found[importer] = found[each] + 1
                    queue.append(importer)
        mirror = Path("tests", *path.parent.parts[2:])
        reached = {file: n for file, n in found.items() if file.name.startswith("test_")}
        # Of a module with much to test, several files: its name, or that and more; but
        # `test_supervisor_texts.py` is another module's.
        beside = [each.stem for each in (self._root / path.parent).glob("*.py")]
        mirrored = {
            file
            for folder in (self._root / mirror, self._root / mirror / path.stem)
            for file in folder.glob(f"test_{path.stem}*.py")
            if path.stem == max((s for s in beside if mirrors(file.stem, s)), key=len, default="")
        }
        for file in mirrored:
            reached.setdefault(file, 0)

        def order(file: Path) -> tuple[bool, bool, float, bool, int]:
            away = file.parent != self._root / mirror
            spoken = _words(file)
            nearer = 2 if names and names[0] in spoken else int(any(n in spoken for n in names))
            steps: float = reached[file] - nearer
            if file.relative_to(self._root) in KEPT:
                steps = min(steps, JUST_BEFORE)
            named_so = file.stem == f"test_{path.stem}"
            return file not in mirrored, not named_so, steps, away, file.stat().st_size

        return [file.relative_to(self._root) for file in sorted(reached, key=order)]


def mirrors(test: str, module: str) -> bool:
    """Whether a file of tests has the name of a module, or that and more; both without an end."""
    return f"{test}_".startswith(f"test_{module}_")


def names_at(source: str, line: int) -> list[str]:
    """The names of what a line is part of (a method and its class, a function, a constant), then
    those of what uses it in the same module, by way of others too.

    Errors: SyntaxError where it cannot be parsed.
    """
    found: list[str] = []
    uses: dict[str, set[str]] = {}
    for node in ast.parse(source).body:
        used = {name for each in ast.walk(node) for name in _mentioned(each)}
        uses |= dict.fromkeys(_defined(node), used)
        if _holds(node, line):
            methods = node.body if isinstance(node, ast.ClassDef) else []
            inner = [name for each in methods if _holds(each, line) for name in _defined(each)]
            found = [name for name in inner if not name.startswith("__")] + _defined(node)
    for name in found:  # it grows
        found += [user for user, used in uses.items() if name in used and user not in found]
    return found


def _holds(node: ast.stmt, line: int) -> bool:
    return node.lineno <= line <= (node.end_lineno or node.lineno)


def _defined(node: ast.stmt) -> list[str]:
    """What a statement gives a name to."""
    match node:
        case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
            return [name]
        case ast.AnnAssign(target=ast.Name(id=name)):
            return [name]
        case ast.Assign(targets=targets):
            return [each.id for each in targets if isinstance(each, ast.Name)]
    return []


def _mentioned(node: ast.AST) -> list[str]:
    match node:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return [name]
    return []


@cache
def _words(file: Path) -> frozenset[str]:
    """All names in a file of tests."""
    return frozenset(re.findall(r"\w+", file.read_text(encoding="utf-8")))


def _named(folder: Path, pattern: str) -> dict[str, Path]:
    """Files by the names under which they are imported."""
    found = {}
    for path in sorted(folder.glob(pattern)):
        parts = path.relative_to(folder).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def _imported(path: Path) -> set[str]:
    """The names of what a file may import, at any place in it; some of these are no modules.  What
    a name ends with that is put together as it runs is left out: it ends with a dot."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call) and "import_module" in _mentioned(node.func):
            match node.args[0]:
                case ast.JoinedStr(values=[ast.Constant(value=str(begins)), *_]):
                    names.add(begins)
    return names
