"""Airframe and site files: good ones, and every kind of bad one with its message."""

from __future__ import annotations

import re
from math import radians
from pathlib import Path

import pytest
from msgspec import inspect

from tgl_soar.config import files
from tgl_soar.config.airframe import MODEL_KEYS, Airframe
from tgl_soar.config.files import (
    ConfigError,
    line_parameters,
    load_airframe,
    load_file,
    load_parameters,
    load_site,
    shipped,
)
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import GridAir, HillAir, JetAir, PolynomialAir, Site
from tgl_soar.config.strict import Strict
from tgl_soar.geometry import SoaringFrame
from tgl_soar.types import GlidePolar

AIRFRAME = """
[airframe]
name = "test"
mass_kg = 0.7
wing_area_m2 = 0.18
span_m = 1.1
chord_m = 0.164
ixx_kgm2 = 0.013
iyy_kgm2 = 0.0115
izz_kgm2 = 0.0233
[autopilot]
firmware = "bridge"
[surfaces]
elevator = { channel = 2, reversed = true }
aileron = { channel = 1 }
rudder = { channel = 4, pwm_min = 1000, pwm_trim = 1520, pwm_max = 2000 }
[polar]
c0 = 9.0
c1 = -2.0
c2 = 0.2
c3 = -0.005
speed_min_mps = 7.5
speed_max_mps = 12
[parameters]
RHO_P = 0.5
PITCH_TRIM = -1.5
[model]
CL0 = 0.2
"""

SITE = """
[site]
name = "hall"
origin_north_m = 1.0
origin_down_m = -2
wind_from_deg = 270.0
[lines]
a = { x_m = -0.5, z_m = 1.5 }
b = { x_m = 0.25, z_m = 2, lean_deg = 30 }
[parameters]
RHO_P = 0.75
TGL_LEAN = 20.0
[air]
kind = "jet"
wind_mps = 8.5
slope_deg = 23
[start]
x_m = 0.0
z_m = 1.0
"""


def written(tmp_path: Path, text: str, name: str = "file.toml") -> Path:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def with_change(text: str, old: str, new: str) -> str:
    assert text.count(old) == 1, f"{old!r} must be in the file once"
    return text.replace(old, new)


# --- good files -----------------------------------------------------------------------------


def test_a_good_airframe(tmp_path: Path) -> None:
    airframe = load_airframe(written(tmp_path, AIRFRAME))
    assert airframe.airframe.mass_kg == 0.7
    assert airframe.surfaces.elevator.reversed
    assert airframe.surfaces.rudder.pwm_trim == 1520
    assert airframe.polar.as_polar() == GlidePolar(
        c0=9.0, c1=-2.0, c2=0.2, c3=-0.005, speed_min_mps=7.5, speed_max_mps=12.0
    )
    assert airframe.model == {"CL0": 0.2}
    assert airframe.autopilot.component_id == 191  # an onboard computer, by default


def test_a_good_site(tmp_path: Path) -> None:
    site = load_site(written(tmp_path, SITE))
    assert site.frame() == SoaringFrame(1.0, 0.0, -2.0, radians(270.0))
    assert isinstance(site.air, JetAir)
    assert site.air.turbulence.intensity == 0.0
    assert line_parameters(site.lines["a"]) == {"TGL_X": -0.5, "TGL_Z": 1.5}
    assert line_parameters(site.lines["b"]) == {"TGL_X": 0.25, "TGL_Z": 2.0, "TGL_LEAN": 30.0}


def test_a_site_for_flying_needs_no_air(tmp_path: Path) -> None:
    site = load_site(written(tmp_path, '[site]\nname = "field"\n'))
    assert site.air is None
    assert site.lines == {}


POLYNOMIAL = """kind = "polynomial"
of = { kind = "jet", wind_mps = 8.5, slope_deg = 23 }
degree = 8
x_m = [-0.5, 2.2]
z_m = [0.2, 2.8]"""


