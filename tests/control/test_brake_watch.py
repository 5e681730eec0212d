"""Whether the brake does what it is commanded: detected by the motion of a sliding aircraft."""

from __future__ import annotations

from math import cos, exp, log, radians, sin
from random import Random

import pytest
from samples import STILL

from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.control.brake_shake import BLOCK_S, SHAKEN, SHAKES_FEWEST
from tgl_soar.control.brake_watch import (
    ACTS,
    DOES_NOT,
    HALF_S,
    MOVED,
    NOT_TRIED,
    NOT_WATCHED,
    NOTHING,
    SAMPLE_S,
    SAMPLES,
    TRIED,
    TRIED_FEWEST,
    TRIED_LEAST,
    TRIED_REST_S,
    TRIED_SIGMAS,
    WATCH_S,
    _judged,
    even_step,
    pulls,
)
from tgl_soar.control.envelope import brake_blocked
from tgl_soar.control.laws import laws_from
from tgl_soar.control.point_hold import (
    ABOVE_BAND,
    BELOW_BAND,
    DEAD,
    GIVES_WAY,
    HOLDS,
    MIDDLE,
    NO_POINT,
    POINT_TEXTS,
    RESTS,
    TRIES,
    UNEVEN,
    Around,
    BrakeGains,
    BrakeState,
    acts,
    brake_step,
)
from tgl_soar.control.target_line import TargetLine
from tgl_soar.geometry import SoaringFrame
from tgl_soar.types import VehicleState, polar_slope

PLANE = shipped("airframes/eclipson_c_spoilers.toml")
SITE = shipped("sites/tunnel.toml")
AIRFRAME = load_airframe(PLANE)
AERO = AIRFRAME.aerodynamics()
LAWS = laws_from(
    load_parameters(AIRFRAME, PLANE, load_site(SITE), SITE).changed({"TGL_HOLD": 1.0}),
    SoaringFrame(0.0, 0.0, 0.0, 0.0),
    AERO,
)
ETA = radians(105.0)
TARGET = TargetLine(0.0, 1.0, ETA)
DT = 0.005
SPEED_MPS = 9.0
LIFT_RADPS = 6.0  # the speed along the line follows as a lag of this
SLIDE_PER_S = 1.0  # excess updraft along the line, as in the tunnel: a band of 0.34 m
GUST_MPS, GUST_S = 0.15, 0.3  # of what lifts, some 2 % of the wind


class Slide:
    """An aircraft on the line, as the brake's law gets it: its place, its speed, and its roll loop.

    `room`: how far the brake may go; `effect`: of what the brake is commanded, what it does;
    `stuck`: where a half or all of it stands that does not move; `roll`: aileron for all of the
    difference of two halves; `trim`, `throw`: of ailerons that are the brake too; `inertial`:
    accelerations are known.
    """

    def __init__(
        self,
        *,
        effect: float = 1.0,
        stuck: float = 0.0,
        roll: float = 0.0,
        gusts: float = 0.0,
        speed_mps: float = SPEED_MPS,
        room: float = 1.0,
        inertial: bool = False,
        seed: int = 3,
    ) -> None:
        self.effect, self.stuck, self.roll, self.gusts = effect, stuck, roll, gusts
        self.airspeed_mps, self.room, self.inertial = speed_mps, room, inertial
        self.along_m = self.speed_mps = self.gust_mps = self.aileron = 0.0
        self.roll_gust = self.trim = self.throw = 0.0
        self.bound = 0
        self.brake, self.rate = 0.0, 200.0
        self.state: BrakeState = NO_POINT
        self.standings: list[int] = []
        self._random = Random(seed)

    def fly(
        self, of: BrakeGains, seconds: float, *, up_free: bool = True, down_free: bool = True
    ) -> Slide:
        """It rests at 0 with half of the brake."""

        most = of.sink * self.airspeed_mps**3
        sinks = sin(ETA) - polar_slope(AERO.polar, self.airspeed_mps) * cos(ETA)
        for _ in range(round(seconds / DT)):
            room = self.room
            if self.throw > 0.0:
                room = min(room, (1.0 - abs(self.aileron)) / self.throw)
                self.bound += self.state.brake > room
            brake = max(self.brake - self.rate * DT, min(self.brake + self.rate * DT, room))
            brake = self.brake = max(self.brake - self.rate * DT, min(brake, self.state.brake))
            does = self.effect * brake + (1.0 - self.effect) * self.stuck
            self.aileron = self.trim + self.roll_gust - self.roll * (brake - self.stuck)
            white = self._random.gauss(0.0, 1.0), self._random.gauss(0.0, 1.0)
            scale = (2.0 * DT / GUST_S) ** 0.5
            self.gust_mps += -self.gust_mps * DT / GUST_S + self.gusts * GUST_MPS * scale * white[0]
            self.roll_gust += -self.roll_gust * DT / GUST_S + self.gusts * 0.08 * scale * white[1]
            lifts = self.gust_mps - SLIDE_PER_S * self.along_m - most * (does - 0.5)
            self.speed_mps += LIFT_RADPS * (lifts / sinks - self.speed_mps) * DT
            self.along_m += self.speed_mps * DT
            around = Around(
                on_the_line=True,
                answers=True,
                blocked=brake_blocked(brake, self.state.brake, room),
                room=room,
                brake=brake,
                aileron=self.aileron,
                inertial=self.inertial,
                up_free=up_free,
                down_free=down_free,
            )
            self.state = brake_step(
                of, AERO, self.state, TARGET, ETA, self._vehicle(), self.airspeed_mps, around, DT
            )
            self.standings.append(self.state.standing)
        return self

    def _vehicle(self) -> VehicleState:
        nothing = STILL
        return nothing._replace(
            x_m=TARGET.x_m + self.along_m * cos(ETA),
            z_m=TARGET.z_m + self.along_m * sin(ETA),
            velocity_x_mps=self.speed_mps * cos(ETA),
            climb_mps=self.speed_mps * sin(ETA),
        )

    def order_of_standings(self) -> list[int]:
        """Each once, in the order in which they came."""
        return list(dict.fromkeys(self.standings))


