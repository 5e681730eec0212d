"""How many bytes a second a flight puts on its line to the autopilot, and what rate carries them.

A serial line sends ten bits for a byte.  Frames of several streams come when they come: of a line
that is in use for a part u of the time, a frame waits u / (2 (1 - u)) times its own duration on
average (a queue with one server and constant service, Pollaczek and Khinchine): twice at u = 0.8,
and without end at 1.  Beyond `USED_MAX` nothing is on time any more.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from tgl_soar.link.encoder import Encoder
from tgl_soar.link.frames import SHORTEST_V2, SIGNATURE
from tgl_soar.link.messages import (
    ID_ATTITUDE_QUATERNION,
    ID_HEARTBEAT,
    ID_ODOMETRY,
    ID_VISION_POSITION_ESTIMATE,
)
from tgl_soar.link.transports.serial_line import BITS_PER_BYTE
from tgl_soar.onboard.module import Onboard
from tgl_soar.onboard.setup import ModuleSetup
from tgl_soar.types import Setpoints, SurfaceCommand

USED_MAX: Final = 0.8  # of what the line carries
RATES_BAUD: Final = (57_600, 115_200, 230_400, 460_800, 921_600, 1_500_000, 3_000_000)
# MAVLink 2 cuts off the zeros at the end of a payload.  Only repr_offset_q is sure to be zero here;
# RAW_IMU and SCALED_IMU end with the temperature, which ArduPlane fills in.
_PAYLOAD_BYTES: Final = {ID_ATTITUDE_QUATERNION: 32}
_FORWARDED: Final = {
    "vision_position_estimate": ID_VISION_POSITION_ESTIMATE,
    "odometry": ID_ODOMETRY,
}


class LineLoad(NamedTuple):
    """Bytes a second."""

    to_companion: float
    to_autopilot: float

    def is_carried_by(self, baud: int) -> bool:
        """Whether a serial line of this rate carries it, and on time."""
        return max(self) <= USED_MAX * baud / BITS_PER_BYTE

    def refusal(self, baud: int) -> str:
        """Why a rate is too low, and the way out; "" if it is not."""
        if self.is_carried_by(baud):
            return ""
        enough = next((rate for rate in RATES_BAUD if self.is_carried_by(rate)), None)
        way = "lower LOOP_RATE" if enough is None else f"take {enough} baud on both sides"
        return (
            f"the line is too slow: {baud} baud carries {baud / BITS_PER_BYTE:.0f} bytes a second"
            f" each way and {USED_MAX * baud / BITS_PER_BYTE:.0f} on time; this flight needs"
            f" {self.to_companion:.0f} from the autopilot and {self.to_autopilot:.0f} to it: {way}"
        )


def load_of(setup: ModuleSetup, *, signed: bool = False) -> LineLoad:
    """What is asked for and what is sent with these settings, at the rates that are wanted.

    `signed`: frames both ways carry signatures.
    """
    more = SHORTEST_V2 + (SIGNATURE if signed else 0)
    onboard = Onboard(setup, lambda _: True, 0.0)
    wanted = onboard.session.streams.all_wanted()
    to_companion = sum(s.rate_hz * (_payload_bytes(s.message_id) + more) for s in wanted)

    values = setup.parameters
    moved, asked = SurfaceCommand(0.1, 0.1, 0.1), Setpoints(0.1, 0.1, 0.1)
    encoder = Encoder(setup.override)
    commands = setup.flavour.commands(moved, asked)
    signatures = SIGNATURE * len(commands) if signed else 0
    a_tick = sum(len(encoder.encode(message)) for message in commands) + signatures
    to_autopilot = values["LOOP_RATE"] * a_tick + values["TEL_BUDGET"]
    to_autopilot += _payload_bytes(ID_HEARTBEAT) + more
    if setup.forward is not None:
        pose = _payload_bytes(_FORWARDED[setup.forward.message]) + more
        to_autopilot += setup.forward.rate_hz * pose
    return LineLoad(to_companion, to_autopilot)


def _payload_bytes(message_id: int) -> int:
    """At most."""
    whole: int = dialect.mavlink_map[message_id].unpacker.size
    return _PAYLOAD_BYTES.get(message_id, whole)
