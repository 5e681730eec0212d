"""The parts of the OptiTrack client by themselves: each interval and limit from both sides."""

from __future__ import annotations

from math import inf, isnan, nan
from typing import Any

import pytest

from tgl_soar.geometry import HallFrame
from tgl_soar.link.messages import SEVERITY_INFO, SEVERITY_WARNING
from tgl_soar.link.natnet import layout, track
from tgl_soar.link.natnet.diagnostics import OptitrackCounters, OptitrackLedger, OutageNotices
from tgl_soar.link.natnet.frame_times import FrameTimes
from tgl_soar.link.natnet.layout import MocapFrame, RigidBody, ServerInfo
from tgl_soar.link.natnet.pose_filter import PoseFilter
from tgl_soar.link.natnet.server import MulticastStream, NatNetServer
from tgl_soar.link.natnet.settings import OptitrackSettings
from tgl_soar.link.natnet.track import PoseTrack

SENDER = ("10.0.0.2", 1510)
SETTINGS = OptitrackSettings(
    server="",
    body="glider",
    unicast=True,
    hall=HallFrame(
        z_up=True, yaw_rad=0.0, origin_north_m=0.0, origin_east_m=0.0, origin_down_m=0.0
    ),
    noise_m=0.001,
    max_error_m=0.02,
    max_speed_mps=10.0,
    max_age_s=0.3,
    max_rate_hz=100.0,
)
INFO = ServerInfo(
    name="Motive",
    application=(3, 1, 0, 0),
    version=(4, 1),
    clock_hz=1000,
    data_port=1511,
    is_multicast=False,
    group="239.0.0.1",
)
AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.0, -0.8))


def ledger() -> OptitrackLedger:
    return OptitrackLedger(OptitrackCounters(), OutageNotices())


def body(x: float = 0.0, y: float = 0.0, z: float = 0.0, **changes: Any) -> RigidBody:
    plain = RigidBody(
        id=7, x_m=x, y_m=y, z_m=z, qx=0.0, qy=0.0, qz=0.0, qw=1.0, error_m=0.0004, flags=1
    )
    return plain._replace(**changes)


# --- requests -----------------------------------------------------------------------------------


def asked(server: NatNetServer, now_s: float, *, silent: bool = False) -> list[int]:
    return [layout.message_of(data) for data in server.poll(now_s, silent=silent)]


def times_of(
    server: NatNetServer, number: int, until_s: float, silent: bool = False
) -> list[float]:
    """When a request is made, of polls each hundredth of a second."""
    return [
        round(0.01 * i, 2)
        for i in range(round(until_s * 100.0))
        if number in asked(server, 0.01 * i + 1e-9, silent=silent)
    ]


def server_of(given: OptitrackSettings = SETTINGS, *, lockstep: bool = False) -> NatNetServer:
    return NatNetServer(given, ledger(), lockstep=lockstep)


def known(given: OptitrackSettings = SETTINGS, *, lockstep: bool = False) -> NatNetServer:
    server = server_of(given, lockstep=lockstep)
    server.accept(INFO, SENDER)
    server.on_models({"glider": 7})
    return server


def test_until_it_answers_a_server_is_asked_every_second_and_nothing_else() -> None:
    server = server_of()
    assert times_of(server, layout.CONNECT, 3.5) == [0.0, 1.0, 2.0, 3.0]
    assert asked(server, 9.0) == [layout.CONNECT]
    assert not server.is_ready


def test_a_known_server_is_asked_who_it_is_while_it_is_silent() -> None:
    assert times_of(known(), layout.CONNECT, 3.5) == []
    assert times_of(known(), layout.CONNECT, 2.5, silent=True) == [0.0, 1.0, 2.0]


def test_definitions_are_asked_for_every_half_a_second_by_turns_of_all_and_of_bodies() -> None:
    server = server_of()
    server.accept(INFO, SENDER)
    sizes = []
    for i in range(5):
        requests = server.poll(0.5 * i + 1e-9, silent=False)
        sizes += [len(r) for r in requests if layout.message_of(r) == layout.MODELS_REQUEST]
        assert layout.MODELS_REQUEST not in asked(server, 0.5 * i + 0.49)
    assert sizes == [4, 8, 4, 8, 4]
    server.on_models({"other": 1})  # ours is not among them
    assert not server.is_ready
    assert layout.MODELS_REQUEST in asked(server, 9.0)
    server.on_models({"glider": 3, "other": 1})
    assert (server.is_ready, server.body_id) == (True, 3)
    assert layout.MODELS_REQUEST not in asked(server, 19.0)
    server.refresh_models()
    assert layout.MODELS_REQUEST in asked(server, 29.0)
    assert server.is_ready  # by the old ones meanwhile
    server.discard_models()
    assert not server.is_ready
    assert layout.MODELS_REQUEST in asked(server, 29.01)  # at once


