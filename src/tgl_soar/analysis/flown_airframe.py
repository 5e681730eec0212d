"""The aircraft that is flown, where its figures are not those of its file."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from tgl_soar.config.airframe import Airframe


def flown_airframe(airframe: Airframe, figures: Iterable[tuple[str, float]]) -> Airframe:
    """The aircraft with other figures than its file.  Errors: ValueError for an unknown one."""
    for name, value in figures:
        section, _, key = name.partition(".")
        if section == "model" and key in airframe.model:
            airframe = msgspec.structs.replace(airframe, model={**airframe.model, key: value})
        elif section == "airframe" and hasattr(airframe.airframe, key):
            bench = msgspec.structs.replace(airframe.airframe, **{key: value})
            airframe = msgspec.structs.replace(airframe, airframe=bench)
        else:
            raise ValueError(f"{name}: no figure of [airframe] or [model] of this airframe")
    return airframe
