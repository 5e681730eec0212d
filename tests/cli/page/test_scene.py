"""The place as a browser draws it: what of a site is in view, the map's grid, what numbers mean."""

from __future__ import annotations

from math import isnan
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from page_flight import AIRFRAME, SITE

from tgl_soar.cli.page.scene import Place, _contour, _map, _screen, meanings, place_of
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.config.parameters import PARAMETERS
from tgl_soar.control.supervisor import ENTRY
from tgl_soar.control.supervisor_texts import CONDITION_TEXTS, MODE_NAMES
from tgl_soar.estimation.health import FAULT_TEXTS
from tgl_soar.onboard.telemetry_values import HELD_BACK
from tgl_soar.types import GlidePolar

BARE = '[site]\nname = "bare"\nwind_from_deg = 270.0\n'


def sinking(sink_mps: float) -> GlidePolar:
    """An aircraft that sinks as fast at every speed."""
    return GlidePolar(c0=sink_mps, c1=0.0, c2=0.0, c3=0.0, speed_min_mps=5.0, speed_max_mps=15.0)


def placed(path: Path, airframe_file: Path = AIRFRAME) -> Place:
    airframe, site = load_airframe(airframe_file), load_site(path)
    values = load_parameters(airframe, airframe_file, site, path)
    return place_of(airframe, site, values, path.parent)


def view_of(folder: Path, text: str) -> list[float]:
    path = folder / "site.toml"
    path.write_text(BARE + text, encoding="utf-8")
    view: list[float] = placed(path).scene["view"]
    return view


# --- what is in view ---------------------------------------------------------------------------


def test_with_nothing_to_see_it_is_five_metres_around_the_line(tmp_path: Path) -> None:
    view = view_of(tmp_path, "[parameters]\nTGL_X = 3.0\nTGL_Z = 7.0\n")
    assert view == pytest.approx([-2.8, 8.8, 1.2, 12.8])  # and 8 % of 10 m around it


def test_the_sites_lines_are_in_view_with_room_of_eight_hundredths(tmp_path: Path) -> None:
    view = view_of(
        tmp_path, "[lines]\na = { x_m = 0.0, z_m = 2.0 }\nb = { x_m = 10.0, z_m = 4.0 }\n"
    )
    assert view == pytest.approx([-0.8, 10.8, 1.2, 4.8])


def test_one_line_alone_has_the_room_of_a_metre(tmp_path: Path) -> None:
    view = view_of(tmp_path, "[lines]\na = { x_m = 1.0, z_m = 2.0 }\n")
    assert view == pytest.approx([0.92, 1.08, 1.92, 2.08])


@pytest.mark.parametrize(("name", "value", "i"), [
    ("FENCE_X_MIN", -20.0, 0), ("FENCE_X_MAX", 20.0, 1), ("FENCE_Z_MIN", -20.0, 2),
    ("FENCE_Z_MAX", 20.0, 3),
])  # fmt: skip
def test_a_side_of_the_fence_that_is_set_is_in_view(
    name: str, value: float, i: int, tmp_path: Path
) -> None:
    lines = "[lines]\na = { x_m = 0.0, z_m = 2.0 }\nb = { x_m = 5.0, z_m = 4.0 }\n"
    view = view_of(tmp_path, f"{lines}[parameters]\n{name} = {value}\n")
    others = [0.0, 5.0, 2.0, 4.0]
    others[i] = value
    room = 0.08 * max(others[1] - others[0], others[3] - others[2])
    expected = [others[0] - room, others[1] + room, others[2] - room, others[3] + room]
    assert view == pytest.approx(expected)


def test_of_the_ground_only_what_is_between_is_in_view(tmp_path: Path) -> None:
    lines = "[lines]\na = { x_m = 0.0, z_m = 2.0 }\nb = { x_m = 5.0, z_m = 4.0 }\n"
    ground = "[ground]\nprofile = [[-9.0, -9.0], [0.0, 1.0], [5.0, 0.5], [9.0, -8.0]]\n"
    view = view_of(tmp_path, lines + ground)
    assert view == pytest.approx([-0.4, 5.4, 0.1, 4.4])


def test_the_contour_is_in_view(tmp_path: Path) -> None:
    contour = (
        '[contour]\nairframe = "Eclipson Model C"\nparts = [[[0.0, 1.0], [4.0, 2.0], [2.0, 6.0]]]\n'
    )
    view = view_of(tmp_path, contour)
    assert view == pytest.approx([-0.4, 4.4, 0.6, 6.4])


# --- the map -----------------------------------------------------------------------------------


class Sloped:
    """Updraft of x + 10 z [m/s] where z is above 1 m, unknown above 3 m."""

    def wind(self, x: Any, _y: Any, z: Any, _t: float = 0.0) -> Any:
        w = np.where(np.asarray(z) > 3.0, np.nan, np.asarray(x) + 10.0 * np.asarray(z))
        return np.full_like(w, 8.0), np.zeros_like(w), w

    def wind_at(self, x: float, _y: float, z: float, _t: float) -> tuple[float, float, float]:
        return 8.0, 0.0, x + 10.0 * z

    def inside(self, _x: float, _y: float, z: float) -> bool:
        return z > 1.0


