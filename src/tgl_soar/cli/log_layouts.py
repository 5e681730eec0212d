"""Layouts that show a flight log at once: PlotJuggler's for the ULog, Foxglove's for its MCAP.

Both draw the same panels, in the order in which a flight is judged: did it hold the line, with
which pitch and surfaces, in what air, and what did the module know and decide.
"""

from __future__ import annotations

import json
from typing import Any, Final, NamedTuple
from xml.etree import ElementTree as Xml


class PlotPanel(NamedTuple):
    """One pair of axes over time."""

    title: str
    curves: tuple[str, ...]  # topic/field of the flight log


PANELS: Final = (
    PlotPanel("distance to the line [m]", ("tick/e_rho_m",)),
    PlotPanel("pitch [rad]", ("tick/setpoints_pitch_rad", "tick/vehicle_pitch_rad")),
    PlotPanel(
        "commands [of full travel]",
        ("tick/command_elevator", "tick/command_aileron", "tick/command_rudder"),
    ),
    PlotPanel("air [m/s]", ("slow/air_wind_mps", "slow/air_updraft_mps", "slow/air_excess_mps")),
    PlotPanel("mode, and the reason of its change", ("tick/mode", "tick/reason")),
    PlotPanel("clearance [m]", ("tick/margins_clearance_m",)),
    PlotPanel("age of the last fix [s]", ("tick/health_position_age_s",)),
)
PLACE: Final = ("tick/vehicle_x_m", "tick/vehicle_z_m")  # the path in the vertical plane
LINE: Final = ("tick/line_x_m", "tick/line_z_m")

_COLOURS: Final = ("#1f77b4", "#d62728", "#2ca02c")


def plotjuggler() -> str:
    """A layout for PlotJuggler 3, to be loaded after a `.ulg`."""
    root = Xml.Element("root")
    attributes = {"parent": "main_window", "name": "Main Window"}
    tabs = Xml.SubElement(root, "tabbed_widget", attributes)
    _tab(tabs, "flight", [_over_time(panel) for panel in PANELS])
    _tab(tabs, "vertical plane", [_plane()])
    Xml.SubElement(tabs, "currentTabIndex", index="0")
    Xml.SubElement(root, "use_relative_time_offset", enabled="1")
    Xml.indent(root)
    return Xml.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _tab(tabs: Xml.Element, name: str, areas: list[Xml.Element]) -> None:
    """Panels one below the other."""
    tab = Xml.SubElement(tabs, "Tab", tab_name=name, containers="1")
    container = Xml.SubElement(tab, "Container")
    sizes = ";".join([f"{1 / len(areas):.6f}"] * len(areas))
    attributes = {"orientation": "-", "count": str(len(areas)), "sizes": sizes}
    Xml.SubElement(container, "DockSplitter", attributes).extend(areas)


def _over_time(panel: PlotPanel) -> Xml.Element:
    area = Xml.Element("DockArea", name=panel.title)
    plot = _plot(area, "TimeSeries")
    for colour, curve in zip(_COLOURS, panel.curves, strict=False):
        Xml.SubElement(plot, "curve", name=curve, color=colour)
    return area


def _plane() -> Xml.Element:
    area = Xml.Element("DockArea", name="aircraft and line, x and z [m]")
    plot = _plot(area, "XYPlot")
    for colour, name, (x, z) in zip(_COLOURS, ("aircraft", "line"), (PLACE, LINE), strict=False):
        Xml.SubElement(plot, "curve", name=name, curve_x=x, curve_y=z, color=colour)
    return area


def _plot(area: Xml.Element, mode: str) -> Xml.Element:
    plot = Xml.SubElement(area, "plot", mode=mode, style="Lines", flip_x="false", flip_y="false")
    Xml.SubElement(plot, "limitY")
    return plot


def foxglove() -> str:
    """A layout for Foxglove, to be imported beside what `tgl-soar log export --to mcap` wrote."""
    panels = {f"Plot!{number}": _foxglove_plot(panel) for number, panel in enumerate(PANELS)}
    layout = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _stacked(list(panels)),
    }
    return json.dumps(layout, indent=2) + "\n"


def _foxglove_plot(panel: PlotPanel) -> dict[str, Any]:
    paths = [
        {"value": f"/{curve.replace('/', '.')}", "enabled": True, "timestampMethod": "receiveTime"}
        for curve in panel.curves
    ]
    return {
        "title": panel.title,
        "paths": paths,
        "xAxisVal": "timestamp",
        "isSynced": True,
        "showLegend": True,
        "legendDisplay": "floating",
        "showXAxisLabels": True,
        "showYAxisLabels": True,
    }


def _stacked(names: list[str]) -> Any:
    """Equally high, one below the other: Foxglove splits each area in two."""
    if len(names) == 1:
        return names[0]
    return {
        "direction": "column",
        "first": names[0],
        "second": _stacked(names[1:]),
        "splitPercentage": 100 / len(names),
    }