@pytest.mark.parametrize(
    ("change", "reported"),
    [
        (("degree = 8", "degree = 13"), "air.degree = 13: must be a whole number from 1 to 12"),
        (("degree = 8", ""), "air.degree: missing"),
        (("2.2]", "-0.5]"), r"air: x_m = \[-0.5, -0.5\]: must be from, to, growing"),
        (
            ('"jet"', '"polynomial"'),
            'air.of.kind = "polynomial": must be "jet" or "hill" or "grid"$',
        ),
        (
            ("slope_deg = 23", "slope_deg = 23, turbulence = { intensity = 0.01 }"),
            r"air: of.turbulence: the polynomial is of calm air; give it to \[air\]",
        ),
        (
            (
                '"jet", wind_mps = 8.5, slope_deg = 23',
                '"hill", wind_mps = 8.5, radius_m = 8, record = "a.csv"',
            ),
            "air: of.record: a polynomial is of a steady wind; leave it out",
        ),
    ],
)
def test_a_polynomial_air_is_refused_with_the_way_out(
    tmp_path: Path, change: tuple[str, str], reported: str
) -> None:
    file = written(tmp_path, f'[site]\nname = "s"\n[air]\n{POLYNOMIAL.replace(*change)}\n')
    with pytest.raises(ConfigError, match=reported):
        load_site(file)


@pytest.mark.parametrize(
    ("air", "kind"),
    [
        ('kind = "hill"\nwind_mps = 8\nradius_m = 30', HillAir),
        ('kind = "grid"\nwind_mps = 8\nfile = "cfd.csv"', GridAir),
        (POLYNOMIAL, PolynomialAir),
    ],
)
def test_other_airs(tmp_path: Path, air: str, kind: type) -> None:
    site = load_site(written(tmp_path, f'[site]\nname = "s"\n[air]\n{air}\n'))
    assert isinstance(site.air, kind)


def test_site_beats_airframe_beats_default(tmp_path: Path) -> None:
    a, s = written(tmp_path, AIRFRAME, "a.toml"), written(tmp_path, SITE, "s.toml")
    values = load_parameters(load_airframe(a), a, load_site(s), s)
    assert values["RHO_P"] == 0.75
    assert values["PITCH_TRIM"] == -1.5
    assert values["RHO_I"] == ParameterSet()["RHO_I"]


def test_what_is_shipped_can_be_used() -> None:
    airframes = sorted(shipped("airframes").glob("*.toml"))
    sites = sorted(shipped("sites").glob("*.toml"))
    assert airframes
    assert sites
    for a in airframes:
        for s in sites:
            load_parameters(load_airframe(a), a, load_site(s), s)


# --- bad values -----------------------------------------------------------------------------

