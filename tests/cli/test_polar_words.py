"""`tgl-soar polar`: its table, its summary and its reading of a file, worked out by hand."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from tgl_soar.analysis.logs.flight_data import FlightData, series
from tgl_soar.analysis.logs.gliding import MeanWind
from tgl_soar.cli import polar as module
from tgl_soar.cli.app import app
from tgl_soar.cli.polar import brake_words, logged_glides, polar_toml, read_glides
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.estimation.polar import fit_polar, fit_polar_family

PLAIN = shipped("airframes/eclipson_c.toml")
SPEEDS = (7.4, 7.9, 8.6, 9.4, 10.3, 11.5)


def sink(speed: float) -> float:
    return 1.3 + 0.1 * (speed - 8.6) ** 2


def table(folder: Path, text: str, name: str = "glides.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def made(folder: Path) -> Path:
    rows = [f"{u},{sink(u):.6f}" for u in SPEEDS]
    return table(folder, "\n".join(["speed_mps,sink_mps", *rows]) + "\n")


def run(*arguments: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, ["polar", *map(str, arguments)], env={"COLUMNS": "200"})
    return done.exit_code, done.output


def test_a_fit_says_where_it_sinks_least_and_glides_farthest(tmp_path: Path) -> None:
    """sink / u is least where 0.1 (u² - 8.6²) = 1.3: at 9.325 m/s, u / sink is 6.89 there."""
    code, output = run("fit", made(tmp_path))
    assert code == 0, output
    assert "6 glides at 6 speeds; residual 0.000 m/s, at most 0.000 m/s" in output
    assert "least sink 1.300 m/s at 8.60 m/s" in output
    best = (8.6**2 + 13.0) ** 0.5
    assert f"best glide 1 : {best / sink(best):.2f} at {best:.2f} m/s" in output
    assert "valid from 7.4 to 11.5 m/s, not beyond" in output
    assert "CD_brake" not in output
    rows = [
        line.split() for line in output.splitlines() if line.strip().startswith(("7.40", "11.50"))
    ]
    assert rows[0][:5] == ["7.40", "m/s", "1.444", "1.444", rows[0][4]]
    assert rows[1][2:4] == ["2.141", "2.141"]
    assert float(rows[0][4]) == pytest.approx(0.0, abs=0.001)


def test_the_printed_table_is_the_polar_of_an_airframe_file() -> None:
    fitted = fit_polar(list(SPEEDS), [sink(u) for u in SPEEDS])
    lines = dict(line.split(" = ") for line in polar_toml(fitted).splitlines()[1:])
    # 1.3 + 0.1 (u - 8.6)² = 8.696 - 1.72 u + 0.1 u²
    expected = {"c0": 8.696, "c1": -1.72, "c2": 0.1, "c3": 0.0,
                "speed_min_mps": 7.4, "speed_max_mps": 11.5}  # fmt: skip
    assert {name: float(value) for name, value in lines.items()} == pytest.approx(
        expected, abs=1e-4
    )
    assert polar_toml(fitted).startswith("[polar]\n")


def test_residuals_are_what_was_measured_less_what_was_fitted(tmp_path: Path) -> None:
    rows = [(u, sink(u) + (0.05 if u == 9.4 else 0.0)) for u in SPEEDS]
    path = table(tmp_path, "\n".join(["speed_mps,sink_mps", *(f"{u},{s}" for u, s in rows)]))
    _, output = run("fit", path)
    found = [line.replace("m/s", " ").split() for line in output.splitlines() if "…" in line]
    assert len(found) == len(SPEEDS)
    for words in found:
        measured, fitted, residual = (float(word) for word in words[1:4])
        assert residual == pytest.approx(measured - fitted, abs=0.0011)
        low, high = float(words[4]), float(words[6])
        assert low < fitted < high
        assert fitted == pytest.approx((low + high) / 2.0, abs=0.0011)


def test_show_lists_eleven_speeds_from_end_to_end() -> None:
    code, output = run("show")
    assert code == 0
    polar = load_airframe(PLAIN).polar
    lines = output.splitlines()
    rows = [line.split() for line in lines if line.strip().endswith(tuple("0123456789"))
            and " m/s " in line]  # fmt: skip
    rows = [row for row in rows if len(row) == 7]
    assert len(rows) == 11
    low, high = polar.speed_min_mps, polar.speed_max_mps
    for i, row in enumerate(rows):
        u = low + (high - low) * i / 10
        s = polar.c0 + polar.c1 * u + polar.c2 * u * u + polar.c3 * u**3
        slope = polar.c1 + 2 * polar.c2 * u + 3 * polar.c3 * u * u
        numbers = [float(row[j]) for j in (0, 2, 4, 5, 6)]
        assert numbers == pytest.approx([u, s, u / s, slope, s / u - slope], abs=0.0051)
    assert f"valid from {low:g} to {high:g} m/s" in output


def test_a_best_glide_beyond_the_range_is_not_named(tmp_path: Path) -> None:
    text = PLAIN.read_text(encoding="utf-8")
    at = text.index("[polar]")
    end = text.index("speed_max_mps", at)
    end = text.index("\n", end)
    own = (
        "[polar]\nc0 = 3.0\nc1 = -0.2\nc2 = 0.0\nc3 = 0.0\nspeed_min_mps = 7.0\n"
        "speed_max_mps = 9.0\n"
    )
    path = table(tmp_path, text[:at] + own + text[end:], "plane.toml")
    code, output = run("show", "--airframe", path)
    assert code == 0, output
    assert "best glide lies outside the range" in output
    assert "least sink 1.200 m/s at 9.00 m/s" in output


# --- the file ----------------------------------------------------------------------------------


def test_columns_are_read_by_their_names_and_the_brake_where_there_is_one(tmp_path: Path) -> None:
    path = table(tmp_path, "\ufeff sink , speed, brake\n1.5,8,0.25\n1.75,9,1\n")
    assert read_glides(path, "speed", "sink") == ([8.0, 9.0], [1.5, 1.75], [0.25, 1.0])
    assert read_glides(path, "speed", "sink", "none") == ([8.0, 9.0], [1.5, 1.75], [0.0, 0.0])


@pytest.mark.parametrize(("text", "words"), [
    ("speed_mps,other\n8,1\n",
     "no column 'sink_mps'; the first line names speed_mps, other. Name yours with --speed"),
    ("", "no column 'speed_mps'; the first line names none"),
    ("speed_mps,sink_mps\n8,1.5\n9,x\n", "line 3: sink_mps = 'x' is not a number"),
    ("speed_mps,sink_mps\n8,1.5\n9\n", "line 3: sink_mps = None is not a number"),
    ("speed_mps,sink_mps,brake\n8,1.5,?\n", "line 2: brake = '?' is not a number"),
])  # fmt: skip
def test_a_mistake_in_a_table_is_named_with_its_line(text: str, words: str, tmp_path: Path) -> None:
    path = table(tmp_path, text)
    with pytest.raises(ValueError, match=r"glides\.csv: ") as refused:
        read_glides(path, "speed_mps", "sink_mps")
    assert words in str(refused.value)
    code, output = run("fit", path)
    assert code == 2
    assert output.count(str(path)) == 1
    assert words in output


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    code, output = run("fit", tmp_path / "none.csv")
    assert (code, "none.csv: cannot be read: No such file" in output) == (2, True)
    (tmp_path / "bad.csv").write_bytes(b"\xff\xfe\x00")
    code, output = run("fit", tmp_path / "bad.csv")
    assert (code, "bad.csv: not UTF-8 text: save it as CSV in UTF-8" in output) == (2, True)


def test_one_table_at_a_time(tmp_path: Path) -> None:
    path = made(tmp_path)
    other = tmp_path / "other.csv"
    code, output = run("fit", path, other)
    assert code == 2
    assert f"{other}: one table at a time" in output
    few = table(tmp_path, "speed_mps,sink_mps\n8,1.5\n", "FEW.CSV")
    code, output = run("fit", few)
    assert code == 2
    assert f"{few}: " in output


# --- the brake ---------------------------------------------------------------------------------


def test_what_the_brake_adds_is_reported_with_its_error_and_at_nine_metres_a_second() -> None:
    k = 4.6e-4
    glides = [(u, b) for b in (0.0, 0.5, 1.0) for u in SPEEDS]
    sinks = [sink(u) + k * b * u**3 for u, b in glides]
    family = fit_polar_family([u for u, _ in glides], sinks, [b for _, b in glides])
    words = brake_words(family._replace(brake_sink=k, brake_sink_error=1e-5), None)
    assert words.startswith(
        f"all of the brake adds 0.00046 ± 2e-05 (95 %) times the cube of the airspeed:"
        f" {k * 729.0:.3f} m/s at 9 m/s"
    )
    assert words.endswith("With --compare an airframe file its CD_brake follows")
    plane = load_airframe(PLAIN)
    text = brake_words(family._replace(brake_sink=k, brake_sink_error=1e-5), plane)
    # k V³ is the sink of CD_brake: D V = m g sink, D = rho/2 V² S CD.
    per_sink = 2.0 * 0.699 * 9.80665 / (1.225 * 0.180)
    assert f"CD_brake = {k * per_sink:.4g} ± {1.96e-5 * per_sink:.1g} (the file has none)" in text


def test_glides_at_one_position_of_the_brake_are_no_family(tmp_path: Path) -> None:
    rows = [f"{u},{sink(u):.6f},0.5" for u in SPEEDS]
    path = table(tmp_path, "\n".join(["speed_mps,sink_mps,brake", *rows]))
    code, output = run("fit", path)
    assert code == 0
    assert "the brake adds" not in output
    assert "least sink 1.300 m/s at 8.60 m/s" in output


def test_of_a_family_the_sinks_without_the_brake_are_fitted(tmp_path: Path) -> None:
    k = 4.6e-4
    rows = [f"{u},{sink(u) + k * b * u**3:.6f},{b}" for b in (0.0, 1.0) for u in SPEEDS]
    path = table(tmp_path, "\n".join(["speed_mps,sink_mps,brake", *rows]))
    code, output = run("fit", path)
    assert code == 0
    assert "12 glides at 6 speeds; residual 0.000 m/s, at most 0.000 m/s" in output
    assert "least sink 1.300 m/s at 8.60 m/s" in output
    assert "all of the brake adds 0.00046 ±" in output


# --- logs --------------------------------------------------------------------------------------


def test_the_glides_of_several_logs_are_put_together(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def glide(speed: float, duration: float) -> SimpleNamespace:
        return SimpleNamespace(
            speed_mps=speed, sink_mps=speed / 6.0, brake=speed / 20.0, duration_s=duration
        )

    found = {"a.ulg": [glide(8.0, 10.0), glide(9.0, 20.4)], "b.ulg": [glide(10.0, 5.0)]}
    monkeypatch.setattr(
        module,
        "read_flight",
        lambda path: SimpleNamespace(lost=("a bit",), name=path.name, airspeed=None),
    )
    monkeypatch.setattr(module, "glides", lambda flight, _wind: found[flight.name])
    speeds, sinks, brakes = logged_glides([Path("a.ulg"), Path("b.ulg")], SimpleNamespace())  # type: ignore[arg-type]
    assert speeds == [8.0, 9.0, 10.0]
    assert sinks == [speed / 6.0 for speed in speeds]
    assert brakes == [speed / 20.0 for speed in speeds]
    out, err = capsys.readouterr()
    assert out == "a.ulg: 2 steady glides, 30 s in all\nb.ulg: 1 steady glides, 5 s in all\n"
    assert err.count("lost: a bit") == 2


@pytest.mark.parametrize(
    ("fast", "airspeed", "wind", "refused"),
    [
        (2.26, None, 0.0, True),
        (2.26, float("nan"), 0.0, True),
        (4.99, None, 0.0, True),
        (5.0, None, 0.0, False),
        (2.26, None, 0.1, False),
        (2.26, 2.0, 0.0, False),
    ],
)
def test_speeds_over_the_ground_are_not_taken_for_glides_against_a_wind_that_nobody_gave(
    fast: float,
    airspeed: float | None,
    wind: float,
    refused: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    measured = None if airspeed is None else series([0.0], "airspeed", airspeed_mps=[airspeed])
    monkeypatch.setattr(module, "read_flight", lambda _: FlightData("a", "b", airspeed=measured))
    glided = [SimpleNamespace(speed_mps=u, sink_mps=0.2, brake=0.0, duration_s=9.0)
              for u in (0.72, fast)]  # fmt: skip
    monkeypatch.setattr(module, "glides", lambda _flight, _wind: glided)
    if not refused:
        assert logged_glides([Path("a.ulg")], MeanWind(wind, 0.0))[0] == [0.72, fast]
        return
    words = (
        f"^a.ulg: the log has no airspeed, and --wind is 0: .* glides at 0.7 to {fast:.1f} m/s."
        " Give the wind of the flight with --wind and --wind-from$"
    )
    with pytest.raises(ValueError, match=words):
        logged_glides([Path("a.ulg")], MeanWind(wind, 0.0))


def test_the_brake_of_a_log_is_read_by_the_airframe_that_is_compared(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    surfaces = load_airframe(shipped("airframes/eclipson_c_spoilers.toml")).surfaces
    known = surfaces.brake
    assert known is not None
    pulses = {str(known.channel): [known.pwm_min, known.pwm_max]}
    read: list[FlightData] = []

    def glided(flight: FlightData, _wind: object) -> list[object]:
        read.append(flight)
        return []

    flown = FlightData("a", "b", outputs=series([0.0, 1.0], "outputs", **pulses))
    monkeypatch.setattr(module, "read_flight", lambda _: flown)
    monkeypatch.setattr(module, "glides", glided)
    logged_glides([Path("a.bin")], MeanWind(0.0, 0.0), surfaces)
    logged_glides([Path("a.bin")], MeanWind(0.0, 0.0))
    assert read[0].brake is not None
    assert sorted(read[0].brake["brake"]) == [0.0, 1.0]
    assert read[1].brake is None


def test_a_figure_of_no_known_format_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="figures need matplotlib")
    code, output = run("show", "--out", tmp_path / "polar.xyz")
    assert code == 2
    assert "no figure: " in output
