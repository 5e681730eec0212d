"""The laws' parameters in SI units, from the operator's and what airframe and site know.

An operator sets degrees, hertz and names of sixteen letters (`config.parameters`); a law takes
radians, rad/s and one tuple of its own.  What lies between stands here and nowhere else.
"""

from __future__ import annotations

from math import pi, radians
from typing import Final, NamedTuple

from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.envelope import EnvelopeLimits, Fence
from tgl_soar.control.excitation import Excitation
from tgl_soar.control.forecast import ForecastParams
from tgl_soar.control.heading import BankGains, HeadingGains
from tgl_soar.control.landing import BEARING_MAX_RAD, SLOW_BY_MPS, LandingParams, LandingPlace
from tgl_soar.control.lateral_schedule import LateralSchedule, lateral_schedule_of
from tgl_soar.control.launch import LaunchParams
from tgl_soar.control.pid import PidGains
from tgl_soar.control.pitch_schedule import HOLD_S, Dynamics, GainSchedule, schedule_of
from tgl_soar.control.point_hold import BrakeGains
from tgl_soar.control.ridge_beat import BeatParams
from tgl_soar.control.soaring import SoaringGains, TrimGains
from tgl_soar.control.target_line import LineLimits, TargetLine, eta_from_lean
from tgl_soar.control.throttle import ThrottleParams
from tgl_soar.estimation.aerodynamics import (
    brake_sink,
    elevator_of_rate,
    elevator_room,
    stall_speed,
)
from tgl_soar.estimation.cross_wind import CrossWindParams
from tgl_soar.estimation.ground_range import RangeGains
from tgl_soar.estimation.health import HealthLimits
from tgl_soar.estimation.motion_state import MotionGains
from tgl_soar.estimation.wind import WindParams
from tgl_soar.geometry import SoaringFrame, wrap_angle
from tgl_soar.types import (
    NO_AERODYNAMICS,
    NO_GROUND,
    OURS,
    THEIRS,
    Aerodynamics,
    Ground,
    SurfaceCommand,
)

BEAT_OF_FENCE: Final = 0.8  # a turn begins there, and ends a little farther out
# How the search for lift stands: SRCH_START.
SEARCH_OFF: Final = 0
SEARCH_LOOKS: Final = 1
SEARCH_SOARS: Final = 2  # it says so
SEARCH_GIVEN_UP: Final = 3
SEARCH_NONE: Final = 4  # as 0, and FC_ACT 4 can begin none

# Of the sideways speed's error: ten times as fast as that loop is, so that it costs 6 degrees.
SIDEWAYS_FILTER_RADPS: Final = 20.0
# An estimator's heading may be off by 15 to 20 degrees without a word (docs/autopilots.md), and a
# wind by 10 from where a site says: together. Where a firmware turns by banking the heading is
# counted from there on at least; with PSI_MAX the nose stays within 50 degrees of the stream.
HEADING_OFF_RAD: Final = radians(30.0)


class SupervisorLimits(NamedTuple):
    """When the supervisor considers the aircraft captured, lost or upset."""

    capture_distance_m: float
    e_rho_max_m: float
    tilt_max_rad: float
    position_age_max_s: float  # since the last confident position; holding ends here
    position_sd_max_m: float  # until then the line is flown, where accelerations are known
    reckoned_max_s: float  # a position that is only dead reckoned is flown with for so long
    recover_s: float  # the longest time of it


