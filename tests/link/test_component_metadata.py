"""Component metadata: the files follow MAVLink's schemas, and say what the declarations say."""

from __future__ import annotations

import json
import lzma
import re
from typing import Any

import pytest

from tgl_soar.config.parameters import PARAMETERS
from tgl_soar.link.component_metadata import (
    GENERAL,
    PARAMETER_FILE,
    checksum_of,
    general_checksum,
    general_uri,
    metadata_files,
)

# Of parameter.schema.json and general.schema.json of mavlink/mavlink, component_metadata: the keys
# that there may be, with their types; no others are allowed.
OF_A_PARAMETER: dict[str, type | tuple[type, ...]] = {
    "name": str, "type": str, "shortDesc": str, "longDesc": str, "units": str,
    "default": (int, float), "decimalPlaces": int, "min": (int, float), "max": (int, float),
    "increment": (int, float), "rebootRequired": bool, "group": str, "category": str,
    "volatile": bool, "values": list, "bitmask": list, "readOnly": bool,
}  # fmt: skip
OF_A_TYPE = {
    "type", "uri", "fileCrc", "uriFallback", "fileCrcFallback", "translationUri",
    "translationUriFallback",
}  # fmt: skip
OF_GENERAL = {
    "version", "vendorName", "modelName", "firmwareVersion", "hardwareVersion", "metadataTypes",
}  # fmt: skip


@pytest.fixture(scope="module")
def described() -> dict[str, Any]:
    read = json.loads(lzma.decompress(metadata_files()[PARAMETER_FILE]))
    assert isinstance(read, dict)
    return read


def test_the_general_file_follows_its_schema_and_leads_to_the_other() -> None:
    general = json.loads(metadata_files()[GENERAL])
    assert set(general) <= OF_GENERAL
    assert general["version"] >= 1
    (kind,) = general["metadataTypes"]
    assert set(kind) <= OF_A_TYPE
    assert kind["type"] == 1  # COMP_METADATA_TYPE_PARAMETER
    assert kind["uri"] == f"mftp://{PARAMETER_FILE}"
    assert kind["fileCrc"] == checksum_of(metadata_files()[PARAMETER_FILE])
    assert general_uri() == f"mftp://{GENERAL}"
    assert len(general_uri()) < 100  # and a zero behind it
    assert general_checksum() == checksum_of(metadata_files()[GENERAL])


def test_the_parameters_follow_their_schema(described: dict[str, Any]) -> None:
    assert set(described) == {"version", "parameters"}
    assert described["version"] == 1
    for row in described["parameters"]:
        assert set(row) <= set(OF_A_PARAMETER)
        assert all(isinstance(value, OF_A_PARAMETER[key]) for key, value in row.items()), row
        assert re.fullmatch(r"[.\-a-zA-Z0-9_{}]{1,16}", row["name"])
        assert row["type"] == "Float"  # as they are served


def test_they_are_the_declared_ones(described: dict[str, Any]) -> None:
    rows = described["parameters"]
    assert [row["name"] for row in rows] == [p.name for p in PARAMETERS]
    for row, p in zip(rows, PARAMETERS, strict=True):
        assert (row["min"], row["max"], row["default"]) == (p.minimum, p.maximum, p.default)
        assert row.get("units", "") == p.unit
        assert row["longDesc"].startswith(p.meaning)
        assert p.meaning.startswith(row["shortDesc"])
        assert ("Not to be changed while flying" in row["longDesc"]) != p.in_flight
        assert (row.get("decimalPlaces") == 0) == p.integer


def test_checksums_are_counted_as_px4_counts_them() -> None:
    """From 0 and without a last inversion, where the usual CRC-32 of "123456789" is cbf43926."""
    assert checksum_of(b"123456789") == 0x2DFD2D88
    assert checksum_of(b"") == 0


def test_a_slow_radio_carries_them_in_seconds() -> None:
    """At half of TEL_BUDGET's default of 2400 B/s, in pieces of 239 bytes with 24 around them."""
    size = sum(len(data) for data in metadata_files().values())
    assert size * (239 + 24) / 239 / 1200 < 10.0
