"""A MAVSDK client as a process: `mavsdk_client.py PORT SEED`, a report as JSON on its output.

It reads every parameter of component 191, then sets and gets a few, repeating what failed, as a
program written with MAVSDK would.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

from mavsdk.component_type import ComponentType
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.param import Param, ParamError

COMPONENT = 191
TRIES = 12


def patiently(what: Callable[[], Any]) -> Any:
    """The result, at one of several tries; a time-out is no result."""
    for attempt in range(TRIES):
        try:
            return what()
        except ParamError:
            if attempt == TRIES - 1:
                raise
            time.sleep(0.1)
    return None


def main(port: str, sets: str) -> None:
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    mavsdk.add_any_connection(f"udpout://127.0.0.1:{port}")
    system = mavsdk.first_autopilot(20.0)
    assert system is not None, "no autopilot"
    param = Param(system)
    with suppress(ParamError):  # so it says, and yet it takes effect
        param.select_component(COMPONENT, 0)

    def everything() -> dict[str, float]:
        found = {p.name: p.value for p in param.get_all_params().float_params}
        if len(found) < 40:
            raise ParamError(None, "get_all_params()")
        return found

    report: dict[str, Any] = {"all": patiently(everything), "set": {}}
    for name, value in json.loads(sets).items():
        patiently(partial(param.set_param_float, name, value))
        report["set"][name] = patiently(partial(param.get_param_float, name))
    try:
        param.set_param_float("TGL_LEAN", 80.0)
        report["refused"] = False
    except ParamError as error:
        report["refused"] = str(error)
    report["lean"] = patiently(partial(param.get_param_float, "TGL_LEAN"))
    report["integers"] = len(param.get_all_params().int_params)
    print(json.dumps(report), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
