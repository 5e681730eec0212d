"""A tick gone through once more, for nothing: the next one finds what it needs at hand.

It is the last one with a new position, which has the most to do.  A tick of the laws is a function
of its arguments; what it returns is thrown away.  `pacing.Pacer` says when.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from tgl_soar import autopilot
from tgl_soar.control.laws import Laws
from tgl_soar.link.autopilots.base import Flavour
from tgl_soar.link.decoder import Decoder
from tgl_soar.link.encoder import Encoder
from tgl_soar.link.messages import Source
from tgl_soar.onboard.outbox import frame_of
from tgl_soar.onboard.surface_control import is_finite_command
from tgl_soar.types import Inputs

PIECE_BYTES: Final = 512  # more than a tick usually receives is not gone through


class WarmUp(NamedTuple):
    """What a tick had, to go through it once more."""

    state: autopilot.AutopilotState
    inputs: Inputs
    piece: bytes  # what came before it


class WarmUps:
    """Remembers a tick, and goes through it with a decoder and an encoder that nobody else has."""

    def __init__(self, flavour: Flavour, override: Source) -> None:
        self.kept: WarmUp | None = None
        self._flavour = flavour
        self._loops = flavour.route.loops
        self._piece = b""  # that came last over the first link
        self._decoder = Decoder(stream=False)
        self._encoder = Encoder(override)

    def received(self, data: bytes) -> None:
        """Bytes have come over the first link."""
        self._piece = data if len(data) <= PIECE_BYTES else b""

    def keep(self, state: autopilot.AutopilotState, inputs: Inputs) -> None:
        """A tick begins from this."""
        kept = self.kept
        if kept is None or inputs.position.sequence != kept.inputs.position.sequence:
            self.kept = WarmUp(state, inputs, self._piece)

    def run(self, laws: Laws) -> None:
        """Go through it."""
        if self.kept is None:
            return
        state, inputs, piece = self.kept
        self._decoder.feed(piece)
        _, output = autopilot.step(laws, state, inputs)
        if output.active and is_finite_command(output, self._loops):
            for message in self._flavour.commands(output.command, output.setpoints):
                frame_of(message, self._encoder)