class Laws(NamedTuple):
    """All parameters of one tick, in SI units."""

    frame: SoaringFrame
    motion: MotionGains
    health: HealthLimits
    guards: SupervisorLimits
    target: TargetLine
    line: LineLimits
    soaring: SoaringGains
    soaring_imu: SoaringGains  # while accelerations are in use
    pitch: PidGains
    pitch_imu: PidGains
    setpoint_weight: float  # of the pitch setpoint's rate in the derivative, with accelerations
    schedule: GainSchedule  # of these four
    roll: PidGains
    heading: HeadingGains
    bank: BankGains
    sideways: PidGains  # m/s to bank
    lateral_schedule: LateralSchedule  # of roll and heading, and of the speed that the bank follows
    envelope: EnvelopeLimits
    trim: SurfaceCommand
    wind: WindParams
    cross_wind: CrossWindParams
    fence: Fence
    ground: Ground
    rangefinder: RangeGains
    pitch_trim: TrimGains
    loops: int  # whose loops move the surfaces: OURS, THEIRS or THEIRS_WITH_RUDDER
    excitation: Excitation
    forecast: ForecastParams
    brake: BrakeGains
    search: int  # SEARCH_…
    surveys: bool  # the line slides from one place where it soars to the next
    survey_reach_m: float  # to either side of where it began
    launch: LaunchParams
    landing: LandingParams
    beat: BeatParams
    throttle: ThrottleParams


def laws_from(
    values: ParameterSet,
    frame: SoaringFrame,
    aerodynamics: Aerodynamics = NO_AERODYNAMICS,
    ground: Ground = NO_GROUND,
    loops: int = OURS,
) -> Laws:
    """The laws' parameters in SI units.

    loops: whose loops move the surfaces, as `types` numbers them.
    """
    soaring = _soaring_gains(values)
    soaring_imu = soaring
    if loops == OURS:  # a firmware's loops are too slow for what ours allow
        soaring_imu = soaring._replace(
            pid=_imu_gains(values, "RHO", soaring.pid, values["RHO_DF_IMU"])
        )
    pitch = _surface_gains(values, "ELE")
    lateral = lateral_schedule_of(values["LAT_SPEED"], values["LAT_LATE"], late_by_s(values))
    cross_wind = _cross_wind(values, loops)
    return Laws(
        frame=frame,
        motion=_motion_gains(values),
        health=HealthLimits(
            position_age_max_s=values["AGE_POS_HOLD"],
            attitude_age_max_s=values["AGE_ATT_MAX"],
            heartbeat_age_max_s=values["AGE_AP_MAX"],
            frozen_s=values["AGE_FROZEN"],
            surface_error_max=values["SURF_TOL"],
        ),
        guards=_supervisor_limits(values),
        target=TargetLine(
            values["TGL_X"], values["TGL_Z"], eta_from_lean(radians(values["TGL_LEAN"]))
        ),
        line=_line_limits(values),
        soaring=soaring,
        soaring_imu=soaring_imu,
        pitch=pitch,
        pitch_imu=_imu_gains(values, "ELE", pitch, 0.0),
        setpoint_weight=values["ELE_DSP_IMU"],
        schedule=_schedule(values),
        roll=_surface_gains(values, "AIL"),
        heading=_heading_gains(values),
        bank=BankGains(values["BANK_P"], radians(values["BANK_MAX"])),
        sideways=_sideways_gains(values),
        lateral_schedule=lateral,
        envelope=_envelope_limits(values, aerodynamics),
        trim=SurfaceCommand(values["ELE_TRIM"], values["AIL_TRIM"], values["RUD_TRIM"], 0.0),
        wind=WindParams(aerodynamics, values["WIND_CHANGE"], radians(values["WIND_ALIGN"])),
        cross_wind=cross_wind,
        fence=fence_of(values),
        ground=ground,
        rangefinder=RangeGains(int(values["RNG_USE"]), values["RNG_GATE"]),
        pitch_trim=TrimGains(
            radians(values["PITCH_TRIM"]),
            values["WIND_TRIM"],
            values["WIND_TRIM_T"],
            values["WIND_FF"],
        ),
        loops=loops,
        excitation=Excitation(radians(values["EXC_AMP"]), values["EXC_START"] != 0.0),
        forecast=ForecastParams(
            act=int(values["FC_ACT"]),
            time_s=values["FC_TIME"],
            chance=values["FC_CHANCE"],
            clearance_min_m=values["CLEAR_MIN"],
            speed_min_mps=values["SPEED_MIN"],
            polar=aerodynamics.polar,
        ),
        brake=_brake_gains(values, aerodynamics, loops),
        search=int(values["SRCH_START"]),
        surveys=values["SRV_START"] != 0.0,
        survey_reach_m=values["SRV_REACH"],
        launch=_launch_params(values),
        landing=_landing_params(values, frame, aerodynamics),
        beat=_beat_params(values, cross_wind.veer_max_rad),
        throttle=_throttle_params(values, aerodynamics, loops),
    )


