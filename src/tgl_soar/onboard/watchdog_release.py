"""What the watchdog does instead of a flying process that has died: it releases the surfaces.

It opens the link to the autopilot once more, says what was not said, and leaves the mode that the
module had entered.
"""

from __future__ import annotations

import time
from typing import Final

from tgl_soar.link.messages import COMPONENT_AUTOPILOT, SEVERITY_CRITICAL, Heartbeat, Source
from tgl_soar.link.mode_change import ModeChange
from tgl_soar.link.open_link import open_link
from tgl_soar.link.presence import Presence
from tgl_soar.link.routing import Route
from tgl_soar.link.signing import TICKS_PER_S, Signing
from tgl_soar.link.signing_keys import peers_of
from tgl_soar.link.telemetry import StatusTexts
from tgl_soar.link.transports.base import LinkError, Transport
from tgl_soar.link.transports.udp import UdpListener
from tgl_soar.onboard import realtime
from tgl_soar.onboard.command_line import RunOptions
from tgl_soar.onboard.console import say
from tgl_soar.onboard.setup import ModuleSetup
from tgl_soar.onboard.surface_control import RELEASE_FRAMES, outlast_cut_frame
from tgl_soar.onboard.watchdog import Sign

GIVE_BACK_INTERVAL_S: Final = 0.02  # between frames that release the surfaces for a dead process


def open_for(setup: ModuleSetup, options: RunOptions, link: str, signing: Signing) -> Transport:
    """A link of a flight.  Errors: `LinkError`."""
    autopilot = Source(setup.own.system, COMPONENT_AUTOPILOT)
    is_first = link == options.links[0]
    trusted = autopilot if is_first and options.secret.unsigned_autopilot else None
    return open_link(link, peers_of(signing, trusted), realtime.clock_s())


def hand_over(setup: ModuleSetup, options: RunOptions, sign: Sign, became: str) -> None:
    """Hand the surfaces over for a process that is dead, and whose links are closed.

    `sign`: what it showed last; `became`: what happened to it.
    """
    try:
        # The key as the dead process had it: its file may be gone.  Beyond what it may have signed
        # since it showed itself, and within its block of stamps: its successor begins behind that.
        signing = Signing(sign.key, time.time(), realtime.clock_s())
        if sign.timestamp:
            signing.timestamp = sign.timestamp + TICKS_PER_S
        transport = open_for(setup, options, options.links[0], signing)
    except LinkError as error:
        say(f"the watchdog cannot release the surfaces: {error}")
        return
    if isinstance(transport, UdpListener) and sign.host:
        transport.peer = (sign.host, sign.port)
    unsigned = options.secret.unsigned_autopilot
    excused = Source(setup.own.system, COMPONENT_AUTOPILOT) if unsigned else None
    route = Route(
        0,
        setup.own,
        setup.override,
        transport.send,
        signing,
        stream=transport.is_stream,
        excused=excused,
    )
    route.own.version1 = route.override.version1 = sign.version1

    def release() -> int:
        """Once; each frame is packed again, for signed ones are accepted only once."""
        frames = [route.override.encode(message) for message in setup.flavour.release()]
        for frame in frames:
            transport.send(frame)
        return sum(map(len, frames))

    words = StatusTexts().chunks(SEVERITY_CRITICAL, f"surfaces released: module {became}")
    try:
        transport.clear_for_release()
        if transport.is_stream:  # where the dead process was writing, its last frame was cut
            outlast_cut_frame(release)
        for _ in range(RELEASE_FRAMES):
            release()
            time.sleep(GIVE_BACK_INTERVAL_S)
        for chunk in words:
            transport.send(route.own.encode(chunk))
        _leave_mode(setup, route, transport)
        transport.receive(realtime.clock_s())  # a serial line writes what is left
    finally:
        transport.close()


def _leave_mode(setup: ModuleSetup, route: Route, transport: Transport) -> None:
    """Out of the mode that the dead process has entered, unless the pilot has chosen another."""
    flavour = setup.flavour
    autopilot = Source(setup.own.system, COMPONENT_AUTOPILOT)
    change = ModeChange(flavour)
    change.leave(realtime.clock_s(), float("-inf"))
    if change.is_changing:  # this socket may be new: a peer answers only senders that it knows
        transport.send(route.own.encode(Presence(0).heartbeat()))
    received_s, obeys, custom_mode = float("-inf"), False, -1
    while change.is_changing:
        now_s = realtime.clock_s()
        for data in transport.receive(now_s):
            for source, message in route.decoder.feed(data):
                if source == autopilot and isinstance(message, Heartbeat):
                    received_s, custom_mode = now_s, message.custom_mode
                    obeys = not flavour.mismatch(message) and flavour.obeys(message)
        for asked in change.poll(now_s, received_s, obeys, custom_mode):
            transport.send(route.own.encode(asked))
        time.sleep(GIVE_BACK_INTERVAL_S)
    if change.failed:
        for chunk in StatusTexts().chunks(SEVERITY_CRITICAL, change.failed):
            transport.send(route.own.encode(chunk))
