"""The measurement of a propeller's budget: its site, and what it makes of a flight."""

from __future__ import annotations

import sys
from math import isnan, tan
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import measure_throttle
import numpy as np
import pytest
from measure_throttle import LEAN_DEG, PLACE, STAY_S, WIND_MPS, end_of, main, outcome, site_text

from tgl_soar.config.files import load_flight, load_site, shipped
from tgl_soar.config.site import HillAir
from tgl_soar.sim.sitl_options import SitlError, SitlOptions

HILL = shipped("sites/hill.toml").read_text(encoding="utf-8")
STEP_S = 0.2


def truth(fraction: float = 0.25, across_m: float = 0.0) -> dict[str, Any]:
    """Ten seconds held, 20 on the line from 8 m down to 6, a second on the ground."""
    times = np.arange(0.0, 31.0, STEP_S)
    flies = (times >= 10.0) & (times < 30.0)
    z = np.where(flies, PLACE[1] - 0.1 * (times - 10.0), 0.0)
    lean = np.radians(LEAN_DEG)
    x = PLACE[0] - (z - PLACE[1]) * tan(lean) + across_m / np.cos(lean)
    return {
        "time_s": times,
        "x_m": x,
        "z_m": z,
        "throttle": np.where(flies, fraction, 0.0),
        "flying": flies.astype(float),
        "overridden": np.where(times >= 10.0, 1.0, 0.0),
    }


def test_the_site_is_the_hill_with_a_line_upstream_of_its_lift(tmp_path: Path) -> None:
    path = tmp_path / "upstream.toml"
    path.write_text(site_text(HILL))
    site = load_site(path)
    assert isinstance(site.air, HillAir)
    assert site.air.wind_mps == WIND_MPS
    assert site.start is not None
    assert (site.start.x_m, site.start.z_m) == PLACE
    assert site.contour is None
    assert list(site.lines) == ["a"]
    airframe = shipped("airframes/eclipson_c_propeller.toml")
    _, _, values = load_flight(airframe, path)
    assert (values["TGL_X"], values["TGL_Z"], values["TGL_LEAN"]) == (*PLACE, LEAN_DEG)
    assert (values["LND_X"], values["FENCE_X_MIN"]) == (-28.0, -24.0)


def test_a_flight_is_counted_while_the_module_flies_it() -> None:
    found = outcome(truth(), 4.9)
    assert found.flown_s == pytest.approx(20.0)
    assert found.heights_m == pytest.approx((6.02, 8.0))
    assert found.e_rho_m == pytest.approx(0.0, abs=1e-9)
    assert (found.moved_s, found.used_s) == pytest.approx((5.0, 4.9))


def test_what_is_off_the_line_is_measured_across_it() -> None:
    assert outcome(truth(across_m=0.04), 0.0).e_rho_m == pytest.approx(0.04)


def test_a_flight_that_never_began_has_no_numbers() -> None:
    found = outcome({**truth(), "overridden": np.zeros(155)}, 0.0)
    assert (found.flown_s, found.moved_s) == (0.0, 0.0)
    assert all(map(isnan, (*found.heights_m, found.e_rho_m)))


def test_the_end_is_the_last_word_on_the_mode() -> None:
    log = "tgl_soar: capturing: engaged\ntgl_soar: soaring: on the line\n"
    assert end_of(log) == "soaring: on the line"
    assert end_of(log + "tgl_soar: released: throttle used up\ntgl_soar: x\n").endswith("used up")
    assert end_of("tgl_soar: ready\n") == "–"


def test_the_command_prints_a_row_a_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[SitlOptions] = []

    def fly(options: SitlOptions, _: Any) -> Any:
        asked.append(options)
        if options.seed == 2:
            raise SitlError("the bridge ended\n  with words")
        (options.out / "module.log").write_text("tgl_soar: soaring: on the line\n")
        return SimpleNamespace(truth=truth())

    monkeypatch.setattr(measure_throttle, "fly", fly)
    monkeypatch.setattr(measure_throttle, "used_by", lambda _: 4.95)
    line = f"measure_throttle --autopilot ardupilot --firmware plane --seeds 1 2 --out {tmp_path}"
    monkeypatch.setattr(sys, "argv", [*line.split(), "--budgets", "0", "30"])
    assert main() == 0
    rows = capsys.readouterr().out.splitlines()
    assert [row.count("|") for row in rows] == [9] * 6
    assert rows[2] == "| 0 | 1 | 20 | 6.0, 8.0 | 0.0 | 5.00 | 4.95 | soaring: on the line |"
    assert rows[5].endswith("| not flown: the bridge ended |")
    assert asked[2].settings == (("THR_BUDGET", 30.0),)
    assert (asked[2].autopilot, asked[2].stay_s, asked[2].legs) == ("ardupilot", STAY_S, ("a",))
