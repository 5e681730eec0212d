"""What the ground can watch: the numbers of one tick, in the units of the operator's parameters.

    NAMED_VALUE_FLOAT     `FAST` and `SLOW`, by name
    DEBUG_FLOAT_ARRAY     all that a tick decided and why, `ARRAY`, for plots and for tuning
    NAV_CONTROLLER_OUTPUT only when asked for: several ground stations show it as the autopilot's
                          own, whichever component sends it
    WIND_COV              only when asked for, for the same reason
    COMPONENT_METADATA    only when asked for: where our parameters are described

A number that does not exist (a setpoint in standby) is NaN.  `health` says what may be flown
with, `faults` what ails whom: the bits of `estimation.health.FAULT_TEXTS`, which a float holds
exactly.  `entry` says what engaging still lacks, by the bits of the supervisor's conditions.
`exc_state` is how the multisine stands, as `control.excitation` numbers it.
`fc_state` is how the forecast stands, as `control.forecast` numbers it: above 1 there is no place
to settle, and `fc_time` is the time until the limit is reached, at the height `fc_z`.
`pt_state` is how the point on the line stands, as `control.point_hold` numbers it, `pt_off` the
distance from it along the line.
`thr_used` is the integral of `throttle` over the flight, in seconds of full throttle, and `pushed`
the climb that the propeller gives.
"""

from __future__ import annotations

from collections.abc import Callable
from math import degrees
from typing import Final

from tgl_soar.autopilot import Output
from tgl_soar.geometry import SoaringFrame, ned_vector_from_soaring
from tgl_soar.link.component_metadata import general_checksum, general_uri
from tgl_soar.link.messages import (
    ID_COMPONENT_METADATA,
    ID_DEBUG_FLOAT_ARRAY,
    ID_NAMED_VALUE_FLOAT,
    ID_NAV_CONTROLLER_OUTPUT,
    ID_WIND_COV,
    ComponentMetadata,
    DebugFloatArray,
    NamedValueFloat,
    NavControllerOutput,
    Outbound,
    WindCov,
)
from tgl_soar.link.telemetry import Flow
from tgl_soar.types import NAN, AirEstimate, isfinite

FAST_S: Final = 0.2  # between two of the same number
SLOW_S: Final = 1.0
ARRAY_S: Final = 0.5

FAST: Final = (
    "e_rho",
    "soar_x",
    "soar_z",
    "pitch_sp",
    "soar_mode",
    "line_x",
    "line_z",
    "line_lean",
)
SLOW: Final = (
    *("climb", "health", "faults", "age_pos", "age_att", "age_ap", "loss", "rtt_ms"),
    *("wind", "updraft", "excess", "airspeed", "entry", "stall", "clearance"),
    *("fc_state", "fc_chance", "fc_time", "fc_z"),
    *("pt_state", "pt_off", "brake"),
    *("esc_left", "esc_time"),
    *("throttle", "thr_used"),
)
ARRAY: Final = (
    *("mode", "e_rho", "e_rho_rate", "line_x", "line_z", "line_lean", "line_moving"),
    *("x", "y", "z", "speed_x", "speed_y", "climb", "roll", "pitch", "heading"),
    *("pitch_sp", "heading_sp"),
    *("rho_p", "rho_i", "rho_d", "rho_saturated"),
    *("elevator", "ele_p", "ele_i", "ele_d", "ele_saturated"),
    *("aileron", "ail_p", "ail_i", "ail_d", "ail_saturated"),
    *("rudder", "rud_p", "rud_d", "pushed"),
    *("age_pos", "age_att", "age_ap", "health"),
    *("airspeed", "alpha", "wind", "updraft", "excess", "wind_sd", "updraft_sd"),
    *("imu_weight", "faults"),
    *(
        "gain_speed",
        "rho_gain_p",
        "rho_gain_i",
        "rho_gain_d",
        "ele_gain_p",
        "ele_gain_i",
        "ele_gain_d",
    ),
    *("exc_pitch", "exc_state"),
)
_ENTRY: Final = SLOW.index("entry")
ARRAY_NAME: Final = "tgl_soar"
ARRAY_ID: Final = 191

POSITION_OK: Final = 1  # bits of "health"
ATTITUDE_OK: Final = 2
AUTOPILOT_OK: Final = 4

HELD_BACK: Final = 1  # a bit of "entry" that is no condition of the supervisor's: ENGAGE's place


