"""The benchmarks' results as a page and as JSON, and whether the references are what they say."""

import json
import select
import shutil
import socket
import subprocess
import sys
import time
from array import array
from contextlib import ExitStack
from pathlib import Path

import pytest
from benchmarks import c_reference, hostile, latency, lengths, page, skipping, waking
from benchmarks.codec import FRAMES, in_c
from benchmarks.hanging import site_to_hang_in
from benchmarks.module_flight import ModuleFlight
from benchmarks.page import AWAKE, BEGIN, END, Group, markdown, replace_table, write_json
from benchmarks.result import Result, percentile
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.files import load_site
from tgl_soar.link.natnet.layout import frame_of
from tgl_soar.onboard.pacing import AWAKE_MAX_S
from tgl_soar.sim.natnet_frames import Scene, SimulatedBody, encode_frame

ROOT = Path(__file__).parents[2]
MET = Result(
    what="a tick",
    value=70.0,
    reference=75.0,
    unit="µs",
    reference_what="1.5 % of the period",
    aim=1.0,
)
MISSED = Result(
    what="a wake-up", value=30.0, reference=20.0, unit="µs", reference_what="C", aim=1.3
)
NONE_LATE = Result(what="late", value=0.0, reference=0.0, unit="", reference_what="C", aim=1.0)
SOME_LATE = Result(what="late", value=2.0, reference=0.0, unit="", reference_what="C", aim=1.0)
GROUPS = (Group("On time", [MET, MISSED]), Group("Left out", []))

needs_compiler = pytest.mark.skipif(
    not any(shutil.which(name) for name in ("cc", "gcc", "clang")), reason="no C compiler here"
)


def test_an_aim_is_met_or_said_to_be_missed() -> None:
    text = markdown(GROUPS)
    assert "| a tick | 70 µs | 75 µs | 1.5 % of the period | 0.933 | ≤ 1 |" in text
    assert "| a wake-up | 30 µs | 20 µs | C | 1.5 | ≤ 1.3, **missed** |" in text
    assert "Left out" not in text
    assert [r.is_met for r in (MET, MISSED, NONE_LATE, SOME_LATE)] == [True, False, True, False]


def test_only_what_stands_between_the_marks_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "page.md"
    path.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    for _ in range(2):
        replace_table(path, GROUPS)
        text = path.read_text()
        assert text.startswith("before\n")
        assert text.endswith("\nafter\n")
        assert "old" not in text
        assert text.count("### On time") == 1
    path.write_text("no marks")
    with pytest.raises(ValueError, match="to put the results between"):
        replace_table(path, GROUPS)


def test_the_page_that_is_shipped_has_its_marks() -> None:
    text = (ROOT / "docs/performance.md").read_text(encoding="utf-8")
    assert text.count(BEGIN) == text.count(END) == 1


def test_json_holds_machine_date_and_plain_numbers(tmp_path: Path) -> None:
    path = tmp_path / "made" / "results.json"
    write_json(path, [Group("Late", [SOME_LATE, NONE_LATE])])
    kept = json.loads(path.read_text(), parse_constant=lambda word: pytest.fail(word))
    assert {"date", "processor", "python", "pymavlink"} <= set(kept["machine"])
    assert [r["ratio"] for r in kept["results"]] == [None, 1.0]
    assert page.machine()["cores"] >= 1  # type: ignore[operator]


def test_percentiles_and_cyclictest_s_histogram() -> None:
    text = "# /dev/cpu_dma_latency set to 0us\n000003 000002\n000007 000001\n# Total: 000000003\n"
    assert waking.histogram(text) == [3, 3, 7]
    assert percentile([5, 1, 4, 2, 3], 0.5) == 3


def test_without_a_compiler_it_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda _: None)
    c_reference.program.cache_clear()
    with pytest.raises(c_reference.NoCompilerError, match="no C compiler"):
        c_reference.program("wake")


@needs_compiler
def test_the_c_codec_reads_every_frame_batch_by_batch() -> None:
    """A reference that did less than is claimed would make us look worse, or better."""
    c_reference.program.cache_clear()
    for _, message in FRAMES:
        frame = bytes(message.pack(mavlink.MAVLink(None, 1, 1)))
        with in_c(frame.hex(), batch=3) as batch:
            assert all(batch() > 0.0 for _ in range(3))
    with in_c("pack", batch=3) as batch:
        assert batch() > 0.0
    broken = frame[:-1] + bytes((frame[-1] ^ 1,))  # a batch that reads nothing is no reference
    with in_c(broken.hex(), batch=3) as batch:
        batch()
        with pytest.raises((ValueError, BrokenPipeError)):
            batch()