# What is replaced, by what, and the whole of the message after the file's name.
BAD_AIRFRAMES = [
    (
        "mass_kg = 0.7",
        "mas_kg = 0.7",
        "airframe.mas_kg: unknown key; known here: name, mass_kg, wing_area_m2, span_m, chord_m,"
        " ixx_kgm2, iyy_kgm2, izz_kgm2",
    ),
    (
        "[model]",
        "[modell]",
        "modell: unknown key; known here: airframe, autopilot, surfaces, polar, parameters, model,"
        " dynamics",
    ),
    (
        "CL0 = 0.2",
        "CLO = 0.2",
        f"model.CLO: unknown key; known here: kind, {', '.join(MODEL_KEYS)}",
    ),
    (
        "mass_kg = 0.7",
        "",
        "airframe.mass_kg: missing; must be a number from 0.02 to 100",
    ),
    (
        "aileron = { channel = 1 }",
        "",
        "surfaces: give either aileron, or aileron_left and aileron_right",
    ),
    (
        "mass_kg = 0.7",
        "mass_kg = true",
        "airframe.mass_kg = true: must be a number from 0.02 to 100",
    ),
    (
        "mass_kg = 0.7",
        'mass_kg = "3"',
        'airframe.mass_kg = "3": must be a number from 0.02 to 100',
    ),
    (
        "mass_kg = 0.7",
        "mass_kg = nan",
        "airframe.mass_kg = nan: must be a number from 0.02 to 100",
    ),
    (
        "mass_kg = 0.7",
        "mass_kg = inf",
        "airframe.mass_kg = inf: must be a number from 0.02 to 100",
    ),
    (
        "mass_kg = 0.7",
        "mass_kg = 0",
        "airframe.mass_kg = 0: must be a number from 0.02 to 100",
    ),
    (
        "mass_kg = 0.7",
        "mass_kg = 1" + 400 * "0",
        "airframe.mass_kg = 1" + 36 * "0" + "...: must be a number from 0.02 to 100",
    ),
    (
        "mass_kg = 0.7",
        "mass_kg = 2024-05-01",
        "airframe.mass_kg = 2024-05-01: must be a number from 0.02 to 100",
    ),
    ("c0 = 9.0", "c0 = nan", "polar.c0 = nan: must be a number from -1e+06 to 1e+06"),
    ("CL0 = 0.2", "CL0 = nan", "model.CL0 = nan: must be a number from -1e+06 to 1e+06"),
    ('name = "test"', "name = 3", "airframe.name = 3: must be text in quotes"),
    (
        'firmware = "bridge"',
        'firmware = "px5"',
        'autopilot.firmware = "px5": must be "ardupilot" or "bridge" or "paparazzi" or "px4"',
    ),
    (
        'firmware = "bridge"',
        'firmware = "bridge"\nsystem_id = 256',
        "autopilot.system_id = 256: must be a whole number from 1 to 255",
    ),
    (
        'firmware = "bridge"',
        'firmware = "bridge"\noperators = [255, 300]',
        "autopilot.operators[1] = 300: must be a whole number from 1 to 255",
    ),
    (
        'firmware = "bridge"',
        'firmware = "bridge"\noperators = 255',
        "autopilot.operators = 255: must be an array, each a whole number from 1 to 255",
    ),
    (
        "reversed = true",
        "reversed = 1",
        "surfaces.elevator.reversed = 1: must be true or false",
    ),
    (
        "{ channel = 1 }",
        "{ channel = 1.5 }",
        "surfaces.aileron.channel = 1.5: must be a whole number from 1 to 18",
    ),
    (
        "{ channel = 1 }",
        "{ channel = true }",
        "surfaces.aileron.channel = true: must be a whole number from 1 to 18",
    ),
    (
        "{ channel = 1 }",
        "{ channel = 19 }",
        "surfaces.aileron.channel = 19: must be a whole number from 1 to 18",
    ),
    (
        "{ channel = 1 }",
        "1",
        "surfaces.aileron = 1: must be a table with channel, pwm_min, pwm_trim, pwm_max, reversed",
    ),
    (
        "{ channel = 1 }",
        "[1]",
        "surfaces.aileron = an array: must be a table with channel, pwm_min, pwm_trim, pwm_max,"
        " reversed",
    ),
    (
        "{ channel = 1 }",
        "{ channel = 4 }",
        "surfaces: two surfaces share a channel: aileron 4, rudder 4; give each its own",
    ),
    (
        "pwm_trim = 1520",
        "pwm_trim = 900",
        "surfaces.rudder: pwm_min 1000 < pwm_trim 900 < pwm_max 2000 must hold",
    ),
    (
        "pwm_max = 2000",
        "pwm_max = 2300",
        "surfaces.rudder.pwm_max = 2300: must be a whole number from 800 to 2200",
    ),
    (
        "speed_max_mps = 12",
        "speed_max_mps = 7",
        "polar: speed_min_mps = 7.5: must be below speed_max_mps = 7",
    ),
    (
        "RHO_P = 0.5",
        "RHO_Q = 0.5",
        "parameters.RHO_Q = 0.5: no such parameter; `tgl-soar params` lists them",
    ),
    ("RHO_P = 0.5", "RHO_P = 9.0", "parameters.RHO_P = 9: allowed 0 to 5 rad/m"),
    ("RHO_P = 0.5", "RHO_P = nan", "parameters.RHO_P = nan: not finite; allowed 0 to 5 rad/m"),
    ("RHO_P = 0.5", 'RHO_P = "1"', "parameters.RHO_P = 1: not a number; allowed 0 to 5 rad/m"),
    ("RHO_P = 0.5", "RHO_P = true", "parameters.RHO_P = True: not a number; allowed 0 to 5 rad/m"),
    (
        "PITCH_TRIM = -1.5",
        "PITCH_MIN = 20",
        "parameters.PITCH_MIN = 20: PITCH_MIN must be below PITCH_MAX (PITCH_MAX = 12)",
    ),
]

