"""Accelerations, airspeed, surfaces and ranges: from messages to samples."""

from __future__ import annotations

from math import inf, isfinite, isnan, nan, sqrt
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.autopilots.ardupilot import ArduPilot
from tgl_soar.link.autopilots.base import (
    SensorMessages,
    SurfaceChannel,
    SurfaceChannels,
    Wanted,
    deflection,
    pulse_width,
)
from tgl_soar.link.decoder import Decoder
from tgl_soar.link.messages import (
    CommandAck,
    CommandLong,
    DistanceSensor,
    GlobalPositionInt,
    Heartbeat,
    HighresImu,
    Inbound,
    LocalPositionNed,
    RawImu,
    Received,
    ScaledImu,
    ServoOutputRaw,
    Source,
    SysStatus,
    VfrHud,
    VisionPositionEstimate,
)
from tgl_soar.link.session import Session, SessionOptions
from tgl_soar.link.sources import GLOBAL_POSITION, LOCAL_POSITION, VISION, PositionSources
from tgl_soar.link.tangent_plane import Home
from tgl_soar.types import NO_AIRSPEED, NO_IMU, NO_RANGE, NO_SURFACES

OWN, AUTOPILOT, STRANGER, BRIDGE = Source(1, 191), Source(1, 1), Source(9, 1), Source(1, 197)
CHANNELS = SurfaceChannels(
    elevator=SurfaceChannel(channel=2, pwm_min=1100, pwm_trim=1500, pwm_max=1900, reversed=True),
    aileron=SurfaceChannel(channel=1, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    rudder=SurfaceChannel(channel=4, pwm_min=1200, pwm_trim=1510, pwm_max=1800),
)
HOME = Home(51.99, 4.375, 20.0)
G = 9.80665
ALL_UPDATED = 0x1FFF


class Px4Like(ArduPilot):
    """Whose HIGHRES_IMU has the pitot's pressure."""

    sensors = SensorMessages(
        imu=(105,),
        airspeed=Wanted(74, "VFR_HUD", 20.0),
        pitot_in_imu=True,
        estimator=None,
        wind=None,
    )


def session(flavour: type[ArduPilot] = ArduPilot, **options: Any) -> Session:
    talk = Session(
        SessionOptions(own=OWN, flavour=flavour(CHANNELS, 1), loop_rate_hz=200.0, **options)
    )
    receive(
        talk,
        Heartbeat(type=1, autopilot=3, base_mode=81 | 128, custom_mode=0, system_status=4),
        0.0,
    )
    return talk


def receive(talk: Session, message: Inbound, now_s: float, source: Source = AUTOPILOT) -> None:
    talk.handle(Received(source, message), now_s)


def highres(time_us: int, updated: int = ALL_UPDATED, **fields: float) -> HighresImu:
    values = {"abs_pressure": 1013.25, "diff_pressure": 0.5, "temperature": 15.0} | fields
    return HighresImu(
        time_usec=time_us,
        xacc=0.5,
        yacc=-0.25,
        zacc=-9.75,
        xgyro=0.125,
        ygyro=0.25,
        zgyro=-0.5,
        abs_pressure=values["abs_pressure"],
        diff_pressure=values["diff_pressure"],
        temperature=values["temperature"],
        fields_updated=updated,
    )


# --- inertial sensors -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("message", "force", "rates"),
    [
        (highres(1_000_000), (0.5, -0.25, -9.75), (0.125, 0.25, -0.5)),
        (
            ScaledImu(
                message_id=26,
                time_boot_ms=1000,
                xacc=100,
                yacc=-20,
                zacc=-1000,
                xgyro=10,
                ygyro=-20,
                zgyro=30,
            ),
            (0.1 * G, -0.02 * G, -G),
            None,
        ),
        (
            ScaledImu(
                message_id=116,
                time_boot_ms=1000,
                xacc=100,
                yacc=-20,
                zacc=-1000,
                xgyro=10,
                ygyro=-20,
                zgyro=30,
            ),
            (0.1 * G, -0.02 * G, -G),
            None,
        ),
        (
            RawImu(
                time_usec=1_000_000, xacc=100, yacc=-20, zacc=-1000, xgyro=10, ygyro=-20, zgyro=30
            ),
            (0.1 * G, -0.02 * G, -G),
            None,
        ),
    ],
)
def test_accelerations_and_rates_in_si_units(
    message: Any, force: tuple[float, ...], rates: tuple[float, ...] | None
) -> None:
    talk = session()
    receive(talk, message, 5.0)
    assert talk.imu.sequence == 1
    assert talk.imu.time_s == pytest.approx(5.0)
    assert talk.imu[2:5] == pytest.approx(force)
    assert talk.imu[5:8] == pytest.approx(rates or (0.01, -0.02, 0.03))


