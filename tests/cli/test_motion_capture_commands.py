"""`tgl-soar align` and `tgl-soar mocap list` on made-up feeds, by a clock that the test moves."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from math import degrees, hypot
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import typer
from rich.console import Console
from typer.testing import CliRunner

from tgl_soar.analysis.alignment import Alignment, AlignmentError, Pair, fit_alignment
from tgl_soar.cli import align, mocap
from tgl_soar.cli.app import app
from tgl_soar.config.files import ConfigError, load_site, shipped
from tgl_soar.config.site import Mocap
from tgl_soar.geometry import HallFrame
from tgl_soar.link.natnet.layout import RigidBody
from tgl_soar.link.natnet.listing import BodyRow
from tgl_soar.link.natnet.sockets import NatNetError

HALL_SITE = shipped("sites/tunnel_mocap.toml")
NAN = float("nan")
Place = tuple[float, float, float]


class Feed:
    """A server that streams a body, a frame each 20 ms of the test's clock."""

    def __init__(self, pose: Callable[[int], Place | None], stale: int = 0) -> None:
        self.now_s = 100.0
        self.stale = stale  # datagrams that wait from before
        self.frames = 0
        self.sent: list[bytes] = []
        self.followed: list[Any] = []
        self.polled: list[float] = []
        self.closed = 0
        self._pose = pose
        self._drained = False
        self.client = SimpleNamespace(
            pose=None, notices=[], stream=None, poll=self._poll, take=self._take
        )

    def _poll(self, now_s: float) -> list[bytes]:
        self.polled.append(now_s)
        return [b"ping"]

    def _take(self, _data: bytes, _sender: Any, _now_s: float) -> Any:
        place = self._pose(self.frames)
        if place is None:
            return None
        x, y, z = place
        self.client.pose = SimpleNamespace(x_m=x, y_m=y, z_m=z)
        return self.client.pose

    def receive(self) -> list[Any]:
        if not self._drained:  # what waited while the body was carried
            self.stale -= 1
            self._drained = self.stale < 0
            return [] if self._drained else [(b"old", None)]
        self.frames += 1
        return [(b"frame", None)]

    def send(self, data: bytes) -> None:
        self.sent.append(data)

    def follow(self, stream: Any) -> None:
        self.followed.append(stream)

    def filenos(self) -> list[int]:
        return []

    def close(self) -> None:
        self.closed += 1


def on_clock(monkeypatch: pytest.MonkeyPatch, module: Any, feed: Any) -> None:
    def select(_r: Any, _w: Any, _x: Any, _timeout_s: float) -> None:
        feed.now_s += 0.02

    monkeypatch.setattr(module, "select", SimpleNamespace(select=select))
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: feed.now_s))


def averaged(monkeypatch: pytest.MonkeyPatch, feed: Feed, seconds: float = 2.0) -> Any:
    on_clock(monkeypatch, align, feed)
    return align.average_pose(feed, seconds)  # type: ignore[arg-type]


# --- a body that is held still -----------------------------------------------------------------


