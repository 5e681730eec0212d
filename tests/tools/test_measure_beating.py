"""The measurement of beating: its wind, its site, and what it makes of a flight."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import measure_beating
import numpy as np
import pytest
from measure_beating import (
    ENDS_S,
    FALLS_S,
    RAMP_S,
    SLOW_S,
    STANDS_MPS,
    STOOD_S,
    Flown,
    flown,
    main,
    outcome,
    site_of,
    wind_of,
    words,
)

from tgl_soar.config.files import airframe_file, load_flight
from tgl_soar.config.site import HillAir
from tgl_soar.control.supervisor import BEATING, RELEASED, SOARING
from tgl_soar.sim.sitl_options import SitlOptions

BACK_S = FALLS_S + SLOW_S


def test_the_wind_is_too_slow_to_stand_in_for_a_while(tmp_path: Path) -> None:
    record = wind_of(1)
    slow = np.arange(FALLS_S + RAMP_S, BACK_S - RAMP_S, 2.0).tolist()
    winds = [record.wind_mps.at(time_s) for time_s in slow]
    assert 4.0 < np.mean(winds) < 6.0
    for time_s in (0.0, FALLS_S, BACK_S, ENDS_S):
        assert record.wind_mps.at(time_s) == STANDS_MPS
        assert record.veer_rad.at(time_s) == 0.0
    other = wind_of(2)
    assert winds != [other.wind_mps.at(time_s) for time_s in slow]
    assert (site_of(tmp_path / "a", 1).parent / "wind.csv").read_text() == (
        site_of(tmp_path / "b", 1).parent / "wind.csv"
    ).read_text()


def test_the_site_is_the_larger_hill_with_room_to_beat(tmp_path: Path) -> None:
    path = site_of(tmp_path, 1)
    _, site, values = load_flight(airframe_file("eclipson_c"), path)
    assert isinstance(site.air, HillAir)
    assert site.air.radius_m == 30.0
    assert site.air.record == "wind.csv"
    assert site.start is not None
    assert site.start.z_m == pytest.approx(52.75)
    assert values["BEAT_AUTO"] == 1.0
    assert values["BEAT_WIDTH"] == 100.0
    assert values["ESC_AUTO"] == 2.0
    assert values["VEER_MAX"] == 45.0
    assert (values["FENCE_Y_MAX"], values["FENCE_Z_MAX"]) == (150.0, 90.0)
    assert (values["LND_X"], values["ESC_X"]) == (-80.0, -37.5)
    assert site.lines["a"].z_m == pytest.approx(53.25)


def truth(ends_s: float = ENDS_S) -> dict[str, Any]:
    """To and fro by 90 m, a leg in half a minute, 40 m high, at the plane."""
    times = np.arange(0.0, ends_s, 0.02)
    phase = 2.0 * np.pi * times / 60.0
    z = 40.0 + np.sin(phase / 3.0)
    return {
        "time_s": times,
        "x_m": -23.25 - (z - 53.25) * np.tan(np.radians(15.0)) + 2.0,
        "y_m": 90.0 * np.sin(phase),
        "z_m": z,
        "heading_rad": np.where(np.cos(phase) > 0.0, 1.0, -1.0),
    }


def modes(times: Any, again_s: float = 20.0) -> Any:
    beats = (times >= FALLS_S + 12.0) & (times < BACK_S + again_s)
    return np.where(beats, float(BEATING), float(SOARING))


def test_a_flight_is_reported_in_a_row(tmp_path: Path) -> None:
    _, _, values = load_flight(airframe_file("eclipson_c"), site_of(tmp_path, 1))
    flight = truth()
    found = outcome(flight, modes(flight["time_s"]), values)
    assert found.began_s == pytest.approx(12.0)
    assert found.beating_s == pytest.approx(SLOW_S + 8.0)
    assert found.turns == 9
    assert found.heights_m == pytest.approx((39.0, 40.0, 41.0), abs=0.2)
    assert found.aside_m == pytest.approx(90.0, abs=0.1)
    assert found.off_m == pytest.approx((2.0, 2.0), abs=0.01)
    assert found.again_s == pytest.approx(20.0, abs=0.02)
    assert words(found) == "12 | 248 | 9 | 39, 40, 41 | 90 | 2, 2 | 20 | soaring"


def test_a_flight_that_never_beats_has_no_numbers(tmp_path: Path) -> None:
    _, _, values = load_flight(airframe_file("eclipson_c"), site_of(tmp_path, 1))
    flight = truth()
    found = outcome(flight, np.full(flight["time_s"].shape, float(RELEASED)), values)
    assert words(found) == "– | 0 | 0 | –, –, – | – | –, – | – | released"


# The module comes when the firmware has booted, and a long flight has a log of parts.
PARTS = {"flight.ulg": (30.0, 200.0), "flight_part2.ulg": (200.0, ENDS_S)}


class Process:
    """Takes the place of `sitl.fly`: a flight as above, and the module's log of it."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, log: str = "") -> None:
        self.asked: list[SitlOptions] = []
        self.log = log
        monkeypatch.setattr(measure_beating, "fly", self.fly)
        monkeypatch.setattr(measure_beating, "read_log", self.read)

    def fly(self, options: SitlOptions, _: Any) -> Any:
        self.asked.append(options)
        folder = options.out / "logs" / "today"
        folder.mkdir(parents=True)
        for name in PARTS:
            (folder / name).touch()
        (options.out / "module.log").write_text(self.log)
        return SimpleNamespace(truth=truth())

    def read(self, path: Path) -> Any:
        begins, ends = PARTS[path.name]
        times = np.arange(begins, ends, 0.005)
        return SimpleNamespace(topics={"tick": {"timestamp": 1e6 * times, "mode": modes(times)}})


@pytest.mark.parametrize(
    ("autopilot", "without"),
    [("ardupilot", ("ARSPD_TYPE=0",)), ("px4", ("FW_USE_AIRSPD=0", "SYS_HAS_NUM_ASPD=0"))],
)
def test_it_is_flown_in_the_wind_of_its_seed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, autopilot: str, without: tuple[str, ...]
) -> None:
    process = Process(monkeypatch)
    how = Flown(autopilot, Path("firmware"), "attitude", pitot=False)
    first, second = (flown(how, tmp_path / "folder", 3) for _ in range(2))
    assert first == second
    assert first.began_s == pytest.approx(12.0, abs=0.03)
    asked = process.asked[0]
    assert (asked.seed, asked.turbulence, asked.route) == (3, 0.03, "attitude")
    assert asked.autopilot_parameters == without
    assert asked.stay_s == ENDS_S - STOOD_S[autopilot]
    assert not asked.pitot


def test_the_command_prints_a_row_a_seed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    process = Process(monkeypatch, "beating: …\nreleased: outside the fence\n")
    words = ["measure_beating", "--seeds", "4", "5", "--out", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", words)
    assert main() == 0
    rows = capsys.readouterr().out.splitlines()
    assert len(rows) == 4
    assert rows[2] == "| 4 | 12 | 248 | 9 | 39, 40, 41 | 90 | 2, 2 | 20 | outside the fence |"
    assert [row.count("|") for row in rows] == [10] * 4
    assert [each.seed for each in process.asked] == [4, 5]
    assert process.asked[0].pitot


def test_a_firmware_needs_its_program(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["measure_beating", "--autopilot", "ardupilot"])
    with pytest.raises(SystemExit):
        main()
    assert "--firmware names the program" in capsys.readouterr().err
