"""What the measurement of campaigns makes of its numbers, and that its machines are apart."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import measure_campaign
import pytest
from measure_campaign import (
    FirstFlights,
    Look,
    PlainFlight,
    PlainJob,
    Timed,
    draw,
    medians,
    report,
    timed,
)

from tgl_soar.sim.campaign.executors import InLine


def rounds() -> list[Timed]:
    """Two of them: the second a little slower."""
    rates = {
        "in line": (1, 50.0),
        "local, 1 worker": (1, 48.0),
        "local, 2 workers": (2, 90.0),
        "dask, 1 worker": (1, 47.0),
        "dask, 2 workers": (2, 88.2),
        "dask, 2 machines": (2, 85.5),
    }
    return [
        Timed(
            name=name,
            workers=n,
            flights=1000 * n,
            seconds=1000 * n / rate / slow,
            processor_s=(21.0 if name.startswith("dask") else 20.0) * n / slow,
            load=load,
        )
        for slow, load in ((1.0, 0.2), (0.9, 1.1), (1.1, 0.5))
        for name, (n, rate) in rates.items()
    ]


LOOKS = [
    Look(flown=1, seconds=0.1, resident_mib=200.0),
    Look(flown=1001, seconds=11.0, resident_mib=210.0),
    Look(flown=5001, seconds=50.01, resident_mib=211.0),
]


def test_the_report_says_what_was_measured() -> None:
    assert medians(rounds())["dask, 2 workers"] == pytest.approx(88.2)
    page = report(rounds(), LOOKS, 1000)
    # Beside as many local processes: 88.2 of 90, 85.5 of 90, 47 of 48.
    assert "| dask, 2 workers | 88.2 | 2,646 | -2.0 % | 21.0 | +5.0 % | 0.2 … 1.1 |" in page
    assert "| dask, 2 machines | 85.5 | 2,565 | -5.0 % |" in page
    assert "| dask, 1 worker | 47.0 | 1,410 | -2.1 % |" in page
    assert "| in line | 50.0 | 1,500 |  | 20.0 |  |" in page
    assert "1.88 times as fast" in page  # 90 / 48
    assert "10⁶ flights would take 0.39 h on 16 cores" in page  # 10⁶ / (16 · 45 · 3600)
    assert "5,001 flights were flown in 50 s: 100.0 a second" in page
    assert "210.0 MiB after 1,001 of them and 211.0 MiB after the last" in page


def test_without_the_long_campaign_nothing_is_reported_of_it() -> None:
    page = report(rounds(), [], 1000)
    assert "MiB" not in page
    assert "compiled" not in page


def test_a_first_flight_is_timed_before_and_after_the_source_is_compiled() -> None:
    page = report(rounds(), LOOKS, 1000, FirstFlights(cold_s=151.6, warm_s=6.04, worker_s=4.5))
    assert "first flight after 152 s where nobody has compiled this source" in page
    assert "after 6.0 s where somebody has; a new worker of dask after 4.5 s" in page


KEEPS = "import os, pathlib; (pathlib.Path(os.environ['XDG_CACHE_HOME']) / 'kernel').touch()"


@contextmanager
def in_line(groups: Sequence[int], folder: Path, environment: dict[str, str]) -> Iterator[InLine]:
    """In place of a worker: it finds what the processes before it have kept."""
    assert (groups, environment["XDG_CACHE_HOME"]) == ((1,), str(folder / "cache"))
    assert (folder / "cache" / "kernel").exists()
    yield InLine()


def test_the_first_flights_share_a_folder_of_kernels_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(measure_campaign, "FIRST", KEEPS)
    monkeypatch.setattr(measure_campaign, "fly_plain", fly_at_once)
    monkeypatch.setattr(measure_campaign, "cluster", in_line)
    assert min(measure_campaign.first_flights(tmp_path)) > 0.0


def fly_at_once(job: PlainJob) -> PlainFlight:
    return PlainFlight(job.seed, "", 30.0)


def test_rows_that_differ_by_who_flies_them_are_no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measure_campaign, "fly_plain", fly_at_once)
    known = [PlainFlight(0, "", 30.0)]
    assert timed("in line", InLine(), 3, known).flights == 3
    assert [flight.seed for flight in known] == [0, 1, 2]
    known[1] = PlainFlight(1, "", 29.5)
    with pytest.raises(ValueError, match="in line flies seed 1 otherwise"):
        timed("in line", InLine(), 3, known)


def test_the_figure_is_drawn(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    draw(tmp_path / "speed.png", rounds(), LOOKS)
    assert (tmp_path / "speed.png").stat().st_size > 1000


@pytest.mark.long
def test_two_machines_are_two_groups_of_processes(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    with measure_campaign.cluster((1, 1), tmp_path) as machines:
        assert machines.workers == 2
        assert {path.name for path in tmp_path.iterdir()} >= {"machine0", "machine1"}