class Panel:
    """The newest of everything, and the messages that show it."""

    def __init__(self, frame: SoaringFrame, entry_lacks: Callable[[], int]) -> None:
        """`frame`: the site's, in which the wind blows along x.  `entry_lacks`: the bits of what
        engaging lacks now; it is asked once for each number that is sent."""
        self._frame = frame
        self._entry_lacks = entry_lacks
        self._output: Output | None = None
        self._vehicle_time_s = NAN
        self._loss = 0.0
        self._round_trip_s = NAN

    def look(self, output: Output, vehicle_time_s: float, loss: float, round_trip_s: float) -> None:
        """Take in a tick.

        loss: share of the autopilot's frames that were lost of late, 0 … 1; round_trip_s: to the
        autopilot and back, NaN: not measured.
        """
        self._output = output
        self._vehicle_time_s = vehicle_time_s
        self._loss = loss
        self._round_trip_s = round_trip_s

    def flows(self) -> tuple[Flow, ...]:
        """What goes out without being requested, and how often; the last three only on request."""
        return (
            Flow(ID_NAMED_VALUE_FLOAT, len(FAST), FAST_S, self._fast),
            Flow(ID_NAMED_VALUE_FLOAT, len(SLOW), SLOW_S, self._slow),
            Flow(ID_DEBUG_FLOAT_ARRAY, 1, ARRAY_S, self._array),
            Flow(ID_NAV_CONTROLLER_OUTPUT, 1, float("inf"), self._navigation),
            Flow(ID_WIND_COV, 1, float("inf"), self._wind),
            Flow(ID_COMPONENT_METADATA, 1, float("inf"), self._metadata),
        )

    def _fast(self, turn: int) -> Outbound | None:
        if self._output is None:
            return None
        return named_value(FAST[turn], self._vehicle_time_s, fast_value(self._output, turn))

    def _slow(self, turn: int) -> Outbound | None:
        if self._output is None:
            return None
        lacks = self._entry_lacks() if turn == _ENTRY else 0
        value = slow_value(self._output, self._loss, self._round_trip_s, lacks, turn)
        return named_value(SLOW[turn], self._vehicle_time_s, value)

    def _array(self, _turn: int) -> Outbound | None:
        return None if self._output is None else float_array(self._output, self._vehicle_time_s)

    def _navigation(self, _turn: int) -> Outbound | None:
        return None if self._output is None else nav_controller_output(self._output)

    def _wind(self, _turn: int) -> Outbound | None:
        if self._output is None:
            return None
        return wind_cov(self._output.air, self._frame, self._vehicle_time_s)

    def _metadata(self, _turn: int) -> Outbound | None:
        stamp = _stamp(self._vehicle_time_s, 1e3) & 0xFFFFFFFF
        return ComponentMetadata(stamp, general_checksum(), general_uri())


def health_bits(output: Output) -> float:
    """What may be flown with, as bits."""
    health = output.health
    return float(
        POSITION_OK * health.position_ok
        + ATTITUDE_OK * health.attitude_ok
        + AUTOPILOT_OK * health.autopilot_ok
    )


def fast_value(output: Output, turn: int) -> float:
    """The number of `FAST[turn]`."""
    return (
        output.line.e_rho_m,
        output.vehicle.x_m,
        output.vehicle.z_m,
        degrees(output.setpoints.pitch_rad),
        float(output.mode),
        output.line.x_m,
        output.line.z_m,
        degrees(output.line.eta_rad) - 90.0,
    )[turn]


def slow_value(
    output: Output, loss: float, round_trip_s: float, entry_lacks: int, turn: int
) -> float:
    """The number of `SLOW[turn]`; a margin that is not known is NaN."""
    health, margins, foreseen = output.health, output.margins, output.forecast
    return (
        output.vehicle.climb_mps,
        health_bits(output),
        float(health.faults),
        health.position_age_s,
        health.attitude_age_s,
        health.heartbeat_age_s,
        loss,
        round_trip_s * 1e3,
        output.air.wind_mps,
        output.air.updraft_mps,
        output.air.excess_mps,
        output.air.airspeed_mps,
        float(entry_lacks),
        degrees(margins.stall_rad) if isfinite(margins.stall_rad) else NAN,
        margins.clearance_m if isfinite(margins.clearance_m) else NAN,
        float(foreseen.standing),
        foreseen.chance,
        foreseen.ahead_s if isfinite(foreseen.ahead_s) else NAN,
        foreseen.z_m,
        float(output.point.standing),
        output.point.off_m,
        output.command.brake,
        output.launch_landing.height_left_m,
        output.launch_landing.time_left_s if isfinite(output.launch_landing.time_left_s) else NAN,
        output.throttle.fraction,
        output.throttle.used_s,
    )[turn]