def _line_limits(values: ParameterSet) -> LineLimits:
    """How fast the line moves; in a survey no faster than that is to be."""
    speed_mps = values["TGL_SLEW"]
    if values["SRV_START"] != 0.0:
        speed_mps = min(speed_mps, values["SRV_SPEED"])
    return LineLimits(speed_mps, values["TGL_ACCEL"], radians(values["TGL_ROT_SLEW"]))


def _launch_params(values: ParameterSet) -> LaunchParams:
    return LaunchParams(
        wanted=values["LNC_START"] != 0.0,
        throw_mps=values["LNC_SPEED"],
        wait_s=values["LNC_WAIT"],
        pitch_rad=radians(values["LNC_PITCH"]),
        line=LineLimits(values["LNC_SLEW"], values["LNC_ACCEL"], radians(values["TGL_ROT_SLEW"])),
    )


def _landing_params(
    values: ParameterSet, frame: SoaringFrame, aerodynamics: Aerodynamics
) -> LandingParams:
    def from_upwind(name: str) -> float:
        return wrap_angle(radians(values[name]) - frame.wind_from_rad)

    approach_rad, escape_rad = from_upwind("LND_BEAR"), from_upwind("ESC_BEAR")
    # Another bearing than the one that was given would lead to another place: then none is known.
    is_known = max(abs(approach_rad), abs(escape_rad)) <= BEARING_MAX_RAD
    return LandingParams(
        place=LandingPlace(
            x_m=values["LND_X"],
            y_m=values["LND_Y"],
            z_m=values["LND_Z"],
            bearing_rad=approach_rad,
            length_m=values["LND_LEN"] if is_known else 0.0,
        ),
        escape_rad=escape_rad,
        away_x_m=values["ESC_X"],
        spare_m=values["ESC_SPARE"],
        asked=int(values["ESC_START"]),
        auto=values["ESC_AUTO"] != 0.0,
        waits=values["ESC_AUTO"] == 2.0,
        clearance_m=values["ESC_CLEAR"],
        polar=aerodynamics.polar,
        best_glide_mps=values["DYN_BEST"] or values["SPEED_MIN"] + SLOW_BY_MPS,  # 0: not known
        stall_mps=stall_speed(aerodynamics),
        speed_min_mps=values["SPEED_MIN"],
        heading_max_rad=radians(values["PSI_MAX"]),
        sigmas=values["ESC_SIGMA"],
        wind_fraction=values["ESC_WIND"],
        glide_pitch_rad=radians(values["REC_PITCH"]),
        side_max_m=values["FENCE_Y_MAX"],
        tilt_max_rad=radians(values["TILT_MAX"]),
    )


def _beat_params(values: ParameterSet, veer_max_rad: float) -> BeatParams:
    return BeatParams(
        asked=values["BEAT_START"] != 0.0,
        auto=values["BEAT_AUTO"] != 0.0,
        aside=values["BEAT_AUTO"] == 2.0,
        half_width_m=min(values["BEAT_WIDTH"], BEAT_OF_FENCE * values["FENCE_Y_MAX"]),
        top_z_m=values["FENCE_Z_MAX"],
        veer_max_rad=veer_max_rad,
    )


def _motion_gains(values: ParameterSet) -> MotionGains:
    return MotionGains(
        fix_sd_m=values["EST_FIX_SD"],
        velocity_sd_mps=values["EST_VEL_SD"],
        force_sd_mps2=values["EST_ACC_SD"],
        bias_sd_mps2=values["EST_ACC_BIAS_SD"],
        unknown_sd_mps2=values["EST_CV_SD"],
        fix_delay_s=values["EST_DELAY"],
        fix_gate_m=values["EST_GATE"],
        reset_max_m=values["EST_RESET_MAX"],
        use_imu=values["EST_IMU"] != 0.0,
    )