@pytest.mark.parametrize("view", [[0.0, 7.2, 0.5, 4.1], [0.0, 3.6, 0.5, 7.7]])
def test_the_map_has_72_cells_along_its_longer_side(view: list[float]) -> None:
    found = _map(Sloped(), view)
    assert (found["x"], found["z"], found["step"]) == (view[0], view[2], pytest.approx(0.1))
    columns, rows = len(found["cells"][0]), len(found["cells"])
    assert columns == pytest.approx((view[1] - view[0]) / 0.1 + 1, abs=1)
    assert rows == pytest.approx((view[3] - view[2]) / 0.1 + 1, abs=1)
    assert found["x"] + (columns - 1) * found["step"] >= view[1] - 1e-9
    assert found["z"] + (rows - 1) * found["step"] >= view[3] - 1e-9
    for j, row in enumerate(found["cells"]):
        z = view[2] + 0.1 * j
        for i in (0, 5, 20):
            if 1.05 < z < 2.95:
                assert row[i] == pytest.approx(100.0 * (0.1 * i + 10.0 * z), abs=0.51)
                assert isinstance(row[i], int)
            elif z < 0.95 or z > 3.05:
                assert row[i] is None


@pytest.mark.parametrize(
    ("view", "screen"),
    [([1.0, 3.0, 0.0, 2.0], [0.65, 3.35, 0.0, 2.0]), ([1.0, 4.0, 0.0, 2.0], [1.0, 4.0, 0.0, 2.0])],
)
def test_the_air_is_as_wide_as_the_plane_on_a_screen(
    view: list[float], screen: list[float]
) -> None:
    """1.35 times as wide as high at least; without it the map would end beside the view."""
    assert _screen(view) == pytest.approx(screen)


def test_the_map_of_a_site_begins_and_ends_at_the_edges_of_the_screen() -> None:
    scene = placed(SITE).scene
    x_from, x_to, z_from, _ = _screen(scene["view"])
    drawn = scene["updraft"]
    assert x_from < scene["view"][0]
    assert (drawn["x"], drawn["z"]) == (pytest.approx(x_from), pytest.approx(z_from))
    assert drawn["x"] + drawn["step"] * (len(drawn["cells"][0]) - 1) >= x_to - 1e-9


def test_the_models_contour_is_where_updraft_is_sink() -> None:
    """The made-up aircraft sinks 21.5 m/s at every speed: x + 10 z = 21.5."""
    polar = sinking(21.5)
    (part,) = _contour(Sloped(), polar, [0.0, 5.0, 1.2, 2.8])
    for x, z in part:
        assert x + 10.0 * z == pytest.approx(21.5, abs=0.02)
        assert (round(x, 3), round(z, 3)) == (x, z)
    assert min(x for x, _ in part) < 0.1
    assert max(x for x, _ in part) > 4.9


def test_air_without_a_contour_has_none() -> None:
    polar = sinking(999.0)
    assert _contour(Sloped(), polar, [0.0, 5.0, 1.2, 2.8]) == []


# --- the whole ---------------------------------------------------------------------------------


def test_the_tunnel_is_drawn_with_all_that_its_file_has() -> None:
    scene = placed(SITE).scene
    assert (scene["site"], scene["airframe"]) == ("open jet, board at 23 degrees",
                                                  "Eclipson Model C")  # fmt: skip
    assert scene["ground"] == [[-2.0, 0.0], [0.0, 0.0], [2.255, 0.957]]
    assert scene["presets"][1] == {"name": "b", "x": 0.6, "z": 1.6, "lean": 15.0}
    assert [len(part) for part in scene["known"]] == [16]
    assert scene["contour"] != scene["known"]  # the model's, where there is one
    assert scene["updraft"] is not None
    assert scene["outline"]
    assert (scene["has_brake"], scene["braked"]) == (False, [])
    length = sum(
        float(np.hypot(b[0] - a[0], b[1] - a[1]))
        for a, b in zip(scene["known"][0], scene["known"][0][1:], strict=False)
    )
    assert scene["contour_m"] == pytest.approx(length, abs=1e-5)


def test_a_brake_has_a_contour_of_its_own() -> None:
    spoilers = shipped("airframes/eclipson_c_spoilers.toml")
    scene = placed(SITE, spoilers).scene
    assert scene["has_brake"]
    assert scene["braked"]
    # It sinks more with the brake: where it soars then the updraft is larger, nearer to the board.
    assert min(z for _, z in scene["braked"][0]) < max(z for _, z in scene["contour"][0])
    assert scene["braked"] != scene["contour"]


def test_without_air_the_files_contour_is_drawn_and_no_map(tmp_path: Path) -> None:
    path = tmp_path / "site.toml"
    contour = '[contour]\nairframe = "Eclipson Model C"\nparts = [[[0.0, 1.0], [4.0, 2.0]]]\n'
    path.write_text(BARE + contour, encoding="utf-8")
    place = placed(path)
    scene = place.scene
    assert scene["contour"] == scene["known"] == [[(0.0, 1.0), (4.0, 2.0)]]
    assert (scene["updraft"], scene["outline"], scene["ground"]) == (None, [], [])
    assert scene["braked"] == []
    measured = place.measured_air()
    assert measured.drawing is None
    assert list(measured._box) == scene["view"]


def test_numbers_are_reported_in_the_words_of_their_modules() -> None:
    texts = meanings()
    assert texts["modes"] == list(MODE_NAMES)
    assert texts["faults"] == [[2**i, words] for i, words in enumerate(FAULT_TEXTS)]
    asked = [[2**i, words] for i, words in enumerate(CONDITION_TEXTS) if ENTRY & 2**i]
    assert texts["checks"][1:] == asked
    assert texts["checks"][0] == [HELD_BACK, "not held back (abort, switch, line, set-up)"]
    assert len(texts["parameters"]) == len(PARAMETERS)
    rho = next(p for p in texts["parameters"] if p["name"] == "RHO_P")
    assert rho == {
        "name": "RHO_P",
        "group": rho["group"],
        "unit": "rad/m",
        "min": 0.0,
        "max": rho["max"],
        "default": rho["default"],
        "meaning": rho["meaning"],
        "in_flight": True,
        "integer": False,
    }
    assert not isnan(rho["max"])
    assert rho["group"]
    assert {"forecasts", "points"} <= texts.keys()
