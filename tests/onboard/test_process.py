"""What the process opens, says and hands on, and that it gives everything back: no socket, no disk.

Its parts are replaced by ones that record calls; `test_run_process.py` starts it as it is.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from module_process import AIRFRAME, SITE

from tgl_soar import __version__
from tgl_soar.config.files import load_airframe, load_parameters, load_site
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.link.messages import SEVERITY_ERROR, SEVERITY_NOTICE, SEVERITY_WARNING
from tgl_soar.link.natnet.sockets import NatNetError, NatNetNotReadyError
from tgl_soar.link.signing_keys import Secret, SigningError
from tgl_soar.link.transports.base import LinkError, LinkNotReadyError
from tgl_soar.onboard import loop, process, realtime, watchdog
from tgl_soar.onboard.command_line import RunOptions
from tgl_soar.onboard.flightlog.recorder import NO_RECORDER
from tgl_soar.onboard.link_load import load_of
from tgl_soar.onboard.realtime import RealtimeOptions
from tgl_soar.onboard.setup import setup_from, with_values
from tgl_soar.onboard.watchdog import ProcessHeartbeat

pytestmark = pytest.mark.interpreted

HILL, HALL = SITE.parent / "hill.toml", SITE.parent / "tunnel_mocap.toml"
LINKS = ("udp:127.0.0.1:14550", "udpout:127.0.0.1:14551")


class Transport:
    """A link that is opened and closed."""

    def __init__(self, name: str, done: list[Any]) -> None:
        self.name, self.is_stream = name, name.startswith("serial")
        self.send = self.send_command = self.clear_for_release = lambda *_: True
        self._done = done

    def close(self) -> None:
        self._done.append(f"closed {self.name}")


class Process:
    """A run whose parts keep their arguments."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.done: list[Any] = []
        self.words: list[str] = []
        self.opened: list[str] = []
        self.refuses: dict[str, Exception] = {}
        self.in_order = True
        self.given: dict[str, Any] = {}
        self.module: Any = None
        self.in_loop: Callable[[], object] = lambda: None
        self.links: list[Any] = []
        self.watched: tuple[Any, str] = (None, "")
        self.lowered = False
        for module, name, stand_in in (
            (process, "say", self.say),
            (process, "Onboard", self._onboard),
            (process, "open_for", self._open),
            (process, "MocapFeed", self._mocap),
            (process, "SearchBeside", self._search),
            (process, "keep_timestamp", self._keep_timestamp),
            (process, "FlightRecorder", self._recorder),
            (loop, "run", self._loop),
            (realtime, "prepare", self._prepare),
            (realtime, "lower_priority", self._lower),
            (realtime, "raise_priority", lambda: None),
            (watchdog, "watch", self._watch),
        ):
            monkeypatch.setattr(module, name, stand_in)

    def say(self, text: str) -> None:
        self.words.append(text)

    def _refuse(self, what: str) -> None:
        if what in self.refuses:
            raise self.refuses[what]

    def _onboard(self, setup: Any, send: Any, now_s: float, options: Any) -> Any:
        self.given["module"] = (setup, send, now_s, options)
        self.module = SimpleNamespace(
            signing=SimpleNamespace(is_on=options.signing.is_on),
            settings=SimpleNamespace(values=setup.parameters),
            pacer=SimpleNamespace(
                counters=SimpleNamespace(ticks=11, late=3, skipped=2, over_run=1)
            ),
            stop=lambda: self.done.append("surfaces handed over"),
            add_link=lambda send, *, stream: self.links.append((send, stream)),
            positions=SimpleNamespace(add_mocap=lambda *given: self.links.append(given)),
        )
        return self.module

    def _open(self, _setup: Any, _options: Any, text: str, _signing: Any) -> Any:
        self._refuse(text)
        self.opened.append(text)
        return Transport(text, self.done)

    def _mocap(self, mocap: Any, *, lockstep: bool) -> Any:
        self._refuse("mocap")
        self.given["mocap"] = (mocap.server, mocap.command_port, lockstep)
        return SimpleNamespace(
            client=SimpleNamespace(summary=lambda: "9 poses"),
            close=lambda: self.done.append("closed mocap"),
        )

    def _search(self) -> Any:
        self._refuse("search")
        self.given["search lowered"] = self.lowered
        return SimpleNamespace(close=lambda: self.done.append("closed search"))

    def _keep_timestamp(self, _signing: Any, key_file: Path | None, say: Any) -> Any:
        assert say == self.say
        self.given["timestamp lowered"] = self.lowered
        self.given["key file"] = key_file
        return lambda: self.done.append("timestamp kept")

    def _recorder(self, folder: Path, metadata: Any, now_s: float, **named: Any) -> Any:
        self.given["log"] = (folder, metadata, now_s, named)
        return SimpleNamespace(
            start=lambda: self.done.append(("log started", self.lowered)),
            stop=lambda: ["log written"],
        )

    def _prepare(self, options: RealtimeOptions, *, real_time: bool) -> list[str]:
        self.given["real time"] = (options, real_time)
        return ["no locked memory"]

    @contextmanager
    def _lower(self, _options: RealtimeOptions) -> Iterator[None]:
        self.lowered = True
        yield
        self.lowered = False

    def _loop(self, onboard: Any, transports: Any, stop: Any, say: Any, **named: Any) -> bool:
        assert onboard is self.module
        self.done.append("flown")
        self.given["loop"] = (transports, stop, say, named)
        self.in_loop()
        return self.in_order

    def run(self, site: Path = SITE, airframe: Path = AIRFRAME, **named: Any) -> int:
        named.setdefault("links", LINKS[:1])
        return process.run(RunOptions(airframe=airframe, site=site, **named))

    def fly(self, became: str = "", heartbeat: Any = None, **named: Any) -> int:
        """As the watchdog starts it."""
        self.watched = (heartbeat, became)
        return self.run(watched=True, **named)

    def _watch(self, child: Any, _release: Any, _say: Any) -> int:
        code: int = child(*self.watched)
        return code

    @property
    def first_words(self) -> list[tuple[int, str]]:
        return list(self.given["module"][3].first_words)


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch) -> Process:
    return Process(monkeypatch)


