"""Every parameter, declared once: name, unit, range, default, meaning.

The MAVLink parameter server, the TOML loader, the reference page and the tests all read
`PARAMETERS`.  Values are in the operator's units (degrees, hertz) and are 32-bit floats, as
they are on the wire, so that what is set is exactly what is read back; the laws' own objects
in SI units are built from them by `tgl_soar.control.laws.laws_from`.

Names have at most 16 characters and share a prefix by topic.  No firmware has a parameter of
the same name: an autopilot that has not yet learnt the way to this component would execute a
set by itself.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from math import isfinite
from typing import Final, NamedTuple

from tgl_soar.config.parameter_rules import contradiction


class Parameter(NamedTuple):
    """The declaration of one parameter."""

    name: str
    unit: str  # as written in the reference page; "" for a pure number
    minimum: float
    maximum: float
    default: float
    meaning: str
    in_flight: bool = True  # may it change while the module is engaged?
    integer: bool = False  # whole numbers only
    in_files: bool = True  # may a file give it, and is it kept over a restart?


class ParameterError(ValueError):
    """A value that cannot be taken, with the parameter, the value and what is allowed."""

    def __init__(self, name: str, value: object, reason: str) -> None:
        self.name = name
        self.value = value
        self.reason = reason
        super().__init__(f"{name} = {value}: {reason}")


PARAMETERS: Final[tuple[Parameter, ...]] = (
    # --- the operator's switch -----------------------------------------------------------
    Parameter(
        name="OP_ENGAGE", unit="", minimum=0, maximum=2, default=0,
        meaning="1: take the surfaces and soar; 0: disengage. A second after the module has"
                " engaged, OP_ENGAGE reads 2; a module that is not engaged refuses to be set to"
                " 2: a file that a ground station has saved in flight does not engage when it is"
                " loaded. When the module disengages by itself it shows 0, so that it never engages"
                " again unasked.",
        integer=True, in_files=False,
    ),
    Parameter(
        name="OP_RC_CHAN", unit="", minimum=0, maximum=18, default=0,
        meaning="Channel of the pilot's transmitter whose switch engages and releases; 0: none. It"
                " must be none that moves a surface.",
        in_flight=False, integer=True,
    ),
    Parameter(
        name="OP_FORCE", unit="", minimum=0, maximum=1, default=0,
        meaning="1: overrides one refusal by fence, clearance, contour, TGL_STEP_MAX or the set-up"
                " of the autopilot, for the next move of the line, change of fence or CLEAR_MIN, or"
                " engagement. It is 0 again after that, or after 60 s.",
        integer=True, in_files=False,
    ),
    Parameter(
        name="OP_RC_ON", unit="us", minimum=1000, maximum=2000, default=1700,
        meaning="The switch is high above this pulse width.",
    ),
    Parameter(
        name="OP_RC_OFF", unit="us", minimum=1000, maximum=2000, default=1300,
        meaning="Below this pulse width the switch is low: disengaged, and not to be engaged.",
    ),
    Parameter(
        name="OP_GCS_LOSS", unit="", minimum=0, maximum=1, default=0,
        meaning="What happens when no ground station was received for OP_GCS_S. 0: the module says"
                " so once and flies on; 1: it disengages, and the autopilot flies on in"
                " the mode that it had before. Then it cannot be engaged without a station either.",
        integer=True,
    ),
    Parameter(
        name="OP_GCS_S", unit="s", minimum=2, maximum=600, default=10,
        meaning="For how long every ground station may be silent, by its heartbeats, which usually"
                " come once a second. Longer than the silences of the link in use.",
    ),
    # --- the target gradient line --------------------------------------------------------
    Parameter(
        name="TGL_PRESET", unit="", minimum=0, maximum=99, default=0,
        meaning="Puts the line on a line of the site file: 1 is the first in the file. It goes back"
                " to 0 (set by hand) when TGL_X, TGL_Z or TGL_LEAN changes.",
        integer=True,
    ),
    Parameter(
        name="TGL_STAGE", unit="", minimum=0, maximum=2, default=0,
        meaning="Several values as one move. 1: hold back new values of TGL_X, TGL_Z, TGL_LEAN and"
                " TGL_SLEW; then 0: apply all of them at once, or 2: discard them. After 60 s"
                " without another value they are discarded.",
        integer=True, in_files=False,
    ),
    Parameter(
        name="TGL_X", unit="m", minimum=-500, maximum=500, default=0.0,
        meaning="Downstream position of the line's point.",
    ),
    Parameter(
        name="TGL_Z", unit="m", minimum=-100, maximum=1000, default=0.0,
        meaning="Height of the line's point.",
    ),
    Parameter(
        name="TGL_LEAN", unit="deg", minimum=-60, maximum=60, default=15.0,
        meaning="Lean of the line from the vertical, positive when its upper end leans upwind.",
    ),
    Parameter(
        name="TGL_LEAN_MIN", unit="deg", minimum=-60, maximum=60, default=5.0,
        meaning="Smallest lean accepted. On a line that leans downwind the loop is non-minimum"
                " phase and cannot be flown well: lower this only if you know why.",
    ),
    Parameter(
        name="TGL_LEAN_MAX", unit="deg", minimum=5, maximum=60, default=45.0,
        meaning="Largest lean accepted.",
    ),
    Parameter(
        name="TGL_SLEW", unit="m/s", minimum=0.02, maximum=1.0, default=0.3,
        meaning="Speed at which the line moves, perpendicular to itself, at the aircraft.",
    ),
    Parameter(
        name="TGL_ACCEL", unit="m/s^2", minimum=0.05, maximum=5.0, default=0.5,
        meaning="Acceleration with which the line begins and ends a move.",
    ),
    Parameter(
        name="TGL_ROT_SLEW", unit="deg/s", minimum=0.5, maximum=30, default=5.0,
        meaning="Rate at which the line turns to a new lean.",
    ),
    # A decimal point that slipped moves a place of 0.25 m or more by more than 2 m; the lines of
    # the tunnel are 0.6 m apart, those at its ends 1.2 m. At TGL_SLEW's 0.3 m/s it is 7 s of way.
    Parameter(
        name="TGL_STEP_MAX", unit="m", minimum=0.05, maximum=2000, default=2.0,
        meaning="Farthest that one change may move the line's point while engaged (OP_FORCE"
                " overrides). A good value is twice the distance between neighbouring lines.",
    ),
    Parameter(
        name="TGL_HOLD", unit="", minimum=0, maximum=2, default=0,
        meaning="0: the line alone, on which the aircraft slides to where updraft equals sink; 1:"
                " hold a point of the line with the brake; 2: the same, but if the brake stays at"
                " an end of its travel for long, the point moves along the line until the brake is"
                " in the middle again. Only for an airframe with a brake (BRK_…) and a route that"
                " commands it.",
        integer=True,
    ),
    Parameter(
        name="TGL_ALONG", unit="m", minimum=-100, maximum=100, default=0.0,
        meaning="The point to hold: its distance from (TGL_X, TGL_Z) along the line, positive"
                " towards the upper end. The point that is flown follows at BRK_SPEED.",
    ),
    Parameter(
        name="TGL_PLACE", unit="m", minimum=-1, maximum=2000, default=-1,
        meaning="Puts the line's point onto the site's contour: the distance along it from its"
                " upstream end. It is -1 (set by hand) while the point is elsewhere.",
        in_files=False,
    ),
    Parameter(
        name="TGL_CAPTURE", unit="m", minimum=0.01, maximum=2.0, default=0.05,
        meaning="The mode becomes soaring when the line stands still and the aircraft has been"
                " within this distance of it for one second.",
    ),
    # --- e_rho -> pitch setpoint (eq. 15) ------------------------------------------------
    Parameter(
        name="RHO_P", unit="rad/m", minimum=0, maximum=5, default=0.64,
        meaning="Pitch setpoint for each metre of e_rho.",
    ),
    Parameter(
        name="RHO_I", unit="rad/(m s)", minimum=0, maximum=5, default=0.11,
        meaning="Pitch setpoint for each metre-second of e_rho.",
    ),
    Parameter(
        name="RHO_D", unit="rad s/m", minimum=0, maximum=5, default=0.25,
        meaning="Pitch setpoint for each m/s of e_rho's rate.",
    ),
    Parameter(
        name="RHO_D_FILT", unit="Hz", minimum=0.1, maximum=100, default=6.5,
        meaning="Cut-off frequency of the low-pass on e_rho's rate.",
    ),
    Parameter(
        name="RHO_LEAN", unit="deg", minimum=5, maximum=45, default=15.0,
        meaning="Lean of the line that the gains RHO_… and ELE_… were found on. On another lean the"
                " schedule changes them so that the loop keeps its margins.",
    ),
    Parameter(
        name="RHO_SPEED", unit="m/s", minimum=0, maximum=60, default=8.5,
        meaning="Airspeed at which RHO_… and ELE_… were found, for the schedule over speed, lean,"
                " airframe and latency; below 1: no schedule, the gains are used unchanged.",
    ),
    Parameter(
        name="RHO_P_IMU", unit="rad/m", minimum=0, maximum=5, default=0.0,
        meaning="RHO_P while the estimator uses accelerations; 0: RHO_P. The law changes over to"
                " this set of gains within half a second, and back within a tenth. Not used where"
                " a firmware's own loops hold the attitude.",
    ),
    Parameter(
        name="RHO_I_IMU", unit="rad/(m s)", minimum=0, maximum=5, default=0.0,
        meaning="RHO_I while the estimator uses accelerations; 0: RHO_I.",
    ),
    Parameter(
        name="RHO_D_IMU", unit="rad s/m", minimum=0, maximum=5, default=0.0,
        meaning="RHO_D while the estimator uses accelerations; 0: RHO_D.",
    ),
    Parameter(
        name="RHO_DF_IMU", unit="Hz", minimum=0, maximum=100, default=0.0,
        meaning="RHO_D_FILT while the estimator uses accelerations; 0: RHO_D_FILT.",
    ),
    Parameter(
        name="RHO_I_MAX", unit="deg", minimum=0, maximum=30, default=8.0,
        meaning="Largest part of the pitch setpoint that the integral may make up.",
    ),
    Parameter(
        name="PITCH_TRIM", unit="deg", minimum=-30, maximum=30, default=0.0,
        meaning="theta_0: pitch setpoint on the line, without any error. Where the airframe file"
                " gives none of PITCH_TRIM, PITCH_MIN, PITCH_MAX and REC_PITCH and has lift and"
                " drag in [model], the pitch of a glide at 0.94 of the best glide's speed, and the"
                " others 10.5 deg below, 7.5 deg above and 2.5 deg below it.",
    ),
    Parameter(
        name="PITCH_MIN", unit="deg", minimum=-45, maximum=45, default=-15.0,
        meaning="Smallest pitch setpoint.",
    ),
    Parameter(
        name="PITCH_MAX", unit="deg", minimum=-45, maximum=45, default=12.0,
        meaning="Largest pitch setpoint.",
    ),
    Parameter(
        name="PITCH_SLEW", unit="deg/s", minimum=1, maximum=1000, default=120.0,
        meaning="Fastest change of the pitch setpoint.",
    ),
    # --- pitch -> elevator (eq. 16) ------------------------------------------------------
    Parameter(
        name="ELE_P", unit="1/rad", minimum=0, maximum=20, default=2.2,
        meaning="Elevator for each radian of pitch error.",
    ),
    Parameter(
        name="ELE_I", unit="1/(rad s)", minimum=0, maximum=50, default=2.7,
        meaning="Elevator for each radian-second of pitch error.",
    ),
    Parameter(
        name="ELE_D", unit="s/rad", minimum=0, maximum=5, default=0.19,
        meaning="Elevator for each rad/s of pitch rate.",
    ),
    Parameter(
        name="ELE_P_IMU", unit="1/rad", minimum=0, maximum=20, default=0.0,
        meaning="ELE_P while the estimator uses accelerations; 0: ELE_P.",
    ),
    Parameter(
        name="ELE_I_IMU", unit="1/(rad s)", minimum=0, maximum=50, default=0.0,
        meaning="ELE_I while the estimator uses accelerations; 0: ELE_I.",
    ),
    Parameter(
        name="ELE_D_IMU", unit="s/rad", minimum=0, maximum=5, default=0.0,
        meaning="ELE_D while the estimator uses accelerations; 0: ELE_D.",
    ),
    Parameter(
        name="ELE_DSP_IMU", unit="", minimum=0, maximum=1, default=0.0,
        meaning="Part of the setpoint's rate that ELE_D_IMU acts on; 1: eq. 16 as printed.",
    ),
    Parameter(
        name="ELE_D_FILT", unit="Hz", minimum=0.5, maximum=100, default=40.0,
        meaning="Cut-off frequency of the low-pass on the pitch rate.",
    ),
    Parameter(
        name="ELE_FREQ", unit="rad/s", minimum=1, maximum=60, default=11.5,
        meaning="Undamped short-period frequency, at RHO_SPEED, of the airframe of those gains.",
    ),
    Parameter(
        name="ELE_DAMP", unit="", minimum=0.1, maximum=2, default=0.75,
        meaning="Damping ratio of that short period.",
    ),
    Parameter(
        name="ELE_EFFECT", unit="rad/s^2", minimum=1, maximum=500, default=31.0,
        meaning="Pitch acceleration for a full deflection of the elevator, at RHO_SPEED, of the"
                " airframe that the gains were found on.",
    ),
    Parameter(
        name="ELE_LATE", unit="s", minimum=0.001, maximum=0.3, default=0.026,
        meaning="Time from a tick to the elevator on that airframe: servo 18.5 ms, link 7.5 ms. A"
                " later elevator is flown with less gain, an earlier one with no more.",
    ),
    Parameter(
        name="ELE_LAG", unit="s", minimum=0, maximum=0.3, default=0.0185,
        meaning="The servo's time constant in ELE_LATE: it counts half of a delay of its length.",
    ),
    Parameter(
        name="ELE_TRIM", unit="", minimum=-1, maximum=1, default=0.0,
        meaning="Elevator in trimmed flight on the line.",
    ),
    # --- the airframe in pitch -----------------------------------------------------------
    # Filled in from the airframe file ([dynamics], or what follows from [model] and [polar]).
    Parameter(
        name="DYN_SPEED", unit="m/s", minimum=0, maximum=60, default=0.0,
        meaning="Airspeed at which DYN_FREQ, DYN_DAMP and DYN_EFFECT hold; 0: not known, and the"
                " airframe is taken to be the one that the gains were found on.",
    ),
    Parameter(
        name="DYN_FREQ", unit="rad/s", minimum=0, maximum=60, default=0.0,
        meaning="Undamped short-period frequency of this airframe; 0: not known.",
    ),
    Parameter(
        name="DYN_DAMP", unit="", minimum=0, maximum=2, default=0.0,
        meaning="Damping ratio of this airframe's short period; 0: not known.",
    ),
    Parameter(
        name="DYN_EFFECT", unit="rad/s^2", minimum=0, maximum=500, default=0.0,
        meaning="This airframe's pitch acceleration for a full elevator; 0: not known.",
    ),
    Parameter(
        name="DYN_LIFT", unit="m/s^2", minimum=-200, maximum=200, default=0.0,
        meaning="Lift of that deflection over the mass; of a tail below 0. 0: not known.",
    ),
    Parameter(
        name="DYN_SERVO", unit="s", minimum=0, maximum=0.3, default=0.0185,
        meaning="Lag and delay of this airframe's elevator servo.",
    ),
    Parameter(
        name="DYN_LAG", unit="s", minimum=0, maximum=0.3, default=0.0185,
        meaning="The part of DYN_SERVO that is the servo's time constant; the rest is pure delay.",
    ),
    Parameter(
        name="DYN_PATH", unit="s", minimum=0, maximum=5, default=0.0,
        meaning="Time constant with which the flight path follows the pitch, V / (lift per mass and"
                " radian), at DYN_SPEED: for the schedule and the check of margins; 0: not known.",
    ),
    Parameter(
        name="DYN_GLIDE", unit="", minimum=0, maximum=80, default=0.0,
        meaning="Best glide ratio of this airframe; 0: not known.",
    ),
    Parameter(
        name="DYN_BEST", unit="m/s", minimum=0, maximum=60, default=0.0,
        meaning="Airspeed of the best glide; 0: not known.",
    ),
    Parameter(
        name="CMD_DELAY", unit="s", minimum=0, maximum=0.2, default=0.0075,
        meaning="Latency from a tick to the servo's input: the link and the autopilot's loop."
                " `tgl-soar surfaces` measures it with the way back, where outputs are read back.",
    ),
    # --- roll -> aileron (eq. 17) --------------------------------------------------------
    Parameter(
        name="AIL_P", unit="1/rad", minimum=0, maximum=20, default=1.2,
        meaning="Aileron for each radian of roll error.",
    ),
    Parameter(
        name="AIL_I", unit="1/(rad s)", minimum=0, maximum=20, default=0.5,
        meaning="Aileron for each radian-second of roll error.",
    ),
    Parameter(
        name="AIL_D", unit="s/rad", minimum=0, maximum=5, default=0.06,
        meaning="Aileron for each rad/s of roll rate.",
    ),
    Parameter(
        name="AIL_D_FILT", unit="Hz", minimum=0.5, maximum=100, default=40.0,
        meaning="Cut-off frequency of the low-pass on the roll rate.",
    ),
    Parameter(
        name="AIL_TRIM", unit="", minimum=-1, maximum=1, default=0.0,
        meaning="Aileron with wings level.",
    ),
    # --- roll, heading and bank: where their gains were found -----------------------------
    # Filled in with the gains, where these follow from the airframe file.
    Parameter(
        name="LAT_SPEED", unit="m/s", minimum=0, maximum=60, default=8.5,
        meaning="Airspeed at which AIL_P, AIL_I, AIL_D, RUD_P and RUD_D were found. In faster air"
                " the surfaces do more, and are moved less; below 1: the gains are used unchanged.",
    ),
    Parameter(
        name="LAT_LATE", unit="s", minimum=0, maximum=0.5, default=0.0,
        meaning="Time from a tick to the surfaces for which these gains, SIDE_P and SIDE_I were"
                " found. Slower surfaces (DYN_SERVO + CMD_DELAY) are flown with less gain, faster"
                " ones with no more. 0: the time of this airframe.",
    ),
    # --- heading -> rudder (eq. 18) ------------------------------------------------------
    Parameter(
        name="RUD_P", unit="1/rad", minimum=0, maximum=20, default=1.2,
        meaning="Rudder for each radian of heading error.",
    ),
    Parameter(
        name="RUD_D", unit="s/rad", minimum=0, maximum=5, default=0.2,
        meaning="Rudder for each rad/s of heading rate.",
    ),
    Parameter(
        name="RUD_D_FILT", unit="Hz", minimum=0.5, maximum=100, default=40.0,
        meaning="Cut-off frequency of the low-pass on the heading rate.",
    ),
    Parameter(
        name="RUD_TRIM", unit="", minimum=-1, maximum=1, default=0.0,
        meaning="Rudder in straight flight.",
    ),
    Parameter(
        name="WPT_X", unit="m", minimum=-2000, maximum=500, default=-8.0,
        meaning="Downstream position of the virtual waypoint: negative is upwind. It must stay"
                " upwind of the aircraft by WPT_R_MIN.",
    ),
    Parameter(
        name="WPT_R_MIN", unit="m", minimum=1, maximum=100, default=3.0,
        meaning="Shortest distance used to the virtual waypoint.",
    ),
    Parameter(
        name="PSI_MAX", unit="deg", minimum=1, maximum=45, default=20.0,
        meaning="Largest heading setpoint to either side of the wind.",
    ),
    Parameter(
        name="VEER_MAX", unit="deg", minimum=0, maximum=60, default=0,
        meaning="How far the wind may turn, to either side of wind_from_deg of the site or, with"
                " ridge_deg, of straight off the ridge: its direction is estimated in flight, and"
                " the nose points into it. 0: the wind is assumed to blow from there. Where a"
                " firmware turns by banking, 30 at least: a heading that is wrong turns with it.",
    ),
    Parameter(
        name="VEER_T", unit="s", minimum=1, maximum=120, default=6,
        meaning="Time constant of that estimate.",
    ),
    Parameter(
        name="BANK_P", unit="", minimum=0, maximum=5, default=1.0,
        meaning="Bank setpoint for each degree of heading error, on routes where the autopilot's"
                " own loops hold the attitude and turn by banking.",
    ),
    Parameter(
        name="BANK_MAX", unit="deg", minimum=1, maximum=40, default=20.0,
        meaning="Largest bank setpoint from BANK_P, but for beating's turns. A lasting turn beyond"
                " 20 degrees disengages, as a wrong attitude, where accelerations are received.",
    ),
    # --- sideways speed -> bank ----------------------------------------------------------
    Parameter(
        name="SIDE_P", unit="rad s/m", minimum=0, maximum=1, default=0.15,
        meaning="Bank for each m/s that the sideways speed differs from the one with which the"
                " heading setpoint leads to the middle. With SIDE_I also 0 the wings are level, as"
                " in the paper. Not used where a firmware turns by banking.",
    ),
    Parameter(
        name="SIDE_I", unit="rad/m", minimum=0, maximum=1, default=0.03,
        meaning="Bank for each metre of that difference, integrated: removes the sideways offset"
                " that a constant error of the roll angle would leave.",
    ),
    Parameter(
        name="SIDE_BANK", unit="deg", minimum=0, maximum=30, default=10.0,
        meaning="Largest bank setpoint from SIDE_P and SIDE_I, half of it from the integral."
                " High up on the way home, without a pitot tube, it may be half as much again, up"
                " to 20 degrees and half of TILT_MAX. With more than 20 degrees as in BANK_MAX.",
    ),
    # --- surfaces ------------------------------------------------------------------------
    Parameter(
        name="SURF_MAX", unit="", minimum=0.05, maximum=1, default=1.0,
        meaning="Largest deflection commanded, as a fraction of full travel.",
    ),
    Parameter(
        name="SURF_RATE", unit="1/s", minimum=0.5, maximum=100, default=20.0,
        meaning="Fastest change of a command, in full travels a second.",
    ),
    Parameter(
        name="SURF_TOL", unit="", minimum=0.05, maximum=2, default=0.25,
        meaning="Largest difference between the commands and the outputs that the autopilot"
                " reports; beyond it for half a second the surfaces do not answer: disengage.",
    ),
    # --- the envelope --------------------------------------------------------------------
    Parameter(
        name="ALPHA_MAX", unit="deg", minimum=3, maximum=45, default=14.0,
        meaning="Largest angle of attack, where it is known: from 3 deg below it the nose is kept"
                " from rising, 3 deg above it the module recovers. Where the airframe file has a"
                " stall, the default is its stall_alpha_rad plus stall_width_rad.",
    ),
    Parameter(
        name="SPEED_MIN", unit="m/s", minimum=0, maximum=50, default=6.0,
        meaning="Smallest airspeed, where it is known: from 1 m/s above it the nose is kept from"
                " rising, 1 m/s below it the module recovers. The default is 0.79 of the slowest"
                " speed of the airframe file's [polar].",
    ),
    Parameter(
        name="SINK_MAX", unit="m/s", minimum=0.5, maximum=50, default=6.0,
        meaning="Sinking faster than this: recover.",
    ),
    Parameter(
        name="CLEAR_MIN", unit="m", minimum=0, maximum=50, default=0.0,
        meaning="Smallest distance to the ground of the site file: nearer, recover.",
    ),
    Parameter(
        name="FENCE_X_MIN", unit="m", minimum=-5000, maximum=5000, default=-5000,
        meaning="Upstream of this: disengage.",
    ),
    Parameter(
        name="FENCE_X_MAX", unit="m", minimum=-5000, maximum=5000, default=5000,
        meaning="Downstream of this: disengage.",
    ),
    Parameter(
        name="FENCE_Y_MAX", unit="m", minimum=0.5, maximum=5000, default=5000,
        meaning="Further to either side than this: disengage.",
    ),
    Parameter(
        name="FENCE_Z_MIN", unit="m", minimum=-1000, maximum=5000, default=-1000,
        meaning="Below this height: disengage.",
    ),
    Parameter(
        name="FENCE_Z_MAX", unit="m", minimum=-1000, maximum=5000, default=5000,
        meaning="Above this height: disengage.",
    ),
    # --- estimation ----------------------------------------------------------------------
    Parameter(
        name="EST_FIX_SD", unit="m", minimum=0.0002, maximum=20, default=0.003,
        meaning="Noise of a position fix on each axis (standard deviation); a larger one that the"
                " source reports replaces it.",
    ),
    Parameter(
        name="EST_VEL_SD", unit="m/s", minimum=0.002, maximum=20, default=0.05,
        meaning="Noise of the velocity that comes with a fix.",
    ),
    Parameter(
        name="EST_IMU", unit="", minimum=0, maximum=1, default=1,
        meaning="1: propagate position and velocity with the accelerometers, where they arrive.",
        integer=True,
    ),
    Parameter(
        name="EST_ACC_SD", unit="m/s^2", minimum=0.01, maximum=20, default=0.2,
        meaning="Noise of one sample of the accelerometers, errors of the attitude included.",
    ),
    Parameter(
        name="EST_ACC_BIAS_SD", unit="m/s^2", minimum=0.001, maximum=5, default=0.15,
        meaning="Bias of the accelerations, errors of the attitude included: 1 deg of tilt is"
                " 0.17.",
    ),
    Parameter(
        name="EST_CV_SD", unit="m/s^2", minimum=0.05, maximum=50, default=3.0,
        meaning="Standard deviation of the acceleration, assumed where accelerometers are missing.",
    ),
    Parameter(
        name="EST_SD_MAX", unit="m", minimum=0.005, maximum=10, default=0.10,
        meaning="With accelerometers the line is flown on without fixes until the position's"
                " uncertainty (standard deviation) exceeds this, and not only for AGE_POS_HOLD. A"
                " position less certain than three times this is not used, however recent.",
    ),
    Parameter(
        name="EST_GATE", unit="m", minimum=0.05, maximum=100, default=0.5,
        meaning="Innovation gate: a fix no farther than this from the estimate is always accepted,"
                " and counts less the more it scatters; one farther than this and than five"
                " standard deviations is refused, unless several agree.",
    ),
    Parameter(
        name="EST_RESET_MAX", unit="m", minimum=0, maximum=100, default=10,
        meaning="In flight a position that jumps, while its velocity goes on, is a reset of the"
                " autopilot's estimator or of its origin: the line moves with it, up to this far in"
                " all, so that the aircraft stays where its lift is. Beyond, or at 0, the line"
                " stays where it is in the source's frame, and is captured again.",
    ),
    # What PX4's filter asks of a receiver before it begins (EKF2_REQ_EPH, EKF2_REQ_EPV): worse, the
    # firmware's own position would not be used either.
    Parameter(
        name="GPS_ACC_H", unit="m", minimum=0, maximum=100, default=3.0,
        meaning="Where the site's position is by latitude and longitude: engaging is refused"
                " while the receiver reports a larger standard deviation of its place. 0: any.",
    ),
    Parameter(
        name="GPS_ACC_V", unit="m", minimum=0, maximum=100, default=5.0,
        meaning="As GPS_ACC_H, for the height.",
    ),
    # Only a bound by default: it makes the ground nearer and never farther. A profile of a few
    # points that is off by a metre moves the line by a metre, so who has surveyed it asks for 2.
    Parameter(
        name="RNG_USE", unit="", minimum=0, maximum=2, default=1,
        meaning="What a rangefinder that looks down is used for. 1: ground that it sees nearer than"
                " the position says counts for CLEAR_MIN, flare and way home; 2: it also corrects"
                " the height, slowly, where the site file knows the ground; 0: nothing.",
        integer=True,
    ),
    # 1.5 standard deviations of a receiver's height of 2 m; twice as much, three, is the most.
    Parameter(
        name="RNG_GATE", unit="m", minimum=0.2, maximum=20, default=3.0,
        meaning="A rangefinder that steps by more than this against the position, or that differs"
                " by more than twice this, is not used.",
    ),
    Parameter(
        name="EST_DELAY", unit="s", minimum=0, maximum=0.5, default=0.0,
        meaning="Delay of the position source that is not included in its time stamps.",
    ),
    # --- the air at the aircraft -----------------------------------------------------------
    Parameter(
        name="WIND_CHANGE", unit="m/s/sqrt(s)", minimum=0.05, maximum=10, default=0.8,
        meaning="Process noise of the wind at the aircraft: the square root of what its variance"
                " grows by in half a second. In Dryden turbulence it is sigma / sqrt(L / V).",
    ),
    Parameter(
        name="WIND_ALIGN", unit="deg", minimum=0, maximum=5, default=0.5,
        meaning="Standard deviation of the pitch's constant error, for the uncertainty of the"
                " updraft.",
    ),
    Parameter(
        name="WIND_TRIM", unit="", minimum=0, maximum=1, default=0.0,
        meaning="Blend weight of theta_0: 0 is PITCH_TRIM, 1 the pitch of the steady glide at the"
                " local wind's speed.",
    ),
    Parameter(
        name="WIND_TRIM_T", unit="s", minimum=0.1, maximum=60, default=2.0,
        meaning="Time constant with which theta_0 follows the local wind (WIND_TRIM).",
    ),
    Parameter(
        name="WIND_FF", unit="", minimum=0, maximum=1, default=0.0,
        meaning="Feed-forward: the fraction of a gust's change of incidence that the pitch"
                " setpoint removes.",
    ),
    # --- when to disengage ----------------------------------------------------------------
    Parameter(
        name="AGE_POS_HOLD", unit="s", minimum=0.05, maximum=2, default=0.25,
        meaning="Position older than this: hold the pitch; with accelerometers only when the"
                " position is less certain than EST_SD_MAX.",
    ),
    Parameter(
        name="AGE_POS_MAX", unit="s", minimum=0.1, maximum=5, default=2.0,
        meaning="No confident position for longer than this, because no fixes come or those that"
                " come leave it uncertain: recover, wings level at REC_PITCH, for REC_TIME; then"
                " hand over.",
    ),
    # EKF3 says so after 7 s. By g times 0.2 deg of tilt, 0.03 m/s^2, it is 0.7 m off then, and
    # 1.2 m two seconds later; 3 m are all of the lift over a small hill.
    Parameter(
        name="AGE_POS_DR", unit="s", minimum=0, maximum=60, default=2.0,
        meaning="How long a position is used that the autopilot's estimator reports as dead"
                " reckoned. After that it counts as lost (with ESC_AUTO 1 the module breaks off).",
    ),
    Parameter(
        name="AGE_FROZEN", unit="s", minimum=0.1, maximum=10, default=1.0,
        meaning="If a source repeats its numbers for longer than this, its age counts from their"
                " last change (in flight a position's at once, but for global_position); on the"
                " ground it may stand still. Of an attitude that jumps: from the first jump.",
    ),
    Parameter(
        name="AGE_ATT_MAX", unit="s", minimum=0.02, maximum=1, default=0.2,
        meaning="Attitude older than this: disengage. Younger, its average age lowers the gains.",
    ),
    Parameter(
        name="AGE_AP_MAX", unit="s", minimum=1, maximum=10, default=3.0,
        meaning="Autopilot's heartbeat older than this: disengage.",
    ),
    Parameter(
        name="REC_PITCH", unit="deg", minimum=-30, maximum=10, default=-4.0,
        meaning="Pitch flown while recovering: that of the best glide, or a little lower; from"
                " PITCH_MIN to PITCH_TRIM.",
    ),
    Parameter(
        name="REC_TIME", unit="s", minimum=0.0, maximum=10, default=2.0,
        meaning="Longest time of recovering, 0.3 or more; then hand over. 0: hand over at once.",
    ),
    Parameter(
        name="CAPTURE_MAX", unit="m", minimum=0.1, maximum=10, default=1.5,
        meaning="|e_rho| beyond this while flying: disengage.",
    ),
    Parameter(
        name="TILT_MAX", unit="deg", minimum=20, maximum=80, default=60.0,
        meaning="Roll or pitch beyond this: disengage.",
    ),
    # --- the forecast ----------------------------------------------------------------------
    Parameter(
        name="FC_ACT", unit="", minimum=0, maximum=4, default=2,
        meaning="What to do when no place to settle is foreseen on the line. 0: no forecast; 1:"
                " only report; 2: disengage, while soaring only in the last second; 3: disengage"
                " at once; 4: search for a place (SRCH_START), and disengage where there is none;"
                " as 2 where no search can begin. It needs [model] in the airframe file.",
        integer=True,
    ),
    Parameter(
        name="FC_CHANCE", unit="", minimum=0.001, maximum=0.5, default=0.05,
        meaning="If the chance of a place to settle is below this, none is foreseen, on a line"
                " that stands still.",
    ),
    Parameter(
        name="FC_TIME", unit="s", minimum=0, maximum=20, default=1.0,
        meaning="With less time than this to CLEAR_MIN or the fence, the chance of a place to"
                " settle must be one third or more: height to land with. 0: only FC_CHANCE"
                " decides.",
    ),
    # --- telemetry -----------------------------------------------------------------------
    Parameter(
        name="TEL_BUDGET", unit="B/s", minimum=100, maximum=50000, default=2400,
        meaning="Bytes a second that texts and numbers may use on each link, MAVLink's headers"
                " included.",
    ),
    # --- the process ---------------------------------------------------------------------
    Parameter(
        name="LOOP_RATE", unit="Hz", minimum=100, maximum=250, default=200,
        meaning="Rate of the control loop.",
        in_flight=False, integer=True,
    ),
    # --- the brake, along the line ---------------------------------------------------------
    # k_s K / (1 + K), the bandwidth of the place, is a third of the lift's answer to incidence,
    # 6 rad/s, so that servo, transport and the pitch's lag of 0.1 s leave 45 degrees and more.
    Parameter(
        name="BRK_P", unit="1/s", minimum=0, maximum=10, default=2.5,
        meaning="Speed along the line for each metre from the point.",
    ),
    Parameter(
        name="BRK_V", unit="", minimum=0, maximum=5, default=1.2,
        meaning="Sink that the brake adds for each m/s of speed along the line that is too high.",
    ),
    Parameter(
        name="BRK_I", unit="1/s", minimum=0, maximum=10, default=1.0,
        meaning="Sink that the brake adds for each metre of the integral of that speed.",
    ),
    Parameter(
        name="BRK_SPEED", unit="m/s", minimum=0.01, maximum=1.0, default=0.15,
        meaning="Largest speed along the line back to the point, and of the point itself.",
    ),
    Parameter(
        name="BRK_BIAS", unit="", minimum=0, maximum=1, default=0.5,
        meaning="Fraction of the brake that is out without any disturbance, so that it acts both"
                " ways. It costs that fraction of the sink that the full brake adds.",
    ),
    # --- a propeller ----------------------------------------------------------------------
    Parameter(
        name="THR_BUDGET", unit="s", minimum=0, maximum=600, default=0,
        meaning="Full throttle that a flight may use when no place to settle is foreseen, the way"
                " home's height is gone, or it sinks low; 0: none. Only for an airframe with a"
                " propeller, [surfaces.throttle]. Disarming begins another flight.",
    ),
    Parameter(
        name="THR_MAX", unit="", minimum=0, maximum=1, default=1,
        meaning="Largest throttle that the module uses.",
    ),
    # --- margins measured in flight --------------------------------------------------------
    Parameter(
        name="EXC_START", unit="", minimum=0, maximum=1, default=0,
        meaning="1: add a multisine of six tones, 2.5 to 18.8 rad/s, to the pitch setpoint for"
                " 23 s, from which `tgl-soar log margins` reads the open loop. Only while soaring"
                " on a line that stands still; anything unusual ends it. When it has ended the"
                " module shows 0; setting 0 ends it at once.",
        integer=True, in_files=False,
    ),
    Parameter(
        name="EXC_AMP", unit="deg", minimum=0.2, maximum=1.0, default=1.0,
        meaning="Amplitude of that multisine: its largest value to either side.",
    ),
    # --- the search for lift ---------------------------------------------------------------
    Parameter(
        name="SRCH_START", unit="", minimum=0, maximum=4, default=0,
        meaning="1: search for a place to soar: while engaged the module moves the line itself,"
                " in mode searching, and soars where it finds one; 0: the line goes on to where it"
                " was sent last. The module shows 2 while it claims to soar; 3 when it has given"
                " up, which disengages, then 0; and 4 instead of 0 when FC_ACT is 4 and no search"
                " can begin by itself. Setting any TGL_ parameter ends a search. It needs a fence"
                " on every side, CLEAR_MIN, [polar] and [model].",
        integer=True, in_files=False,
    ),
    # --- the survey --------------------------------------------------------------------------
    Parameter(
        name="SRV_START", unit="", minimum=0, maximum=3, default=0,
        meaning="1: survey the contour: while soaring, the module slides the line slowly"
                " downstream until a limit stops it, back past the start to the other end, and"
                " home; `tgl-soar survey` draws the contour from the log. The module shows 2 on"
                " the way upstream, 3 on the way home, and 0 when it has ended. 0 stops the line"
                " where it is; setting any TGL_ parameter ends a survey. It needs a fence on every"
                " side, the forecast (FC_ACT), [polar] and [model] in the airframe file.",
        integer=True, in_files=False,
    ),
    # 3.5 m of contour there and back, the line moving 0.9 m for each metre of it, in 105 s.
    Parameter(
        name="SRV_SPEED", unit="m/s", minimum=0.01, maximum=1.0, default=0.06,
        meaning="As TGL_SLEW, while a survey moves the line. The aircraft lags by about half of"
                " this speed divided by the rate at which it returns to its place.",
    ),
    Parameter(
        name="SRV_REACH", unit="m", minimum=0.1, maximum=500, default=5.0,
        meaning="Farthest that a survey moves the line to either side of where it began.",
    ),
    # --- from the hand to the line ---------------------------------------------------------
    Parameter(
        name="LNC_START", unit="", minimum=0, maximum=1, default=0,
        meaning="1: the next engagement is a launch from the hand: the module holds the attitude,"
                " waits for the throw, gains speed and glides to the line, in mode launching."
                " While the aircraft is in the hand, airspeed and clearance are not checked. It is"
                " 0 again when the launch has ended, after any flight, and after 60 s without an"
                " engagement; setting 0 before the throw calls it off.",
        integer=True, in_files=False,
    ),
    Parameter(
        name="LNC_SPEED", unit="m/s", minimum=0.1, maximum=10, default=1.5,
        meaning="The aircraft counts as thrown when it is faster than this, by its velocity over"
                " the ground or by the push that its accelerometers measure. Choose more than"
                " walking speed; for an aircraft that is only released, as in a tunnel, 0.3.",
    ),
    Parameter(
        name="LNC_WAIT", unit="s", minimum=1, maximum=600, default=60,
        meaning="A launch is called off if there is no throw for this time.",
    ),
    Parameter(
        name="LNC_PITCH", unit="deg", minimum=-15, maximum=15, default=3.0,
        meaning="Pitch that is held from the hand until there is speed, and the best glide's"
                " (REC_PITCH) while the airspeed is known to be less.",
    ),
    Parameter(
        name="LNC_SLEW", unit="m/s", minimum=0.02, maximum=5, default=0.6,
        meaning="As TGL_SLEW, of the line's way from the aircraft to the target after a throw.",
    ),
    Parameter(
        name="LNC_ACCEL", unit="m/s^2", minimum=0.05, maximum=5, default=1.5,
        meaning="As TGL_ACCEL, after a throw: the speed of the throw is turned into height with"
                " it. The nose comes up by a tenth of it in radians.",
    ),
    # --- home --------------------------------------------------------------------------------
    Parameter(
        name="ESC_START", unit="", minimum=0, maximum=2, default=0,
        meaning="1: break off, away from the slope, and land; 2: soar on, from breaking off or"
                " landing, and do not break off by itself; 0: neither. 1 is refused unless in"
                " control, and is 0 again a second after breaking off began; 2, after the flight.",
        integer=True, in_files=False,
    ),
    Parameter(
        name="ESC_AUTO", unit="", minimum=0, maximum=2, default=0,
        meaning="1: break off by itself as soon as the glide to the landing place would leave less"
                " than ESC_SPARE of height, or the flight would end on the slope; 2: likewise, but"
                " while it soars the height is that in the least wind in which this line has"
                " carried it, so that it waits until a wind that has risen falls; 0: only say so.",
        integer=True,
    ),
    # To gain 2 m/s over a wind of 8 takes (10^2 - 8^2) / 2g = 1.8 m, and a second of dive another.
    Parameter(
        name="ESC_CLEAR", unit="m", minimum=0, maximum=50, default=3.0,
        meaning="With ESC_AUTO 1 it breaks off when soaring nearer to the ground than this.",
    ),
    Parameter(
        name="ESC_SPARE", unit="m", minimum=0, maximum=50, default=1.0,
        meaning="Height that is kept in hand for the way to the landing place.",
    ),
    Parameter(
        name="ESC_SIGMA", unit="", minimum=0, maximum=5, default=2.0,
        meaning="Standard deviations of the estimated wind that are added to it for the way home.",
    ),
    Parameter(
        name="ESC_WIND", unit="", minimum=0.3, maximum=1.5, default=1.0,
        meaning="Wind on the way home, divided by that at the aircraft. A slope makes it stronger"
                " at the line: set this to the undisturbed wind divided by the line's.",
    ),
    Parameter(
        name="ESC_BEAR", unit="deg", minimum=-360, maximum=360, default=0,
        meaning="Bearing, from north, of the way out from the slope; at most 60 degrees from"
                " upwind. From the site file's [landing].",
        in_flight=False,
    ),
    Parameter(
        name="ESC_X", unit="m", minimum=-500, maximum=500, default=0,
        meaning="Upstream of this the slope is left behind, and breaking off becomes landing.",
    ),
    # --- beating -----------------------------------------------------------------------------
    Parameter(
        name="BEAT_START", unit="", minimum=0, maximum=1, default=0,
        meaning="1: beat along the ridge, to and fro in the line's plane; 0: back to the line,"
                " with BEAT_AUTO 1 once the wind is fast enough. 1 is refused unless in control.",
        integer=True, in_files=False,
    ),
    Parameter(
        name="BEAT_AUTO", unit="", minimum=0, maximum=2, default=0,
        meaning="1: beat where the wind is too slow to hover in; 2: or beyond VEER_MAX; 0: never.",
        integer=True,
    ),
    Parameter(
        name="BEAT_WIDTH", unit="m", minimum=0, maximum=500, default=40.0,
        meaning="How far to either side it turns; at most 0.8 of FENCE_Y_MAX. 0: it never beats.",
    ),
    Parameter(
        name="LND_X", unit="m", minimum=-500, maximum=500, default=0,
        meaning="Downstream position of the point where to touch down.",
        in_flight=False,
    ),
    Parameter(
        name="LND_Y", unit="m", minimum=-500, maximum=500, default=0,
        meaning="Its position to the right of an aircraft that faces upwind.",
        in_flight=False,
    ),
    Parameter(
        name="LND_Z", unit="m", minimum=-100, maximum=1000, default=0,
        meaning="Its height.",
        in_flight=False,
    ),
    Parameter(
        name="LND_BEAR", unit="deg", minimum=-360, maximum=360, default=0,
        meaning="Bearing, from north, of the approach; at most 60 degrees from upwind.",
        in_flight=False,
    ),
    Parameter(
        name="LND_LEN", unit="m", minimum=0, maximum=500, default=0,
        meaning="Length of the strip about the point; 0: no landing place is known. Then the"
                " height left is not known either, and a break-off glides straight upwind.",
        in_flight=False,
    ),
    Parameter(
        name="LND_BY", unit="", minimum=0, maximum=2, default=0,
        meaning="Who lands once the slope is left behind. 0: the module; 1: the autopilot, by the"
                " landing of its mission (DO_LAND_START); 2: the autopilot, by its return to"
                " launch, which lands with PX4 alone. The module flies its own approach until a"
                " heartbeat shows that mode.",
        integer=True,
    ),
)  # fmt: skip


INDEX: Final[Mapping[str, int]] = {p.name: i for i, p in enumerate(PARAMETERS)}


def as_wire_value(value: float) -> float:
    """The nearest 32-bit float: what a value is after a journey over MAVLink."""
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


# The aircraft, speed and lean that the gains of pitch were found on, and those gains.
ANCHORS: Final = (
    *("RHO_SPEED", "RHO_LEAN", "ELE_FREQ", "ELE_DAMP", "ELE_EFFECT"),
    *("ELE_LATE", "ELE_LAG"),
)
PITCH_GAINS: Final = tuple(
    p.name
    for p in PARAMETERS
    if p.name.startswith(("RHO_", "ELE_")) and p.name not in (*ANCHORS, "ELE_TRIM")
)


class ParameterSet:
    """An immutable, complete and consistent set of parameter values.

    A change makes a new set or raises `ParameterError` and leaves everything as it was.
    """

    __slots__ = ("_values",)

    def __init__(self, values: tuple[float, ...] | None = None) -> None:
        self._values = values or tuple(as_wire_value(p.default) for p in PARAMETERS)

    def __getitem__(self, name: str) -> float:
        return self._values[INDEX[name]]

    def __iter__(self) -> Iterator[tuple[Parameter, float]]:
        return iter(zip(PARAMETERS, self._values, strict=True))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ParameterSet) and self._values == other._values

    def __hash__(self) -> int:
        return hash(self._values)

    def changed(self, changes: Mapping[str, float], *, flying: bool = False) -> ParameterSet:
        """A new set with several values changed as one.

        Errors: `ParameterError` for an unknown name, a value that is not finite, out of range,
        not whole where it must be, not changeable while `flying`, or inconsistent with the
        others.
        """
        values = list(self._values)
        for name, value in changes.items():
            index = _index_of(name, value)
            values[index] = _checked(PARAMETERS[index], value, flying)
        result = ParameterSet(tuple(values))
        _check_together(result, changes)
        return result


def checked_value(name: str, value: float, *, flying: bool = False) -> float:
    """One value as it would stand, looked at without the others.  Errors: `ParameterError`."""
    return _checked(PARAMETERS[_index_of(name, value)], value, flying)


def _index_of(name: str, value: object) -> int:
    if name not in INDEX:
        raise ParameterError(name, value, "no such parameter; `tgl-soar params` lists them")
    return INDEX[name]


def _checked(parameter: Parameter, value: float, flying: bool) -> float:
    allowed = f"allowed {parameter.minimum:g} to {parameter.maximum:g} {parameter.unit}".rstrip()
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ParameterError(parameter.name, value, f"not a number; {allowed}")
    if not isfinite(value):
        raise ParameterError(parameter.name, value, f"not finite; {allowed}")
    # Limits are compared as they are on the wire, so that a limit itself is always accepted.
    low, high = as_wire_value(parameter.minimum), as_wire_value(parameter.maximum)
    if not parameter.minimum <= value <= parameter.maximum and not low <= value <= high:
        raise ParameterError(parameter.name, f"{value:g}", allowed)
    if parameter.integer and value != int(value):
        raise ParameterError(parameter.name, f"{value:g}", f"whole numbers only; {allowed}")
    if flying and not parameter.in_flight:
        raise ParameterError(parameter.name, f"{value:g}", "not while flying; disengage first")
    return as_wire_value(value)


def _check_together(values: ParameterSet, changes: Mapping[str, float]) -> None:
    """Raise if two parameters contradict each other, blaming one that was changed."""
    found = contradiction(values)
    if found is None:
        return
    candidates, reason = found
    name, *others = sorted(candidates, key=lambda candidate: candidate not in changes)
    reported = ", ".join(f"{other} = {values[other]:g}" for other in others)
    reason = reason if any(map(str.isdigit, reason)) else f"{reason} ({reported})"
    raise ParameterError(name, f"{values[name]:g}", reason)
