"""What the module takes of airframe and site: channels, identities, needs, sources."""

from __future__ import annotations

from math import isnan, radians
from typing import Any

import pytest
from msgspec.structs import replace

from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import ConfigError, load_airframe, load_parameters, load_site, shipped
from tgl_soar.config.site import Forward, HomePosition, PositionSettings, Sender, Site
from tgl_soar.link.autopilots.requirements import MUST, Requirement, compare, remedy
from tgl_soar.link.messages import Source
from tgl_soar.link.sources import GLOBAL_POSITION, LOCAL_POSITION, MOCAP, VISION
from tgl_soar.onboard.setup import (
    accepted_bridges,
    commanding_source,
    direct_flavour_of,
    flavour_of,
    forwarding_of,
    known_systems,
    needs_of,
    session_of,
    setup_from,
    surface_channels,
    with_values,
)
from tgl_soar.types import OURS

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME, SITE = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
TRACKED = load_site(shipped("sites/tunnel_mocap.toml"))
VALUES = load_parameters(AIRFRAME, AIRFRAME_PATH, SITE, SITE_PATH)
HOME = HomePosition(latitude_deg=52.0, longitude_deg=4.4, altitude_m=20.0)


def by(**changes: Any) -> Airframe:
    return replace(AIRFRAME, autopilot=replace(AIRFRAME.autopilot, **changes))


def at(**changes: Any) -> Site:
    return replace(SITE, position=PositionSettings(**changes))


def test_each_surface_has_its_own_channel_with_its_ends() -> None:
    surfaces, channels = AIRFRAME.surfaces, surface_channels(AIRFRAME)
    for name in ("elevator", "aileron", "rudder"):
        given, taken = getattr(surfaces, name), getattr(channels, name)
        assert taken.channel == given.channel
        assert (taken.pwm_min, taken.pwm_trim, taken.pwm_max) == (
            *(given.pwm_min, given.pwm_trim),
            given.pwm_max,
        )
        assert taken.reversed == given.reversed
    assert len(set(channels.numbers())) == 3
    assert (channels.brake, channels.throttle) == (None, None)


def test_an_unknown_route_is_named_by_its_key_with_those_that_are() -> None:
    with pytest.raises(ConfigError, match=r"^autopilot\.route = 'actuators': .*attitude"):
        flavour_of(by(firmware="ardupilot", route="actuators"))


@pytest.mark.parametrize(
    ("firmware", "route", "system"),
    [("ardupilot", "override", 240), ("px4", "attitude", 3), ("px4", "manual_control", 3)],
)
def test_commands_carry_the_identity_that_the_firmware_obeys(
    firmware: str, route: str, system: int
) -> None:
    airframe = by(
        firmware=firmware, route=route, system_id=3, component_id=77, override_system_id=240
    )
    flavour = flavour_of(airframe)
    assert flavour.route.as_operator is (system == 240)
    assert commanding_source(airframe, flavour) == Source(system, 77)
    setup = setup_from(airframe, SITE, VALUES)
    assert (setup.own, setup.override) == (Source(3, 77), Source(system, 77))


@pytest.mark.parametrize(
    ("firmware", "route", "direct"),
    [
        ("ardupilot", "override", "override"),
        ("ardupilot", "attitude", "override"),
        ("px4", "attitude", "manual_control"),
        ("px4", "actuators", "actuators"),
    ],
)
def test_on_the_bench_surfaces_are_moved_directly(firmware: str, route: str, direct: str) -> None:
    chosen = direct_flavour_of(by(firmware=firmware, route=route))
    assert (chosen.name, chosen.route.name, chosen.route.loops) == (firmware, direct, OURS)


def test_what_the_firmware_must_be_follows_site_and_values() -> None:
    needs = needs_of(by(override_system_id=240), SITE, VALUES)
    assert (needs.override_system, needs.loop_rate_hz) == (240, VALUES["LOOP_RATE"])
    assert (needs.external_pose, needs.gps, needs.lands) == (False, True, False)
    tracked = needs_of(AIRFRAME, replace(TRACKED, forward=Forward()), VALUES)
    assert (tracked.external_pose, tracked.gps) == (True, False)


@pytest.mark.parametrize(("by_mission", "lands"), [(0.0, False), (1.0, True), (2.0, False)])
def test_only_a_landing_of_the_mission_needs_one(by_mission: float, lands: bool) -> None:
    values = VALUES.changed({"LND_BY": by_mission})
    assert needs_of(AIRFRAME, SITE, values).lands is lands
    setup = with_values(setup_from(AIRFRAME, SITE, VALUES), values)
    assert setup.needs is not None
    assert setup.needs.lands is lands
    assert setup.parameters is values
    without = with_values(setup._replace(needs=None), values)
    assert without.needs is None


