"""The loop that a multisine shows: against a known one, and against the linear model in flight."""

from __future__ import annotations

from functools import lru_cache
from math import isnan, radians
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import asdict
from typer.testing import CliRunner

from tgl_soar.analysis.linear_controller import linear_controller
from tgl_soar.analysis.linear_model import Loop, close_loop, margin, sensitivity
from tgl_soar.analysis.linear_plant import Condition, field_gradient, linear_plant
from tgl_soar.analysis.logs.flight_data import Series
from tgl_soar.analysis.logs.open_log import read_flight
from tgl_soar.analysis.loop_response import (
    AT_ELEVATOR,
    AT_SETPOINT,
    TONES_RADPS,
    LoopResponse,
    loop_responses,
    margins_between_tones,
    open_loop_discs,
    opened,
)
from tgl_soar.analysis.report.flight_page import analysed, write_page
from tgl_soar.analysis.report.flight_report_figures import Surroundings
from tgl_soar.cli.app import app
from tgl_soar.config.files import (
    line_parameters,
    load_airframe,
    load_parameters,
    load_site,
    shipped,
)
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.excitation import LEAD_S, RUNNING, WHOLE_S, multisine
from tgl_soar.control.laws import laws_from
from tgl_soar.onboard.flightlog.topics import VERSION
from tgl_soar.onboard.flightlog.ulog_messages import LogMetadata
from tgl_soar.onboard.flightlog.writer import FlightRecorder
from tgl_soar.sim.aircraft import aircraft_model
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.sensors import MEMS_IMU, USUAL_SENSORS, Sensors
from tgl_soar.sim.servos import servo_params
from tgl_soar.sim.world import build_field, make_world
from tgl_soar.types import Inputs

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME, SITE = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
BEGIN_S = 14.0  # settled: the integral's pole with accelerations is at 0.11 rad/s, its size small
BREAKS = {AT_SETPOINT: "e_rho", AT_ELEVATOR: "elevator"}
QUIET = Sensors(
    position=USUAL_SENSORS.position._replace(noise_m=0.0, velocity_noise_mps=0.0),
    attitude=USUAL_SENSORS.attitude._replace(noise_rad=0.0, rate_noise_radps=0.0),
    imu=MEMS_IMU._replace(force_noise_mps2=0.0, rate_noise_radps=0.0),
)


# --- a loop that is known -----------------------------------------------------------------------

KNOWN = np.array([0.5 - 0.4j, 0.9 + 0.3j, 1.5 + 1.0j, 1.2 - 1.1j, 1.6 - 0.2j, 1.1 + 0.1j])


def known_flight(noise_rad: float, runs: int, seed: int) -> Series:
    """What a loop of just this sensitivity would log, and white noise in the setpoint."""
    rows = np.random.default_rng(seed)
    dt, parts, standing = 0.005, [], []
    length = WHOLE_S + 2.0
    time_s = np.arange(round(runs * length / dt)).astype(np.float64) * dt
    for _ in range(runs):
        t = np.arange(round(length / dt)) * dt
        amplitude = radians(1.0) / 2.96
        tones = [amplitude * np.exp(1j * w * (t - LEAD_S)) for w in TONES_RADPS]
        phases = np.exp(1j * np.array((4.762, 5.539, 2.515, 2.368, 3.878, 5.403)))
        answer = sum((tone * p * s).real for tone, p, s in zip(tones, phases, KNOWN, strict=True))
        added = np.array([radians(1.0) * multisine(value - LEAD_S) for value in t.tolist()])
        runs_now = t < WHOLE_S
        parts.append(np.array([added * runs_now, answer]))
        standing.append(np.where(runs_now, RUNNING, 0))
    injected, setpoint = np.concatenate(parts, axis=1)
    nothing = np.full(len(time_s), np.nan)
    return Series(
        time_s,
        {
            "standing": np.concatenate(standing).astype(float),
            "injected_rad": injected,
            "setpoint_rad": setpoint + noise_rad * rows.standard_normal(len(time_s)) + 0.01,
            "pitch_rad": nothing,
            "elevator": nothing,
            "elevator_p": nothing,
            "elevator_i": nothing,
        },
        "made",
    )


