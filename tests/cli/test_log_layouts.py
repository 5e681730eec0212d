"""The layouts that `tgl-soar init` writes name what a log of ours really has, and nothing else."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from logged_flight import recorded

from tgl_soar.analysis.logs.export import to_mcap
from tgl_soar.analysis.logs.ulog_reader import read_log
from tgl_soar.cli.log_layouts import PANELS, foxglove, plotjuggler
from tgl_soar.onboard.flightlog.topics import TOPICS


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("log"), 1.0)


def test_plotjuggler_finds_every_curve_in_a_log(log: Path) -> None:
    """Its ULog reader names a curve topic/field."""
    from pyulog import ULog

    there = {f"{d.name}/{field}" for d in ULog(str(log)).data_list for field in d.data}
    root = ElementTree.fromstring(plotjuggler())
    curves = list(root.iter("curve"))
    named = {curve.get("curve_x") or curve.get("name") for curve in curves}
    named |= {curve.get("curve_y") for curve in curves} - {None}
    assert len(named) > 12
    assert named - there == set()
    for splitter in root.iter("DockSplitter"):
        sizes = [float(size) for size in splitter.get("sizes", "").split(";")]
        assert len(sizes) == len(list(splitter)) == int(splitter.get("count", ""))
        assert sum(sizes) == pytest.approx(1.0, abs=1e-4)


@pytest.mark.interpreted  # what a column means stands in the source
def test_foxglove_finds_every_path_in_the_export(log: Path, tmp_path: Path) -> None:
    from mcap.reader import make_reader

    (exported,) = to_mcap(read_log(log), tmp_path / "log.mcap")
    with exported.open("rb") as file:
        summary: Any = make_reader(file).get_summary()
    there = set()
    for channel in summary.channels.values():
        fields = json.loads(summary.schemas[channel.schema_id].data).get("properties", {})
        there |= {f"{channel.topic}.{name}" for name in fields}
    layout = json.loads(foxglove())
    paths = {path["value"] for plot in layout["configById"].values() for path in plot["paths"]}
    assert len(paths) > 8
    assert paths - there == set()
    assert sorted(re.findall(r"Plot!\d+", json.dumps(layout["layout"]))) == sorted(
        layout["configById"]
    )


def test_layouts_name_what_is_declared() -> None:
    """Also what a log of a second may lack."""
    known = {f"{name}/{field.name}" for name, topic in TOPICS.items() for field in topic.fields}
    assert {curve for panel in PANELS for curve in panel.curves} <= known