def test_a_numbered_body_needs_no_definitions() -> None:
    server = server_of(SETTINGS._replace(body=5))
    server.accept(INFO, SENDER)
    assert server.body_id == 5
    server.refresh_models()
    server.discard_models()
    assert (server.is_ready, server.body_id) == (True, 5)
    assert layout.MODELS_REQUEST not in asked(server, 1.0)
    server.on_models({"glider": 9})
    assert server.body_id == 5


def test_a_unicast_server_is_told_every_second_that_we_live() -> None:
    assert times_of(known(), layout.KEEP_ALIVE, 3.5) == [0.0, 1.0, 2.0, 3.0]
    assert times_of(known(SETTINGS._replace(unicast=False)), layout.KEEP_ALIVE, 3.5) == []


def test_ten_echoes_come_in_quick_succession_and_then_one_each_second() -> None:
    times = times_of(known(), layout.ECHO_REQUEST, 3.7)
    assert times == pytest.approx([0.05 * i for i in range(11)] + [1.5, 2.5, 3.5], abs=0.011)
    assert times_of(known(lockstep=True), layout.ECHO_REQUEST, 3.0) == []
    # A server that has restarted is measured anew; another clock of ours lets all be due.
    server = known()
    times_of(server, layout.ECHO_REQUEST, 3.0)
    server.reset()
    assert layout.ECHO_REQUEST not in asked(server, 3.01)
    server.rebase()
    assert {layout.ECHO_REQUEST, layout.KEEP_ALIVE} <= set(asked(server, 0.01))
    assert layout.ECHO_REQUEST in asked(server, 0.07)


def test_an_echo_carries_our_time_in_nanoseconds() -> None:
    for now_s, stamp in ((2.5, 2_500_000_000), (0.0, 1)):
        request = next(r for r in known().poll(now_s, silent=False) if layout.message_of(r) == 12)
        assert int.from_bytes(request[4:12], "little") == stamp


@pytest.mark.parametrize(
    ("version", "can", "words"),
    [
        ((2, 99), False, "3.0 to 4.2 can be read"),
        ((3, 0), True, ""),
        ((4, 2), True, ""),
        ((4, 3), True, "read as 4.2"),
        ((5, 0), False, "can be read"),
    ],
)
def test_versions_from_3_0_to_below_5_are_read(
    version: layout.Version, can: bool, words: str
) -> None:
    kept = ledger()
    server = NatNetServer(SETTINGS, kept, lockstep=False)
    info = INFO._replace(version=version)
    assert server.is_new(info, SENDER) == can
    assert kept.counters.wrong_version == (0 if can else 1)
    if can:
        server.accept(info, SENDER)
        assert server.version == version
        assert not server.is_new(info, SENDER)
    text = kept.notices.texts[0][1]
    assert words in text
    assert ("read as" in text) == (version == (4, 3))
    assert text.startswith(f"OptiTrack: Motive at 10.0.0.2 speaks NatNet {version[0]}.{version[1]}")


def test_a_server_that_answers_again_may_have_other_ids() -> None:
    server = known()
    asked(server, 1.0)
    assert not server.is_new(INFO, SENDER)
    assert layout.MODELS_REQUEST in asked(server, 2.0)
    assert server.is_new(INFO._replace(clock_hz=2000), SENDER)


@pytest.mark.parametrize("multicast", [False, True])
@pytest.mark.parametrize("unicast", [False, True])
def test_where_it_streams_and_that_the_site_says_otherwise(multicast: bool, unicast: bool) -> None:
    kept = ledger()
    server = NatNetServer(SETTINGS._replace(unicast=unicast), kept, lockstep=False)
    server.accept(INFO._replace(is_multicast=multicast), SENDER)
    assert server.stream == (MulticastStream("239.0.0.1", 1511) if multicast else None)
    wrong = [text for severity, text in kept.notices.texts if severity == SEVERITY_WARNING]
    theirs = "multicast" if multicast else "unicast"
    expected = [f"OptiTrack: it streams {theirs}, mocap.stream does not"]
    assert wrong == (expected if multicast == unicast else [])


