"""Site and aircraft of a recording: the log's own or others, and what is said of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from page_flight import AIRFRAME, SITE

from tgl_soar.analysis.logs import open_log
from tgl_soar.analysis.logs.flight_data import FlightData, Series
from tgl_soar.cli.page.command import recorded_desk
from tgl_soar.config.files import ConfigError, shipped

HILL = shipped("sites/hill.toml")
SPOILERS = shipped("airframes/eclipson_c_spoilers.toml")
LOG = Path("x.ulg")
BOTH = {"airframe": SPOILERS.read_text(), "site": HILL.read_text()}


def holding(monkeypatch: pytest.MonkeyPatch, files: dict[str, str]) -> None:
    """The log that is read holds these files."""
    columns = {name: np.zeros(2) for name in ("x_m", "y_m", "z_m")}
    path = Series(np.array([0.0, 1.0]), columns, "a test")
    flight = FlightData("x.ulg", "a log", path=path, files=files)
    monkeypatch.setattr(open_log, "read_flight", lambda _log: flight)


def shown(**named: Any) -> tuple[str, str, list[str]]:
    """Site and airframe as the page names them, and what is said of them."""
    desk, notes = recorded_desk(LOG, **named, maps=False)
    assert desk.recording is not None
    assert json.loads(desk.recording)["notes"] == notes  # the page says it, too
    scene = json.loads(desk.scene)
    return scene["site"], scene["airframe"], notes


def test_the_logs_own_files_are_shown_and_nothing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    holding(monkeypatch, BOTH)
    site, airframe, notes = shown()
    assert (site, airframe) == ("half-cylinder hill of 8 m", "Eclipson Model C with spoilers")
    assert not notes


def test_other_files_than_the_logs_are_shown_and_named(monkeypatch: pytest.MonkeyPatch) -> None:
    holding(monkeypatch, BOTH)
    site, airframe, notes = shown(airframe=AIRFRAME, site=SITE)
    assert (site, airframe) == ("open jet, board at 23 degrees", "Eclipson Model C")
    words = "not what the log's flight was flown with"
    assert notes == [f"--airframe {AIRFRAME}: {words}", f"--site {SITE}: {words}"]
    assert shown(airframe=SPOILERS, site=HILL)[2] == []  # the same, by name


def test_a_log_without_files_is_shown_with_those_of_the_options(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    holding(monkeypatch, {})
    site, _, notes = shown()
    assert site == "open jet, board at 23 degrees"
    assert notes == [
        f"the log holds no {kind} file: it is shown with {name}; name its by --{kind}"
        for kind, name in (("airframe", "eclipson_c"), ("site", "tunnel"))
    ]
    assert shown(airframe=SPOILERS, site=HILL)[2] == []


def test_a_file_of_the_log_that_is_not_understood_is_needed_only_where_none_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    holding(monkeypatch, BOTH | {"site": "[site]\nname = 3\n"})
    with pytest.raises(
        ConfigError, match=r"own site file is not understood: .*; name one by --site"
    ):
        shown()
    assert shown(site=HILL)[0] == "half-cylinder hill of 8 m"


def test_no_file_of_this_computer_is_opened_because_a_log_names_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    text = SITE.read_text()
    begin = text.index("[air]")
    grid = '[air]\nkind = "grid"\nfile = "secret.csv"\nwind_mps = 8.0\n'
    holding(monkeypatch, BOTH | {"site": text[:begin] + grid})
    desk, notes = recorded_desk(LOG, maps=False)
    assert json.loads(desk.scene)["updraft"] is None
    assert "a file that the log does not hold, secret.csv, and that is not opened" in notes[0]
    assert "name the site file by --site" in notes[0]