@pytest.mark.parametrize(
    "message",
    [
        highres(1_000_000, updated=0b111011),
        highres(1_000_000)._replace(xacc=nan),
        highres(1_000_000)._replace(zacc=-inf),
        highres(1_000_000)._replace(yacc=1e30),
        ScaledImu(
            message_id=26, time_boot_ms=1000, xacc=0, yacc=0, zacc=0, xgyro=0, ygyro=0, zgyro=0
        ),
        RawImu(time_usec=1_000_000, xacc=0, yacc=0, zacc=0, xgyro=5, ygyro=5, zgyro=5),
    ],
)
def test_what_no_accelerometer_measures_is_counted_and_not_used(message: Any) -> None:
    talk = session()
    receive(talk, message, 5.0)
    assert talk.imu == NO_IMU
    assert talk.counters.no_measurement == 1


@pytest.mark.parametrize("rate", [nan, inf, 1e6])
def test_broken_gyros_leave_the_accelerometers(rate: float) -> None:
    talk = session()
    receive(talk, highres(1_000_000)._replace(xgyro=rate), 5.0)
    receive(talk, highres(1_010_000, updated=0b111), 5.01)
    assert talk.imu.sequence == 2
    assert all(isnan(r) for r in talk.imu[5:8])


def test_two_inertial_messages_do_not_mix() -> None:
    talk = session()
    for i in range(100):
        receive(
            talk,
            RawImu(time_usec=i * 5000, xacc=100, yacc=0, zacc=-1000, xgyro=0, ygyro=0, zgyro=0),
            i * 0.005,
        )
        receive(
            talk,
            ScaledImu(
                message_id=116,
                time_boot_ms=i * 5,
                xacc=500,
                yacc=0,
                zacc=-1000,
                xgyro=0,
                ygyro=0,
                zgyro=0,
            ),
            i * 0.005,
        )
        assert talk.imu.force_x_frd_mps2 == pytest.approx(0.1 * G)
    receive(
        talk,
        ScaledImu(
            message_id=116,
            time_boot_ms=2000,
            xacc=500,
            yacc=0,
            zacc=-1000,
            xgyro=0,
            ygyro=0,
            zgyro=0,
        ),
        2.0,
    )  # the first has fallen silent
    assert talk.imu.force_x_frd_mps2 == pytest.approx(0.5 * G)


def test_another_message_is_asked_for_where_the_usual_one_is_refused() -> None:
    talk, asked = session(), []
    for i in range(400):
        for m in talk.poll(i * 0.01):
            if isinstance(m, CommandLong):
                asked.append(m.params[0])
                refused = m.params[0] == 27.0
                ack = CommandAck(
                    command=511, result=3 if refused else 0, target_system=1, target_component=191
                )
                receive(talk, ack, i * 0.01)
    assert asked.count(27.0) == 1
    assert 26.0 in asked


@pytest.mark.parametrize(("imu", "wanted"), [(105, {105.0}), (0, set())])
def test_the_airframe_file_says_which_message_or_none(imu: int, wanted: set[float]) -> None:
    talk, asked = session(imu=imu), set()
    for i in range(100):
        asked |= {m.params[0] for m in talk.poll(i * 0.1) if isinstance(m, CommandLong)}
    assert asked & {26.0, 27.0, 105.0} == wanted


# --- airspeed ---------------------------------------------------------------------------------


def test_the_airspeed_of_the_hud_is_taken_only_with_a_healthy_pitot() -> None:
    talk = session()
    receive(talk, VfrHud(9.0, 0.0), 1.0)
    for present, health in ((16, 0), (0, 16)):
        receive(talk, SysStatus(present, health), 1.0)
        receive(talk, VfrHud(9.0, 0.0), 1.0)
    assert talk.airspeed == NO_AIRSPEED
    receive(talk, SysStatus(16 | 32, 16), 1.0)
    receive(talk, VfrHud(9.0, 0.0), 1.1)
    assert talk.airspeed == (1, 1.1, 9.0)
    receive(talk, VfrHud(9.0, 2000.0), 1.2)  # thin air: 22 % less density
    assert talk.airspeed.airspeed_mps == pytest.approx(9.0 / sqrt(0.8217), rel=1e-3)
    for broken in (nan, -1.0, inf, 1e9):
        receive(talk, VfrHud(broken, 0.0), 1.3)
    assert talk.airspeed.sequence == 2


