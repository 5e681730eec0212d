"""Whether a page is of the laws that there are now, by where its probes end."""

from __future__ import annotations

import pytest

from tgl_soar.analysis.experiments.staleness import SAME_M, differences, mark, marked

ENDS = {"tunnel": (1.25, 0.5), "hill": (-4.0, 13.0)}


def page(ends: dict[str, tuple[float, float]] = ENDS) -> str:
    return f"# Experiments\n\nText.\n\n{mark(ends)}\n"


def test_what_a_page_holds_is_read_back() -> None:
    assert marked(page()) == ENDS
    assert marked("# Experiments\n") is None


def test_the_same_ends_are_no_difference() -> None:
    assert differences(page(), ENDS) == []
    close = {name: (x + 0.5 * SAME_M, z - 0.5 * SAME_M) for name, (x, z) in ENDS.items()}
    assert differences(page(), close) == []


@pytest.mark.parametrize("moved_m", [1e-6, -1e-6])
@pytest.mark.parametrize("axis", [0, 1])
def test_an_end_elsewhere_is_named_whichever_way_it_went(axis: int, moved_m: float) -> None:
    x, z = ENDS["hill"]
    elsewhere = (x + moved_m, z) if axis == 0 else (x, z + moved_m)
    assert differences(page(), {**ENDS, "hill": elsewhere}) == ["hill: ends 1.0e-06 m elsewhere"]


def test_an_end_that_is_no_number_is_a_difference() -> None:
    assert len(differences(page(), {**ENDS, "hill": (float("nan"), 13.0)})) == 1


def test_a_page_of_other_probes_or_none_says_so() -> None:
    assert differences(page(), {"tunnel": ENDS["tunnel"]}) == [
        "the page has the probes tunnel, hill; there are tunnel"
    ]
    assert differences("# Experiments\n", ENDS) == ["the page holds no probes"]