def test_in_gusts_a_brake_that_acts_evenly_is_left_alone() -> None:
    flight = Slide(gusts=1.0).fly(LAWS.brake, 600.0)
    assert set(flight.standings) == {RESTS, HOLDS}
    assert flight.state.even.brake_2 > MOVED**2  # so that it was judged


@pytest.mark.parametrize("roll", [0.17, -0.25])
def test_a_half_that_jams_is_known_by_the_aileron_that_follows_the_brake(roll: float) -> None:
    """The shipped spoilers need 0.17 of the aileron; gusts move it by 0.08 rms."""
    flight = Slide(effect=0.5, stuck=0.3, roll=roll, gusts=1.0).fly(LAWS.brake, 4.0 * WATCH_S)
    assert flight.order_of_standings() == [RESTS, HOLDS, UNEVEN]
    assert flight.state.brake == 0.0
    assert flight.standings.index(UNEVEN) * DT < 2.0 * WATCH_S


def test_a_small_pull_is_left_to_the_aileron() -> None:
    flight = Slide(roll=0.04, gusts=1.0).fly(LAWS.brake, 300.0)
    assert set(flight.standings) == {RESTS, HOLDS}


@pytest.mark.parametrize(("stuck", "standing"), [(0.1, BELOW_BAND), (0.9, ABOVE_BAND)])
@pytest.mark.parametrize("gusts", [0.0, 0.5])
@pytest.mark.parametrize("speed", [9.0, 9.6, 12.0])
def test_a_brake_that_jams_is_tried_and_given_up(
    stuck: float, standing: int, gusts: float, speed: float
) -> None:
    flight = Slide(effect=0.0, stuck=stuck, gusts=gusts, speed_mps=speed).fly(LAWS.brake, 120.0)
    assert flight.order_of_standings() == [RESTS, HOLDS, standing, TRIES, DEAD]
    assert flight.state.brake == 0.0


@pytest.mark.parametrize(("along", "standing"), [(0.4, ABOVE_BAND), (-0.4, BELOW_BAND)])
@pytest.mark.parametrize("gusts", [0.0, 0.5])
def test_outside_the_band_a_brake_that_acts_is_tried_once_and_goes_on(
    along: float, standing: int, gusts: float
) -> None:
    flight = Slide(gusts=gusts).fly(LAWS.brake._replace(along_m=along), 200.0)
    assert flight.order_of_standings() == [RESTS, HOLDS, standing, TRIES]
    assert flight.state.standing == standing
    tried_s = flight.standings.count(TRIES) * DT
    assert 2.0 * HALF_S * TRIED_FEWEST <= tried_s + 0.1 < 80.0  # two trials at most
    assert 0.0 < flight.state.trial.rest_s < TRIED_REST_S