def named_value(name: str, vehicle_time_s: float, value: float) -> NamedValueFloat:
    """One number, stamped with the vehicle's time."""
    return NamedValueFloat(_stamp(vehicle_time_s, 1e3) & 0xFFFFFFFF, name, value)


def float_array(output: Output, vehicle_time_s: float) -> DebugFloatArray:
    """All of `ARRAY`, angles in degrees."""
    vehicle, health, setpoints = output.vehicle, output.health, output.setpoints
    soaring, command, gains = output.soaring, output.command, output.gains
    elevator, aileron, rudder = output.elevator, output.aileron, output.rudder
    air = output.air
    data = (
        float(output.mode),
        output.line.e_rho_m,
        output.line.e_rho_rate_mps,
        output.line.x_m,
        output.line.z_m,
        degrees(output.line.eta_rad) - 90.0,
        float(output.line.moving),
        vehicle.x_m,
        vehicle.y_m,
        vehicle.z_m,
        vehicle.velocity_x_mps,
        vehicle.velocity_y_mps,
        vehicle.climb_mps,
        degrees(vehicle.roll_rad),
        degrees(vehicle.pitch_rad),
        degrees(vehicle.heading_rad),
        degrees(setpoints.pitch_rad),
        degrees(setpoints.heading_rad),
        degrees(soaring.p),
        degrees(soaring.i),
        degrees(soaring.d),
        float(soaring.saturated),
        *(command.elevator, elevator.p, elevator.i, elevator.d, float(elevator.saturated)),
        *(command.aileron, aileron.p, aileron.i, aileron.d, float(aileron.saturated)),
        *(command.rudder, rudder.p, rudder.d, output.throttle.climb_mps),
        health.position_age_s,
        health.attitude_age_s,
        health.heartbeat_age_s,
        health_bits(output),
        *(air.airspeed_mps, degrees(air.alpha_rad), air.wind_mps, air.updraft_mps),
        *(air.excess_mps, air.wind_sigma_mps, air.updraft_sigma_mps),
        output.imu_weight,
        float(health.faults),
        *(gains.airspeed_mps, gains.rho_p, gains.rho_i, gains.rho_d),
        *(gains.ele_p, gains.ele_i, gains.ele_d),
        degrees(output.excitation.pitch_rad),
        float(output.excitation.standing),
    )
    return DebugFloatArray(_stamp(vehicle_time_s, 1e6), ARRAY_NAME, ARRAY_ID, data)


def nav_controller_output(output: Output) -> NavControllerOutput:
    """Setpoints and e_rho in the fields that ground stations have instruments for."""
    heading = degrees(output.setpoints.heading_rad)
    whole = round(heading) if isfinite(heading) else 0
    return NavControllerOutput(
        nav_roll=degrees(output.setpoints.roll_rad),
        nav_pitch=degrees(output.setpoints.pitch_rad),
        nav_bearing=whole,
        target_bearing=whole,
        wp_dist=0,
        alt_error=output.line.z_m - output.vehicle.z_m,
        aspd_error=0.0,
        xtrack_error=output.line.e_rho_m,
    )


def wind_cov(air: AirEstimate, frame: SoaringFrame, vehicle_time_s: float) -> WindCov:
    """The wind in local NED; across the site's x axis none, unless it is estimated (VEER_MAX)."""
    along, across, up = air.wind_mps, air.cross_wind_mps, air.updraft_mps
    north, east, down = ned_vector_from_soaring(frame, along, across, up)
    return WindCov(
        time_usec=_stamp(vehicle_time_s, 1e6),
        wind_x=north,
        wind_y=east,
        wind_z=down,
        horiz_accuracy=air.wind_sigma_mps,
        vert_accuracy=air.updraft_sigma_mps,
    )


def _stamp(vehicle_time_s: float, per_s: float) -> int:
    return int(vehicle_time_s * per_s) if 0.0 <= vehicle_time_s < 1e9 else 0