BAD_SITES = [
    (
        "x_m = -0.5, z_m = 1.5",
        "x_m = -0.5",
        "lines.a.z_m: missing; must be a number from -1e+06 to 1e+06",
    ),
    (
        "x_m = -0.5, z_m = 1.5",
        "x_m = -0.5, z_m = 1.5, y_m = 1",
        "lines.a.y_m: unknown key; known here: x_m, z_m, lean_deg",
    ),
    (
        "x_m = 0.25, z_m = 2",
        'x_m = "0.25", z_m = 2',
        'lines.b.x_m = "0.25": must be a number from -1e+06 to 1e+06',
    ),
    (
        "a = { x_m = -0.5, z_m = 1.5 }",
        "a = 3",
        "lines.a = 3: must be a table with x_m, z_m, lean_deg",
    ),
    ("lean_deg = 30", "lean_deg = 90", "lines.b.lean_deg = 90: must be a number from -60 to 60"),
    (
        "wind_from_deg = 270.0",
        "wind_from_deg = 400",
        "site.wind_from_deg = 400: must be a number from -360 to 360",
    ),
    (
        'kind = "jet"',
        'kind = "jett"',
        'air.kind = "jett": must be "jet" or "hill" or "grid" or "polynomial"',
    ),
    ('kind = "jet"\n', "", 'air.kind: missing; must be "jet" or "hill" or "grid" or "polynomial"'),
    ("wind_mps = 8.5", "wind_mps = 50", "air.wind_mps = 50: must be a number from 5 to 15"),
    (
        "slope_deg = 23",
        "slope_deg = 23\nradius_m = 3",
        "air.radius_m: unknown key; known here: kind, wind_mps, slope_deg, turbulence",
    ),
    (
        "slope_deg = 23",
        "slope_deg = 23\nturbulence = { intensity = 5 }",
        "air.turbulence.intensity = 5: must be a number from 0 to 0.5",
    ),
]