# --- notices ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("after_s", "again"), [(9.9, False), (10.1, True)])
@pytest.mark.parametrize("used", [False, True])
def test_a_kind_is_reported_again_after_poses_and_ten_seconds(
    after_s: float, again: bool, used: bool
) -> None:
    notices = OutageNotices()
    notices.now_s = 100.0
    notices.report("silent", SEVERITY_WARNING, "silent")
    notices.report("silent", SEVERITY_WARNING, "silent")
    if used:
        notices.now_s = 101.0
        notices.pose_used(101.0)
    notices.texts.clear()
    notices.now_s = 100.0 + after_s
    notices.report("silent", SEVERITY_WARNING, "silent")
    assert len(notices.texts) == int(again and used)
    notices.rebase()
    notices.report("silent", SEVERITY_WARNING, "silent")
    assert notices.texts[-1] == (SEVERITY_WARNING, "OptiTrack: silent")


def test_the_end_of_an_outage_is_said_with_its_length() -> None:
    notices = OutageNotices()
    notices.report("order", SEVERITY_INFO, "no outage")
    notices.pose_used(0.0)
    assert len(notices.texts) == 1
    for kind in ("stale", "poor", "jump", "frozen", "finite", "untracked", "absent", "odd"):
        notices = OutageNotices()
        notices.report(kind, SEVERITY_WARNING, "out")
        notices.now_s = 5.0
        notices.pose_used(5.0)
        assert notices.texts[-1] == (SEVERITY_INFO, "OptiTrack: stream is there")
        notices.now_s = 20.0
        notices.report("silent", SEVERITY_WARNING, "out")
        notices.report("nobody", SEVERITY_WARNING, "out")
        notices.now_s = 27.34
        notices.pose_used(27.34)
        notices.pose_used(27.4)
        assert notices.texts[-1] == (SEVERITY_INFO, "OptiTrack: stream is back after 22.3 s")


def test_what_is_counted_is_said_in_words() -> None:
    counters = OptitrackCounters(frames=3, out_of_order=2)
    assert counters.summary() == "3 frames, 2 out of order"
    assert OptitrackCounters().summary() == ""


# --- where it may have come to ------------------------------------------------------------------


@pytest.mark.parametrize("axis", AXES)
def test_a_pose_may_be_5_cm_and_a_flight_away_from_the_last(axis: tuple[float, ...]) -> None:
    for size, verdict in ((0.349, track.GOOD), (0.351, track.JUMPED)):
        for sign in (-1.0, 1.0):
            poses = PoseTrack(10.0)
            assert poses.judge(body(1.0, 2.0, 3.0), 5.0) == track.GOOD
            x, y, z = (sign * size * part for part in axis)
            assert poses.judge(body(1.0 + x, 2.0 + y, 3.0 + z), 5.03) == verdict
            if verdict == track.JUMPED:
                assert poses.jump_m == pytest.approx(size)


def test_a_new_place_is_taken_once_it_has_held_for_a_second() -> None:
    poses = PoseTrack(10.0)
    poses.judge(body(), 5.0)
    assert poses.judge(body(9.0), 5.01) == track.JUMPED
    for i in range(1, 100):
        assert poses.judge(body(9.0 + 1e-4 * (i % 3)), 5.01 + 0.01 * i) == track.SETTLING
    assert poses.judge(body(9.01), 6.011) == track.GOOD
    assert poses.judge(body(9.02), 6.02) == track.GOOD


@pytest.mark.parametrize(("away_m", "back"), [(0.34, True), (0.36, False)])
@pytest.mark.parametrize("after_s", [0.03, 0.5])
def test_back_near_the_last_good_place_it_is_good_at_once(
    away_m: float, back: bool, after_s: float
) -> None:
    """As far as a flight leads since then, but no farther than one of 0.2 s."""
    away_m += 10.0 * (min(0.2, after_s) - 0.03)
    poses = PoseTrack(10.0)
    poses.judge(body(), 5.0)
    poses.judge(body(30.0), 5.01)
    found = poses.judge(body(away_m), 5.0 + after_s)
    assert found == (track.GOOD if back else track.JUMPED)
    if not back:  # it has to hold from here on
        assert poses.judge(body(away_m + 0.001), 5.9 + after_s) == track.SETTLING
        assert poses.judge(body(away_m + 0.002), 6.01 + after_s) == track.GOOD


