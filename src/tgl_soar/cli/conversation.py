"""A command's talk with the autopilot on the ground, and the options that it begins with."""

from __future__ import annotations

import select
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Final, Self

import typer

from tgl_soar.config.airframe import Airframe
from tgl_soar.link.autopilots.base import Flavour
from tgl_soar.link.messages import (
    AUTOPILOT_INVALID,
    COMPONENT_AUTOPILOT,
    STATE_ACTIVE,
    TYPE_ONBOARD_CONTROLLER,
    Heartbeat,
    Outbound,
    Source,
)
from tgl_soar.link.open_link import open_link
from tgl_soar.link.routing import Route
from tgl_soar.link.session import HEARTBEAT_S
from tgl_soar.link.signing_keys import Secret, peers_of, signing_from
from tgl_soar.onboard.setup import commanding_source

LOOK_S: Final = 0.02

LinkOption = Annotated[
    str, typer.Option("--link", help="Link to the autopilot, as for `tgl-soar run`.")
]
TimeoutOption = Annotated[
    float, typer.Option("--timeout", help="Seconds to wait for the autopilot.", min=1.0, max=600.0)
]
KeyOption = Annotated[
    Path | None, typer.Option("--signing-key", help="Sign with the key of a file.")
]


class Conversation:
    """With the autopilot of an airframe file, over one link; the link is closed behind `with`."""

    def __init__(
        self, link: str, airframe: Airframe, flavour: Flavour, signing_key: Path | None
    ) -> None:
        """Open the link.  Errors: `LinkError`, `SigningError`."""
        own = Source(airframe.autopilot.system_id, airframe.autopilot.component_id)
        self.autopilot = Source(own.system, COMPONENT_AUTOPILOT)
        signing = signing_from(Secret(signing_key), time.monotonic())
        self._transport = open_link(link, peers_of(signing, None), time.monotonic())
        self._route = Route(
            0,
            own,
            commanding_source(airframe, flavour),
            self._transport.send,
            signing,
            stream=self._transport.is_stream,
        )
        self._beat_s = float("-inf")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self._transport.close()

    def turn(self, every_second: Sequence[Outbound] = ()) -> list[object]:
        """Wait a moment; what the autopilot has said.

        Each second a heartbeat goes out, and `every_second` with it.
        """
        route = self._route
        fd = self._transport.fileno()
        select.select([fd] if fd >= 0 else [], [], [], LOOK_S)
        now_s = time.monotonic()
        inbound: list[object] = []
        for data in self._transport.receive(now_s):
            messages = route.decoder.feed(data)
            if messages:
                self._transport.hold(now_s)
            for received in messages:
                route.match_version()
                if received.source == self.autopilot:
                    inbound.append(received.message)
        if now_s - self._beat_s >= HEARTBEAT_S:
            self._beat_s = now_s
            self.say(
                Heartbeat(
                    type=TYPE_ONBOARD_CONTROLLER,
                    autopilot=AUTOPILOT_INVALID,
                    base_mode=0,
                    custom_mode=0,
                    system_status=STATE_ACTIVE,
                )
            )
            for message in every_second:
                self.say(message)
        return inbound

    def say(self, message: Outbound) -> None:
        """Send a message as the module."""
        self._route.send(self._route.own.encode(message))

    def command(self, message: Outbound) -> None:
        """Send a message as whom the autopilot lets move the surfaces."""
        self._route.send(self._route.override.encode(message))