@pytest.mark.parametrize("gusts", [0.0, 0.5])
@pytest.mark.parametrize("speed", [9.0, 11.0])
def test_a_law_at_an_end_shakes_the_brake_and_gives_up_one_that_has_jammed(
    speed: float, gusts: float
) -> None:
    flight = Slide(effect=0.0, stuck=0.9, gusts=gusts, speed_mps=speed, inertial=True)
    shaken = []
    for _ in range(600):
        flight.fly(LAWS.brake._replace(gives_way=True), 0.11)  # no whole part of a shake
        shaken.append(flight.state.shake.shaken)
        if flight.state.standing == DEAD:
            break
    assert flight.order_of_standings() == [RESTS, HOLDS, ABOVE_BAND, DEAD]
    assert (min(shaken), max(shaken)) == pytest.approx((-SHAKEN, SHAKEN), rel=0.1)
    assert flight.fly(LAWS.brake, 2.1).state.brake == 0.0


@pytest.mark.parametrize("gusts", [0.0, 0.5])
def test_outside_the_band_a_brake_that_acts_is_shaken_and_then_the_point_may_give_way(
    gusts: float,
) -> None:
    along = LAWS.brake._replace(along_m=0.35)
    stays = Slide(gusts=gusts, inertial=True).fly(along, 120.0)
    assert set(stays.standings) == {RESTS, HOLDS, ABOVE_BAND}
    gives = Slide(gusts=gusts, inertial=True).fly(along._replace(gives_way=True), 120.0)
    assert GIVES_WAY in gives.standings
    assert gives.state.standing == HOLDS
    # Not on the word of a shake that is long past.
    first = gives.standings.index(GIVES_WAY)
    assert gives.standings[:first].count(ABOVE_BAND) * DT > 0.9 * BLOCK_S * SHAKES_FEWEST
    gives.effect, gives.stuck = 0.0, 0.95
    again = len(gives.standings)
    gives.fly(along._replace(gives_way=True, along_m=0.3), 60.0)
    assert GIVES_WAY not in gives.standings[again:]
    assert gives.state.standing == DEAD


@pytest.mark.parametrize("speed", [8.0, 9.6, 11.0, 12.0])
@pytest.mark.parametrize(("sign", "standing"), [(1.0, ABOVE_BAND), (-1.0, BELOW_BAND)])
@pytest.mark.parametrize("gusts", [0.0, 0.3])
def test_outside_the_band_it_is_reported_at_any_speed(
    speed: float, sign: float, standing: int, gusts: float
) -> None:
    """All of the brake is 0.24 to 0.8 m/s of sink there, and the law may ask for 0.18 by place."""
    outside_m = 0.5 * LAWS.brake.sink * speed**3 / SLIDE_PER_S + 0.3
    flight = Slide(gusts=gusts, speed_mps=speed).fly(
        LAWS.brake._replace(along_m=sign * outside_m), 60.0
    )
    assert flight.order_of_standings()[:4] == [RESTS, HOLDS, standing, TRIES]
    # So slowly does it come to its end: the slide is a lag of 1 s, the law's integral of 3 s.
    assert flight.standings.index(standing) * DT < 40.0


@pytest.mark.parametrize("speed", [9.0, 12.0])
def test_where_the_envelope_leaves_a_part_of_the_brake_the_end_of_that_is_an_end(
    speed: float,
) -> None:
    flight = Slide(room=0.3, speed_mps=speed).fly(LAWS.brake._replace(along_m=-0.5), 60.0)
    assert BELOW_BAND in flight.standings
    assert {TRIES, DEAD} & set(flight.standings) <= {TRIES}  # no jam is made of it
    assert flight.state.standing == BELOW_BAND


@pytest.mark.parametrize("rate", [2.0, 0.5])
def test_a_brake_that_goes_only_so_fast_is_at_no_end(rate: float) -> None:
    flight = Slide(gusts=0.5, inertial=True)
    flight.rate = rate
    flight.fly(LAWS.brake, 60.0)
    assert set(flight.standings) == {RESTS, HOLDS}
    assert flight.state.shake.pressed < 0.2


@pytest.mark.parametrize("trim", [0.0, 0.1, -0.2])
def test_a_brake_that_makes_room_for_roll_does_not_pull(trim: float) -> None:
    """Two ailerons: what the one takes of the travel the other has not."""
    flight = Slide(gusts=1.0)
    flight.trim = trim
    flight.throw = 1.5
    flight.fly(LAWS.brake._replace(along_m=-0.1), 120.0)
    assert UNEVEN not in flight.standings
    assert flight.state.standing in (HOLDS, BELOW_BAND)
    assert flight.bound > 1000  # ticks in which there was not room for both


