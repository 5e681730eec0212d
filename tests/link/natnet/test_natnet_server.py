"""What the NatNet client asks of a server, when, and what it takes of the answer."""

from __future__ import annotations

from itertools import pairwise

import pytest

from tgl_soar.geometry import HallFrame
from tgl_soar.link.messages import SEVERITY_INFO, SEVERITY_WARNING
from tgl_soar.link.natnet import layout
from tgl_soar.link.natnet.diagnostics import OptitrackCounters, OptitrackLedger, OutageNotices
from tgl_soar.link.natnet.layout import ServerInfo
from tgl_soar.link.natnet.server import MulticastStream, NatNetServer
from tgl_soar.link.natnet.settings import OptitrackSettings

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


def ledger() -> OptitrackLedger:
    return OptitrackLedger(OptitrackCounters(), OutageNotices())


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
    assert (server.body_id, server_of().body_id) == (5, None)
    server.accept(INFO, SENDER)
    assert server.body_id == 5
    server.refresh_models()
    server.discard_models()
    assert (server.is_ready, server.body_id) == (True, 5)
    assert layout.MODELS_REQUEST not in asked(server, 1.0)
    server.on_models({"glider": 9})
    assert server.body_id == 5


def test_a_unicast_server_is_sent_a_keep_alive_every_second() -> None:
    assert times_of(known(), layout.KEEP_ALIVE, 3.5) == [0.0, 1.0, 2.0, 3.0]
    assert times_of(known(SETTINGS._replace(unicast=False)), layout.KEEP_ALIVE, 3.5) == []


def test_ten_echoes_come_in_quick_succession_and_then_one_each_second() -> None:
    times = times_of(known(), layout.ECHO_REQUEST, 3.7)
    assert times == pytest.approx([0.05 * i for i in range(11)] + [1.5, 2.5, 3.5], abs=0.011)
    assert times_of(known(lockstep=True), layout.ECHO_REQUEST, 3.0) == []
    # A server that has restarted is measured again; another clock of ours lets all be due.
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


def test_a_body_that_is_not_there_is_reported_with_the_first_of_those_that_are() -> None:
    """A status text of 120 letters, not all the props of a hall."""
    kept = ledger()
    server = NatNetServer(SETTINGS, kept, lockstep=False)
    server.accept(INFO, SENDER)
    kept.notices.texts.clear()
    server.on_models({})
    assert kept.notices.texts == []  # nothing is known yet
    props = {f"prop {number:03}": number for number in range(50)}
    server.on_models({**props, "Aircraft": 9})
    ((severity, text),) = kept.notices.texts
    assert severity == SEVERITY_WARNING
    begin = "OptiTrack: no rigid body 'glider'; there are "
    assert text.startswith(f"{begin}Aircraft, prop 000, prop 001")
    assert len(text) == len(begin) + 120
    server.on_models({"glider": 3})
    assert server.body_id == 3
    assert len(kept.notices.texts) == 1


def test_a_server_that_is_accepted_is_reported_with_its_clock() -> None:
    kept = ledger()
    server = NatNetServer(SETTINGS, kept, lockstep=False)
    assert (server.info, server.address, server.stream) == (None, "", None)
    server.accept(INFO, SENDER)
    text = "OptiTrack: Motive at 10.0.0.2 speaks NatNet 4.1, clock 1000 Hz"
    assert kept.notices.texts == [(SEVERITY_INFO, text)]
    assert (server.info, server.address, server.version) == (INFO, "10.0.0.2", (4, 1))


def test_a_server_of_which_nothing_fits_any_more_is_asked_at_once_who_it_is() -> None:
    server = known()
    times_of(server, layout.CONNECT, 0.5, silent=True)
    server.reconnect()
    assert server.info is None
    assert not server.is_ready
    assert asked(server, 0.6) == [layout.CONNECT]


def test_a_server_that_has_restarted_is_used_once_its_ids_are_known() -> None:
    server = known()
    server.reset()
    assert (server.is_ready, server.models) == (False, {})
    assert server.info == INFO
    assert layout.MODELS_REQUEST in asked(server, 0.0)


def test_the_newest_version_is_spoken_until_it_is_known_which() -> None:
    assert server_of().version == (4, 2)
    (request,) = server_of().poll(0.0, silent=True)
    assert request == layout.connect_request((4, 2))


def test_the_clock_of_a_server_that_has_restarted_is_measured_as_quickly_as_at_first() -> None:
    server = known()
    times_of(server, layout.ECHO_REQUEST, 3.0)
    server.reset()
    times = [0.01 * i for i in range(300, 600) if layout.ECHO_REQUEST in asked(server, 0.01 * i)]
    gaps = [after - before for before, after in pairwise(times)]
    assert sum(gap < 0.1 for gap in gaps) == 10
    assert max(gaps) == pytest.approx(1.0, abs=0.02)