def test_a_known_sensitivity_is_found_exactly() -> None:
    (found,) = loop_responses(known_flight(0.0, 1, 0))
    assert found.at == AT_SETPOINT
    assert found.periods == 4
    assert found.sensitivity == pytest.approx(KNOWN, abs=1e-9)
    assert found.open_loop == pytest.approx(1.0 / KNOWN - 1.0, abs=1e-9)
    assert found.coherence == pytest.approx(np.ones(6))


def test_its_discs_hold_the_truth_as_often_as_they_claim() -> None:
    """95 % of 40 x 6 = 240: 228, with a standard deviation of 3.4."""
    held = 0
    for seed in range(40):
        (found,) = loop_responses(known_flight(0.01, 1, seed))
        held += int(np.sum(np.abs(found.sensitivity - KNOWN) <= found.radius))
        centres, radii = open_loop_discs(found)
        inside = np.abs(opened(KNOWN) - centres) <= radii
        assert (inside == (np.abs(found.sensitivity - KNOWN) <= found.radius)).all()
    assert 228 - 4 * 3.4 <= held <= 238


def test_more_runs_are_pooled_and_tell_more() -> None:
    once, often = (loop_responses(known_flight(0.01, runs, 7))[0] for runs in (1, 6))
    assert often.periods == 24
    assert np.all(often.radius < 0.6 * once.radius)


def test_a_run_that_was_stopped_counts_by_its_whole_periods() -> None:
    series = known_flight(0.0, 1, 0)
    for seconds, periods in ((LEAD_S + 10.1, 2), (LEAD_S + 9.9, 0), (LEAD_S + 15.1, 3)):
        columns = dict(series.columns)
        columns["standing"] = np.where(series.time_s < seconds, columns["standing"], 3.0)
        found = loop_responses(Series(series.time_s, columns, "made"))
        assert [response.periods for response in found] == [periods] * (periods > 0)


def test_a_gap_in_the_log_costs_the_period_it_lies_in() -> None:
    series = known_flight(0.0, 1, 0)
    kept = (series.time_s < LEAD_S + 6.0) | (series.time_s > LEAD_S + 6.2)
    columns = {name: values[kept] for name, values in series.columns.items()}
    (found,) = loop_responses(Series(series.time_s[kept], columns, "made"))
    assert found.periods == 3
    assert found.sensitivity == pytest.approx(KNOWN, abs=1e-9)


# --- in flight ----------------------------------------------------------------------------------


@lru_cache(maxsize=1)
def shipped_values() -> ParameterSet:
    values = load_parameters(AIRFRAME, AIRFRAME_PATH, SITE, SITE_PATH)
    return values.changed(line_parameters(SITE.lines["b"]))


class Logged(ClosedLoop):
    """A closed loop with a flight log."""

    recorder: FlightRecorder

    def _decide(self, inputs: Inputs) -> object:  # type: ignore[override]
        output = super()._decide(inputs)
        self.recorder.tick(inputs, output, self.state)
        return output


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Loop]:
    """The log of a flight in calm air with sensors that have no noise, and the model there."""
    folder = tmp_path_factory.mktemp("log")
    assert SITE.air is not None
    field = build_field(SITE.air)
    world = make_world(AIRFRAME, SITE, seed=4, turbulence=0.0, field=field, sensors=QUIET)
    loop = Logged(world, shipped_values(), None)
    texts = {"airframe": AIRFRAME_PATH.read_text(), "site": SITE_PATH.read_text()}
    recorder = FlightRecorder(
        folder,
        LogMetadata({"sys_name": "tgl_soar", "ver_log": str(VERSION)}, texts),
        0.0,
        patient=True,
    )
    recorder.start()
    recorder.parameters(loop.values)
    recorder.reset(loop.state)
    loop.recorder = recorder
    places = []
    for k in range(round((BEGIN_S + WHOLE_S + 0.1) * 200)):
        if k == round(BEGIN_S * 200):
            loop.change({"EXC_START": 1.0})
            recorder.parameters(loop.values)
        loop.tick()
        recorder.poll()
        places.append((world.state.x_m, world.state.z_m))
    recorder.stop()
    x_m, z_m = np.mean(places[-4000:], axis=0).tolist()
    wind_mps, _, _ = field.wind_at(x_m, 0.0, z_m, 0.0)
    condition = Condition(
        model=aircraft_model(asdict(AIRFRAME.airframe), AIRFRAME.model),
        servo=servo_params(AIRFRAME.model),
        speed_mps=float(wind_mps),
        lean_rad=radians(15.0),
        sensors=QUIET,
        gradient_per_s=field_gradient(field, x_m, z_m),
    )
    controller = linear_controller(laws_from(shipped_values(), SITE.frame()), condition)
    (path,) = folder.rglob("*.ulg")
    return path, close_loop(linear_plant(condition), controller)


