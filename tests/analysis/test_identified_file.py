"""An airframe file with identified values: each number in place, with its band beside it."""

from __future__ import annotations

import tomllib
from math import nan
from typing import Any

import pytest

from tgl_soar.analysis.drag import drag_of
from tgl_soar.analysis.identification import Estimate, Identified, KnownAircraft
from tgl_soar.analysis.identified_file import Gliding, Written, glided, with_identified
from tgl_soar.config.files import ConfigError
from tgl_soar.estimation.polar import GlideStretch, fit_polar, fit_polar_family

# In the order of `Identified`; the file's names differ for the delay alone.
NAMES = ("CL0", "CL_alpha", "CL_elevator", "Cm0", "Cm_alpha", "Cm_q", "Cm_elevator", "delay")
KEYS = (*NAMES[:-1], "servo_delay_s")
FILE = "\n".join(
    [
        "# an aircraft",
        "[airframe]",
        "mass_kg = 0.7",
        "CL0 = 9.0",  # not of [model]
        "",
        "[model]",
        *(f"{key} = 1.0  # guessed" for key in KEYS),
        "CD0 = 0.05",
        "other = 2.0",
        "",
        "[polar]",
        "c0 = 1.0",
        "# a comment",
        "",
        "[parameters]",
        "CL0 = 7.0",
    ]
)
NO_GLIDES = Gliding({}, "", "")


def estimate(name: str, value: float) -> Estimate:
    """With a band of a hundredth of it to either side."""
    return Estimate(
        name=name,
        value=value,
        standard_error=0.005 * value,
        low=0.99 * value,
        high=1.01 * value,
        unit="",
    )


def identified(brake: bool = False) -> Identified:
    names = (*NAMES, "CL_brake", "Cm_brake") if brake else NAMES
    some = estimate("some", 1.0)
    return Identified(
        derivatives=tuple(estimate(name, 2.0 + i) for i, name in enumerate(names)),
        no_brake="" if brake else "the log holds no brake",
        frequency=some,
        damping=some,
        effectiveness=some,
        response_delay=some,
        airspeed_mps=9.0,
        manoeuvres=(),
        held_out=(),
        explained=nan,
        fits=(),
    )


def table(text: str, name: str) -> dict[str, str]:
    """Keys of a table, with all that stands behind them."""
    body = text.partition(f"[{name}]\n")[2].partition("\n[")[0]
    rows = [line.split(" = ", 1) for line in body.splitlines() if " = " in line]
    return {key: value for key, value in rows}  # noqa: C416 - of lists


def test_each_value_stands_in_the_models_table_with_half_of_its_band() -> None:
    text = with_identified(FILE, "mine.toml", identified(), NO_GLIDES)
    model = table(text, "model")
    for i, key in enumerate(KEYS):
        value = 2.0 + i
        assert model[key] == f"{value:.5g}  # identified: ± {0.01 * value:.2g} at 95 %"
    assert (model["CD0"], model["other"]) == ("0.05", "2.0")
    assert list(model) == [*KEYS, "CD0", "other"]


def test_all_else_of_the_file_stays_as_it_is() -> None:
    text = with_identified(FILE, "mine.toml", identified(), NO_GLIDES)
    assert text.startswith("# an aircraft\n[airframe]\nmass_kg = 0.7\nCL0 = 9.0\n\n[model]\n")
    assert text.endswith("\n\n[polar]\nc0 = 1.0\n# a comment\n\n[parameters]\nCL0 = 7.0\n")


def test_of_the_brake_what_was_identified_is_put_in_place_or_added() -> None:
    """A file need not have it."""
    text = with_identified(FILE, "mine.toml", identified(brake=True), NO_GLIDES)
    model = table(text, "model")
    assert model["CL_brake"] == "10  # identified: ± 0.1 at 95 %"
    assert model["Cm_brake"] == "11  # identified: ± 0.11 at 95 %"
    assert "\n\n[polar]" in text
    there = FILE.replace("other = 2.0", "other = 2.0\nCL_brake = 0.4")
    again = table(with_identified(there, "mine.toml", identified(brake=True), NO_GLIDES), "model")
    assert again["CL_brake"] == model["CL_brake"]
    assert "CL_brake" not in table(
        with_identified(FILE, "mine.toml", identified(), NO_GLIDES), "model"
    )


