"""How regularly streams came: rates, gaps and the usual time between two samples, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from tgl_soar.analysis.logs.flight_data import FlightData
from tgl_soar.analysis.report.streams import Stream, streams_of


def received(**times_s: list[float]) -> list[Stream]:
    streams = {name: np.array(times) for name, times in times_s.items()}
    return streams_of(FlightData(name="", kind="", streams=streams))


def even(step_s: float, count: int = 101) -> list[float]:
    return [step_s * n for n in range(count)]


def test_an_even_stream_has_its_rate_and_no_gap() -> None:
    (stream,) = received(a=even(0.02))
    assert (stream.name, stream.samples, stream.gaps) == ("a", 101, 0)
    assert stream.rate_hz == pytest.approx(50.0)
    assert stream.usual_s == pytest.approx(0.02)
    assert stream.late_s == pytest.approx(0.02)
    assert stream.longest_s == pytest.approx(0.02)


def test_the_longest_gap_is_reported_with_when_it_began() -> None:
    times = even(0.02)
    times = times[:40] + [t + 0.5 for t in times[40:]]
    (stream,) = received(a=times)
    assert stream.longest_s == pytest.approx(0.52)
    assert stream.longest_at_s == pytest.approx(0.78)
    assert stream.gaps == 1
    assert stream.rate_hz == pytest.approx(100.0 / 2.5)
    assert stream.usual_s == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("step_s", "gap_s", "gaps"),
    [
        (0.01, 0.099, 0),  # a tenth of a second at least
        (0.01, 0.101, 1),
        (0.1, 0.49, 0),  # and five times what is usual
        (0.1, 0.51, 1),
    ],
)
def test_a_gap_is_a_tenth_of_a_second_and_five_times_the_usual(
    step_s: float, gap_s: float, gaps: int
) -> None:
    times = even(step_s, 50)
    (stream,) = received(a=[*times, times[-1] + gap_s, times[-1] + gap_s + step_s])
    assert stream.gaps == gaps


def test_one_step_of_a_hundred_is_later_than_what_is_late() -> None:
    """Of two hundred steps the three longest: the 99th per cent lies among them."""
    steps = [0.01] * 197 + [0.03, 0.04, 0.05]
    (stream,) = received(a=[0.0, *np.cumsum(steps).tolist()])
    assert stream.late_s == pytest.approx(np.percentile(steps, 99.0))
    assert 0.03 < stream.late_s < 0.04


def test_streams_of_a_few_samples_or_of_no_time_are_left_out() -> None:
    found = received(few=even(0.1, 9), enough=even(0.1, 10), still=[3.0] * 50)
    assert [stream.name for stream in found] == ["enough"]


def test_the_fastest_stream_comes_first() -> None:
    found = received(slow=even(0.5), fast=even(0.005), middle=even(0.05))
    assert [stream.name for stream in found] == ["fast", "middle", "slow"]
