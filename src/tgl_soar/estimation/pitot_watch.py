"""Whether the pitot tube tells the truth: what the wing carries at the speed that it claims.

Ice, water or an insect do not silence a pitot tube, they make it read a slower air, and a covered
static port makes it read any.  The wing does not lie.  At the claimed speed u it carries the
measured force at one angle of attack only, and two others are known without the tube:

    lift    alpha_u = (−2 m f_z / (ρ S u²) − C_L0 − C_Lδe δe) / C_Lα
    trim    alpha_t = −(C_m0 + C_mδe δe + C_mq c q / 2V) / C_mα            V: at least the slowest
    axial   alpha_f = f_x / −f_z + C_D / C_L                               C_D, C_L: at alpha_t

The tube lies where alpha_u is off both of them to the same side by more than APART_RAD, as means
of AVERAGE_S, for LASTS_S.  It is accepted again when it has been within half of that of either for
ACCEPTED_S.

APART_RAD is three standard deviations of what an honest file leaves of one of the two, as
`estimation.wind` has them: 0.02 rad of trim (the centre of gravity), or 0.016 of the drag and 0.01
of the accelerometers' bias.  Both must be wrong by it, to the same side, before an honest tube is
doubted.  A gust changes alpha_u and alpha_f alike.  Nothing of this needs the attitude, unless
there are no accelerometers: then the force is that of steady flight, and two degrees of attitude
take half of APART_RAD.

At C_L = 0.7 and C_Lα = 4.6 it is a tube that reads a sixth too slow, or a third too fast.  What
errs by less is left to the filter of the wind, whose margins it narrows or widens.

Beyond the stall the lift curve says nothing, so that nothing is concluded there: a wing that is
stalled must not lose the tube that says so.
"""

from __future__ import annotations

from math import sqrt
from typing import Final, NamedTuple

from tgl_soar.estimation.aerodynamics import lift_drag, trim_alpha
from tgl_soar.types import NAN, Aerodynamics, Inputs, VehicleState, isfinite

# Of a mean square, that one sample counts for at most: a raindrop or a broken frame says nothing,
# and a tube that really reads twice as fast is found out as soon.
MOST_OF_MEAN: Final = 4.0
AVERAGE_S: Final = 1.0  # a short period and a gust of some metres are over
LASTS_S: Final = 0.5
ACCEPTED_S: Final = 5.0
APART_RAD: Final = 0.06
PITOT_AGE_MAX_S: Final = 0.5  # what comes later is of other air
LEAST_FORCE: Final = 0.3  # of gravity: a wing that carries less says little of the speed
LEAST_MPS: Final = 1.0  # a tube that is closed reads nothing


class PitotMeans(NamedTuple):
    """Over AVERAGE_S, body axes."""

    speed2: float  # of the tube's [m²/s²]; NaN: none yet
    force_x_mps2: float
    force_z_mps2: float
    elevator: float  # its deflection, -1 … 1
    pitch_rate_radps: float


class PitotWatch(NamedTuple):
    """What is remembered of the tube."""

    means: PitotMeans
    apart_s: float  # for how long the wing has contradicted it
    agrees_s: float  # for how long it has agreed with the wing
    lies: bool  # it is not used


_NO_MEANS: Final = PitotMeans(
    speed2=NAN, force_x_mps2=NAN, force_z_mps2=NAN, elevator=NAN, pitch_rate_radps=NAN
)
NO_PITOT_WATCH: Final = PitotWatch(means=_NO_MEANS, apart_s=0.0, agrees_s=0.0, lies=False)


def pitot_step(
    aero: Aerodynamics,
    push_mps2: float,
    state: PitotWatch,
    vehicle: VehicleState,
    inputs: Inputs,
    force_mps2: tuple[float, float],
    elevator: float,
    dt_s: float,
) -> PitotWatch:
    """The watch a tick later.

    force_mps2: specific force, x and z, as it is now; push_mps2: a propeller's part of the first;
    elevator: its deflection, -1 … 1; NaN: not known.  Where anything is not known it stays.
    """
    now, pitot = inputs.time_s, inputs.airspeed
    fresh = pitot.sequence > 0 and 0.0 <= now - pitot.time_s <= PITOT_AGE_MAX_S
    speed, rate = pitot.airspeed_mps, vehicle.pitch_rate_radps
    force_x, force_z = force_mps2[0] - push_mps2, force_mps2[1]
    known = isfinite(speed + force_x + force_z + elevator + rate) and dt_s > 0.0
    if not (fresh and known and aero.Cm_alpha < 0.0 and aero.CL_alpha > 0.0):  # false for NaN
        return state
    latest = PitotMeans(
        speed2=speed * speed,
        force_x_mps2=force_x,
        force_z_mps2=force_z,
        elevator=elevator,
        pitch_rate_radps=rate,
    )
    means = _averaged(state.means, latest, dt_s)
    off = off_rad(aero, means)
    apart_s = state.apart_s + dt_s if abs(off) > APART_RAD else 0.0  # false for NaN: not known
    agrees_s = state.agrees_s
    if isfinite(off):
        agrees_s = agrees_s + dt_s if abs(off) <= 0.5 * APART_RAD else 0.0
    lies = apart_s >= LASTS_S or (state.lies and agrees_s < ACCEPTED_S)
    return PitotWatch(means=means, apart_s=apart_s, agrees_s=agrees_s, lies=lies)


def off_rad(aero: Aerodynamics, means: PitotMeans) -> float:
    """By how much the angle of attack at the claimed speed is beyond what trim and force say, of
    the nearer: positive for a tube that reads too slow, zero where it is between; NaN: not known.
    """
    carried = -means.force_z_mps2
    if not carried >= LEAST_FORCE * aero.gravity_mps2:
        return NAN
    speed2 = max(LEAST_MPS * LEAST_MPS, means.speed2)
    pressure_area = 0.5 * aero.air_density_kgpm3 * speed2 * aero.wing_area_m2
    lift = aero.mass_kg * carried / pressure_area
    by_lift = (lift - aero.CL0 - aero.CL_elevator * means.elevator) / aero.CL_alpha
    # The rate's part is small, and as much smaller as the air is faster.
    speed = max(sqrt(speed2), aero.polar.speed_min_mps)
    by_trim = trim_alpha(aero, means.elevator, means.pitch_rate_radps, speed)
    if not by_trim <= aero.stall_alpha_rad:
        return NAN
    cl, _, cd, _ = lift_drag(aero, by_trim, means.elevator)
    if not cl > 0.0:
        return NAN
    by_force = means.force_x_mps2 / carried + cd / cl
    least, most = min(by_trim, by_force), max(by_trim, by_force)
    return max(0.0, by_lift - most) + min(0.0, by_lift - least)


def _averaged(means: PitotMeans, latest: PitotMeans, dt_s: float) -> PitotMeans:
    if not isfinite(means.speed2):  # the first
        return latest
    blend = min(1.0, dt_s / AVERAGE_S)
    most = MOST_OF_MEAN * max(LEAST_MPS * LEAST_MPS, means.speed2)
    force_x, force_z = means.force_x_mps2, means.force_z_mps2
    return PitotMeans(
        speed2=means.speed2 + blend * (min(most, latest.speed2) - means.speed2),
        force_x_mps2=force_x + blend * (latest.force_x_mps2 - force_x),
        force_z_mps2=force_z + blend * (latest.force_z_mps2 - force_z),
        elevator=means.elevator + blend * (latest.elevator - means.elevator),
        pitch_rate_radps=means.pitch_rate_radps
        + blend * (latest.pitch_rate_radps - means.pitch_rate_radps),
    )
