"""Results of flights as bytes and back, every bit of every number the same, and digests.

MessagePack by the types of named tuples and data classes; arrays as their bytes.  No pickle: a
file of flights is data, and opening one that somebody else has written runs nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, Final, get_origin, get_type_hints

import msgspec
import numpy as np

from tgl_soar.config.parameters import PARAMETERS, ParameterSet


def result_type(fly: Callable[..., Any]) -> Any:
    """What a flight gives, by its annotation.  Errors: TypeError without one."""
    try:
        return get_type_hints(fly)["return"]
    except (KeyError, NameError, AttributeError):
        raise TypeError(f"{fly!r}: a flight that is kept says what it returns") from None


def encode(value: Any) -> bytes:
    """Errors: TypeError for what has no such form."""
    return _ENCODER.encode(value)


@cache
def decoder(kind: Any) -> msgspec.msgpack.Decoder[Any]:
    """For values of a type.  Errors: TypeError for a type that has no such form."""
    return msgspec.msgpack.Decoder(kind, dec_hook=_from_plain)


def digest(value: Any) -> str:
    """Of jobs and parameters: equal values have equal ones, in any process."""
    return sha256(_ORDERED.encode(value)).hexdigest()


def _to_plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, ParameterSet):
        return {p.name: value[p.name] for p in PARAMETERS}
    raise TypeError(f"{type(value).__name__} {value!r} is not written to a file of flights")


def _from_plain(kind: Any, value: Any) -> Any:
    if (get_origin(kind) or kind) is np.ndarray:
        dtype, shape, data = value
        return np.frombuffer(data, np.dtype(dtype)).reshape(shape).copy()
    if kind is Path:
        return Path(value)
    raise TypeError(f"{kind} is not read from a file of flights")


_ENCODER: Final = msgspec.msgpack.Encoder(enc_hook=_to_plain)
_ORDERED: Final = msgspec.msgpack.Encoder(enc_hook=_to_plain, order="deterministic")