def test_satellites_are_needed_where_the_site_counts_on_them() -> None:
    for sources, gps in ((["local_position"], False), (["global_position"], True)):
        setup = setup_from(AIRFRAME, at(sources=sources, home=HOME), VALUES)
        assert setup.needs is not None
        assert setup.needs.gps is gps


def requirements_of(firmware: str, site: Site) -> list[tuple[Requirement, ...]]:
    """What is asked of the firmware on the ground and by the flying module."""
    airframe = by(firmware=firmware, route=None)
    ground, flying = needs_of(airframe, site, VALUES), setup_from(airframe, site, VALUES).needs
    assert flying is not None
    return [flavour_of(airframe).requirements(needs) for needs in (ground, flying)]


def test_a_px4_as_it_comes_is_flown_by_satellites_and_not_asked_to_do_without_them() -> None:
    comes = {"EKF2_HGT_REF": 1.0, "EKF2_MAG_TYPE": 0.0, "EKF2_GPS_CTRL": 7.0, "SYS_HAS_GPS": 1.0}
    for rows in requirements_of("px4", load_site(shipped("sites/hill.toml"))):
        found = [f for f in compare(rows, comes) if f.value is not None]
        assert [remedy(f) for f in found if not f.ok and f.requirement.level == MUST] == []


@pytest.mark.parametrize("firmware", ["ardupilot", "px4"])
def test_who_is_sent_poses_is_asked_for_the_same_on_the_ground_as_in_flight(firmware: str) -> None:
    """Poses of a bridge: such a site has no tracker, and satellites must not be asked for too."""
    bridge = PositionSettings(sources=["vision"], vision_from=[Sender(1, 197)])
    forward = Forward(message="vision_position_estimate")
    ground, flying = requirements_of(firmware, replace(SITE, position=bridge, forward=forward))
    assert ground == flying
    wanted = [row for row in ground if row.relation == "is" and row.level == MUST]
    names = [row.names for row in wanted]
    assert len(names) == len(set(names))


def test_a_module_never_starts_engaged() -> None:
    setup = setup_from(AIRFRAME, SITE, VALUES.changed({"OP_ENGAGE": 1.0}))
    assert setup.parameters["OP_ENGAGE"] == 0.0
    assert setup_from(AIRFRAME, SITE, VALUES).parameters is VALUES


@pytest.mark.parametrize("attitude", [False, True])
def test_a_tracker_s_attitude_is_flown_with_where_that_is_asked_for(attitude: bool) -> None:
    assert TRACKED.mocap is not None
    site = replace(TRACKED, mocap=replace(TRACKED.mocap, attitude=attitude))
    assert setup_from(AIRFRAME, site, VALUES).tracked_attitude is attitude
    assert not setup_from(AIRFRAME, SITE, VALUES).tracked_attitude


def test_of_bridges_those_are_accepted_that_are_named_and_never_ourselves() -> None:
    bridges = [Sender(system=1, component=197), Sender(system=9, component=5)]
    position = PositionSettings(sources=["vision"], vision_from=bridges)
    assert accepted_bridges(position, Source(1, 191)) == {Source(1, 197), Source(9, 5)}
    with pytest.raises(ConfigError) as caught:
        accepted_bridges(position, Source(9, 5))
    assert str(caught.value).startswith("position.vision_from = system 9, component 5: ")
    setup = setup_from(by(operators=frozenset({250})), replace(SITE, position=position), VALUES)
    assert known_systems(setup) == {1, 250, 9}


def test_the_conversation_has_the_site_s_sources_in_their_order() -> None:
    site = at(
        sources=["vision", "global_position", "local_position"],
        silence_s=0.5,
        return_s=7.0,
        home=HOME,
        vision_from=[Sender(system=9, component=5)],
    )
    session = session_of(setup_from(AIRFRAME, site, VALUES), lockstep=False, start=5)
    sources = session.sources
    assert list(sources.health) == [VISION, GLOBAL_POSITION, LOCAL_POSITION]
    assert (sources._silence_s, sources._return_s) == (0.5, 7.0)
    assert session.autopilot == Source(1, 1)
    tracked = session_of(setup_from(AIRFRAME, TRACKED, VALUES), lockstep=True, start=5)
    assert list(tracked.sources.health) == [MOCAP]


def test_a_pose_is_forwarded_as_the_site_says() -> None:
    assert forwarding_of(None) is None
    forwarding = forwarding_of(
        Forward(message="odometry", rate_hz=50.0, sigma_m=0.25, sigma_deg=2.0)
    )
    assert forwarding is not None
    assert forwarding._message == "odometry"
    assert forwarding._interval_s == pytest.approx(0.02)
    assert forwarding._sigma_m == 0.25
    assert forwarding._sigma_rad == pytest.approx(radians(2.0))
    usual = forwarding_of(Forward())
    assert usual is not None
    assert isnan(usual._sigma_m)
    assert usual._sigma_rad == pytest.approx(radians(1.0))
    assert usual._interval_s == pytest.approx(0.025)