@pytest.fixture(scope="module")
def responses(flown: tuple[Path, Loop]) -> list[LoopResponse]:
    excitation = read_flight(flown[0]).excitation
    assert excitation is not None
    return loop_responses(excitation)


@pytest.mark.parametrize("at", BREAKS)
def test_without_noise_a_flight_shows_the_linear_models_loop(
    flown: tuple[Path, Loop], responses: list[LoopResponse], at: str
) -> None:
    """Gain within 1 dB and phase within 5 degrees at each tone, and the margins as closely.

    But where the loop's gain is above 20 dB: S is a tenth there, a hundredth of it is a tenth of
    L, and no margin hangs on it.
    """
    (found,) = (response for response in responses if response.at == at)
    model = sensitivity(flown[1], BREAKS[at], TONES_RADPS)
    near = np.abs(opened(model)) < 10.0
    assert np.sum(near) >= 5
    ratio = (found.open_loop / opened(model))[near]
    assert np.max(np.abs(20.0 * np.log10(np.abs(ratio)))) < 1.0
    assert np.max(np.abs(np.degrees(np.angle(ratio)))) < 5.0
    expected = margin(flown[1], BREAKS[at])
    if at == AT_SETPOINT:
        assert found.margins.phase_deg.value == pytest.approx(expected.phase_deg, abs=5.0)
        assert found.margins.alpha.value == pytest.approx(expected.alpha, abs=0.05)
        assert found.margins.gain_db.value == pytest.approx(expected.gain_up_db, abs=1.0)
    else:  # crossed, and least, beyond the last tone: that is not reported at all
        assert expected.at_radps > TONES_RADPS[-1]
        assert all(isnan(bounded.value) for bounded in found.margins)


def test_the_interpolation_between_tones_costs_little(flown: tuple[Path, Loop]) -> None:
    """Of the model itself: a tenth of what a measurement may be wrong by, or two."""
    at = AT_SETPOINT
    expected = margin(flown[1], BREAKS[at])
    gain_db, phase_deg, alpha = margins_between_tones(
        sensitivity(flown[1], BREAKS[at], TONES_RADPS)
    )
    assert phase_deg == pytest.approx(expected.phase_deg, abs=1.0)
    assert alpha == pytest.approx(expected.alpha, abs=0.02)
    assert gain_db == pytest.approx(expected.gain_up_db, abs=0.2)


def test_the_command_reads_the_margins_from_the_log(
    flown: tuple[Path, Loop], tmp_path: Path
) -> None:
    result = CliRunner().invoke(app, ["log", "margins", str(flown[0])])
    assert result.exit_code == 0, result.output
    for words in (f"broken at the {AT_SETPOINT}, 4 periods", AT_ELEVATOR, "phase_deg:", "alpha:"):
        assert words in result.output
    nothing = tmp_path / "nothing.ulg"
    nothing.write_bytes(b"")
    assert CliRunner().invoke(app, ["log", "margins", str(nothing)]).exit_code == 2


def test_the_flights_page_shows_the_loop(flown: tuple[Path, Loop], tmp_path: Path) -> None:
    flight = read_flight(flown[0])
    known = Surroundings(site="", airframe="", lines={}, field=None, polar=None, ground=None)
    analysis = analysed(flight, known, None)
    files = write_page(tmp_path / "page.html", analysis, lambda _: None)
    assert tmp_path / "page-figures" / "loop.svg" in files
    page = files[0].read_text(encoding="utf-8")
    assert 'id="loop"' in page
    assert "phase margin" in page