@pytest.mark.parametrize(("old", "new", "message"), BAD_AIRFRAMES)
def test_a_bad_airframe_is_reported_key_value_and_what_is_allowed(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    path = written(tmp_path, with_change(AIRFRAME, old, new))
    with pytest.raises(ConfigError) as caught:
        load_airframe(path)
    assert str(caught.value) == f"{path}: {message}"


LONG = "9" * 5000
RANGE = "must be a number from -1e+06 to 1e+06"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"[site]\nname = 'a'\norigin_down_m = {LONG}", f"site.origin_down_m = {{}}: {RANGE}"),
        (f"[site]\nname = 'a'\norigin_down_m = 0x{LONG}", f"site.origin_down_m = {{}}: {RANGE}"),
        (f"site.name = '{LONG}'\n[lines]\na = {{ x_m = -1{'_0' * 5000}, z_m = 1 }}",
         f"lines.a.x_m = {{}}: {RANGE}"),
        (f"site.name = 'a'\nheight_m = {LONG}", "height_m: unknown key"),
    ],
)  # fmt: skip
def test_a_number_of_five_thousand_digits_is_reported_by_file_and_key(
    tmp_path: Path, text: str, message: str
) -> None:
    path = written(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        load_site(path)
    reported = message.format("a number of more than 1000 digits")
    assert str(caught.value).startswith(f"{path}: {reported}")


@pytest.mark.parametrize(("wrong", "shown"), [("3.5", "3.5"), ("-1", "-1"), ("true", "true")])
def test_of_a_body_that_is_neither_name_nor_id_the_error_says_what_it_may_be(
    tmp_path: Path, wrong: str, shown: str
) -> None:
    text = shipped("sites/tunnel_mocap.toml").read_text()
    path = written(tmp_path, re.sub(r"(?m)^body = .*", f"body = {wrong}", text))
    with pytest.raises(ConfigError) as caught:
        load_site(path)
    reported = "must be text in quotes or a whole number from 0 to 2147483647"
    assert str(caught.value) == f"{path}: mocap.body = {shown}: {reported}"


@pytest.mark.parametrize(("old", "new", "message"), BAD_SITES)
def test_a_bad_site_is_reported_key_value_and_what_is_allowed(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    path = written(tmp_path, with_change(SITE, old, new))
    with pytest.raises(ConfigError) as caught:
        load_site(path)
    assert str(caught.value) == f"{path}: {message}"


@pytest.mark.parametrize(
    ("old", "new", "starts"),
    [
        # A line that leans downwind, upright, or towards the horizontal.
        ("lean_deg = 30", "lean_deg = -10", "lines.b.lean_deg = -10: the line must lean upwind by"),
        ("lean_deg = 30", "lean_deg = 60", "lines.b.lean_deg = 60: the line must lean by"),
        ("TGL_LEAN = 20.0", "TGL_LEAN = -10", "parameters.TGL_LEAN = -10: the line must lean"),
        ("TGL_LEAN = 20.0", "TGL_LEAN = 90", "parameters.TGL_LEAN = 90: allowed -60 to 60 deg"),
        ("x_m = -0.5", "x_m = -600", "lines.a.x_m = -600: allowed -500 to 500 m"),
        ("z_m = 1.5", "z_m = 2000", "lines.a.z_m = 2000: allowed -100 to 1000 m"),
        ("RHO_P = 0.75", "RHO_Q = 0.75", "parameters.RHO_Q = 0.75: no such parameter"),
    ],
)
def test_a_site_that_no_line_can_be_flown_at(
    tmp_path: Path, old: str, new: str, starts: str
) -> None:
    a = written(tmp_path, AIRFRAME, "a.toml")
    # The limits are the site's own, so that other defaults change nothing here.
    limits = "TGL_LEAN = 20.0\nTGL_LEAN_MIN = 5.0\nTGL_LEAN_MAX = 45.0"
    text = with_change(SITE, "TGL_LEAN = 20.0", limits) if "LEAN" not in old else SITE
    s = written(tmp_path, with_change(text, old, new), "s.toml")
    airframe, site = load_airframe(a), load_site(s)
    with pytest.raises(ConfigError) as caught:
        load_parameters(airframe, a, site, s)
    assert str(caught.value).startswith(f"{s}: {starts}")


LANDING = """
[landing]
x_m = 600.0
z_m = 0.0
bearing_deg = 270.0
length_m = 40.0
away_x_m = -10.0
"""


@pytest.mark.parametrize(
    ("airframe", "site", "words"),
    [
        ("", LANDING, "site.toml: landing.x_m = 600"),
        ("", LANDING + "[parameters]\nLND_X = 601\n", "site.toml: parameters.LND_X = 601"),
        ("[dynamics]\nshort_period_radps = 9e5\n", "", "dynamics.short_period_radps = 900000"),
        (
            "CL_alpha = 4.6\nCm_alpha = -0.9\nCm_q = -12.0\nCm_elevator = 9e5\n",
            "",
            "airframe.toml: DYN_EFFECT, which follows from [airframe], [model] and [polar]: ",
        ),
    ],
)
def test_a_refused_value_is_named_by_the_key_that_the_file_has(
    airframe: str, site: str, words: str, tmp_path: Path
) -> None:
    place = SITE.partition("[parameters]")[0] if site else SITE
    for name, text in (("airframe", AIRFRAME + airframe), ("site", place + site)):
        (tmp_path / f"{name}.toml").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=re.escape(words)) as refused:
        files.load_flight(tmp_path / "airframe.toml", tmp_path / "site.toml")
    assert "allowed" in str(refused.value)


LATERAL = """
gravity_mps2 = 9.81
air_density_kgpm3 = 1.2
servo_lag_radps = 54.0
servo_delay_s = 0.01
CL_alpha = 4.6
Cm_alpha = -0.9
Cm_q = -12.0
Cm_elevator = 1.0
Cl_p = -0.5
Cl_aileron = 0.2
Cn_beta = 0.1
Cn_r = -0.1
Cn_rudder = 0.1
"""


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("mass_kg = 0.7", "mass_kg = 1e-308", "airframe.mass_kg = 1e-308: must be a number from"),
        ("speed_min_mps = 7.5", "speed_min_mps = 1e-308", "polar.speed_min_mps = 1e-308: must be"),
        ("Cl_aileron = 0.2", "Cl_aileron = 0.2\nCD0 = 0.5\nCD_lift = 5e-324", "a number is too"),
    ],
)
def test_numbers_that_nothing_can_be_computed_from_are_refused(
    old: str, new: str, words: str, tmp_path: Path
) -> None:
    text = AIRFRAME + LATERAL
    load_airframe(written(tmp_path, text, "good.toml"))
    with pytest.raises(ConfigError, match=re.escape(words)):
        load_airframe(written(tmp_path, with_change(text, old, new)))


