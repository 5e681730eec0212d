"""What flows through one tick of the autopilot.

Everything here is an immutable named tuple of plain floats, ints and bools: cheap to make,
exact to log and replay, and taken by numba as it stands.  A missing number is NaN; a sequence
number says whether a sample is new.  Numba takes no defaults: what it compiles names all
fields.  This module imports nothing of ours.

Frames (docs/theory.md):
  NED      local north-east-down of the autopilot or the motion-capture hall
  FRD      body forward-right-down
  soaring  x downstream (with the wind), y to the right of an aircraft facing upwind, z up
Signs: positive pitch is nose up, positive roll is right wing down, positive heading is to the
right of straight upwind; positive elevator pitches up, positive aileron rolls right, positive
rudder yaws right, each normalised to -1 … 1 of its travel; a brake goes from 0, retracted, to 1.
"""

from __future__ import annotations

from typing import Final, NamedTuple

NAN: Final = float("nan")
INFINITE: Final = float("inf")
NEVER_S: Final = -INFINITE  # the time of what has not been yet
FLOAT32_MAX: Final = 3.4028234663852886e38  # the largest finite number that 32 bits hold
GRAVITY_MPS2: Final = 9.80665  # what it is elsewhere is a bias of the accelerometers

# Modes of the supervisor.  Plain numbers: they go over the wire and into the log.
BOOT: Final = 0
STANDBY: Final = 1
READY: Final = 2
CAPTURING: Final = 3
SOARING: Final = 4
HOLDING: Final = 5
RECOVERING: Final = 6
RELEASED: Final = 7
FAILED: Final = 8
SEARCHING: Final = 9
LAUNCHING: Final = 10
BREAKING_OFF: Final = 11
LANDING: Final = 12
BEATING: Final = 13


def isfinite(number: float) -> bool:
    """Of a float, as `math.isfinite`; in native code it is no call of Python's."""
    return number - number == 0.0


# Of what a fix may come from (`link.sources`), what has steps of a centimetre: GLOBAL_POSITION_INT.
# An aircraft that hovers in calm air repeats them to the bit, for up to 1.1 s (ArduPlane 4.6.3).
STEPPED_SOURCE: Final = 3


class PositionFix(NamedTuple):
    """One position measurement, in local NED."""

    sequence: int  # grows by one with every fix of the source; 0: none yet
    time_s: float  # when it was measured (not when it arrived), loop's clock
    north_m: float
    east_m: float
    down_m: float
    velocity_north_mps: float  # NaN where the source gives no velocity
    velocity_east_mps: float
    velocity_down_mps: float
    source: int = 0  # which sensor it comes from (`link.sources`)
    sigma_m: float = NAN  # standard deviation of each axis as reported; NaN: not reported
    reckoned: bool = False  # the source says that it is dead reckoned, and not measured

    @property
    def place_ned_m(self) -> tuple[float, float, float]:
        """North, east, down."""
        return self.north_m, self.east_m, self.down_m

    @property
    def velocity_ned_mps(self) -> tuple[float, float, float]:
        """North, east, down; NaN where the source gives none."""
        return self.velocity_north_mps, self.velocity_east_mps, self.velocity_down_mps


class AttitudeSample(NamedTuple):
    """One attitude measurement: the rotation from FRD to local NED, and body rates."""

    sequence: int  # grows by one with every sample; 0: none yet
    time_s: float  # when it was measured, loop's clock
    qw: float
    qx: float
    qy: float
    qz: float
    roll_rate_frd_radps: float  # NaN where the source gives no rates
    pitch_rate_frd_radps: float
    yaw_rate_frd_radps: float

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """w, x, y, z."""
        return self.qw, self.qx, self.qy, self.qz

    @property
    def rates_frd_radps(self) -> tuple[float, float, float]:
        """Roll, pitch, yaw; NaN where the source gives none."""
        return self.roll_rate_frd_radps, self.pitch_rate_frd_radps, self.yaw_rate_frd_radps


class ImuSample(NamedTuple):
    """One sample of accelerometers and gyros, FRD."""

    sequence: int  # grows by one with every sample; 0: none yet
    time_s: float  # when it was measured, loop's clock
    force_x_frd_mps2: float  # specific force: gravity is not in it
    force_y_frd_mps2: float
    force_z_frd_mps2: float
    roll_rate_frd_radps: float  # NaN where the source gives no rates
    pitch_rate_frd_radps: float
    yaw_rate_frd_radps: float

    @property
    def force_frd_mps2(self) -> tuple[float, float, float]:
        """Specific force, forward, right, down."""
        return self.force_x_frd_mps2, self.force_y_frd_mps2, self.force_z_frd_mps2

    @property
    def rates_frd_radps(self) -> tuple[float, float, float]:
        """Roll, pitch, yaw; NaN where the source gives none."""
        return self.roll_rate_frd_radps, self.pitch_rate_frd_radps, self.yaw_rate_frd_radps