# --- a flight and its end -------------------------------------------------------------------------


def test_it_flies_and_gives_all_back_the_surfaces_first(flown: Process, tmp_path: Path) -> None:
    assert flown.run(links=LINKS, log=tmp_path) == 0
    assert flown.done == [
        ("log started", True),
        "flown",
        "surfaces handed over",
        "timestamp kept",
        f"closed {LINKS[0]}",
        f"closed {LINKS[1]}",
        "closed search",
    ]
    assert flown.opened == list(LINKS)
    assert not flown.lowered
    assert flown.given["search lowered"]
    assert flown.given["timestamp lowered"]


def test_words_of_the_console(flown: Process) -> None:
    flown.run()
    assert flown.words[0].startswith("code: ")
    assert "parameters changed over the air are not stored: no --state" in flown.words
    assert "no flight log is kept: no --log" in flown.words
    assert f"listening on {LINKS[0]} as 1:191" in flown.words
    assert "no locked memory" in flown.words
    assert flown.words[-1] == "11 ticks, 3 late, 2 skipped, 1 longer than a period"


@pytest.mark.parametrize(("in_order", "lockstep"), [(False, False), (True, True), (False, True)])
def test_ticks_are_counted_of_a_flight_in_real_time_that_ended_in_order(
    flown: Process, in_order: bool, lockstep: bool
) -> None:
    flown.in_order = in_order
    assert flown.run(lockstep=lockstep) == (0 if in_order else 3)
    assert not any("ticks" in text for text in flown.words)


def test_whatever_ends_the_loop_the_pilot_gets_the_surfaces(flown: Process) -> None:
    def fail() -> None:
        raise ZeroDivisionError

    flown.in_loop = fail
    with pytest.raises(ZeroDivisionError):
        flown.run()
    assert flown.done[1:] == [
        "surfaces handed over", "timestamp kept", f"closed {LINKS[0]}", "closed search",
    ]  # fmt: skip


