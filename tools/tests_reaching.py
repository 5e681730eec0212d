"""Which test files reach a module, by what imports what, the nearest first."""

from __future__ import annotations

import ast
from collections import deque
from pathlib import Path

PACKAGE = "tgl_soar"


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
                if imported := self._files.get(name):
                    self._importers.setdefault(imported, set()).add(path)

    def tests_of(self, path: Path) -> list[Path]:
        """Test files that reach a file (relative paths): those that mirror it, then those of the
        same folder and others by the number of imports between, small ones first."""
        steps = {self._root / path: 0}
        queue = deque(steps)
        while queue:
            each = queue.popleft()
            for importer in self._importers.get(each, ()):
                if importer not in steps:
                    steps[importer] = steps[each] + 1
                    queue.append(importer)
        mirror = Path("tests", *path.parent.parts[2:])
        reached = {file: n for file, n in steps.items() if file.name.startswith("test_")}
        mirrored = self._root / mirror / f"test_{path.stem}.py"
        if mirrored.is_file():
            reached.setdefault(mirrored, 0)

        def order(file: Path) -> tuple[bool, int, bool, int]:
            away = file.parent != self._root / mirror
            return file != mirrored, reached[file], away, file.stat().st_size

        return [file.relative_to(self._root) for file in sorted(reached, key=order)]


def _named(folder: Path, pattern: str) -> dict[str, Path]:
    """Files by the names under which they are imported."""
    found = {}
    for path in sorted(folder.glob(pattern)):
        parts = path.relative_to(folder).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def _imported(path: Path) -> set[str]:
    """The names of what a file may import, at any place in it; some of these are no modules."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    return names