class AirspeedSample(NamedTuple):
    """One sample of a pitot tube along the nose."""

    sequence: int  # grows by one with every sample; 0: none yet
    time_s: float  # when it was measured, loop's clock
    airspeed_mps: float


class RangeSample(NamedTuple):
    """One sample of a rangefinder that looks down along the body's third axis."""

    sequence: int  # grows by one with every sample; 0: none yet
    time_s: float  # when it was measured, loop's clock
    range_m: float  # along the beam, within what the sensor says that it can measure


class AutopilotStatus(NamedTuple):
    """What is known of the autopilot that moves the surfaces."""

    time_s: float  # when its last heartbeat arrived, loop's clock; NaN: never
    accepts_surfaces: bool  # it is in a mode in which it obeys the module's surface commands
    armed: bool
    failsafe: bool = False  # it reports a failsafe itself
    boots: int = 0  # how often it has restarted since its first heartbeat


class SurfacesSample(NamedTuple):
    """Where the autopilot reports that it puts the surfaces, read back from its outputs."""

    sequence: int  # grows by one with every sample; 0: none yet
    time_s: float  # when it was measured, loop's clock
    elevator: float  # -1 … 1 of travel, as in SurfaceCommand; NaN: not known
    aileron: float
    rudder: float
    brake: float = NAN  # 0 … 1


NO_FIX: Final = PositionFix(
    sequence=0,
    time_s=NAN,
    north_m=NAN,
    east_m=NAN,
    down_m=NAN,
    velocity_north_mps=NAN,
    velocity_east_mps=NAN,
    velocity_down_mps=NAN,
)
NO_ATTITUDE: Final = AttitudeSample(
    sequence=0,
    time_s=NAN,
    qw=NAN,
    qx=NAN,
    qy=NAN,
    qz=NAN,
    roll_rate_frd_radps=NAN,
    pitch_rate_frd_radps=NAN,
    yaw_rate_frd_radps=NAN,
)
NO_IMU: Final = ImuSample(
    sequence=0,
    time_s=NAN,
    force_x_frd_mps2=NAN,
    force_y_frd_mps2=NAN,
    force_z_frd_mps2=NAN,
    roll_rate_frd_radps=NAN,
    pitch_rate_frd_radps=NAN,
    yaw_rate_frd_radps=NAN,
)
NO_AIRSPEED: Final = AirspeedSample(0, NAN, NAN)
NO_SURFACES: Final = SurfacesSample(
    sequence=0, time_s=NAN, elevator=NAN, aileron=NAN, rudder=NAN, brake=NAN
)
NO_RANGE: Final = RangeSample(0, NAN, NAN)


class Inputs(NamedTuple):
    """Everything that goes into one tick."""

    time_s: float  # the time of this tick, loop's clock, never decreasing
    position: PositionFix
    attitude: AttitudeSample
    autopilot: AutopilotStatus
    engage: bool  # the operator wants the module to fly
    imu: ImuSample = NO_IMU
    airspeed: AirspeedSample = NO_AIRSPEED
    surfaces: SurfacesSample = NO_SURFACES
    rangefinder: RangeSample = NO_RANGE


class AirEstimate(NamedTuple):
    """What the air does at the aircraft, as far as it can be estimated on board."""

    airspeed_mps: float  # true; NaN: not known
    alpha_rad: float  # angle of attack of the body's x axis; NaN: not known
    wind_mps: float  # horizontal, along the soaring frame's x: positive downstream
    updraft_mps: float  # vertical wind, positive up
    excess_mps: float  # excess updraft: the updraft less the sink in still air
    wind_sigma_mps: float  # standard deviations of the two
    updraft_sigma_mps: float
    measured: bool  # the airspeed comes from a pitot tube
    cross_wind_mps: float  # horizontal, along the soaring frame's y: positive to the right
    trim_alpha_rad: float  # the angle of attack that the elevator holds; NaN: not known


NO_AIR: Final = AirEstimate(
    airspeed_mps=NAN,
    alpha_rad=NAN,
    wind_mps=NAN,
    updraft_mps=NAN,
    excess_mps=NAN,
    wind_sigma_mps=NAN,
    updraft_sigma_mps=NAN,
    measured=False,
    cross_wind_mps=NAN,
    trim_alpha_rad=NAN,
)


