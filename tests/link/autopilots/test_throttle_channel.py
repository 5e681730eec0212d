"""The throttle on the wire: sent only while power is asked for, else the pilot's."""

from __future__ import annotations

from math import inf, nan

import pytest

from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import (
    ConfigError,
    airframe_from,
    load_airframe,
    load_parameters,
    load_site,
    shipped,
    value_refusal,
)
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.link.autopilots.requirements import Needs
from tgl_soar.onboard.setup import flavour_of, setup_from
from tgl_soar.types import NO_SETPOINTS, SurfaceCommand

PATH = shipped("airframes/eclipson_c_propeller.toml")
TEXT = PATH.read_text(encoding="utf-8")
SITE = shipped("sites/hill.toml")
LEAVE = 65535
UP = SurfaceCommand(0.1, -0.2, 0.3)
NEEDS = Needs(loop_rate_hz=200.0, override_system=255, external_pose=False, gps=False)


def plane(firmware: str = "bridge", route: str = "", channel: int = 3) -> Airframe:
    text = TEXT.replace('firmware = "bridge"', f'firmware = "{firmware}"{route}')
    return airframe_from(text.replace("channel = 3", f"channel = {channel}"), "plane.toml")


def sent(craft: Airframe, throttle: float) -> tuple[int, ...]:
    (message,) = flavour_of(craft).commands(UP, NO_SETPOINTS, throttle)
    return message.channels  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("throttle", "pulse"), [(1.0, 2000), (0.5, 1500), (0.001, 1001), (7.0, 2000), (inf, 2000)]
)
def test_power_goes_over_all_of_its_channel(throttle: float, pulse: int) -> None:
    assert sent(plane(), throttle)[2] == pulse
    assert sent(plane(channel=9), throttle)[8] == pulse


@pytest.mark.parametrize("throttle", [0.0, -1.0, nan])
def test_without_power_the_channel_is_the_pilots(throttle: float) -> None:
    assert sent(plane(), throttle)[2] == 0  # released
    assert sent(plane(channel=9), throttle)[8] == 65534


def test_an_aircraft_without_touches_no_throttle() -> None:
    without = load_airframe(shipped("airframes/eclipson_c.toml"))
    assert sent(without, 1.0)[2] == LEAVE
    assert sent(without, 1.0) == sent(without, 0.0)


def test_releasing_gives_the_throttle_back() -> None:
    (released,) = flavour_of(plane()).release()
    assert [i + 1 for i in range(8) if released.channels[i] == 0] == [1, 2, 3, 4]  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("firmware", "route"),
    [
        ("px4", ""),
        ("px4", '\nroute = "manual_control"'),
        ("paparazzi", ""),
        ("ardupilot", '\nroute = "attitude"'),
    ],
)
def test_a_route_without_a_throttle_refuses_the_file(firmware: str, route: str) -> None:
    with pytest.raises(ConfigError, match="takes no throttle of ours"):
        flavour_of(plane(firmware, route))


def test_what_an_arduplane_has_to_be_set_to() -> None:
    rows = flavour_of(plane("ardupilot")).requirements(NEEDS)
    wanted = {name: row.wanted for row in rows for name in row.names}
    assert (wanted["SERVO3_FUNCTION"], wanted["RCMAP_THROTTLE"]) == (70.0, 3.0)
    assert (wanted["RC3_MIN"], wanted["SERVO3_MAX"]) == (1000.0, 2000.0)
    without = TEXT.replace("throttle = {", "# throttle = {")
    rows = flavour_of(airframe_from(without, "p.toml")).requirements(NEEDS)
    assert not any("3_" in name for row in rows for name in row.names)


def test_a_budget_without_a_propeller_is_refused() -> None:
    airframe, site = load_airframe(shipped("airframes/eclipson_c.toml")), load_site(SITE)
    known, none = airframe.aerodynamics(), frozenset[int]()
    assert value_refusal("THR_BUDGET", 0.0, none, known) == ""
    assert "no propeller" in value_refusal("THR_BUDGET", 5.0, none, known)
    assert value_refusal("THR_BUDGET", 5.0, none, plane().aerodynamics()) == ""
    assert value_refusal("TGL_X", 5.0, frozenset({5}), known) == ""
    with pytest.raises(ConfigError, match=r"THR_BUDGET = 5: no propeller"):
        setup_from(airframe, site, ParameterSet().changed({"THR_BUDGET": 5.0}))
    text = shipped("airframes/eclipson_c.toml").read_text(encoding="utf-8")
    wrong = airframe_from(text.replace("[parameters]\n", "[parameters]\nTHR_BUDGET = 9\n"), "p")
    with pytest.raises(ConfigError, match=r"plane\.toml: parameters\.THR_BUDGET = 9: no propeller"):
        load_parameters(wrong, "plane.toml", site, SITE)


def test_its_channel_can_be_no_switch() -> None:
    site = load_site(SITE)
    with pytest.raises(ConfigError, match="moves a surface: 1 to 18 but none of 1, 2, 3, 4"):
        setup_from(plane(), site, ParameterSet().changed({"OP_RC_CHAN": 3.0}))
