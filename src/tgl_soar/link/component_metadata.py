"""What a station may read about this component: its parameters' units, ranges and meanings.

    /general.json         names the other file, as MAVLink's component metadata has it
    /parameters.json.xz   the declarations of `config.parameters`

A station asks for COMPONENT_METADATA, which names the first file, and reads both over MAVLink FTP
(`file_transfer`).  The number in `fileCrc` changes with a file, so that a station which has it
already does not read it again.

https://mavlink.io/en/services/component_metadata.html
"""

from __future__ import annotations

import json
import lzma
from functools import cache
from typing import Any, Final
from zlib import crc32

from tgl_soar.config.parameters import PARAMETERS, Parameter

GENERAL: Final = "/general.json"
PARAMETER_FILE: Final = "/parameters.json.xz"
_URI: Final = "mftp://"  # to the component that was asked
_TYPE_PARAMETER: Final = 1  # COMP_METADATA_TYPE
_GENERAL_VERSION: Final = 1
_PARAMETER_VERSION: Final = 1  # QGroundControl refuses any other
_ALL_BITS: Final = 0xFFFFFFFF
# A dictionary no larger than the text: packing needs less than a megabyte.
_PACKING: Final = [{"id": lzma.FILTER_LZMA2, "preset": 6, "dict_size": 1 << 16}]


@cache
def metadata_files() -> dict[str, bytes]:
    """Every file by its path.  They are made once, before anything flies."""
    described = {
        "version": _PARAMETER_VERSION,
        "parameters": [_described(parameter) for parameter in PARAMETERS],
    }
    packed = lzma.compress(_text(described), format=lzma.FORMAT_XZ, filters=_PACKING)
    general = {
        "version": _GENERAL_VERSION,
        "vendorName": "tgl_soar",
        "modelName": "target gradient line",
        "metadataTypes": [
            {
                "type": _TYPE_PARAMETER,
                "uri": _URI + PARAMETER_FILE,
                "fileCrc": checksum_of(packed),
            }
        ],
    }
    return {GENERAL: _text(general), PARAMETER_FILE: packed}


def general_uri() -> str:
    """Of the file that names the others."""
    return _URI + GENERAL


@cache
def general_checksum() -> int:
    """Of that file."""
    return checksum_of(metadata_files()[GENERAL])


def checksum_of(data: bytes) -> int:
    """CRC-32 as PX4 and QGroundControl count it: from 0, and not inverted at its end."""
    return crc32(data, _ALL_BITS) ^ _ALL_BITS


def _described(parameter: Parameter) -> dict[str, Any]:
    """One parameter, by the keys of MAVLink's schema; all are served as 32-bit floats."""
    meaning = parameter.meaning
    if not parameter.in_flight:
        meaning += " Not to be changed while flying."
    described: dict[str, Any] = {
        "name": parameter.name,
        "type": "Float",
        "shortDesc": _first_sentence(parameter.meaning),
        "longDesc": meaning,
        "group": parameter.name.partition("_")[0],
        "min": float(parameter.minimum),
        "max": float(parameter.maximum),
        "default": float(parameter.default),
    }
    if parameter.unit:
        described["units"] = parameter.unit
    if parameter.integer:
        described |= {"decimalPlaces": 0, "increment": 1}
    if not parameter.in_files:
        described["volatile"] = True
    return described


def _first_sentence(text: str) -> str:
    return text.partition(". ")[0].rstrip(".")


def _text(value: dict[str, Any]) -> bytes:
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False).encode()