class VehicleState(NamedTuple):
    """Where the aircraft is and how it moves, at the time of the tick, soaring frame."""

    time_s: float
    x_m: float
    y_m: float
    z_m: float
    velocity_x_mps: float
    velocity_y_mps: float
    climb_mps: float
    roll_rad: float
    pitch_rad: float
    heading_rad: float  # from straight upwind, positive to the right
    roll_rate_radps: float  # rates of the three angles above, not body rates
    pitch_rate_radps: float
    heading_rate_radps: float


class MotionQuality(NamedTuple):
    """How certain the estimates are, and how the samples of a tick were used; soaring frame."""

    innovation_x_m: float  # of the last fix: measured less predicted; NaN: none compared yet
    innovation_y_m: float
    innovation_z_m: float
    nis: float  # normalised innovation squared, of three degrees of freedom: 3 on average
    position_sigma_m: float  # standard deviations now, each axis; NaN: nothing is known
    velocity_sigma_mps: float
    bias_x_mps2: float  # of the measured accelerations
    bias_y_mps2: float
    bias_z_mps2: float
    bias_sigma_mps2: float
    offset_x_m: float  # of the source of position, yet to be bled off
    offset_y_m: float
    offset_z_m: float
    shift_x_m: float  # by which its frame has moved in this flight, and which is taken off
    shift_y_m: float
    shift_z_m: float
    source: int  # of the last fix used
    fix_used: bool  # in this tick
    fix_refused: bool
    jumped: bool  # the estimated position was reset in this tick
    inertial: bool  # accelerations are in use
    reckoned_s: float  # for so long it has been dead reckoned alone; 0: it is measured


class Health(NamedTuple):
    """How old the inputs are and whether they may be flown with."""

    position_age_s: float  # age of the last fix that was used; inf: none
    attitude_age_s: float
    heartbeat_age_s: float
    position_ok: bool
    attitude_ok: bool
    autopilot_ok: bool
    rejected: int  # samples refused so far (not finite, out of order, no rotation)
    position_interval_s: float  # mean between two samples; NaN: not known
    position_jitter_s: float  # mean deviation from it
    attitude_interval_s: float
    attitude_jitter_s: float
    gaps: int  # intervals much longer than the mean, so far, of both
    surfaces_answer: int  # 1: they follow our commands, 0: they do not, -1: not known
    faults: int  # bits, as `estimation.health` names them


class Setpoints(NamedTuple):
    """What the guidance asks of the attitude loops."""

    pitch_rad: float
    roll_rad: float
    heading_rad: float


class SurfaceCommand(NamedTuple):
    """Normalised surface deflections, -1 … 1, and the brake's, 0 … 1."""

    elevator: float
    aileron: float
    rudder: float
    brake: float = 0.0  # what adds drag: both ailerons together, a flap or a spoiler


# Whose loops move the surfaces.
OURS: Final = 0  # the module commands elevator, aileron and rudder
THEIRS_WITH_RUDDER: Final = 1  # the firmware holds pitch and bank, the module commands the rudder
THEIRS: Final = 2  # the firmware holds pitch and bank, and turns by banking


NO_SETPOINTS: Final = Setpoints(NAN, NAN, NAN)


class GlidePolar(NamedTuple):
    """Sink as a third-order polynomial of horizontal airspeed, in the paper's way.

    sink_mps = c0 + c1 u + c2 u² + c3 u³ for u in [speed_min_mps, speed_max_mps]; sink is
    positive down.  Outside that range it is not defined.
    """

    c0: float
    c1: float
    c2: float
    c3: float
    speed_min_mps: float
    speed_max_mps: float


def polar_sink(polar: GlidePolar, speed_mps: float) -> float:
    """Sink [m/s, positive down] at a horizontal airspeed [m/s]; NaN outside the polar's range."""
    if not polar.speed_min_mps <= speed_mps <= polar.speed_max_mps:
        return NAN
    return polar.c0 + speed_mps * (polar.c1 + speed_mps * (polar.c2 + speed_mps * polar.c3))


def polar_slope(polar: GlidePolar, speed_mps: float) -> float:
    """d sink / d speed [-] at a horizontal airspeed [m/s]; NaN outside the polar's range."""
    if not polar.speed_min_mps <= speed_mps <= polar.speed_max_mps:
        return NAN
    return polar.c1 + speed_mps * (2.0 * polar.c2 + speed_mps * 3.0 * polar.c3)