@pytest.mark.interpreted
def test_the_differential_pressure_is_a_pitot_s_only_where_the_firmware_means_it() -> None:
    """0.5 hPa in standard air: sqrt(2 * 50 / 1.225) = 9.04 m/s."""
    for flavour, taken in ((ArduPilot, False), (Px4Like, True)):
        talk = session(flavour)
        receive(talk, highres(1_000_000), 5.0)
        assert (talk.airspeed.sequence == 1) == taken
    assert talk.airspeed.airspeed_mps == pytest.approx(9.035, abs=0.01)
    receive(talk, highres(1_010_000, updated=0x3F), 5.01)  # no new one
    wrong: list[dict[str, float]] = [
        {"diff_pressure": nan},
        {"abs_pressure": 0.0},
        {"abs_pressure": inf},
        {"temperature": -273.15},
        {"temperature": nan},
    ]
    for i, fields in enumerate(wrong):
        receive(talk, highres(1_020_000 + 10_000 * i, ALL_UPDATED, **fields), 5.02)
    assert talk.airspeed.sequence == 1
    receive(talk, highres(2_000_000, diff_pressure=-0.01), 6.0)  # noise at rest
    assert talk.airspeed.airspeed_mps == 0.0


# --- surfaces and the autopilot's state -------------------------------------------------------


@given(st.floats(-1.0, 1.0), st.booleans())
def test_outputs_are_read_back_as_they_were_put(value: float, is_reversed: bool) -> None:
    channel = SurfaceChannel(
        channel=3, pwm_min=1000, pwm_trim=1450, pwm_max=1950, reversed=is_reversed
    )
    servos = (0, 0, pulse_width(channel, value))
    assert deflection(channel, servos) == pytest.approx(value, abs=0.5 / 450 + 1e-9)


def test_the_surfaces_come_from_the_outputs_of_the_first_port() -> None:
    talk = session()
    outputs = (1900, 1900, 0, 0, *(1500,) * 12)
    receive(talk, ServoOutputRaw(1_000_000, 1, outputs), 1.0)
    assert talk.surfaces == NO_SURFACES
    receive(talk, ServoOutputRaw(1_000_000, 0, outputs), 1.0)
    assert talk.surfaces[:4] == (1, 1.0, -1.0, 1.0)
    assert isnan(talk.surfaces.rudder)  # an output of 0 is not driven
    receive(talk, ServoOutputRaw(1_020_000, 0, (65535, 1, 0, 1655, *(0,) * 12)), 1.02)
    assert talk.surfaces[2:5] == pytest.approx((1.0, 1.0, 0.5))
    assert isnan(talk.surfaces.brake)  # there is none


def test_a_failsafe_and_a_restart_are_in_the_status() -> None:
    talk = session()
    for state, failsafe in ((4, False), (5, True), (6, True), (3, False)):
        receive(
            talk,
            Heartbeat(type=1, autopilot=3, base_mode=81 | 128, custom_mode=0, system_status=state),
            1.0,
        )
        assert talk.status.failsafe == failsafe
    assert talk.status.boots == 0
    for i in range(10):
        receive(
            talk,
            RawImu(
                time_usec=60_000_000 + i * 5000,
                xacc=0,
                yacc=0,
                zacc=-1000,
                xgyro=0,
                ygyro=0,
                zgyro=0,
            ),
            1.0 + i * 0.005,
        )
    for i in range(5):
        receive(
            talk,
            RawImu(
                time_usec=1_000_000 + i * 5000,
                xacc=0,
                yacc=0,
                zacc=-1000,
                xgyro=0,
                ygyro=0,
                zgyro=0,
            ),
            3.0 + i * 0.005,
        )
    assert talk.status.boots == talk.counters.reboots == 1
    receive(talk, Heartbeat(type=1, autopilot=3, base_mode=81, custom_mode=0, system_status=4), 4.0)
    assert talk.status.boots == 1


# --- hostile ----------------------------------------------------------------------------------