@pytest.mark.parametrize("field", ["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"])
def test_bit_for_bit_the_last_pose_is_frozen(field: str) -> None:
    poses = PoseTrack(10.0)
    first = body(1.0, 2.0, 3.0)
    poses.judge(first, 5.0)
    assert poses.judge(first._replace(error_m=0.1, flags=3), 5.01) == track.FROZEN
    moved: dict[str, Any] = {field: getattr(first, field) + 1e-6}
    assert poses.judge(first._replace(**moved), 5.02) == track.GOOD


def test_reset_it_begins_with_the_next_pose() -> None:
    poses = PoseTrack(10.0)
    poses.judge(body(), 5.0)
    poses.judge(body(30.0), 5.01)
    poses.reset()
    assert poses.judge(body(60.0), 5.02) == track.GOOD
    assert poses.judge(body(60.001), 5.03) == track.GOOD


# --- fixes --------------------------------------------------------------------------------------


def filter_of(**changes: Any) -> tuple[PoseFilter, OptitrackLedger]:
    kept = ledger()
    return PoseFilter(SETTINGS._replace(**changes), kept), kept


@pytest.mark.parametrize(("error_m", "sigma_m"), [(0.0004, 0.001), (0.019, 0.019), (0.021, None)])
def test_the_markers_error_is_a_fix_s_uncertainty_up_to_a_limit(
    error_m: float, sigma_m: float | None
) -> None:
    poses, kept = filter_of()
    fix = poses.fix_of(body(error_m=error_m), 5.0, 5.02)
    assert (fix.sigma_m if fix else None) == sigma_m
    assert kept.counters.poor == int(fix is None)
    if fix is None:
        assert kept.notices.texts == [
            (SEVERITY_WARNING, "OptiTrack: mean marker error 21 mm: not used")
        ]


@pytest.mark.parametrize(("after_s", "used"), [(0.0074, False), (0.0076, True)])
def test_a_pose_that_is_early_by_a_quarter_of_the_interval_is_not_thinned(
    after_s: float, used: bool
) -> None:
    poses, kept = filter_of()
    poses.fix_of(body(), 5.0, 5.02)
    fix = poses.fix_of(body(0.01), 5.0 + after_s, 5.02)
    assert (fix is not None) == used
    assert (kept.counters.thinned, kept.counters.fixes) == ((0, 2) if used else (1, 1))
    poses.reset()
    assert poses.fix_of(body(0.02), 5.0 + after_s, 5.03) is not None


@pytest.mark.parametrize("field", ["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw", "error_m"])
@pytest.mark.parametrize("value", [nan, inf])
def test_a_pose_of_no_numbers_is_none(field: str, value: float) -> None:
    poses, kept = filter_of()
    changes: dict[str, Any] = {field: value}
    assert poses.fix_of(body(**changes), 5.0, 5.0) is None
    assert kept.counters.not_finite == 1
    assert poses.pose is None


@pytest.mark.parametrize(("flags", "tracked"), [(1, True), (3, True), (2, False), (0, False)])
def test_a_pose_that_the_server_does_not_vouch_for_is_not_used(flags: int, tracked: bool) -> None:
    poses, kept = filter_of()
    assert (poses.fix_of(body(flags=flags), 5.0, 5.0) is not None) == tracked
    assert kept.counters.untracked == int(not tracked)


def test_what_a_track_finds_is_counted_and_said() -> None:
    poses, kept = filter_of()
    poses.fix_of(body(), 5.0, 5.02)
    assert poses.latency_s == pytest.approx(0.02)
    assert poses.pose == body()
    assert poses.fix_of(body(), 5.01, 5.02) is None
    assert poses.fix_of(body(3.0), 5.02, 5.03) is None
    assert poses.fix_of(body(3.001), 5.03, 5.04) is None
    counters = kept.counters
    assert (counters.frozen, counters.jumps, counters.settling) == (1, 1, 1)
    assert [text for _, text in kept.notices.texts] == [
        "OptiTrack: the pose of 'glider' is frozen: bit for bit the last one",
        "OptiTrack: 'glider' has jumped by 3.00 m: not used until it holds",
    ]
    assert poses.pose == body()


