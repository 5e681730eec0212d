"""What the module is set up from: an airframe file, a site file and parameters, as it flies them.

Identities, the firmware's flavour, the site's frame and lines, whose positions are accepted and
what is required of the firmware.  All of it is decided before the flight.
"""

from __future__ import annotations

from math import radians
from typing import Final, NamedTuple

from tgl_soar.config.airframe import OPERATORS, Airframe, Surface
from tgl_soar.config.files import ConfigError, airframe_refusal, preset_lines
from tgl_soar.config.lateral_dynamics import UNKNOWN, LateralDynamics
from tgl_soar.config.lateral_gains import lateral_dynamics
from tgl_soar.config.line_changes import Contour, Presets
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import Forward, PositionSettings, Site
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.control.line_bounds import LineBounds
from tgl_soar.geometry import SoaringFrame
from tgl_soar.link.autopilots import flavour as autopilot_flavour
from tgl_soar.link.autopilots import routes
from tgl_soar.link.autopilots.base import (
    BrakeChannel,
    Flavour,
    SurfaceChannel,
    SurfaceChannels,
    ThrottleChannel,
)
from tgl_soar.link.autopilots.requirements import Needs
from tgl_soar.link.messages import ID_HIGHRES_IMU, ID_RAW_IMU, ID_SCALED_IMU, Source
from tgl_soar.link.pose_forwarding import PoseForwarding
from tgl_soar.link.session import Session, SessionOptions
from tgl_soar.link.sources import NUMBERS, PositionSources
from tgl_soar.link.tangent_plane import Home
from tgl_soar.types import NAN, NO_AERODYNAMICS, NO_GROUND, OURS, Aerodynamics, Ground

_IMUS: Final = {
    "usual": None,
    "raw_imu": ID_RAW_IMU,
    "scaled_imu": ID_SCALED_IMU,
    "highres_imu": ID_HIGHRES_IMU,
    "none": 0,
}


class ModuleSetup(NamedTuple):
    """What the module needs to know of an airframe and a site."""

    own: Source
    override: Source  # the sender of commands that the autopilot obeys
    flavour: Flavour
    frame: SoaringFrame
    parameters: ParameterSet
    operators: frozenset[int] = OPERATORS  # systems that may set parameters and command
    presets: Presets = ()  # the site's lines, for TGL_PRESET
    contour: Contour = ()  # of the site, which a line has to cross
    surface_channels: frozenset[int] = frozenset()  # none of them can be the pilot's switch
    position: PositionSettings = PositionSettings()  # the site's sources
    imu: int | None = None  # the message that is to carry accelerations; None: the usual one
    rangefinder: bool = False  # one is fitted
    forward: Forward | None = None  # what is reported to the autopilot of the position
    aerodynamics: Aerodynamics = NO_AERODYNAMICS  # of the airframe, to read the air by
    lateral: LateralDynamics = UNKNOWN  # of the airframe, to judge gains by
    ground: Ground = NO_GROUND  # of the site, to keep away from
    tracked_attitude: bool = False  # the tracker's attitude is flown with
    needs: Needs | None = None  # what the autopilot's parameters are read for; None: they are not


def surface_channels(airframe: Airframe) -> SurfaceChannels:
    """The channels of an airframe's surfaces."""
    surfaces, motor = airframe.surfaces, airframe.surfaces.throttle
    return SurfaceChannels(
        elevator=_channel(surfaces.elevator),
        aileron=_channel(surfaces.aileron),
        rudder=_channel(surfaces.rudder),
        brake=None
        if surfaces.brake is None
        else BrakeChannel(_channel(surfaces.brake), surfaces.brake_throw),
        throttle=None
        if motor is None
        else ThrottleChannel(motor.channel, motor.pwm_min, motor.pwm_max),
    )


def flavour_of(airframe: Airframe) -> Flavour:
    """How an airframe's autopilot is commanded.  Errors: `ConfigError` for an unknown route."""
    link = airframe.autopilot
    try:
        channels = surface_channels(airframe)
        return autopilot_flavour(link.firmware, link.route, channels, link.system_id)
    except ValueError as error:
        raise ConfigError(f"autopilot.route = {link.route!r}: {error}") from None


def commanding_source(airframe: Airframe, flavour: Flavour) -> Source:
    """The identity that commands carry: the one that the firmware obeys, else our own."""
    link = airframe.autopilot
    system = link.override_system_id if flavour.route.as_operator else link.system_id
    return Source(system, link.component_id)


def direct_flavour_of(airframe: Airframe) -> Flavour:
    """The firmware by a route that moves surfaces directly, for the bench."""
    chosen = flavour_of(airframe)
    if chosen.route.loops == OURS:
        return chosen
    link = airframe.autopilot
    direct = next(r.name for r in routes(link.firmware) if r.loops == OURS)
    return autopilot_flavour(link.firmware, direct, surface_channels(airframe), link.system_id)


def needs_of(airframe: Airframe, site: Site, values: ParameterSet) -> Needs:
    """What the module asks of the firmware."""
    return Needs(
        override_system=airframe.autopilot.override_system_id,
        loop_rate_hz=values["LOOP_RATE"],
        external_pose=site.forward is not None,
        gps=site.mocap is None and site.forward is None,
        lands=values["LND_BY"] == 1.0,
    )


