"""The measurement of landings: its mission, and what it makes of a flight."""

from __future__ import annotations

import sys
from math import isnan
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import measure_landings
import numpy as np
import pytest
from measure_beating import NO_PITOT
from measure_landings import (
    MADE_FIT,
    Landed,
    main,
    mission_text,
    outcome,
    reported,
    words,
)

from tgl_soar.config.files import load_flight, shipped
from tgl_soar.control.supervisor import BREAKING_OFF, LANDING, RELEASED, SOARING
from tgl_soar.link.autopilots.px4 import MODE_MISSION, MODE_OFFBOARD
from tgl_soar.onboard.firmware_landing import BY_MISSION
from tgl_soar.sim.firmware.mission import read_mission
from tgl_soar.sim.sitl_options import SitlError, SitlOptions

_, SITE, VALUES = load_flight(shipped("airframes/eclipson_c.toml"), shipped("sites/hill.toml"))
BREAKS_S, TAKEN_S, DOWN_S, ENDS_S = 20.0, 23.0, 30.0, 35.0


def truth(lands: bool = True) -> dict[str, Any]:
    """Out from x = -5 m by 3 m/s, down from 12 m by 1.25 m/s, from the break-off on."""
    times = np.arange(0.0, ENDS_S, 0.02)
    since = np.clip(times - BREAKS_S, 0.0, DOWN_S - BREAKS_S)
    flies = (times < DOWN_S) | (not lands)
    return {
        "time_s": times,
        "x_m": -5.0 - 3.0 * since,
        "y_m": np.full(times.shape, 0.5),
        "z_m": 12.5 - 1.25 * since,
        "climb_mps": np.where(flies, -1.25, 0.0),
        "mode": np.where(times < TAKEN_S, MODE_OFFBOARD, MODE_MISSION),
        "flying": flies.astype(float),
    }


def modes(times: Any) -> Any:
    steps = [times < BREAKS_S, times < BREAKS_S + 2.0, times < TAKEN_S]
    return np.select(steps, [SOARING, BREAKING_OFF, LANDING], RELEASED).astype(float)


def test_the_mission_lands_at_the_landing_place(tmp_path: Path) -> None:
    path = tmp_path / "mission.txt"
    path.write_text(mission_text(VALUES))
    home, start, approach, land = read_mission(path)
    assert [item.command for item in (home, start, approach, land)] == [16, 189, 16, 21]
    assert start.frame == 2  # PX4 refuses a DO_LAND_START that has a place
    assert (home.latitude_deg, home.longitude_deg, home.height_m) == (
        land.latitude_deg,
        land.longitude_deg,
        land.height_m,
    )
    assert approach.longitude_deg > land.longitude_deg  # downwind, which is east
    assert approach.height_m - land.height_m == pytest.approx(9.0)
    path.write_text(mission_text(VALUES, lands=False))
    assert [item.command for item in read_mission(path)] == [16, 16]


def test_a_flight_is_reported_in_a_row() -> None:
    flight = truth()
    found = outcome(flight, modes(flight["time_s"]), MODE_MISSION, VALUES)
    assert found.taken_s == pytest.approx(3.0, abs=0.03)
    assert found.taken_at == pytest.approx((-14.0, 8.75), abs=0.1)
    assert found.down_s == pytest.approx(10.0, abs=0.05)
    assert found.down_at == pytest.approx((-35.0, 0.0), abs=0.1)
    assert found.along_m == pytest.approx(7.0, abs=0.1)
    assert (found.across_m, found.sink_mps) == (0.5, 1.25)
    rounded = Landed(
        taken_s=3.0,
        taken_at=(-14.0, 8.75),
        down_s=10.0,
        down_at=(-35.0, 0.04),
        along_m=7.0,
        across_m=0.5,
        sink_mps=1.25,
    )
    assert words(rounded) == "3.0 | -14.0, 8.8 | 10.0 | -35.0, 0.0 | 7.0 | 0.5 | 1.25"


def test_what_did_not_happen_has_no_numbers() -> None:
    flight = truth(lands=False)
    found = outcome(flight, modes(flight["time_s"]), None, VALUES)
    assert all(isnan(number) for number in (found.taken_s, found.down_s, found.sink_mps))
    assert words(found) == "– | – | – | – | – | – | –"
    never = outcome(flight, np.full(flight["time_s"].shape, SOARING), MODE_MISSION, VALUES)
    assert isnan(never.taken_s)


def test_what_the_module_reported_of_it() -> None:
    log = (
        "tgl_soar: landing: away from the slope\n"
        "tgl_soar: released: autopilot mode changed\n"
        "tgl_soar: the autopilot lands: item 2 of its mission\n"
    )
    assert reported(log) == "the autopilot lands: item 2 of its mission; autopilot mode changed"
    assert reported("tgl_soar: ready\n") == "–"
    refused = "tgl_soar: LND_BY 1: its mission has no landing: we land\nreleased: on the ground\n"
    assert reported(refused) == "LND_BY 1: its mission has no landing: we land; on the ground"


def test_the_command_prints_a_row_a_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[SitlOptions] = []

    def fly(options: SitlOptions, _: Any) -> Any:
        asked.append(options)
        if options.seed == 2:
            raise SitlError("the bridge ended\n  with words")
        (options.out / "module.log").write_text("tgl_soar: released: on the ground\n")
        return SimpleNamespace(truth=truth())

    monkeypatch.setattr(measure_landings, "fly", fly)
    monkeypatch.setattr(measure_landings, "modes_of", lambda _, times: modes(times))
    line = "measure_landings --autopilot px4 --firmware px4 --by 0 1 --seeds 1 2"
    line += f" --set FW_LND_ANG=40 --out {tmp_path}"
    monkeypatch.setattr(sys, "argv", line.split())
    assert main() == 0
    rows = capsys.readouterr().out.splitlines()
    assert [row.count("|") for row in rows] == [11] * 6
    assert rows[2] == "| 0 | 1 | – | – | 10.0 | -34.9, 0.0 | 6.9 | 0.5 | 1.25 | on the ground |"
    assert rows[4].startswith("| 1 | 1 | 3.0 | -14.0, 8.8 | 10.0 |")
    assert rows[5].endswith("| not flown: the bridge ended |")
    assert asked[2].settings == (("LND_BY", float(BY_MISSION)),)
    assert asked[2].autopilot_parameters == (*MADE_FIT["px4"], "FW_LND_ANG=40")
    assert asked[2].pitot
    assert asked[2].goes_home
    assert asked[2].mission == tmp_path / "px4-usual-1-1" / "mission.txt"


def test_a_firmware_needs_its_program(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["measure_landings", "--autopilot", "px4"])
    with pytest.raises(SystemExit):
        main()
    assert "--firmware names the program" in capsys.readouterr().err


def test_without_a_tube_the_firmware_is_given_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[SitlOptions] = []

    def fly(options: SitlOptions, _: Any) -> Any:
        asked.append(options)
        raise SitlError("enough")

    monkeypatch.setattr(measure_landings, "fly", fly)
    line = f"measure_landings --autopilot px4 --firmware px4 --by 0 --seeds 1 --out {tmp_path}"
    monkeypatch.setattr(sys, "argv", [*line.split(), "--no-pitot"])
    assert main() == 0
    assert not asked[0].pitot
    assert asked[0].autopilot_parameters == (*MADE_FIT["px4"], *NO_PITOT["px4"])
    assert asked[0].out.name == "px4-usual-0-none-1"
