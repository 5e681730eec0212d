"""The benchmarks' results as a page and as JSON, and whether the references are what they say."""

import json
import shutil
import socket
import subprocess
from pathlib import Path

import pytest
from benchmarks import c_reference, page, waking
from benchmarks.codec import FRAMES
from benchmarks.page import BEGIN, END, Group, markdown, replace_table, write_json
from benchmarks.result import Result, percentile
from pymavlink.dialects.v20 import ardupilotmega as mavlink

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
    with pytest.raises(ValueError, match="there is no"):
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


def test_without_a_compiler_it_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda _: None)
    c_reference.program.cache_clear()
    with pytest.raises(c_reference.NoCompilerError, match="no C compiler"):
        c_reference.program("wake")


@needs_compiler
def test_the_c_reference_reads_every_frame_and_answers_an_attitude() -> None:
    """A reference that did less than is claimed would make us look worse, or better."""
    c_reference.program.cache_clear()
    for _, message in FRAMES:
        frame = bytes(message.pack(mavlink.MAVLink(None, 1, 1)))
        subprocess.run([c_reference.program("codec"), "3"], input=frame, check=True)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        vehicle.settimeout(10.0)
        command = [c_reference.program("responder"), f"udp:{vehicle.getsockname()[1]}", "0"]
        with subprocess.Popen(command) as responder:
            try:
                decoder = mavlink.MAVLink(None)
                data, address = vehicle.recvfrom(2048)
                assert decoder.decode(bytearray(data)).get_type() == "HEARTBEAT"
                attitude = mavlink.MAVLink_attitude_quaternion_message(1, 1, 0, 0.25, 0, 0, 0, 0)
                vehicle.sendto(attitude.pack(mavlink.MAVLink(None, 1, 1)), address)
                answer = decoder.decode(bytearray(vehicle.recv(2048)))
                assert (answer.get_type(), answer.chan2_raw) == ("RC_CHANNELS_OVERRIDE", 1600)
            finally:
                responder.kill()
