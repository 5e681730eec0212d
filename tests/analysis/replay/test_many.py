"""The line about each of many logs."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tgl_soar.analysis.logs.ulog_reader import LogError
from tgl_soar.analysis.replay import many
from tgl_soar.analysis.replay.many import ReplayJob, replay_campaign, replay_many
from tgl_soar.sim.campaign.executors import InLine

LOG = SimpleNamespace(losses=["100 bytes belong to no record", "0.2 s without a tick"])
FOUND = SimpleNamespace(
    time_s=[1.0, 1.005, 1.01],
    duration_s=0.01,
    differences=[SimpleNamespace(name="command_rudder"), SimpleNamespace(name="cut")],
    left_out=7,
)


def test_each_log_has_a_line_with_all_that_was_found_and_what_cannot_be_read_has_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What is lost of a log and what is left out of its replay are different numbers, and without
    either the rest would pass for all of it."""
    asked: list[dict[str, Any]] = []

    def read_log(path: Path) -> Any:
        if path.stem == "bad":
            raise LogError(f"{path}: not a log")
        return LOG

    def replay(log: Any, **options: Any) -> Any:
        assert log is LOG
        asked.append(options)
        return FOUND

    monkeypatch.setattr(many, "read_log", read_log)
    monkeypatch.setattr(many, "replay", replay)
    airframe = Path("other.toml")
    jobs = [
        ReplayJob(Path("good.ulg"), (("RHO_P", 2.0),), airframe),
        ReplayJob(Path("bad.ulg")),
    ]
    good, bad = replay_many(jobs, InLine())
    assert good._asdict() == {
        "log": "good.ulg",
        "ticks": 3,
        "duration_s": 0.01,
        "differing": ("command_rudder", "cut"),
        "left_out": 7,
        "losses": 2,
        "error": "",
    }
    assert (bad.log, bad.ticks, bad.error) == ("bad.ulg", 0, "bad.ulg: not a log")
    assert asked == [{"changes": {"RHO_P": 2.0}, "airframe": airframe, "workers": 1}]


def test_a_campaign_of_replays_keeps_which_logs_and_which_airframe_they_were(
    tmp_path: Path,
) -> None:
    """By their digests: a log that has changed since is another one."""
    logs = [tmp_path / "a.ulg", tmp_path / "b.ulg"]
    plane = tmp_path / "plane.toml"
    for path, text in zip((*logs, plane), ("one", "two", "three"), strict=True):
        path.write_text(text, encoding="utf-8")
    digests = [sha256(text).hexdigest() for text in (b"one", b"two", b"three")]
    made = replay_campaign(logs, (("RHO_P", 2.0),), plane)
    assert made.name == "replay"
    assert made.parameters == {
        "logs": [
            {"log": str(path), "sha256": digest}
            for path, digest in zip(logs, digests[:2], strict=True)
        ],
        "changes": {"RHO_P": 2.0},
        "airframe": str(plane),
        "airframe_sha256": digests[2],
    }
    assert list(made.jobs) == [
        ReplayJob(path, (("RHO_P", 2.0),), plane, digest)
        for path, digest in zip(logs, digests[:2], strict=True)
    ]
    bare = replay_campaign(logs[:1], (), None)
    assert (bare.parameters["airframe"], bare.parameters["airframe_sha256"]) == ("", "")
    assert bare.parameters["changes"] == {}
