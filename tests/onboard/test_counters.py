"""Every counter begins at zero: its value is read as what has happened."""

from __future__ import annotations

from dataclasses import fields

import pytest

from tgl_soar.link.commands import CommandCounters
from tgl_soar.link.decoder import DecoderCounters
from tgl_soar.link.natnet.diagnostics import OptitrackCounters
from tgl_soar.link.parameter_server import ParameterCounters
from tgl_soar.link.signing import SigningCounters
from tgl_soar.link.transports.base import LinkCounters
from tgl_soar.link.vehicle.diagnostics import SessionCounters
from tgl_soar.onboard.counters import Counters
from tgl_soar.onboard.pacing import TickCounters

KINDS = (
    *(CommandCounters, DecoderCounters, OptitrackCounters, ParameterCounters, SigningCounters),
    *(LinkCounters, SessionCounters, Counters, TickCounters),
)


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_has_happened_at_first(kind: type) -> None:
    counters = kind()
    assert [each.name for each in fields(kind) if getattr(counters, each.name)] == []


def test_changes_of_mode_are_counted_by_the_new_mode() -> None:
    counters = Counters()
    for mode in (3, 4, 3):
        counters.count_mode(mode)
    assert counters.mode_changes == {3: 2, 4: 1}