class Aerodynamics(NamedTuple):
    """What is known of the airframe's lift, drag and trim, for reading the air from what it feels.

    C_L = CL0 + CL_alpha (alpha − s) + CL_elevator elevator + CL_brake brake
    C_D = CD0 + CD_lift C_L² + CD_separated sin s + CD_brake brake
    s = w ln(1 + exp((alpha − stall_alpha) / w))     how far the incidence is beyond the stall
    C_m = Cm0 + Cm_alpha alpha + Cm_q chord q / 2V + Cm_elevator elevator + Cm_brake brake
    """

    mass_kg: float
    wing_area_m2: float
    gravity_mps2: float
    air_density_kgpm3: float
    CL0: float
    CL_alpha: float  # per rad
    CL_elevator: float  # per half-throw
    stall_alpha_rad: float
    stall_width_rad: float
    CD0: float
    CD_lift: float
    CD_separated: float
    chord_m: float
    Cm0: float
    Cm_alpha: float
    Cm_q: float
    Cm_elevator: float
    CL_brake: float  # of all of the brake; all three are 0 without one
    CD_brake: float
    Cm_brake: float
    brake_throw: float  # of each aileron's that all of it takes; 0: a surface of its own
    propeller_thrust_n: float  # at full throttle and no airspeed; 0: there is no propeller
    propeller_speed_mps: float  # the airspeed at which nothing of it is left
    propeller_lag_s: float
    polar: GlidePolar  # with the brake retracted


NO_POLAR: Final = GlidePolar(c0=NAN, c1=NAN, c2=NAN, c3=NAN, speed_min_mps=NAN, speed_max_mps=NAN)
NO_AERODYNAMICS: Final = Aerodynamics(
    mass_kg=NAN,
    wing_area_m2=NAN,
    gravity_mps2=NAN,
    air_density_kgpm3=NAN,
    CL0=NAN,
    CL_alpha=NAN,
    CL_elevator=NAN,
    stall_alpha_rad=NAN,
    stall_width_rad=NAN,
    CD0=NAN,
    CD_lift=NAN,
    CD_separated=NAN,
    chord_m=NAN,
    Cm0=NAN,
    Cm_alpha=NAN,
    Cm_q=NAN,
    Cm_elevator=NAN,
    CL_brake=0.0,
    CD_brake=0.0,
    Cm_brake=0.0,
    brake_throw=0.0,
    propeller_thrust_n=0.0,
    propeller_speed_mps=0.0,
    propeller_lag_s=0.0,
    polar=NO_POLAR,
)


class Ground(NamedTuple):
    """The profile of the ground in the vertical plane, soaring frame: level beyond its ends."""

    points: int  # how many of them there are, with growing x; 0: it is not known
    x_m: tuple[float, ...]  # GROUND_POINTS of them: the last one is repeated
    z_m: tuple[float, ...]


GROUND_POINTS: Final = 8
_NOUGHTS = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
NO_GROUND: Final = Ground(0, _NOUGHTS, _NOUGHTS)


class GroundStretch(NamedTuple):
    """A straight stretch of a profile, from one point to the next one downstream.

    Beyond the profile's ends, where it is level, both are the same point.
    """

    x_m: float
    z_m: float
    next_x_m: float
    next_z_m: float


def ground_stretch(ground: Ground, x_m: float) -> GroundStretch:
    """The stretch of a known profile on which x lies, at a point the one that ends there; NaN lies
    upstream of all.

    Written out: where numba compiles it, an index that is only known in flight costs as much as
    hundreds of comparisons.
    """
    x, z = ground.x_m, ground.z_m
    begin_x, begin_z, end_x, end_z = x[0], z[0], x[0], z[0]
    if x_m > x[0]:
        begin_x, begin_z, end_x, end_z = x[0], z[0], x[1], z[1]
    if x_m > x[1]:
        begin_x, begin_z, end_x, end_z = x[1], z[1], x[2], z[2]
    if x_m > x[2]:
        begin_x, begin_z, end_x, end_z = x[2], z[2], x[3], z[3]
    if x_m > x[3]:
        begin_x, begin_z, end_x, end_z = x[3], z[3], x[4], z[4]
    if x_m > x[4]:
        begin_x, begin_z, end_x, end_z = x[4], z[4], x[5], z[5]
    if x_m > x[5]:
        begin_x, begin_z, end_x, end_z = x[5], z[5], x[6], z[6]
    if x_m > x[6]:
        begin_x, begin_z, end_x, end_z = x[6], z[6], x[7], z[7]
    if x_m >= x[7]:
        begin_x, begin_z, end_x, end_z = x[7], z[7], x[7], z[7]
    return GroundStretch(x_m=begin_x, z_m=begin_z, next_x_m=end_x, next_z_m=end_z)