def test_the_mean_of_the_poses_and_their_spread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two places 2 mm either side of their middle along each of two axes: 2.83 mm."""

    def swung(frame: int) -> Place:
        side = 0.002 if frame % 2 else -0.002
        return 1.0 + side, 2.0, 3.0 - side

    feed = Feed(swung, stale=30)
    mean, spread_m = averaged(monkeypatch, feed)
    assert mean == pytest.approx((1.0, 2.0, 3.0), abs=1e-4)
    assert spread_m == pytest.approx(hypot(0.002, 0.002), rel=1e-3)
    assert feed.frames == pytest.approx(101, abs=2)  # 2 s from the first pose on
    assert feed.sent[:1] == [b"ping"]


@pytest.mark.parametrize(("swing_m", "good"), [(0.0049, True), (0.0051, False)])
def test_a_body_that_moves_by_over_five_millimetres_is_refused(
    swing_m: float, good: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    feed = Feed(lambda frame: (0.0, swing_m if frame % 2 else -swing_m, 0.0))
    if good:
        averaged(monkeypatch, feed)
        return
    with pytest.raises(AlignmentError, match="the body moves by 5 mm: put it down, 5 mm are allo"):
        averaged(monkeypatch, feed)


@pytest.mark.parametrize(("every", "good"), [(5, True), (6, False)])
def test_twenty_poses_are_needed(every: int, good: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    feed = Feed(lambda frame: (0.0, 0.0, 0.0) if frame % every == 1 else None)
    if good:
        averaged(monkeypatch, feed)
        return
    with pytest.raises(AlignmentError, match=r"1[78] poses in 2 s: 20 are needed"):
        averaged(monkeypatch, feed)


def test_a_body_that_is_never_seen_is_given_up_ten_seconds_later(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    feed = Feed(lambda _frame: None)
    with pytest.raises(AlignmentError, match="0 poses in 12 s: nothing came"):
        averaged(monkeypatch, feed)
    assert feed.now_s == pytest.approx(112.0, abs=0.05)
    watched = Feed(lambda _frame: None)
    watched.client.notices = [(4, "no body 'a'"), (4, "silent")]
    with pytest.raises(AlignmentError, match="0 poses in 13 s: no body 'a'; silent"):
        averaged(monkeypatch, watched, 3.0)


def test_where_the_server_streams_is_listened(monkeypatch: pytest.MonkeyPatch) -> None:
    feed = Feed(lambda _frame: (0.0, 0.0, 0.0))
    averaged(monkeypatch, feed)
    assert feed.followed == []
    feed = Feed(lambda _frame: (0.0, 0.0, 0.0))
    feed.client.stream = "239.1.1.1"
    averaged(monkeypatch, feed)
    assert set(feed.followed) == {"239.1.1.1"}


def test_each_point_is_asked_for_and_measured(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    feeds: list[Any] = []
    poses = iter([(0.0, 1.0, 2.0), (3.0, 4.0, 5.0)])

    def opened(_mocap: Any) -> Any:
        feeds.append(SimpleNamespace(closed=0))
        feeds[-1].close = lambda: setattr(feeds[-1], "closed", 1)
        return feeds[-1]

    monkeypatch.setattr(align, "MocapFeed", opened)
    monkeypatch.setattr(align, "average_pose", lambda _feed, _seconds: (next(poses), 0.0012))
    monkeypatch.setattr(align, "input", lambda: "", raising=False)
    monkeypatch.setattr(align, "errors", Console(stderr=True, width=200))
    mocap_ = Mocap(server="discover", body="glider")
    pairs = align._measure(mocap_, [(0.0, 0.0, 0.0), (1.5, 0.0, -1.2)], 2.0)
    assert pairs == [
        Pair((0.0, 1.0, 2.0), (0.0, 0.0, 0.0)),
        Pair((3.0, 4.0, 5.0), (1.5, 0.0, -1.2)),
    ]
    output = capsys.readouterr().err
    assert "2 of 2: put 'glider' at north, east, down 1.5, 0, -1.2 m, leave it there" in output
    assert "hall 0.0000, 1.0000, 2.0000 m ± 1.2 mm" in output
    assert feeds[0].closed == 1

    def ended() -> str:
        raise EOFError

    monkeypatch.setattr(align, "input", ended, raising=False)
    with pytest.raises(ConfigError, match="stopped: no Enter came"):
        align._measure(mocap_, [(0.0, 0.0, 0.0)], 2.0)
    assert feeds[1].closed == 1


# --- what is typed, read and printed -----------------------------------------------------------


@pytest.mark.parametrize("text", ["1,2", "1,2,3,4", "1,x,3", "1,nan,3", "inf,0,0"])
def test_what_is_no_point_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="write NORTH,EAST,DOWN in metres, such as"):
        align._point(text)
    assert align._point("1.5, 0,-1.2") == (1.5, 0.0, -1.2)


HEADER = "hall_x,hall_y,hall_z,north,east,down\n"


def points_file(folder: Path, text: str) -> Path:
    path = folder / "points.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_table_of_points_is_read_by_its_names(tmp_path: Path) -> None:
    text = "# by hand\nnorth,east,down,hall_x,hall_y,hall_z\n1,2,3,4,5,6\n # later\n7,8,9,1,2,3\n"
    assert align.read_pairs(points_file(tmp_path, text)) == [
        Pair((4.0, 5.0, 6.0), (1.0, 2.0, 3.0)),
        Pair((1.0, 2.0, 3.0), (7.0, 8.0, 9.0)),
    ]


@pytest.mark.parametrize(("row", "words"), [
    ("1,2,3,4,5", "point 2: down = ''"), ("1,2,3,nan,5,6", "point 2: north = 'nan'"),
    ("1,2,x,4,5,6", "point 2: hall_z = 'x'"),
])  # fmt: skip
def test_a_cell_that_is_no_number_is_named(row: str, words: str, tmp_path: Path) -> None:
    path = points_file(tmp_path, f"{HEADER}1,2,3,4,5,6\n{row}\n")
    with pytest.raises(ConfigError) as refused:
        align.read_pairs(path)
    assert f"{path}: {words}: must be a number [m]" in str(refused.value)


@pytest.mark.parametrize(("words", "reported"), [
    ((), "give a CSV file with pairs, or --site and --at for each point, but not both"),
    (("p.csv", "--at", "0,0,0"), "but not both"),
    (("--at", "0,0,0"), "--at: needs --site with a [mocap] table"),
    (("--at", "0,0,0", "--site", "tunnel"), "--at: needs --site with a [mocap] table"),
    (("p.csv", "--up", "x"), "--up 'x': y or z"),
    (("--at", "0,0", "--site", "tunnel_mocap"), "--at '0,0': write NORTH,EAST,DOWN"),
])  # fmt: skip
def test_what_does_not_go_together_is_refused(words: tuple[str, ...], reported: str) -> None:
    done = CliRunner().invoke(app, ["align", *words], env={"COLUMNS": "200"})
    assert (done.exit_code, reported in done.output) == (2, True), done.output


@pytest.mark.parametrize(("options", "up"), [
    ((), "y"), (("--up", "z"), "z"), (("--site", "tunnel_mocap"), "y"),
    (("--site", "tunnel_mocap", "--up", "z"), "z"),
])  # fmt: skip
def test_the_axis_that_is_up_is_the_options_or_the_sites(
    options: tuple[str, ...], up: str, tmp_path: Path
) -> None:
    up_of = {"y": lambda e, n, u: (e, u, -n), "z": lambda e, n, u: (e, n, u)}
    rows = [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 3.0, 0.0), (1.0, 1.0, 1.5)]  # east, north, up
    lines = [",".join(map(str, (*up_of[up](*row), row[1], row[0], -row[2]))) for row in rows]
    path = points_file(tmp_path, HEADER + "\n".join(lines) + "\n")
    done = CliRunner().invoke(app, ["align", str(path), *options], env={"COLUMNS": "200"})
    assert done.exit_code == 0, done.output
    assert f'up = "{up}"' in done.output
    assert "residual 0.0 mm rms" in done.output


def test_the_table_that_is_printed_is_the_sites_with_the_new_axes() -> None:
    found = Alignment(
        hall=HallFrame(
            z_up=True, yaw_rad=1.0, origin_north_m=0.12345, origin_east_m=-2.0, origin_down_m=3.0
        ),
        residuals_m=(),
        rms_m=0.0,
        yaw_sigma_rad=0.0,
    )
    own = load_site(HALL_SITE).mocap
    assert own is not None
    table = tomllib.loads(align.mocap_toml(found, own))["mocap"]
    assert (table["up"], table["yaw_deg"]) == ("z", round(degrees(1.0), 3))
    assert table["offset_m"] == [0.1235, -2.0, 3.0]
    for name in (
        *("server", "body", "stream", "interface", "group", "command_port", "data_port"),
        *("noise_m", "max_error_m", "max_speed_mps", "max_age_s", "max_rate_hz"),
    ):
        assert table[name] == getattr(own, name), name
    bare = align.mocap_toml(found, None)
    assert "# server, body and stream: see" in bare
    assert set(tomllib.loads(bare)["mocap"]) == {"up", "yaw_deg", "offset_m"}


def test_residuals_are_in_millimetres(capsys: pytest.CaptureFixture[str]) -> None:
    pairs = [Pair((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), Pair((2.0, 0.0, 0.0), (0.0, 2.004, 0.0)),
             Pair((0.0, 3.0, 0.0), (3.0, 0.0, 0.0))]  # fmt: skip
    found = fit_alignment(pairs, z_up=True, tolerance_m=0.1)
    Console(width=200).print(align._residuals(pairs, found))
    output = capsys.readouterr().out
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in output.splitlines()]
    rows = [row for row in rows if row]
    assert [row[0] for row in rows] == ["1", "2", "3"]
    assert rows[1][1:3] == ["2.000, 0.000, 0.000", "0.000, 2.004, 0.000"]
    for row, residual in zip(rows, found.residuals_m, strict=True):
        numbers = [float(each) for each in row[3].removesuffix(" mm").split(",")]
        assert numbers == pytest.approx([1e3 * each for each in residual], abs=0.051)


# --- the list of bodies ------------------------------------------------------------------------


def body(number: int, x: float = 1.0, *, tracked: bool = True) -> RigidBody:
    return RigidBody(
        id=number, x_m=x, y_m=2.0, z_m=3.0, qx=0.0, qy=0.0, qz=0.0, qw=1.0, error_m=0.0,
        flags=int(tracked),
    )  # fmt: skip


class Streamed:
    """A server of whose frames the client can use none: all bodies are listed."""

    def __init__(self, first_at: int, bodies: list[RigidBody]) -> None:
        self.now_s = 50.0
        self.turns = 0
        self.bodies = bodies
        self.sent: list[tuple[float, bytes]] = []
        self._first_at = first_at
        self.client = SimpleNamespace(
            info=None, models={}, stream=None, notices=[], version=(4, 1), age_s=0.005,
            counters=SimpleNamespace(absent=0, stale=0), poll=lambda _now_s: [], take=self._take,
        )  # fmt: skip

    def _take(self, _data: bytes, _sender: Any, _now_s: float) -> None:
        self.client.counters.absent += 1

    def receive(self) -> list[Any]:
        self.turns += 1
        return [(b"frame", None)] if self.turns >= self._first_at else []

    def send(self, data: bytes) -> None:
        self.sent.append((round(self.now_s, 2), data))

    def filenos(self) -> list[int]:
        return []


def listed(
    monkeypatch: pytest.MonkeyPatch, feed: Streamed, seconds: float = 2.0, timeout_s: float = 10.0
) -> list[BodyRow]:
    on_clock(monkeypatch, mocap, feed)
    layout = SimpleNamespace(
        keep_alive=lambda: b"alive",
        models_request=lambda: b"models",
        bodies_of=lambda _data, _version: feed.bodies,
    )
    monkeypatch.setattr(mocap, "layout", layout)
    return mocap.listed(feed, seconds, timeout_s)  # type: ignore[arg-type]


def test_bodies_are_listed_from_the_first_frame_on(monkeypatch: pytest.MonkeyPatch) -> None:
    feed = Streamed(50, [body(7), body(3, tracked=False)])
    feed.client.models = {"glider": 7}
    rows = listed(monkeypatch, feed)
    assert [(row.id, row.name, row.tracked) for row in rows] == [
        *((3, "", False), (7, "glider", True)),
    ]
    assert rows[0].rate_hz == pytest.approx(50.0, rel=0.02)
    assert rows[0].age_s == 0.005
    assert rows[0].silent_s == pytest.approx(0.0, abs=0.021)
    assert feed.now_s == pytest.approx(50.0 + 50 * 0.02 + 2.0, abs=0.05)
    assert feed.sent == []  # no answer yet: nothing is asked of the server


def test_the_server_is_sent_a_keep_alive_twice_a_second(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    feed = Streamed(1, [body(7)])
    feed.client.info = SimpleNamespace()
    listed(monkeypatch, feed)
    alive = [at for at, data in feed.sent if data == b"alive"]
    assert alive == pytest.approx([50.0, 50.5, 51.0, 51.5, 52.0], abs=0.05)
    assert [at for at, data in feed.sent if data == b"models"] == alive
    named = Streamed(1, [body(7)])
    named.client.info, named.client.models = SimpleNamespace(), {"glider": 7}
    listed(monkeypatch, named)
    assert {data for _, data in named.sent} == {b"alive"}


@pytest.mark.parametrize(("notices", "words"), [
    ([], "no frame in 4 s: nobody has answered"), ([(4, "a"), (4, "b")], "no frame in 4 s: a; b"),
])  # fmt: skip
def test_a_silent_server_is_given_up(
    notices: list[Any], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    feed = Streamed(10_000, [])
    feed.client.notices = notices
    with pytest.raises(NatNetError, match=words):
        listed(monkeypatch, feed, timeout_s=4.0)
    assert feed.now_s == pytest.approx(54.0, abs=0.05)


def test_a_row_of_each_body(capsys: pytest.CaptureFixture[str]) -> None:
    row = BodyRow(
        id=7, name="a[b]", tracked=True, tracked_fraction=1.0, rate_hz=99.6, age_s=0.0054,
        silent_s=0.49, pose=body(7, 1.23456),
    )  # fmt: skip
    lost = row._replace(name="", tracked=False, tracked_fraction=0.25, rate_hz=NAN, age_s=NAN,
                        silent_s=0.5)  # fmt: skip
    never = row._replace(tracked=False, tracked_fraction=0.0)
    Console(width=200).print(mocap._table([row, lost, never]))
    output = capsys.readouterr().out
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in output.splitlines()]
    place = "1.235, 2.000, 3.000 m"
    assert [each for each in rows if each] == [
        ["7", "a[b]", "yes", "100 Hz", "5 ms", "now", place],
        ["7", "–", "no (25 % of frames)", "–", "–", "0.5 s ago", place],
        ["7", "a[b]", "no", "100 Hz", "5 ms", "now", place],
    ]


def test_the_server_is_the_options_the_sites_or_whichever_answers() -> None:
    own = load_site(HALL_SITE).mocap
    assert own is not None
    asked = mocap._wanted(HALL_SITE, "", "")
    assert (asked.server, asked.command_port) == (own.server, own.command_port)
    assert asked.body == 2**31 - 1  # of no body
    other = mocap._wanted(HALL_SITE, "10.0.0.9:1234", "10.0.0.2")
    assert (other.server, other.command_port, other.interface) == ("10.0.0.9", 1234, "10.0.0.2")
    assert mocap._wanted(None, "", "").server == "discover"
    alone = mocap._wanted(None, "hall", "")
    assert (alone.server, alone.command_port) == ("hall", 1510)
    assert mocap._wanted(None, "hall:99", "").command_port == 99


@pytest.mark.parametrize(("given", "words"), [
    ((shipped("sites/tunnel.toml"), "", ""), "no [mocap] table; name the server with --server"),
    ((None, ":1", ""), "--server ':1': write HOST or HOST:PORT"),
    ((None, "", "hall"), "--interface 'hall': must be an IPv4 address"),
])  # fmt: skip
def test_a_server_that_is_none_is_refused(given: Any, words: str) -> None:
    with pytest.raises(ConfigError) as refused:
        mocap._wanted(*given)
    assert words in str(refused.value)


@pytest.mark.parametrize("joined", [True, False])
def test_both_ways_to_stream_are_tried(joined: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[str] = []

    def feed(wanted: Mocap) -> Any:
        tried.append(wanted.stream)
        if wanted.stream == "multicast" and not joined:
            raise NatNetError("no group")
        return "a feed"

    monkeypatch.setattr(mocap, "MocapFeed", feed)
    assert mocap._opened(Mocap(server="h", body="b")) == "a feed"  # type: ignore[comparison-overlap]
    assert tried == (["multicast"] if joined else ["multicast", "unicast"])


@pytest.mark.parametrize(("rows", "code"), [([], 1), (["row"], 0)])
def test_no_body_is_an_exit_code(
    rows: list[str], code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    feed = SimpleNamespace(closed=0, client=SimpleNamespace(
        info=SimpleNamespace(version=(4, 2), is_multicast=False, name="Motive [x]")))  # fmt: skip
    feed.close = lambda: setattr(feed, "closed", feed.closed + 1)
    monkeypatch.setattr(mocap, "_opened", lambda _wanted: feed)
    monkeypatch.setattr(mocap, "listed", lambda *_given: rows)
    monkeypatch.setattr(mocap, "_table", lambda rows: f"{len(rows)} in a table")
    done = CliRunner().invoke(app, ["mocap", "list"], env={"COLUMNS": "200"})
    assert done.exit_code == code
    assert f"Motive [x], NatNet 4.2, unicast: {len(rows)} rigid bodies\n" in done.output
    assert ("frames arrive without a rigid body" in done.output) == (code == 1)
    assert feed.closed == 1
    monkeypatch.setattr(mocap, "listed", stopped)
    with pytest.raises(typer.Exit) as ended:
        mocap.list_()
    assert ended.value.exit_code == 130


def stopped(*_given: Any) -> Any:
    raise KeyboardInterrupt
