"""Whether a page is of the laws that there are now, by where its probes end."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from tgl_soar.analysis.experiments import staleness
from tgl_soar.analysis.experiments.flights import ScenarioJob
from tgl_soar.analysis.experiments.scenario import SensorSpec
from tgl_soar.analysis.experiments.staleness import (
    PROBES,
    SAME_M,
    differences,
    is_as_written,
    mark,
    marked,
    probe,
    probed,
    sealed,
)

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


def test_what_is_changed_by_hand_is_noticed_and_a_notice_is_not() -> None:
    text = sealed("# Experiments\n\n| claim | ✗ 9.6 cm |\n", ENDS)
    assert marked(text) == ENDS
    assert is_as_written(text)
    assert is_as_written(text.replace("\n\n|", "\n\n\n|"))
    for edited in (text.replace("✗", "✓"), text.replace("9.6", "0.6"), text.replace("# ", "#")):
        assert not is_as_written(edited)
    for notice in (staleness.OLDER, "> **The figures of this section are older than the laws.**"):
        assert is_as_written(
            text.replace("\n\n|", f"\n\n{notice} `command` flies\nthem anew.\n\n|")
        )
    assert not is_as_written(text.replace("\n\n|", "\n\n> **The figures are fine.**\n\n|"))
    assert not is_as_written(page())
    assert not is_as_written(text + "\n✓ all of it\n")
    assert not is_as_written(text.replace("<!-- sum", "✓ all of it <!-- sum"))
    assert not is_as_written(text.replace("<!-- probes", "<!-- "))


def test_an_end_may_differ_by_a_ten_millionth_of_a_metre() -> None:
    x, z = ENDS["hill"]
    for moved_m, named in ((0.99e-7, 0), (1.01e-7, 1)):
        assert len(differences(page(), {**ENDS, "hill": (x, z + moved_m)})) == named


def test_ends_are_kept_to_the_nanometre() -> None:
    assert marked(page({"tunnel": (1.2345678912, -0.0000000016)})) == {
        "tunnel": (1.234567891, -0.000000002)
    }


def test_probes_are_of_both_airs_all_sensors_and_both_models() -> None:
    assert list(PROBES) == ["tunnel", "hill, accelerations and pitot", "point mass"]
    assert [model for *_, model in PROBES.values()] == ["rigid_body", "rigid_body", "point_mass"]
    plain, full, _ = (sensors for _, sensors, _ in PROBES.values())
    assert plain == SensorSpec()
    assert full == SensorSpec(imu=True, pitot=True)
    sites = [probed(*given).site for given in PROBES.values()]
    assert sites[0] == sites[2] != sites[1]


@pytest.mark.parametrize("name", PROBES)
def test_a_probe_is_four_seconds_in_three_per_cent_of_turbulence_and_no_change(name: str) -> None:
    scenario = probed(*PROBES[name])
    assert (scenario.duration_s, scenario.changes) == (4.0, [])
    assert scenario.turbulence is not None
    assert scenario.turbulence.intensity == 0.03
    assert (scenario.sensors, scenario.model) == PROBES[name][1:]


def test_a_probe_ends_where_its_flight_of_seed_one_does(monkeypatch: pytest.MonkeyPatch) -> None:
    flown: list[ScenarioJob] = []

    def fly(job: ScenarioJob) -> Any:
        flown.append(job)
        n = len(flown)
        return SimpleNamespace(path={"x_m": [9.0, 9.0, 1.5 * n], "z_m": [8.0, 8.0, 0.5 * n]})

    monkeypatch.setattr(staleness, "fly_job", fly)
    ends = probe()
    assert ends == dict(zip(PROBES, [(1.5, 0.5), (3.0, 1.0), (4.5, 1.5)], strict=True))
    assert [job.scenario for job in flown] == [probed(*given) for given in PROBES.values()]
    assert {(job.seed, job.dispersed) for job in flown} == {(1, False)}