@needs_compiler
@pytest.mark.parametrize("awake_ns", [0, latency.AWAKE_NS])
def test_the_c_responder_answers_every_attitude(awake_ns: int) -> None:
    c_reference.program.cache_clear()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        vehicle.settimeout(10.0)
        link = f"udp:{vehicle.getsockname()[1]}"
        command = [c_reference.program("responder"), link, "0", str(awake_ns)]
        with subprocess.Popen(command) as responder:
            try:
                decoder = mavlink.MAVLink(None)
                data, address = vehicle.recvfrom(2048)
                assert decoder.decode(bytearray(data)).get_type() == "HEARTBEAT"
                for _ in range(3):
                    attitude = mavlink.MAVLink_attitude_quaternion_message(
                        1, 1, 0, 0.25, 0, 0, 0, 0
                    )
                    vehicle.sendto(attitude.pack(mavlink.MAVLink(None, 1, 1)), address)
                    answer = decoder.decode(bytearray(vehicle.recv(2048)))
                    assert (answer.get_type(), answer.chan2_raw) == ("RC_CHANNELS_OVERRIDE", 1600)
            finally:
                responder.kill()


@needs_compiler
@pytest.mark.parametrize("awake_ns", [0, waking.AWAKE_NS])
def test_the_c_loop_never_wakes_before_its_time(awake_ns: int) -> None:
    c_reference.program.cache_clear()
    begin = str(time.monotonic_ns() + 5_000_000)
    command = [c_reference.program("wake"), "5", "1000000", begin, "0", str(awake_ns)]
    run = subprocess.run(command, capture_output=True, check=True)
    late = array("q", run.stdout)
    assert len(late) == 5
    assert min(late) >= 0


def reported_to(vehicle: socket.socket, pulses: int) -> None:
    message = mavlink.MAVLink_rc_channels_override_message(
        1, 1, *[pulses] * 4, *[65535] * 4, *[0] * 10
    )
    vehicle.send(message.pack(mavlink.MAVLink(None, 255, 191)))


@needs_compiler
def test_the_vehicle_times_answers_however_late_they_come() -> None:
    """Of two modules one answers each third attitude only: no answer is cut off at any part."""
    c_reference.program.cache_clear()
    with ExitStack() as stack:
        sockets = [
            stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(2)
        ]
        probes = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in sockets]
        for probe in probes:
            probe.bind(("127.0.0.1", 0))
        ports = [probe.getsockname()[1] for probe in probes]
        for probe in probes:
            probe.close()
        command = [c_reference.program("vehicle"), "1", "0", "0", "600000"]
        ends = [f"udp:{port}" for port in ports]
        vehicle = stack.enter_context(
            subprocess.Popen([*command, *ends], stdout=subprocess.PIPE, bufsize=0)
        )
        stack.callback(vehicle.kill)
        assert vehicle.stdout is not None
        assert vehicle.stdout.readline() == b"ready\n"
        for each, port in zip(sockets, ports, strict=True):
            each.connect(("127.0.0.1", port))
            reported_to(each, 1500)
        asked = [0, 0]
        while min(asked) < 200:
            ready, _, _ = select.select(sockets, (), (), 10.0)
            assert ready
            for each in ready:
                each.recv(2048)
                i = sockets.index(each)
                asked[i] += 1
                if i == 0 or asked[i] % 3 == 0:
                    reported_to(each, 1500 + asked[i])
        took = array("q", vehicle.communicate(timeout=30)[0])
    assert len(took) == 400
    prompt, seldom = took[:200], took[200:]
    assert min(prompt) > 0
    assert len(set(prompt)) > 100
    # 66 answers for 200 attitudes: each counts for all that were open, and only the last are none.
    assert min(seldom[:195]) > 0
    assert len(set(seldom)) <= 67


def test_answers_that_never_come_count_as_the_whole_run() -> None:
    settled = latency.RATE_HZ * latency.SETTLED_S
    took = [*[1] * settled, 5, -1, *[2] * settled, 7, 8]
    whole = (settled + 2) * latency.PERIOD_NS
    assert latency._answers(took, 2) == [[5, whole], [7, 8]]


def test_few_samples_say_nothing_about_the_slowest_in_a_thousand() -> None:
    rows = list(latency._beside("UDP", [1] * 3000, [1] * 3000, AWAKE))
    assert [row.what[-3:] for row in rows] == ["p50", "p99"]
    rows = list(latency._beside("UDP", [1] * 30_000, [1] * 30_000, AWAKE))
    assert [row.what.rpartition(" ")[2] for row in rows] == ["p50", "p99", "p99.9"]
    for seconds in (latency.SECONDS, waking.SECONDS):
        assert seconds * latency.RATE_HZ >= lengths.P999_SAMPLES