@pytest.mark.parametrize("key", KEYS)
def test_a_key_that_the_model_lacks_is_named_with_its_file(key: str) -> None:
    lacking = FILE.replace(f"{key} = 1.0  # guessed\n", "")
    with pytest.raises(ConfigError, match=rf"mine\.toml: model\.{key}: missing"):
        with_identified(lacking, "mine.toml", identified(), NO_GLIDES)


def test_a_key_that_stands_there_twice_is_no_place() -> None:
    twice = FILE.replace("other = 2.0", "Cm_q = 2.0")
    with pytest.raises(ConfigError, match=r"model\.Cm_q"):
        with_identified(twice, "mine.toml", identified(), NO_GLIDES)


def test_the_glides_give_drag_and_polar() -> None:
    glides = Gliding({"CD0": Written(0.0312, 0.004)}, "c0 = 1.5\nc1 = -0.25", "words")
    text = with_identified(FILE, "mine.toml", identified(), glides)
    assert table(text, "model")["CD0"] == "0.0312  # identified: ± 0.004 at 95 %"
    assert "\n[polar]\nc0 = 1.5\nc1 = -0.25\n\n# a comment\n\n[parameters]\n" in text
    with pytest.raises(ConfigError, match=r"mine\.toml: \[polar\]: missing"):
        with_identified(FILE.replace("[polar]", "[other]"), "mine.toml", identified(), glides)


def test_the_table_may_have_a_comment_and_that_of_the_next_one_stays() -> None:
    file = FILE.replace("[polar]\n", "[polar]  # of the glides\n")
    file = file.replace("[parameters]", "# the operator's\n\n# own [deg]\n[parameters]")
    text = with_identified(file, "mine.toml", identified(), Gliding({}, "c0 = 1.5", "words"))
    assert tomllib.loads(text)["polar"] == {"c0": 1.5}
    assert "# the operator's\n\n# own [deg]\n[parameters]\n" in text
    assert "glides" not in text


@pytest.mark.parametrize("last", [True, False])
def test_a_bracket_in_a_comment_ends_no_table(last: bool) -> None:
    file = FILE.replace("[polar]\n", "[polar]\n# fitted from 9 to 14 [m/s]\n")
    if last:
        file = file.partition("\n[parameters]")[0]
    text = with_identified(file, "mine.toml", identified(), Gliding({}, "c0 = 1.5", "words"))
    assert "[m/s]" not in text
    assert tomllib.loads(text)["polar"] == {"c0": 1.5}
    assert ("parameters" in tomllib.loads(text)) is not last


# --- glides -------------------------------------------------------------------------------------

BODY = KnownAircraft(
    mass_kg=0.7,
    wing_area_m2=0.18,
    chord_m=0.16,
    iyy_kgm2=0.02,
    air_density_kgpm3=1.2,
    servo_lag_radps=40.0,
    servo_rate_per_s=10.0,
)


def stretches(brake: float) -> list[GlideStretch]:
    """Slower and faster glides; with the brake, each second one sinks faster."""
    found = []
    for i in range(10):
        speed, out = 8.0 + 0.4 * i, brake * (i % 2)
        sink = 1.0 + 0.06 * (speed - 9.0) ** 2 + 0.8 * out + 0.01 * (i % 3)
        found.append(
            GlideStretch(pitch_rad=0.0, speed_mps=speed, sink_mps=sink, duration_s=3.0, brake=out)
        )
    return found


@pytest.mark.parametrize("brake", [0.0, 0.6])
def test_glides_are_fitted_together_with_the_brake_where_it_moved(brake: float) -> None:
    rows = stretches(brake)
    found = glided(rows, BODY)
    names = ["CD0", "CD_lift", *(["CD_brake"] if brake else [])]
    expected = {each.name: each for each in drag_of(rows, BODY)}
    assert list(found.written) == names
    for name in names:
        assert found.written[name] == (expected[name].value, expected[name].half_band)
    speeds, sinks = [row.speed_mps for row in rows], [row.sink_mps for row in rows]
    fit: Any = (
        fit_polar_family(speeds, sinks, [row.brake for row in rows]).fit
        if brake
        else fit_polar(speeds, sinks)
    )
    lines = dict(line.split(" = ") for line in found.polar.splitlines())
    assert {key: float(value) for key, value in lines.items()} == pytest.approx(
        fit.polar._asdict(), rel=1e-6
    )
    polar = fit.polar
    assert found.words == (
        f"polar of 10 glides, {polar.speed_min_mps:.2f} to {polar.speed_max_mps:.2f} m/s,"
        f" residual {fit.residual_rms_mps:.3f} m/s"
    )
