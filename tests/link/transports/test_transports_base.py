"""What may pass by itself is told from a mistake, and a link's counters begin at zero."""

from __future__ import annotations

import errno
import socket

import pytest

from tgl_soar.link.transports.base import (
    LinkCounters,
    LinkError,
    LinkNotReadyError,
    not_opened,
    passes,
)


@pytest.mark.parametrize(
    "number",
    [
        errno.EADDRINUSE,  # another program ends
        errno.EADDRNOTAVAIL,  # an interface comes up
        errno.ENODEV,
        errno.ENETDOWN,
        errno.ENETUNREACH,
        errno.EHOSTUNREACH,
        socket.EAI_AGAIN,  # the name server can be asked again
    ],
)
def test_what_another_program_or_a_network_mends_may_pass(number: int) -> None:
    error = OSError(number, "words")
    assert passes(error)
    made = not_opened(error, "link 'x': why")
    assert type(made) is LinkNotReadyError
    assert str(made) == "link 'x': why"


@pytest.mark.parametrize("number", [errno.EACCES, errno.EINVAL, errno.EPERM, socket.EAI_NONAME])
def test_a_mistake_does_not_pass(number: int) -> None:
    error = OSError(number, "words")
    assert not passes(error)
    assert type(not_opened(error, "words")) is LinkError


def test_an_error_without_a_number_does_not_pass() -> None:
    assert not passes(ValueError("words"))


@pytest.mark.parametrize(
    "name", ["bytes_in", "bytes_out", "dropped_out", "left_out", "strangers", "reconnects"]
)
def test_nothing_is_counted_before_anything_was_carried(name: str) -> None:
    assert getattr(LinkCounters(), name) == 0