def test_the_loop_is_given_what_was_asked_for(flown: Process) -> None:
    asked = RealtimeOptions(processor=None, spin_s=0.0003, power_saving=True)
    flown.run(timeout_s=7.0, realtime=asked)
    (first,), stop, says, named = flown.given["loop"]
    assert first.name == LINKS[0]
    assert says == flown.say
    assert not stop()
    assert named["timeout_s"] == 7.0
    assert (named["spin_s"], named["power_saving"]) == (0.0003, True)
    assert flown.given["real time"] == (asked, True)


def test_in_lockstep_nothing_is_kept_on_time(
    flown: Process, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    here: Any = SimpleNamespace(close=lambda: None)
    monkeypatch.setattr(process, "SearchHere", lambda: here)
    flown.run(lockstep=True, log=tmp_path, realtime=RealtimeOptions(None, 0.0003))
    assert flown.given["loop"][3]["spin_s"] == 0.0
    assert flown.given["real time"][1] is False
    assert flown.given["module"][3].search is here  # within the simulated time
    assert flown.given["module"][3].lockstep
    assert not flown.given["timestamp lowered"]
    assert ("log started", False) in flown.done
    _, _, began_s, named = flown.given["log"]
    assert (began_s, named["patient"]) == (0.0, True)


def test_a_search_that_cannot_be_started_is_reported_and_flown_without(flown: Process) -> None:
    flown.refuses["search"] = OSError(11, "Resource temporarily unavailable")
    assert flown.run() == 0
    assert "no search for lift: Resource temporarily unavailable" in flown.words
    assert flown.given["module"][3].search is None


# --- what it is watched by ------------------------------------------------------------------------


def test_guarded_it_flies_in_a_child_that_is_watched_from_above_its_priority(
    flown: Process, monkeypatch: pytest.MonkeyPatch
) -> None:
    raised: list[bool] = []
    monkeypatch.setattr(realtime, "raise_priority", lambda: raised.append(True))
    monkeypatch.setattr(watchdog, "watch", lambda _child, _release, say: 40 + (say == flown.say))
    assert flown.run(watched=True) == 41
    assert raised == [True]
    assert "flown" not in flown.done
    assert flown.run(watched=False) == 0
    assert raised == [True]


def test_the_page_says_that_the_surfaces_were_released_before_the_disk_is_waited_for(
    flown: Process,
) -> None:
    heartbeat = ProcessHeartbeat()
    flown.in_loop = heartbeat.take_surfaces
    flown.fly(heartbeat=heartbeat)
    shown = heartbeat.read()
    assert (shown.rounds, shown.has_surfaces) == (1, False)
    flown.given["module"][3].before_first()
    assert heartbeat.read().has_surfaces
    assert flown.given["loop"][3]["heartbeat"] is heartbeat


def test_started_again_it_says_what_became_of_the_one_before(flown: Process) -> None:
    flown.fly("was killed")
    assert (SEVERITY_ERROR, "restarted: the flying process was killed") in flown.first_words
    flown.fly()
    assert not any("restarted" in text for _, text in flown.first_words)


# --- what cannot be opened ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("error", "became", "code"),
    [
        (LinkError("no such kind"), "", 2),
        (NatNetError("no such kind"), "", 2),
        (SigningError("no such kind"), "", 2),
        (LinkNotReadyError("no such kind"), "", 5),
        (NatNetNotReadyError("no such kind"), "", 5),
        (LinkError("no such kind"), "was killed", 1),
        (LinkNotReadyError("no such kind"), "was killed", 1),
    ],
)
def test_what_was_opened_before_a_refusal_is_closed_and_the_code_says_whether_it_may_pass(
    flown: Process,
    capsys: pytest.CaptureFixture[str],
    error: Exception,
    became: str,
    code: int,
) -> None:
    flown.refuses[LINKS[1]] = error
    assert flown.fly(became, links=LINKS) == code
    assert flown.done == [f"closed {LINKS[0]}"]
    assert "no such kind" in capsys.readouterr().err