def test_a_byte_order_mark_is_no_mistake(tmp_path: Path) -> None:
    """As some editors write it."""
    marked = written(tmp_path, "\ufeff" + AIRFRAME)
    assert load_airframe(marked) == load_airframe(written(tmp_path, AIRFRAME, "plain.toml"))
    assert files.site_from("\ufeff" + SITE, "log").site.name == "hall"


def test_an_airframe_is_blamed_for_its_own_parameters(tmp_path: Path) -> None:
    a, s = written(tmp_path, AIRFRAME, "a.toml"), written(tmp_path, SITE, "s.toml")
    airframe = load_airframe(a)
    airframe.parameters["RHO_P"] = 99.0
    with pytest.raises(ConfigError, match=r"a\.toml: parameters\.RHO_P = 99"):
        load_parameters(airframe, a, load_site(s), s)


@pytest.mark.parametrize("file", ["a", "s"])
def test_a_switch_that_moves_a_surface_is_refused_by_its_file(tmp_path: Path, file: str) -> None:
    a, s = written(tmp_path, AIRFRAME, "a.toml"), written(tmp_path, SITE, "s.toml")
    airframe, site = load_airframe(a), load_site(s)
    (airframe if file == "a" else site).parameters["OP_RC_CHAN"] = 4.0
    reported = rf"{file}\.toml: parameters\.OP_RC_CHAN = 4: .* 1 to 18 but none of 1, 2, 4; 0: no"
    with pytest.raises(ConfigError, match=reported):
        load_parameters(airframe, a, site, s)
    (airframe if file == "a" else site).parameters["OP_RC_CHAN"] = 5.0
    assert load_parameters(airframe, a, site, s)["OP_RC_CHAN"] == 5.0


# --- files that are none --------------------------------------------------------------------