SENDERS = (AUTOPILOT, STRANGER, BRIDGE, OWN)
wild = st.one_of(st.floats(), st.sampled_from([nan, inf, -inf, 1e38, -1e38, 0.0]))
u16, u32, u64 = st.integers(0, 2**16 - 1), st.integers(0, 2**32 - 1), st.integers(0, 2**64 - 1)
i16, i32 = st.integers(-(2**15), 2**15 - 1), st.integers(-(2**31), 2**31 - 1)
wild_message = st.one_of(
    st.builds(HighresImu, u64, *[wild] * 9, u16),
    st.builds(ScaledImu, st.sampled_from([26, 116, 129]), u32, *[i16] * 6),
    st.builds(RawImu, u64, *[i16] * 6),
    st.builds(VfrHud, wild, wild),
    st.builds(SysStatus, u32, u32),
    st.builds(GlobalPositionInt, u32, *[i32] * 3, *[i16] * 3),
    st.builds(VisionPositionEstimate, u64, *[wild] * 6, st.tuples(*[wild] * 21)),
    st.builds(ServoOutputRaw, u32, st.integers(0, 255), st.tuples(*[u16] * 16)),
    st.builds(LocalPositionNed, u32, *[wild] * 6),
)


@pytest.mark.interpreted
@settings(max_examples=150, deadline=None)
@given(st.lists(st.tuples(wild_message, st.sampled_from(SENDERS), st.floats(0, 2)), max_size=30))
@example([(highres(0)._replace(temperature=-1e38), AUTOPILOT, 0.1)])
@example([(VfrHud(9.0, 1e38), AUTOPILOT, 0.1)])
@example(
    [
        (SysStatus(0, 0), AUTOPILOT, 1.404),
        (
            RawImu(time_usec=2**63, xacc=0, yacc=0, zacc=1, xgyro=0, ygyro=0, zgyro=0),
            AUTOPILOT,
            0.333,
        ),
    ]
)
def test_whatever_comes_samples_are_finite_and_only_of_whom_is_accepted(
    messages: list[tuple[Inbound, Source, float]],
) -> None:
    for flavour in (ArduPilot, Px4Like):
        order = (VISION, GLOBAL_POSITION, LOCAL_POSITION)
        talk = session(flavour, sources=PositionSources(order), vision_from=(BRIDGE,), home=HOME)
        now = 0.0
        for message, source, step_s in messages:
            now += step_s
            before = talk.imu, talk.airspeed, talk.surfaces, talk.position
            receive(talk, message, now, source)
            after = talk.imu, talk.airspeed, talk.surfaces, talk.position
            if source in (STRANGER, OWN):
                assert after == before or repr(after) == repr(before)
            if talk.imu.sequence:
                assert all(abs(f) <= 400.0 for f in talk.imu[2:5])
                assert talk.imu.time_s <= now + 1e-3
            if talk.airspeed.sequence:
                assert 0.0 <= talk.airspeed.airspeed_mps <= 150.0
            if talk.position.sequence:
                assert all(isfinite(p) for p in talk.position[1:5])
            for surface in talk.surfaces[2:]:
                assert isnan(surface) or -1.0 <= surface <= 1.0


# --- the codec, both ways ---------------------------------------------------------------------

floats32 = st.floats(width=32, allow_nan=False)


@given(st.data())
def test_what_pymavlink_sends_is_what_is_received(data: st.DataObject) -> None:
    """Every field that is kept, of every inertial, air and position message."""
    kinds = {
        "HIGHRES_IMU": HighresImu,
        "RAW_IMU": RawImu,
        "SCALED_IMU": ScaledImu,
        "SCALED_IMU2": ScaledImu,
        "SCALED_IMU3": ScaledImu,
        "VFR_HUD": VfrHud,
        "GLOBAL_POSITION_INT": GlobalPositionInt,
        "VISION_POSITION_ESTIMATE": VisionPositionEstimate,
    }
    name = data.draw(st.sampled_from(sorted(kinds)))
    numbers = {
        "float": floats32, "uint64_t": u64, "uint32_t": u32, "int32_t": i32, "uint16_t": u16,
        "int16_t": i16, "uint8_t": st.integers(0, 255), "int8_t": st.integers(-128, 127),
    }  # fmt: skip
    (kind,) = [k for k in mavlink.mavlink_map.values() if k.msgname == name]
    values = {}
    lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    for field, of_type in zip(kind.fieldnames, kind.fieldtypes, strict=True):
        one = numbers[of_type]
        many = lengths[field]
        values[field] = data.draw(st.lists(one, min_size=many, max_size=many) if many else one)
    frame = kind(**values).pack(mavlink.MAVLink(None, 1, 1))
    (received,) = Decoder(stream=False).feed(bytes(frame))
    inbound = received.message
    assert isinstance(inbound, kinds[name])
    for field in inbound._fields:
        if field == "message_id":
            assert getattr(inbound, field) == kind.id
        else:
            sent = values[field]
            assert getattr(inbound, field) == (tuple(sent) if isinstance(sent, list) else sent)