def test_the_codes_are_those_that_the_service_and_the_page_know() -> None:
    """0 and 1 are every program's; 2 is that of a command line that is not understood."""
    codes = (
        process.EXIT_OK,
        process.EXIT_ERROR,
        process.EXIT_CANNOT_START,
        process.EXIT_NO_AUTOPILOT,
        watchdog.EXIT_KEEPS_DYING,
        process.EXIT_LINK_NOT_READY,
    )
    assert codes == (0, 1, 2, 3, 4, 5)


def test_a_file_that_is_wrong_is_reported(
    flown: Process, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = tmp_path / "site.toml"
    wrong.write_text("[site]\nnme = 1\n")
    assert flown.run(site=wrong) == 2
    assert "site.toml" in capsys.readouterr().err
    assert flown.done == []


# --- a tracker ------------------------------------------------------------------------------------


def test_a_tracker_is_opened_handed_to_module_and_loop_summed_up_and_closed(
    flown: Process,
) -> None:
    flown.run(site=HALL, mocap_server="127.0.0.2:1600")
    assert flown.given["mocap"] == ("127.0.0.2", 1600, False)
    ((client, feed),) = flown.links
    assert client is feed.client
    assert flown.given["loop"][3]["mocap"] is feed
    assert "OptiTrack: 9 poses" in flown.words
    assert "closed mocap" in flown.done


def test_without_a_tracker_none_is_opened_or_summed_up(flown: Process) -> None:
    flown.run()
    assert flown.given["loop"][3]["mocap"] is None
    assert not any("OptiTrack" in text for text in flown.words)
    assert "closed mocap" not in flown.done


# --- the module -----------------------------------------------------------------------------------


def test_the_first_link_is_the_autopilots_and_others_are_added(flown: Process) -> None:
    flown.run(links=("serial:/dev/ttyX:921600", *LINKS))
    _, _, _, options = flown.given["module"]
    transports = flown.given["loop"][0]
    assert options.stream
    assert flown.given["module"][1] is transports[0].send
    assert options.send_command is transports[0].send_command
    assert options.clear_for_release is transports[0].clear_for_release
    assert flown.links == [(transport.send, False) for transport in transports[1:]]
    assert 0 <= options.start < 1 << 24  # its heartbeat has room for so much
    assert options.console == flown.say
    assert options.recorder is NO_RECORDER
    assert options.store is None


def key_file(folder: Path) -> Path:
    key = folder / "key"
    key.write_bytes(bytes(range(32)))
    key.chmod(0o600)
    return key


@pytest.mark.parametrize("allow_setup", [True, False])
def test_a_key_is_kept_where_one_may_come_over_the_air(
    flown: Process, tmp_path: Path, allow_setup: bool
) -> None:
    key = key_file(tmp_path)
    flown.run(secret=Secret(key, unsigned_autopilot=True, allow_setup=allow_setup))
    options = flown.given["module"][3]
    assert options.unsigned_autopilot
    assert (options.keep_key is not None) is allow_setup
    if options.keep_key is not None:
        options.keep_key(bytes(32 * [7]))
        assert key.read_bytes().strip() in (bytes(32 * [7]), b"07" * 32)
    assert flown.given["key file"] == key
    assert options.signing.is_on


def test_without_a_key_file_none_is_taken_over_the_air(flown: Process) -> None:
    flown.run(secret=Secret(None, allow_setup=True))
    assert flown.given["module"][3].keep_key is None


@pytest.mark.parametrize("signs", [True, False])
def test_an_open_link_is_warned_of_unless_it_is_signed(
    flown: Process, tmp_path: Path, signs: bool
) -> None:
    secret = Secret(key_file(tmp_path)) if signs else Secret()
    flown.run(links=("udp:0.0.0.0:14550", LINKS[1]), secret=secret)
    warnings = [text for text in flown.words if text.startswith("WARNING")]
    assert len(warnings) == (0 if signs else 1)
    assert all("udp:0.0.0.0:14550 is open to the network and unsigned" in w for w in warnings)


# --- reports of a flight's set-up -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("link", "lockstep", "is_warned"),
    [
        ("serial:/dev/ttyX:57600", False, True),
        ("serial:/dev/ttyX:57600", True, False),
        ("serial:/dev/ttyX:921600", False, False),
        (LINKS[0], False, False),
    ],
)
def test_a_line_that_does_not_carry_the_flight_is_warned_of(
    flown: Process, link: str, lockstep: bool, is_warned: bool
) -> None:
    flown.run(links=(link,), lockstep=lockstep)
    found = [s for s, text in flown.first_words if "57600" in text]
    assert found == ([SEVERITY_WARNING] if is_warned else [])


