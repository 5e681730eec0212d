"""`tgl-soar site wind`, and a site that names what it has written."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from tgl_soar.air.wind_record import RecordedField, read_wind_record
from tgl_soar.cli.site import site_app
from tgl_soar.config.files import ConfigError, load_site, shipped
from tgl_soar.sim.world import build_field

HILL = shipped("sites/hill.toml").read_text(encoding="utf-8")


def named(folder: Path, record: str) -> Path:
    site = folder / "site.toml"
    site.write_text(HILL.replace("radius_m = 8.0", f'radius_m = 8.0\nrecord = "{record}"'))
    return site


def test_what_it_writes_is_flown_in(tmp_path: Path) -> None:
    file = tmp_path / "wind.csv"
    options = ["wind", str(file), "--hours", "0.1", "--mean", "7", "--seed", "3"]
    result = CliRunner().invoke(site_app, options)
    assert result.exit_code == 0
    assert "0.1 h" in result.output
    site = load_site(named(tmp_path, "wind.csv"))
    assert site.air is not None
    field = build_field(site.air, tmp_path)
    assert isinstance(field, RecordedField)
    assert field.record.wind_mps.values == read_wind_record(file).wind_mps.values
    assert field.reference_wind_mps == 7.0


def test_a_record_that_is_missing_is_named_with_its_key(tmp_path: Path) -> None:
    site = load_site(named(tmp_path, "nowhere.csv"))
    assert site.air is not None
    with pytest.raises(ConfigError, match=r"air\.record: .*nowhere\.csv"):
        build_field(site.air, tmp_path)


def test_a_folder_that_is_not_there_is_reported(tmp_path: Path) -> None:
    result = CliRunner().invoke(site_app, ["wind", str(tmp_path / "no" / "wind.csv")])
    assert result.exit_code != 0
    assert "cannot be written" in result.output