def _supervisor_limits(values: ParameterSet) -> SupervisorLimits:
    return SupervisorLimits(
        capture_distance_m=values["TGL_CAPTURE"],
        e_rho_max_m=values["CAPTURE_MAX"],
        tilt_max_rad=radians(values["TILT_MAX"]),
        position_age_max_s=values["AGE_POS_MAX"],
        position_sd_max_m=values["EST_SD_MAX"],
        reckoned_max_s=values["AGE_POS_DR"],
        recover_s=values["REC_TIME"],
    )


def _envelope_limits(values: ParameterSet, aero: Aerodynamics) -> EnvelopeLimits:
    alpha_max_rad = radians(values["ALPHA_MAX"])
    return EnvelopeLimits(
        deflection_max=values["SURF_MAX"],
        rate_max_per_s=values["SURF_RATE"],
        alpha_max_rad=alpha_max_rad,
        speed_min_mps=values["SPEED_MIN"],
        sink_max_mps=values["SINK_MAX"],
        clearance_min_m=values["CLEAR_MIN"],
        glide_pitch_rad=radians(values["REC_PITCH"]),
        brake_throw=aero.brake_throw,
        elevator_room=elevator_room(aero, alpha_max_rad, values["ELE_TRIM"]),
        elevator_per_radps=elevator_of_rate(aero, values["DYN_BEST"]),
    )


def _brake_gains(values: ParameterSet, aero: Aerodynamics, loops: int) -> BrakeGains:
    available = loops == OURS and aero.CD_brake > 0.0
    incidence = elevator = 0.0
    if available:
        incidence = -aero.CL_brake / aero.CL_alpha
        elevator = -(aero.Cm_brake + aero.Cm_alpha * incidence) / aero.Cm_elevator
    return BrakeGains(
        wanted=values["TGL_HOLD"] != 0.0,
        gives_way=values["TGL_HOLD"] == 2.0,
        available=available,
        along_m=values["TGL_ALONG"],
        kp_per_s=values["BRK_P"],
        speed_max_mps=values["BRK_SPEED"],
        kv=values["BRK_V"],
        ki_per_s=values["BRK_I"],
        bias=values["BRK_BIAS"],
        sink=brake_sink(aero) if available else 0.0,
        lift_rad=incidence,
        elevator=elevator,
    )


def _throttle_params(values: ParameterSet, aero: Aerodynamics, loops: int) -> ThrottleParams:
    """No budget where nothing would turn: such a one is refused, but a log's may be of others."""
    available = loops == OURS and aero.propeller_thrust_n > 0.0
    return ThrottleParams(
        budget_s=values["THR_BUDGET"] if available else 0.0,
        most=values["THR_MAX"],
        thrust_mps2=aero.propeller_thrust_n / aero.mass_kg if available else 0.0,
        speed_mps=aero.propeller_speed_mps,
        lag_s=aero.propeller_lag_s,
    )


def fence_of(values: ParameterSet) -> Fence:
    """The sides of the fence, as the operator has set them."""
    return Fence(
        x_min_m=values["FENCE_X_MIN"],
        x_max_m=values["FENCE_X_MAX"],
        y_max_m=values["FENCE_Y_MAX"],
        z_min_m=values["FENCE_Z_MIN"],
        z_max_m=values["FENCE_Z_MAX"],
    )


def _soaring_gains(values: ParameterSet) -> SoaringGains:
    return SoaringGains(
        PidGains(
            kp=values["RHO_P"],
            ki=values["RHO_I"],
            kd=values["RHO_D"],
            rate_filter_radps=2.0 * pi * values["RHO_D_FILT"],
            integral_max=radians(values["RHO_I_MAX"]),
            output_min=radians(values["PITCH_MIN"]),
            output_max=radians(values["PITCH_MAX"]),
        ),
        radians(values["PITCH_SLEW"]),
    )