def test_a_missing_file_and_a_folder(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.toml: cannot be read: No such file"):
        load_airframe(tmp_path / "nowhere.toml")
    with pytest.raises(ConfigError, match="cannot be read: Is a directory"):
        load_site(tmp_path)


def test_no_utf8(tmp_path: Path) -> None:
    path = tmp_path / "latin.toml"
    path.write_bytes('[site]\nname = "Höhe"\n'.encode("latin-1"))
    with pytest.raises(ConfigError, match=r"latin\.toml: not UTF-8 text"):
        load_site(path)


@pytest.mark.parametrize(
    "text",
    [
        "[site",
        'name = "a"\nname = "b"',
        "x = 1.2.3",
        "x =",
        "x = " + 5000 * "[",
        "a = 1\n[a]\nb = 2",
        f"a = {LONG}a",
        f"a = -{LONG}_",
    ],
)
def test_no_toml(tmp_path: Path, text: str) -> None:
    with pytest.raises(ConfigError, match=r"file\.toml: not TOML: "):
        load_site(written(tmp_path, text))


def test_what_a_file_may_hold_is_worked_out_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For the words of an error; it takes milliseconds."""
    type_info, kinds = inspect.type_info, []

    def counted(kind: type) -> inspect.Type:
        kinds.append(kind)
        return type_info(kind)

    monkeypatch.setattr(inspect, "type_info", counted)
    files._type_info.cache_clear()
    for _ in range(3):
        with pytest.raises(ConfigError, match="unknown key"):
            load_site(written(tmp_path, "site.name = 'a'\nheight_m = 1"))
    assert kinds == [Site]


@pytest.mark.parametrize("text", ["", "# nothing\n"])
def test_an_empty_file_lacks_its_first_table(tmp_path: Path, text: str) -> None:
    with pytest.raises(ConfigError, match=r"airframe: missing; must be a table with name, mass_kg"):
        load_airframe(written(tmp_path, text))
    with pytest.raises(ConfigError, match=r"site: missing; must be a table with name"):
        load_site(written(tmp_path, text))


@pytest.mark.parametrize("text", ["airframe = 1", "surfaces = []", "parameters = 1", "lines = 1"])
def test_no_shape_of_a_file_is_a_traceback(tmp_path: Path, text: str) -> None:
    path = written(tmp_path, text)
    for load in (load_airframe, load_site):
        with pytest.raises(ConfigError, match=r"file\.toml: \w+"):
            load(path)


# --- other files of the same reader ---------------------------------------------------------


class Leg(Strict, frozen=True):
    wind_mps: float
    settings: dict[str, float] = {}  # noqa: RUF012 - msgspec copies it


class Plan(Strict, frozen=True):
    title: str
    legs: list[Leg] = []  # noqa: RUF012 - msgspec copies it
    spans_s: list[tuple[float, float]] = []  # noqa: RUF012 - msgspec copies it
    site: Site | None = None
    airframe: Airframe | None = None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("legs = 3", "legs = 3: must be an array, each a table with wind_mps, settings"),
        (
            'legs = [{ wind_mps = 8 }, { wind_mps = "9" }]',
            'legs[1].wind_mps = "9": must be a number',
        ),
        (
            "legs = [{ wind_mps = 8, settings = { a = 1, b = [] } }]",
            "legs[0].settings.b = an array: must be a number",
        ),
        ("legs = [{}]", "legs[0].wind_mps: missing; must be a number"),
        ("spans_s = [[1, 2], [3, false]]", "spans_s[1][1] = false: must be a number"),
        ("spans_s = [[1]]", "spans_s[0] = an array: must be an array of a number, a number"),
        (
            'site = { site = { name = "s" }, lines = { a = { x_m = 1, z_m = {} } } }',
            "site.lines.a.z_m = a table: must be a number from -1e+06 to 1e+06",
        ),
    ],
)
def test_arrays_and_nested_tables_are_named_too(tmp_path: Path, text: str, message: str) -> None:
    path = written(tmp_path, f'title = "t"\n{text}\n')
    with pytest.raises(ConfigError) as caught:
        load_file(path, Plan)
    assert str(caught.value) == f"{path}: {message}"


# --- motion capture -----------------------------------------------------------------------------


def test_the_shipped_site_with_mocap_is_read() -> None:
    site = load_site(shipped("sites/tunnel_mocap.toml"))
    assert site.mocap is not None
    hall = site.mocap.hall()
    assert not hall.z_up
    assert hall.yaw_rad == pytest.approx(3.14159265)
    plain = load_site(shipped("sites/tunnel.toml"))
    assert (site.lines, site.contour, site.ground) == (plain.lines, plain.contour, plain.ground)
    # Else what the cameras know better would be taken for as coarse as an autopilot's position.
    assert site.parameters == {**plain.parameters, "EST_FIX_SD": site.mocap.noise_m}


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("yaw_deg = 400.0", "mocap.yaw_deg = 400.0: must be a number from -360 to 360"),
        ('up = "x"', 'mocap.up = "x": must be'),
        ("data_port = 0", "mocap.data_port = 0: must be a whole number from 1 to 65535"),
        ("offset_m = [1.0, 2.0]", "mocap.offset_m"),
        ('group = "10.0.0.1"', "mocap: group '10.0.0.1': must be a multicast address"),
        ('interface = "eth0"', "mocap: interface 'eth0': must be an IPv4 address"),
        ('sever = "10.0.0.1"', "mocap.sever: unknown key; known here: server"),
        ("max_age_s = 5.0", "mocap.max_age_s = 5.0: must be a number from 0.01 to 1"),
    ],
)
def test_a_mistake_in_mocap_is_named(tmp_path: Path, line: str, words: str) -> None:
    text = f"""
[site]
name = "hall"
[position]
sources = ["mocap"]
[mocap]
server = "10.0.0.2"
body = 3
{line}
"""
    path = tmp_path / "site.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError) as error:
        load_site(path)
    assert str(error.value).startswith(str(path))
    assert words in str(error.value)


@pytest.mark.parametrize(
    "text",
    [
        '[position]\nsources = ["mocap"]\n',
        '[mocap]\nserver = "10.0.0.2"\nbody = "aircraft"\n',
    ],
)
def test_mocap_is_a_source_where_it_is_described(tmp_path: Path, text: str) -> None:
    path = tmp_path / "site.toml"
    path.write_text(f'[site]\nname = "hall"\n{text}', encoding="utf-8")
    with pytest.raises(ConfigError, match=r"position\.sources names mocap where there is a"):
        load_site(path)


HOME = "home = { latitude_deg = 52.0, longitude_deg = 4.4, altitude_m = 3.0 }"


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ('sources = ["gps"]', 'position.sources[0] = "gps": must be "global_position" or'),
        ("sources = []", "position: sources: name one or more, each once"),
        ('sources = ["odometry", "odometry"]', "position: sources: name one or more, each once"),
        ('sources = ["global_position"]', "needs home = { latitude_deg, longitude_deg"),
        ('sources = ["vision"]', "needs vision_from = [{ system, component }]"),
        ("silence_s = 0.0", "position.silence_s = 0.0: must be a number from 0.02 to 2"),
        ("return_s = -1", "position.return_s = -1: must be a number from 0 to 60"),
        (HOME.replace("52.0", "95.0"), "latitude_deg = 95.0: must be a number from -90 to 90"),
        (HOME.replace("4.4", "400"), "longitude_deg = 400: must be a number from -180 to 180"),
        (HOME.replace(", altitude_m = 3.0", ""), "position.home.altitude_m: missing"),
        ("vision_from = [{ system = 1 }]", "position.vision_from[0].component: missing"),
        (
            "vision_from = [{ system = 0, component = 197 }]",
            "position.vision_from[0].system = 0: must be a whole number from 1 to 255",
        ),
        ("[forward]\nrate_hz = 1", "forward.rate_hz = 1: must be a number from 5 to 100"),
        ('[forward]\nmessage = "mocap"', 'forward.message = "mocap": must be "odometry" or'),
        ("[forward]\nsigma_deg = 0", "forward.sigma_deg = 0: must be a number from 0.01 to 45"),
    ],
)
def test_a_mistake_in_the_position_s_sources_is_named(
    tmp_path: Path, lines: str, words: str
) -> None:
    path = tmp_path / "site.toml"
    path.write_text(f'[site]\nname = "hill"\n[position]\n{lines}\n', encoding="utf-8")
    with pytest.raises(ConfigError) as error:
        load_site(path)
    assert str(error.value).startswith(str(path))
    assert words in str(error.value)


def test_a_hill_with_everything(tmp_path: Path) -> None:
    path = tmp_path / "site.toml"
    path.write_text(
        '[site]\nname = "hill"\n[position]\nsources = ["vision", "global_position"]\n'
        f"vision_from = [{{ system = 1, component = 197 }}]\n{HOME}\n"
        '[forward]\nmessage = "odometry"\nrate_hz = 30\nsigma_m = 0.05\n',
        encoding="utf-8",
    )
    site = load_site(path)
    assert site.position.home is not None
    assert site.forward is not None
    assert (site.position.home.altitude_m, site.forward.rate_hz) == (3.0, 30.0)