def with_values(setup: ModuleSetup, values: ParameterSet) -> ModuleSetup:
    """The same with other values, and with what these need of the firmware."""
    needs = setup.needs
    if needs is not None:
        needs = needs._replace(loop_rate_hz=values["LOOP_RATE"], lands=values["LND_BY"] == 1.0)
    return setup._replace(parameters=values, needs=needs)


def setup_from(airframe: Airframe, site: Site, parameters: ParameterSet) -> ModuleSetup:
    """Configuration files' contents as the flying module takes them."""
    link = airframe.autopilot
    flavour = flavour_of(airframe)
    if parameters["OP_ENGAGE"] != 0.0:  # a restarted module must never engage by itself
        parameters = parameters.changed({"OP_ENGAGE": 0.0})
    driven, aerodynamics = airframe.surfaces.channels(), airframe.aerodynamics()
    if refusal := airframe_refusal(parameters, driven, aerodynamics):
        raise ConfigError(f"parameters.{refusal}")
    accepted_bridges(site.position, Source(link.system_id, link.component_id))
    needs = needs_of(airframe, site, parameters)
    # Its own local position may also come from poses that somebody else sends to it: only a site
    # that counts on latitude and longitude is kept on the ground by what satellites require.
    needs = needs._replace(gps=needs.gps and "global_position" in site.position.sources)
    return ModuleSetup(
        own=Source(link.system_id, link.component_id),
        override=commanding_source(airframe, flavour),
        flavour=flavour,
        frame=site.frame(),
        parameters=parameters,
        operators=link.operators,
        presets=preset_lines(site, parameters),
        contour=site.contour_for(airframe.airframe.name),
        surface_channels=driven,
        position=site.position,
        imu=_IMUS[link.imu],
        rangefinder=link.rangefinder,
        forward=site.forward,
        aerodynamics=aerodynamics,
        lateral=lateral_dynamics(airframe),
        ground=site.known_ground(),
        tracked_attitude=site.mocap is not None and site.mocap.attitude,
        needs=needs,
    )


def bounds_of(setup: ModuleSetup, contour: Contour) -> LineBounds:
    """What is allowed of lines and gains."""
    return _bounds(contour, setup.ground, setup.lateral, setup.flavour)


def bounds_from(airframe: Airframe, site: Site) -> LineBounds:
    """What these files allow of lines and gains.  Errors: `ConfigError` for an unknown route."""
    contour = site.contour_for(airframe.airframe.name)
    lateral, flavour = lateral_dynamics(airframe), flavour_of(airframe)
    return _bounds(contour, site.known_ground(), lateral, flavour)


def _bounds(
    contour: Contour, ground: Ground, lateral: LateralDynamics, flavour: Flavour
) -> LineBounds:
    return LineBounds(contour, ground, lateral, flavour.route.loops)


def known_systems(setup: ModuleSetup) -> frozenset[int]:
    """Systems whose frames belong into a log."""
    accepted = accepted_bridges(setup.position, setup.own)
    return frozenset((setup.own.system, *setup.operators, *(s.system for s in accepted)))


def accepted_bridges(position: PositionSettings, own: Source) -> frozenset[Source]:
    """Sources whose VISION_POSITION_ESTIMATE is accepted.

    Errors: `ConfigError` for our own, which an autopilot may send back to us.
    """
    accepted = frozenset(Source(s.system, s.component) for s in position.vision_from)
    if own in accepted:
        raise ConfigError(
            f"position.vision_from = system {own.system}, component {own.component}: that is"
            " this module itself; name the bridge that measures"
        )
    return accepted


def session_of(setup: ModuleSetup, *, lockstep: bool, start: int) -> Session:
    """The conversation with the autopilot.  `start`: as `Presence` takes it."""
    position, home = setup.position, setup.position.home
    return Session(
        SessionOptions(
            own=setup.own,
            flavour=setup.flavour,
            loop_rate_hz=setup.parameters["LOOP_RATE"],
            override_system=setup.override.system,
            lockstep=lockstep,
            sources=PositionSources(
                [NUMBERS[name] for name in position.sources],
                silence_s=position.silence_s,
                return_s=position.return_s,
            ),
            home=Home(home.latitude_deg, home.longitude_deg, home.altitude_m) if home else None,
            vision_from=accepted_bridges(position, setup.own),
            imu=setup.imu,
            rangefinder=setup.rangefinder,
            start=start,
            needs=setup.needs,
        )
    )


def forwarding_of(forward: Forward | None) -> PoseForwarding | None:
    """What tells the autopilot its position, if the site asks for it."""
    if forward is None:
        return None
    return PoseForwarding(
        forward.message,
        forward.rate_hz,
        sigma_m=NAN if forward.sigma_m is None else forward.sigma_m,
        sigma_rad=radians(forward.sigma_deg),
    )


def laws_of(setup: ModuleSetup, values: ParameterSet) -> Laws:
    """The laws of one tick: here, and in the replay of a log."""
    loops = setup.flavour.route.loops
    return laws_from(values, setup.frame, setup.aerodynamics, setup.ground, loops)


def _channel(surface: Surface) -> SurfaceChannel:
    return SurfaceChannel(
        channel=surface.channel,
        pwm_min=surface.pwm_min,
        pwm_trim=surface.pwm_trim,
        pwm_max=surface.pwm_max,
        reversed=surface.reversed,
    )