def late_by_s(values: ParameterSet) -> float:
    """How late the surfaces are [s]: servo, the command's way, and where the loop is slower than
    200 Hz what half a tick is longer than HOLD_S, which the schedules add."""
    longer_s = max(0.0, 0.5 / values["LOOP_RATE"] - HOLD_S)
    return values["DYN_SERVO"] + values["CMD_DELAY"] + longer_s


def dynamics_of(values: ParameterSet) -> Dynamics:
    """The airframe that flies, as its parameters have it."""
    return Dynamics(
        speed_mps=values["DYN_SPEED"],
        short_period_radps=values["DYN_FREQ"],
        damping=values["DYN_DAMP"],
        effect_radps2=values["DYN_EFFECT"],
        late_s=late_by_s(values),
        lag_s=min(values["DYN_LAG"], values["DYN_SERVO"]),
        glide_ratio=values["DYN_GLIDE"],
        best_glide_mps=values["DYN_BEST"],
        path_s=values["DYN_PATH"],
    )


def _schedule(values: ParameterSet) -> GainSchedule:
    found_on = Dynamics(
        speed_mps=values["RHO_SPEED"],
        short_period_radps=values["ELE_FREQ"],
        damping=values["ELE_DAMP"],
        effect_radps2=values["ELE_EFFECT"],
        late_s=values["ELE_LATE"],
        lag_s=values["ELE_LAG"],
        glide_ratio=0.0,
        best_glide_mps=0.0,
        path_s=0.0,
    )
    return schedule_of(
        values["RHO_SPEED"], radians(values["RHO_LEAN"]), found_on, dynamics_of(values)
    )


def _heading_gains(values: ParameterSet) -> HeadingGains:
    travel = values["SURF_MAX"]
    return HeadingGains(
        PidGains(
            kp=values["RUD_P"],
            ki=0.0,
            kd=values["RUD_D"],
            rate_filter_radps=2.0 * pi * values["RUD_D_FILT"],
            integral_max=0.0,
            output_min=-travel,
            output_max=travel,
        ),
        values["WPT_X"],
        values["WPT_R_MIN"],
        radians(values["PSI_MAX"]),
    )


def _cross_wind(values: ParameterSet, loops: int) -> CrossWindParams:
    """A bank that follows the heading alone needs to know where at rest the nose points."""
    veer_max_rad = radians(values["VEER_MAX"])
    if loops == THEIRS:
        veer_max_rad = max(veer_max_rad, HEADING_OFF_RAD)
    return CrossWindParams(veer_max_rad, values["VEER_T"])


def _sideways_gains(values: ParameterSet) -> PidGains:
    bank = radians(values["SIDE_BANK"])
    return PidGains(
        kp=0.0,
        ki=values["SIDE_I"],
        kd=values["SIDE_P"],
        rate_filter_radps=SIDEWAYS_FILTER_RADPS,
        integral_max=0.5 * bank,
        output_min=-bank,
        output_max=bank,
    )


def _surface_gains(values: ParameterSet, prefix: str) -> PidGains:
    travel = values["SURF_MAX"]
    return PidGains(
        kp=values[f"{prefix}_P"],
        ki=values[f"{prefix}_I"],
        kd=values[f"{prefix}_D"],
        rate_filter_radps=2.0 * pi * values[f"{prefix}_D_FILT"],
        integral_max=travel,  # the integral may take all of the travel
        output_min=-travel,
        output_max=travel,
    )


def _imu_gains(
    values: ParameterSet, prefix: str, plain: PidGains, rate_filter_hz: float
) -> PidGains:
    """The gains for flight with accelerations; one that is 0 is as without."""
    return plain._replace(
        kp=values[f"{prefix}_P_IMU"] or plain.kp,
        ki=values[f"{prefix}_I_IMU"] or plain.ki,
        kd=values[f"{prefix}_D_IMU"] or plain.kd,
        rate_filter_radps=2.0 * pi * rate_filter_hz or plain.rate_filter_radps,
    )
