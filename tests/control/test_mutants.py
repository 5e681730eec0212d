"""The mutation tool itself: it makes the changes that it names, and tells good tests from bad."""

from __future__ import annotations

import ast
from pathlib import Path

import mutate

SOURCE = """
def inside(x: float, most: float) -> bool:
    return not (x > most + 1.0) and True
"""


def test_every_mutant_is_one_change_of_a_function() -> None:
    made = list(mutate.mutants(SOURCE))
    words = [text for _, _, text in made]
    assert "x > most + 1.0  ->  x >= most + 1.0" in words
    assert "most + 1.0  ->  most - 1.0" in words
    assert "True  ->  False" in words
    sources = {ast.unparse(tree) for tree, _, _ in made}
    assert len(sources) == len(made)
    assert ast.unparse(ast.parse(SOURCE)) not in sources
    assert all(line == 3 for _, line, _ in made)


def test_a_mutant_is_noticed_by_a_test_that_looks_and_by_no_other(tmp_path: Path) -> None:
    path = Path("src/tgl_soar/control/envelope.py")
    source = (Path(__file__).parents[2] / path).read_text(encoding="utf-8")
    name = "tgl_soar.control.envelope"
    looks, looks_away = tmp_path / "test_looks.py", tmp_path / "test_looks_away.py"
    use = "from tgl_soar.control.envelope import blocked_side\n\n\ndef test_it() -> None:\n"
    looks.write_text(use + "    assert blocked_side(0.8, 0.8, 0.8) == 1\n", encoding="utf-8")
    looks_away.write_text(use + "    assert blocked_side(0.8, 0.9, 0.8) == 1\n", encoding="utf-8")
    mutant = next(
        tree
        for tree, _, words in mutate.mutants(source)
        if words == "given >= deflection_max  ->  given > deflection_max"
    )
    assert mutate.is_noticed(mutant, name, path, [str(looks)])
    assert not mutate.is_noticed(mutant, name, path, [str(looks_away)])
    assert not mutate.is_noticed(ast.parse(source), name, path, [str(looks)])