def test_a_line_that_carries_the_flight_unsigned_may_be_too_slow_for_signatures(
    flown: Process, tmp_path: Path
) -> None:
    """13 bytes more of each frame."""
    setup = setup_from(load_airframe(AIRFRAME), load_site(SITE), ParameterSet())
    plain = load_of(setup, signed=False)
    signed = load_of(setup, signed=True)
    baud = next(
        rate
        for rate in range(57600, 921600, 1200)
        if not plain.refusal(rate) and signed.refusal(rate)
    )
    link = (f"serial:/dev/ttyX:{baud}",)
    for secret in (Secret(), Secret(key_file(tmp_path))):
        flown.run(links=link, secret=secret)
        assert any(str(baud) in text for _, text in flown.first_words) == bool(secret.key_file)


def test_a_contour_of_another_airframe_is_reported(flown: Process, tmp_path: Path) -> None:
    flown.run(site=HILL)
    assert not any("no line is checked" in text for text in flown.words)
    other = tmp_path / "other.toml"
    name = load_airframe(AIRFRAME).airframe.name
    text = AIRFRAME.read_text().replace(f'name = "{name}"', 'name = "Other"', 1)
    other.write_text(text)
    has_contour = load_site(HILL).contour is not None
    flown.run(site=HILL, airframe=other)
    found = [w for w in flown.words if w.startswith("no line is checked: the site's contour is of")]
    assert len(found) == int(has_contour)
    assert has_contour


@pytest.mark.parametrize("words", ["", "gains of pitch: sought for this aircraft"])
def test_whose_gains_it_flies_with_is_reported_where_there_is_something_to_say(
    flown: Process, monkeypatch: pytest.MonkeyPatch, words: str
) -> None:
    monkeypatch.setattr(process, "gains_words", lambda *_: words)
    flown.run()
    assert (words in flown.words) == bool(words)
    assert "" not in flown.words


# --- what is kept ---------------------------------------------------------------------------------


class Store:
    """What is kept of parameters."""

    path = Path("vehicle.params")
    refused = ""

    def __init__(self, done: list[Any], **found: Any) -> None:
        self.found = {"values": None, "kept": {}, "notes": (), "damaged": False} | found
        self._done = done

    def restore(self) -> Any:
        return SimpleNamespace(**self.found)

    def start(self) -> None:
        self._done.append("store started")

    def stop(self, values: Any) -> list[str]:
        return [f"stored {values['TGL_CAPTURE']:.2f}"]


@pytest.mark.parametrize(
    ("damaged", "severity"), [(False, SEVERITY_WARNING), (True, SEVERITY_ERROR)]
)
def test_stored_parameters_are_flown_with_and_reported(
    flown: Process, monkeypatch: pytest.MonkeyPatch, damaged: bool, severity: int
) -> None:
    values = load_parameters(load_airframe(AIRFRAME), AIRFRAME, load_site(SITE), SITE)
    values = values.changed({"TGL_CAPTURE": 0.07})
    found = {"values": values, "kept": {"TGL_CAPTURE": 0.07}, "notes": ("a note",)}
    store = Store(flown.done, damaged=damaged, **found)
    monkeypatch.setattr(process, "ParameterStore", lambda *_: store)
    flown.run(state=Path("somewhere"))
    assert flown.given["module"][0].parameters["TGL_CAPTURE"] == pytest.approx(0.07)
    assert (severity, "a note") in flown.first_words
    assert (SEVERITY_NOTICE, "1 stored parameters: TGL_CAPTURE") in flown.first_words
    assert flown.done[0] == "store started"
    assert "parameters changed over the air are stored in vehicle.params" in flown.words
    assert "stored 0.07" in flown.words
    assert flown.given["module"][3].store is store
    store.found["kept"], store.refused = {}, "it cannot be written"
    flown.words.clear()
    flown.run(state=Path("somewhere"))
    assert not any("are stored in" in text for text in flown.words)
    assert not any("stored parameters" in text for _, text in flown.first_words)


