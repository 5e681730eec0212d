"""The figure of docs/safety.md shows what its caption says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tgl_soar.analysis.campaigns import drawn_faults
from tgl_soar.analysis.campaigns.safety_timeline import SHOWN, fly_timeline
from tgl_soar.analysis.report.timeline_figure import Timeline
from tgl_soar.cli.app import app


@pytest.fixture(scope="module")
def flights() -> list[Timeline]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drawn_faults, "available", lambda: False)  # compiling would take longer
        return [fly_timeline(title, fault) for title, fault in SHOWN]


def test_a_drop_out_is_held_through_and_the_line_is_flown_on(flights: list[Timeline]) -> None:
    flight = flights[0]
    lost = (flight.time_s >= 12.6) & (flight.time_s < 13.0)
    assert {flight.mode[i] for i in np.flatnonzero(lost)} == {"holding"}
    assert flight.mode[0] == flight.mode[-1] == "soaring"
    assert np.all(np.isfinite(flight.commanded))


def test_from_the_pilots_word_on_nothing_is_commanded(flights: list[Timeline]) -> None:
    flight = flights[1]
    sent = np.isfinite(flight.commanded)
    assert np.all(sent[flight.time_s < 14.0])
    assert not np.any(sent[flight.time_s > 14.0 + 0.02])  # a heartbeat and two ticks
    assert flight.mode[-1] == "released"


def test_the_command_draws_it(
    tmp_path: Path, flights: list[Timeline], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(
        "tgl_soar.analysis.campaigns.safety_timeline.fly_timeline", lambda *_: flights[0]
    )
    path = tmp_path / "new" / "figure.png"
    done = CliRunner().invoke(app, ["campaign", "timeline", "--out", str(path)])
    assert done.exit_code == 0, done.output
    assert path.read_bytes().startswith(b"\x89PNG")
