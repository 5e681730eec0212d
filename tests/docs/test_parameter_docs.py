"""The reference page is that of the declaration, and the declaration can be read."""

import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from tgl_soar.cli.params_page import page
from tgl_soar.config.parameter_groups import GROUPS
from tgl_soar.config.parameters import PARAMETERS
from tgl_soar.onboard.process import main

PAGE = Path(__file__).parents[2] / "docs/parameters.md"
MAKE = "tgl-soar params --markdown > docs/parameters.md"


def test_the_page_is_not_stale() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), f"stale: {MAKE}"


def test_the_command_prints_the_page() -> None:
    command = [sys.executable, "-m", "tgl_soar.cli", "params", "--markdown"]
    printed = subprocess.run(command, capture_output=True, check=True, timeout=60).stdout
    assert printed.decode() == page()


def test_every_parameter_is_in_one_group_and_no_group_is_empty() -> None:
    prefixes = Counter(prefix for group in GROUPS for prefix in group.prefixes)
    assert set(prefixes.values()) == {1}
    assert {p.name.partition("_")[0] for p in PARAMETERS} == set(prefixes)
    rows = [line for line in page().splitlines() if line.startswith("| `")]
    for p in PARAMETERS:
        assert sum(row.startswith(f"| `{p.name}` |") for row in rows) == 1
    for group in GROUPS:
        assert group.sentence.endswith(".")


def test_all_that_no_file_may_give_is_named() -> None:
    (paragraph,) = [p for p in page().split("\n\n") if "can only be set over the air" in p]
    for p in PARAMETERS:
        assert (f"`{p.name}`" in paragraph) is not p.in_files


def test_a_table_row_has_as_many_cells_as_its_head() -> None:
    for line in page().splitlines():
        if line.startswith("| `") and "…" in line:
            assert line.replace("\\|", "").count("|") == 7, line


def test_every_name_goes_over_the_wire() -> None:
    for p in PARAMETERS:
        assert len(p.name) <= 16
        assert p.name.isascii()
        assert p.meaning.endswith(".")
        assert p.minimum <= p.default <= p.maximum


def test_the_flying_command_says_where_the_reference_is(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit, match="0"):
        main(["--help"])
    printed = capsys.readouterr().out
    assert "tgl-soar params" in printed
    assert "docs/parameters.md" in printed