def test_a_line_is_judged_by_the_stored_rate_that_is_flown(
    flown: Process, monkeypatch: pytest.MonkeyPatch
) -> None:
    values = load_parameters(load_airframe(AIRFRAME), AIRFRAME, load_site(SITE), SITE)
    setup = setup_from(load_airframe(AIRFRAME), load_site(SITE), values)
    stored = values.changed({"LOOP_RATE": 100.0})
    slow, fast = (load_of(with_values(setup, v), signed=False) for v in (stored, values))
    baud = next(b for b in range(57600, 921600, 1200) if not slow.refusal(b) and fast.refusal(b))
    store = Store(flown.done, values=stored, kept={"LOOP_RATE": 100.0})
    monkeypatch.setattr(process, "ParameterStore", lambda *_: store)
    for state, is_warned in ((None, True), (Path("somewhere"), False)):
        flown.run(links=(f"serial:/dev/ttyX:{baud}",), state=state)
        assert any(str(baud) in text for _, text in flown.first_words) is is_warned


def test_the_log_of_a_restarted_process_has_the_files_that_are_flown(
    flown: Process, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    site = tmp_path / "site.toml"
    site.write_text(SITE.read_text())

    def restart(child: Callable[..., int], _release: object, _say: object) -> int:
        site.write_text("changed since")
        return child(None, "was killed")

    monkeypatch.setattr(watchdog, "watch", restart)
    flown.run(site=site, watched=True, log=tmp_path)
    assert flown.given["log"][1].texts == {
        "airframe": AIRFRAME.read_text(),
        "site": SITE.read_text(),
    }


def test_the_log_says_what_was_flown_with(flown: Process, tmp_path: Path) -> None:
    flown.run(log=tmp_path, log_bytes=1234567, links=LINKS)
    folder, metadata, began_s, named = flown.given["log"]
    assert folder == tmp_path
    assert began_s > 0.0  # the loop's clock, which has gone on since the computer was started
    assert named == {"largest_bytes": 1234567, "patient": False}
    words, texts = metadata
    assert words["sys_name"] == "tgl_soar"
    assert words["ver_sw"] == __version__
    assert (words["airframe_file"], words["site_file"]) == (str(AIRFRAME), str(SITE))
    assert words["links"] == " ".join(LINKS)
    assert words["lockstep"] == "False"
    assert words["modes"].split(";")[:3] == ["boot", "standby", "ready"]
    assert len(words["reasons"].split(";")) > 10
    assert texts == {"airframe": AIRFRAME.read_text(), "site": SITE.read_text()}
    assert "log written" in flown.words
    assert flown.given["module"][3].recorder is not NO_RECORDER


# --- signals --------------------------------------------------------------------------------------


def test_while_it_flies_what_ends_a_process_asks_it_to_stop_and_what_stops_it_is_ignored(
    flown: Process,
) -> None:
    numbers = (*watchdog.ENDS, *watchdog.IGNORED)
    before = {number: signal.getsignal(number) for number in numbers}
    handlers: dict[int, Any] = {}
    flown.in_loop = lambda: handlers.update({n: signal.getsignal(n) for n in numbers})
    flown.run()
    stop = flown.given["loop"][1]
    assert all(handlers[number] == signal.SIG_IGN for number in watchdog.IGNORED)
    assert not stop()
    for number in watchdog.ENDS:
        assert handlers[number] == stop.__self__.ask
    handlers[signal.SIGINT](signal.SIGINT, None)
    assert stop()
    assert {number: signal.getsignal(number) for number in numbers} == before


def test_in_another_thread_signals_are_left_to_the_main_one(flown: Process) -> None:
    """There they cannot be taken: the tests of other programs fly so."""
    codes: list[int] = []
    thread = threading.Thread(target=lambda: codes.append(flown.run()))
    thread.start()
    thread.join()
    assert codes == [0]
