"""Gusts: what is claimed of the response, of made-up flights."""

from __future__ import annotations

from tgl_soar.analysis.experiments.paper.gust_response import WindEffect, sensitivity_claims


def gust_change(
    line: str, wind_mps: float, margin: float, at_once_m: float, in_the_end_m: float = 0.0
) -> WindEffect:
    return WindEffect(
        line=line,
        wind_mps=wind_mps,
        sink_mps=1.4,
        updraft_gain=0.15 + margin,
        sink_gain=0.15,
        at_once_m=at_once_m,
        highest_m=0.0,
        in_the_end_m=in_the_end_m,
        predicted_m=0.0,
        at_once_error_m=0.0,
        highest_error_m=0.0,
        in_the_end_error_m=0.0,
    )


def test_gust_tells_the_slopes_from_what_happens_at_once() -> None:
    quasi = [gust_change("a", 8.5, 0.1, 0.02, 0.03), gust_change("c", 9.3, 0.0, 0.0)]
    quasi.append(gust_change("d", 9.6, -0.02, -0.01, -0.02))
    assert [c.holds for c in sensitivity_claims(quasi, 9.3)] == [True, True, True]
    assert [c.by_construction for c in sensitivity_claims(quasi, 9.3)] == [True, False, False]
    thrown = [c._replace(at_once_m=0.02) for c in quasi]
    assert [c.holds for c in sensitivity_claims(thrown, 9.3)] == [True, True, False]
    for k, end_m in ((0, -0.01), (1, 0.02), (2, 0.01)):
        astray = [c._replace(in_the_end_m=end_m) if i == k else c for i, c in enumerate(quasi)]
        assert [c.holds for c in sensitivity_claims(astray, 9.3)] == [True, False, True]
    lost = [quasi[0]._replace(lost=1), *quasi[1:]]
    assert [c.holds for c in sensitivity_claims(lost, 9.3)] == [True, False, False]