def test_c_waits_awake_as_long_as_the_module_may() -> None:
    assert latency.AWAKE_NS == waking.AWAKE_NS == round(AWAKE_MAX_S * 1e9)


def test_a_quick_look_writes_no_page() -> None:
    command = [sys.executable, "-m", "benchmarks", "--quick", "--page", "docs/performance.md"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 2
    assert "too few for a page" in run.stderr


@pytest.mark.parametrize("version", [(3, 0), (3, 1), (4, 0), (4, 1), (4, 2)])
def test_the_least_natnet_decoder_finds_the_same_body_as_ours(version: tuple[int, int]) -> None:
    bodies = [
        SimulatedBody(
            name=f"body {i}",
            id=i,
            position_m=(0.1 * i, 1.0, 2.0),
            quaternion=(0.0, 0.0, 0.0, 1.0),
            markers=((0.1, 0.2, 0.3),) * i,
        )
        for i in range(1, 4)
    ]
    scene = Scene(
        number=7,
        bodies=bodies,
        time_s=1.5,
        exposed_ticks=11,
        received_ticks=12,
        sent_ticks=13,
        others=((1.0, 2.0, 3.0),),
        skeletons=((1, bodies),),
        plates=((1, ((1.0, 2.0), (3.0,))),),
        devices=((1, ((1.0,),)),),
    )
    data = encode_frame(version, scene)
    ours = frame_of(data, version, 2)
    found = skipping.body_of(data, version, 2)
    assert ours.body is not None
    assert found is not None
    assert found[0] == tuple(ours.body)
    assert found[1] == (*ours[3:5], ours.time_s, 11, 12, 13)
    assert skipping.body_of(data, version, 99) is None


def test_hostile_frames_count_with_the_tick_that_they_come_before() -> None:
    fired = hostile.fire(200)
    assert all(
        loaded > alone for loaded, alone in zip(fired.loaded_us, fired.fired_us, strict=True)
    )


def test_an_aircraft_that_hangs_in_the_air_is_flown_on(tmp_path: Path) -> None:
    """Ten seconds of one that no law moves: else a benchmark would time a module in standby."""
    path = site_to_hang_in(tmp_path)
    assert load_site(path).parameters["FC_ACT"] == 1.0
    flight = ModuleFlight().engaged()
    for _ in range(2000):
        data = flight.piece()
        flight.onboard.event(data, flight.now_s)
        flight.onboard.periodic(flight.now_s)
    assert flight.onboard.output is not None
    assert flight.onboard.output.active


def test_every_latency_stands_beside_c_that_waits_awake_and_c_that_sleeps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = []

    def measured(kind: str, seconds: int, *options: str, arrivals: str = "0") -> latency.Measured:
        asked.append((kind, seconds, options, arrivals))
        ns = [1_000_000] * (seconds * latency.RATE_HZ)
        return latency.Measured(
            module_ns=ns,
            asleep_ns=ns,
            awake_ns=ns,
            mavutil_ns=ns if arrivals == "0" else [],
            cpu_percent=7.0,
            awake_cpu_percent=4.0,
        )

    monkeypatch.setattr(latency, "measure", measured)
    monkeypatch.setattr(latency, "is_native", lambda: True)
    rows = list(latency.sensor_to_surface())
    assert [each[0] for each in asked] == ["udp"] * 6 + ["pty"]
    assert [each[2] for each in asked].count(("--power-saving",)) == 1
    assert {each[3] for each in asked} == {"0", "200000", "600000", "loop:2500000"}
    delays = [row for row in rows if row.what.startswith("sensor to surface")]
    aims = {(row.what, row.reference_what): row.aim for row in delays}
    for name in ("UDP", "pseudo-terminal"):
        for whose in (AWAKE, latency.ASLEEP):
            assert aims[f"sensor to surface, {name}, p50", whose] == 2.3
            assert aims[f"sensor to surface, {name}, p99", whose] == 2.5
            assert aims[f"sensor to surface, {name}, p99.9", whose] == 2.5
    saving = [row for row in delays if "--power-saving" in row.what]
    assert {row.reference_what for row in saving} == {latency.ASLEEP}
    assert [row.aim for row in saving] == [2.3, 2.5]
    processor = [row for row in rows if row.what == "the flying process, UDP"]
    assert (processor[0].reference, processor[0].aim) == (8.0, 1.0)
    assert processor[1].reference == 4.0
    assert [row.aim for row in processor if row.reference_what == AWAKE] == [2.3]
    assert {row.aim for row in rows if row.what.startswith("answers later")} == {2.5}