def test_two_slow_ways_that_go_together_once_do_not_pull() -> None:
    """The point goes to its place, and takes the brake along, while the aileron settles."""
    for seed in range(60):
        random, state = Random(seed), NOT_WATCHED
        brake = aileron = 0.0
        for i in range(round(40.0 / DT)):
            scale = (2.0 * DT / GUST_S) ** 0.5
            brake += -brake * DT / GUST_S + 0.06 * scale * random.gauss(0.0, 1.0)
            aileron += -aileron * DT / GUST_S + 0.04 * scale * random.gauss(0.0, 1.0)
            settles = exp(-i * DT / 3.0)
            state = even_step(state, 0.5 - 0.3 * settles + brake, 0.1 * settles + aileron, DT)
            assert not pulls(state), (seed, i * DT)


def test_of_few_samples_nothing_is_reported() -> None:
    state, random = NOT_WATCHED, Random(1)
    for i in range(round(60.0 / DT)):
        brake = 0.5 + 0.1 * sin(2.0 * i * DT)
        state = even_step(state, brake, 0.5 * brake + random.gauss(0.0, 0.001), DT)
        if pulls(state):
            break
    assert i * DT == pytest.approx(-WATCH_S * log(1.0 - SAMPLES * SAMPLE_S / WATCH_S), abs=1.0)


def test_while_it_is_tried_it_moves_by_no_more_than_was_said_and_within_its_travel() -> None:
    flight = Slide()
    of = LAWS.brake._replace(along_m=0.4)
    brakes = []
    for _ in range(4000):
        flight.fly(of, DT)
        if flight.state.standing == TRIES:
            brakes.append(flight.state.brake)
    assert (min(brakes), max(brakes)) == pytest.approx((0.0, TRIED))


@pytest.mark.parametrize("along", [0.3, -0.3])
def test_a_point_may_give_way_until_the_brake_is_in_the_middle_again(along: float) -> None:
    """The band reaches 0.17 m to either side: 0.3 m is outside."""
    stays = Slide(gusts=0.3).fly(LAWS.brake._replace(along_m=along), 120.0)
    assert not {GIVES_WAY, HOLDS} & set(stays.standings[-4000:])
    assert stays.state.given_way_m == 0.0
    gives = Slide(gusts=0.3).fly(LAWS.brake._replace(along_m=along, gives_way=True), 120.0)
    assert GIVES_WAY in gives.standings
    assert gives.state.standing == HOLDS
    assert abs(gives.state.mean - LAWS.brake.bias) < 2.0 * MIDDLE
    held_m = along + gives.state.given_way_m
    assert abs(held_m) < 0.1  # in the band, about its middle
    assert abs(gives.state.off_m) < 0.05
    # A law that may no longer give way has the point where it was ordered.
    kept = gives.fly(LAWS.brake._replace(along_m=along), DT)
    assert kept.state.given_way_m == 0.0
    # The next order is flown as it is given.
    again = gives.fly(LAWS.brake._replace(along_m=0.05, gives_way=True), 10.0)
    assert again.state.given_way_m == 0.0
    assert again.along_m == pytest.approx(0.05, abs=0.05)


def test_it_gives_way_no_further_than_it_may_and_never_to_a_jammed_brake() -> None:
    of = LAWS.brake._replace(along_m=0.3, gives_way=True)
    fenced = Slide().fly(of, 60.0, down_free=False)
    assert fenced.state.given_way_m == 0.0
    assert fenced.state.standing == ABOVE_BAND
    jammed = Slide(effect=0.0, stuck=0.9).fly(of, 60.0)
    assert GIVES_WAY not in jammed.standings
    assert jammed.state.standing == DEAD


def test_what_acts_is_reported_of_every_standing() -> None:
    assert [n for n in range(len(POINT_TEXTS)) if acts(n)] == [
        HOLDS,
        ABOVE_BAND,
        BELOW_BAND,
        TRIES,
        GIVES_WAY,
    ]


@pytest.mark.parametrize(("beyond", "found"), [(1.02, True), (0.98, False)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_it_is_reported_by_three_standard_errors_of_the_mean(
    beyond: float, found: bool, side: float
) -> None:
    """Of as few as there may be, of which the deviation is over one less than their number."""
    tries = TRIED_FEWEST
    deviation = 0.5
    sigma = deviation * (tries / (tries - 1.0)) ** 0.5  # half of them above, half below
    mean = TRIED_LEAST + side * beyond * TRIED_SIGMAS * sigma / tries**0.5
    state = NOT_TRIED
    for i in range(round(tries)):
        q = mean + (deviation if i % 2 else -deviation)
        state = state._replace(
            trial_tries=state.trial_tries + 1.0,
            tries=state.tries + 1.0,
            q_sum=state.q_sum + q,
            q_2_sum=state.q_2_sum + q * q,
        )
    verdict = ACTS if side > 0.0 else DOES_NOT
    assert _judged(state).found == (verdict if found else NOTHING)