# --- a rangefinder --------------------------------------------------------------------------------

DOWN = DistanceSensor(
    time_boot_ms=1000,
    min_distance=20,
    max_distance=4000,
    current_distance=1234,
    id=0,
    orientation=25,
    signal_quality=0,
)


@pytest.mark.parametrize(
    "fields",
    [
        {"orientation": 0},  # ahead
        {"orientation": 24},  # up
        {"signal_quality": 1},
        {"current_distance": 0},
        {"current_distance": 20},  # at its smallest: nearer than that for all that is known
        {"current_distance": 4000},
        {"current_distance": 65535},
        {"min_distance": 5000},
        {"max_distance": 0},
        {"min_distance": 0, "max_distance": 0, "current_distance": 0},
    ],
)
def test_what_is_no_distance_to_the_ground_below_is_refused(fields: dict[str, int]) -> None:
    talk = session()
    receive(talk, DOWN._replace(**fields), 1.0)
    assert talk.rangefinder == NO_RANGE
    assert (talk.counters.ranges, talk.counters.no_range) == (0, 1)


@pytest.mark.parametrize("quality", [0, 2, 100])
def test_a_distance_to_the_ground_below_is_in_metres(quality: int) -> None:
    talk = session()
    receive(talk, DOWN._replace(signal_quality=quality), 1.0)
    assert talk.rangefinder.sequence == 1
    assert talk.rangefinder.range_m == pytest.approx(12.34)
    assert talk.rangefinder.time_s <= 1.0


def test_a_distance_of_another_sender_is_counted_and_ignored() -> None:
    talk = session()
    for source in (STRANGER, BRIDGE, OWN):
        receive(talk, DOWN, 1.0, source)
    assert talk.rangefinder == NO_RANGE
    assert talk.counters.foreign == 3


def test_of_several_rangefinders_one_is_used_until_it_is_silent() -> None:
    talk = session()
    for k in range(4):
        now = 1.0 + 0.05 * k
        stamp = round(1000.0 * now)
        receive(talk, DOWN._replace(time_boot_ms=stamp), now)
        receive(talk, DOWN._replace(time_boot_ms=stamp, id=1, current_distance=900), now)
        assert talk.rangefinder.range_m == pytest.approx(12.34)
    for k in range(13):
        now = 1.2 + 0.05 * k
        receive(
            talk, DOWN._replace(time_boot_ms=round(1000 * now), id=1, current_distance=900), now
        )
    assert talk.rangefinder.range_m == pytest.approx(9.0)
    assert talk.counters.stale == 0


def test_a_distance_that_comes_again_or_late_is_no_new_one() -> None:
    talk = session()
    receive(talk, DOWN, 1.0)
    receive(talk, DOWN, 1.05)
    receive(talk, DOWN._replace(time_boot_ms=900), 1.1)
    assert talk.rangefinder.sequence == 1


@pytest.mark.parametrize("fitted", [False, True])
def test_distances_are_asked_for_where_a_rangefinder_is_fitted(fitted: bool) -> None:
    talk = session(rangefinder=fitted)
    wanted = talk.streams.wanted(132)
    assert (wanted is not None) == fitted
    if wanted is not None:
        assert (wanted.name, wanted.rate_hz) == ("DISTANCE_SENSOR", 20.0)


@settings(max_examples=60)
@given(
    stamp=st.integers(0, 2**32 - 1),
    near=st.integers(0, 65535),
    far=st.integers(0, 65535),
    here=st.integers(0, 65535),
    number=st.integers(0, 255),
    turned=st.integers(0, 255),
    quality=st.integers(0, 255),
)
def test_any_distance_on_the_wire_is_a_sane_one_or_none(
    stamp: int, near: int, far: int, here: int, number: int, turned: int, quality: int
) -> None:
    """Every payload, by pymavlink's encoder and through our decoder."""
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    message = mavlink.MAVLink_distance_sensor_message(
        stamp, near, far, here, 0, number, turned, 255, signal_quality=quality
    )
    talk = session()
    for received in Decoder(stream=False).feed(message.pack(sender)):
        talk.handle(received, 1.0)
    sample = talk.rangefinder
    assert talk.counters.ranges + talk.counters.no_range + talk.counters.stale >= 1
    if sample.sequence:
        assert turned == 25
        assert quality != 1
        assert near < here < far
        assert sample.range_m == pytest.approx(0.01 * here)
