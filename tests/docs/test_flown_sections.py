"""Sections with flown figures, on pages that are written by hand, are of what flies now or say
that they are older."""

from __future__ import annotations

import re
from functools import cache, partial
from pathlib import Path

import pytest
from benchmarks.page import BEGIN, END

from tgl_soar.analysis.experiments import staleness, staleness_probes
from tgl_soar.analysis.experiments.pages import AIMS, OWN_PAGES, PAPER
from tgl_soar.analysis.experiments.staleness_probes import (
    BY_HAND,
    DISPERSED,
    FURTHER,
    IN_TUNNEL,
    OVER_HILL,
    SEARCHING,
    SECTIONS,
    STEPPING,
    probe_for,
    probe_for_page,
    stamped,
)

DOCS = Path(__file__).parents[2] / "docs"
# The table that `make bench` writes has its own marks.
BENCH = "docs/performance.md"
soaring = cache(staleness.probe)


@cache
def further(name: str) -> tuple[float, float]:
    return FURTHER[name]()


def section_of(page: str, name: str) -> tuple[str, str]:
    """The command that writes a section, and what is written."""
    text = (DOCS / page).read_text(encoding="utf-8")
    found = re.findall(
        rf"<!-- {re.escape(name)}: begin; written by `([^`]+)` -->(.*?)<!-- {re.escape(name)}: end",
        text,
        flags=re.DOTALL,
    )
    assert len(found) == 1, f"docs/{page}: marks of {name}"
    command, written = found[0]
    return command, written


@pytest.mark.parametrize(("page", "name"), SECTIONS)
def test_a_section_is_of_what_flies_or_says_that_it_is_older(page: str, name: str) -> None:
    command, written = section_of(page, name)
    now = soaring() | {each: further(each) for each in SECTIONS[page, name]}
    older = staleness.differences(written, now)
    says_so = staleness_probes.OLDER in written
    assert says_so == bool(older), (
        f"docs/{page}: {older}; {command}, or say {staleness_probes.OLDER}"
    )
    assert (
        not says_so or command in written.partition(staleness_probes.OLDER)[2].partition("\n\n")[0]
    )


@pytest.mark.parametrize(("page", "name"), BY_HAND)
def test_what_was_copied_is_of_what_flies_or_says_that_it_is_older(page: str, name: str) -> None:
    text = (DOCS / page).read_text(encoding="utf-8")
    (copied,) = re.findall(
        rf"<!-- {name}: begin; copied by hand [^>]+ -->(.*?)<!-- {name}: end -->", text, re.DOTALL
    )
    older = staleness.differences(
        copied, soaring() | {each: further(each) for each in BY_HAND[page, name]}
    )
    assert (staleness_probes.OLDER in copied) == bool(older), f"docs/{page}: {older}"


@pytest.mark.parametrize(("page", "name"), SECTIONS)
def test_a_section_is_what_a_command_wrote(page: str, name: str) -> None:
    command, written = section_of(page, name)
    assert staleness.is_as_written(written), f"docs/{page}, {name}: edited by hand; {command}"


def test_every_section_that_a_command_writes_is_looked_at() -> None:
    written = {
        (file.name, name)
        for file in DOCS.glob("*.md")
        for name in re.findall(
            r"^<!-- ([^:]+): begin; written by", file.read_text(encoding="utf-8"), re.MULTILINE
        )
    }
    assert written == set(SECTIONS)
    assert {(page, name) for name, page in OWN_PAGES.items()} <= written
    assert {each for names in SECTIONS.values() for each in names} == set(FURTHER)


def test_timings_are_of_the_laws_that_fly_or_say_that_they_are_older() -> None:
    """Of another law they would be other numbers: its flights end elsewhere."""
    text = (DOCS.parent / BENCH).read_text(encoding="utf-8")
    older = staleness.differences(text, soaring())
    assert (staleness.OLDER in text) == bool(older), f"{BENCH}: {older}; make bench"
    table = text.partition(BEGIN)[2].partition(END)[0]
    assert staleness.is_as_written(table), f"{BENCH}: edited by hand; make bench"


def test_a_section_carries_its_own_probes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(staleness_probes, "probe", lambda: {"tunnel": (1.0, 2.0)})
    for n, name in enumerate(("a brake", *DISPERSED)):
        monkeypatch.setitem(FURTHER, name, partial(tuple[float, float], (3.0, float(n))))
    ends = probe_for("point.md", "point")
    assert list(ends) == ["tunnel", "a brake", *DISPERSED]
    assert list(ends.values()) == [(1.0, 2.0), (3.0, 0.0), (3.0, 1.0), (3.0, 2.0)]
    assert list(probe_for_page(PAPER)) == ["tunnel", *DISPERSED]
    assert list(probe_for_page(AIMS)) == ["tunnel", IN_TUNNEL]
    text = stamped("point.md", "point", "| a | b |\n")
    assert text.startswith(f"| a | b |\n\n{staleness.mark(ends)}\n")
    assert staleness.is_as_written(text)
    assert staleness.differences(text, ends) == []
    assert list(probe_for("gym.md", "baseline")) == ["tunnel"]


def test_the_probes_do_what_they_are_named_for() -> None:
    """None of them ends where the flight without it does."""
    plain = staleness_probes._changed("speed", 25.0, {})
    for name in ("home from the hill", "beating"):
        assert max(abs(a - b) for a, b in zip(further(name), plain, strict=True)) > 0.01, name
    point = staleness_probes._changed("point", 15.0, {}, staleness_probes.EVERY)
    assert abs(further("a brake")[1] - point[1]) > 0.01
    filed = staleness_probes._changed("static", staleness.PROBED_S, {}, staleness_probes.EVERY)
    assert max(abs(a - b) for a, b in zip(further(IN_TUNNEL), filed, strict=True)) > 0.01
    filed = staleness_probes._changed("speed", staleness.PROBED_S, {}, staleness_probes.EVERY)
    assert max(abs(a - b) for a, b in zip(further(OVER_HILL), filed, strict=True)) > 0.01
    for other in (further("a search"), further(OVER_HILL)):
        assert max(abs(a - b) for a, b in zip(further(SEARCHING), other, strict=True)) > 0.01
    quiet = staleness_probes._changed("static", 12.0, {}, staleness_probes.EVERY)
    assert further("faults") != pytest.approx(quiet, abs=1e-3)
    steady = staleness_probes._changed("speed", 12.0, {}, staleness_probes.EVERY)
    assert further(STEPPING) != pytest.approx(steady, abs=1e-3)