# --- times --------------------------------------------------------------------------------------


def frame(exposed: int, sent: int) -> MocapFrame:
    return MocapFrame(
        number=1, body=None, bodies=0, timecode=0, timecode_sub=0, time_s=0.0,
        exposed_ticks=exposed, received_ticks=0, sent_ticks=sent,
        precision_s=0, precision_fraction=0, flags=0,
    )  # fmt: skip


def clocked(*, lockstep: bool = True) -> tuple[FrameTimes, OptitrackLedger]:
    kept = ledger()
    times = FrameTimes(kept, lockstep=lockstep)
    times.set_clock_rate(1000)
    return times, kept


@pytest.mark.parametrize(
    ("exposed", "sent", "time_s"),
    [
        (5000, 5020, 5.0),
        (5000, 5999, 5.0),
        (4000, 5001, None),  # more than a second later
        (5001, 5000, None),  # before it was exposed
        (5000, 5000, 5.0),
        (0, 5000, 5.0),  # the one stands for the other
        (5000, 0, 5.0),
    ],
)
def test_a_frame_is_sent_within_a_second_of_its_exposure(
    exposed: int, sent: int, time_s: float | None
) -> None:
    times, kept = clocked()
    assert times.time_of(frame(exposed, sent), 5.02) == time_s
    assert kept.counters.odd == int(time_s is None)
    untimed = [text for _, text in kept.notices.texts if "mid-exposure" in text]
    assert bool(untimed) == (exposed == 0)


@pytest.mark.parametrize(
    ("now_s", "used"), [(5.99, True), (6.01, False), (4.01, True), (3.99, False)]
)
def test_in_lockstep_a_clock_is_off_by_a_second_at_most(now_s: float, used: bool) -> None:
    times, kept = clocked()
    assert (times.time_of(frame(5000, 5000), now_s) is not None) == used
    assert kept.counters.odd == int(not used)
    assert times.uncertainty_s == 0.0


def test_frames_come_in_order_and_once() -> None:
    times, kept = clocked()
    assert [times.time_of(frame(n, n), 5.0) for n in (5000, 5000, 4990, 5001)] == [
        5.0, None, None, 5.001
    ]  # fmt: skip
    assert kept.counters.out_of_order == 2
    assert kept.notices.texts == [(SEVERITY_INFO, "OptiTrack: frames come out of order or twice")]
    times.reset()
    assert times.time_of(frame(4990, 4990), 5.0) == pytest.approx(4.99)


@pytest.mark.parametrize(("ago_s", "odd"), [(0.99, 0), (1.01, 1), (-0.01, 1)])
def test_an_echo_is_answered_within_a_second(ago_s: float, odd: int) -> None:
    times, kept = clocked(lockstep=False)
    times.on_echo(round((20.0 - ago_s) * 1e9), 5000, 20.0)
    assert kept.counters.odd == odd
    assert times.clock.is_known == (odd == 0)


def test_another_rate_is_another_clock_and_the_same_is_not() -> None:
    times, _ = clocked(lockstep=False)
    assert times.time_of(frame(5000, 5010), 20.01) == pytest.approx(20.0)
    times.set_clock_rate(1000)
    assert times.clock.is_known
    times.set_clock_rate(2000)
    assert not times.clock.is_known
    assert not times.has_restarted()
    times.clock.restarts = 2
    assert times.has_restarted()
    assert not times.has_restarted()
    assert isnan(times.clock.offset_s)


def test_frames_of_another_clock_are_numbered_by_it_from_the_first() -> None:
    """Its ticks may be smaller than those of the clock before: they are no older frames."""
    times, kept = clocked(lockstep=False)
    assert times.time_of(frame(900_000, 900_000), 20.0) == pytest.approx(20.0)
    found = [times.time_of(frame(5000 + 50 * i, 5000 + 50 * i), 20.1 + 0.05 * i) for i in range(5)]
    assert found[:2] == [None, None]
    assert found[3:] == pytest.approx([20.25, 20.3])
    assert kept.counters.out_of_order == 0
    assert times.has_restarted()
    # And of one clock they stay in order.
    assert times.time_of(frame(5100, 5100), 20.31) is None
    assert kept.counters.out_of_order == 1
