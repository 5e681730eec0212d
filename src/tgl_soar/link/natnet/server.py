"""The conversation with a NatNet server: who it is, and what its bodies are called.

Requests are sent to its command port: a connect request until a server answers, and again
whenever the stream is silent; the definitions of what is tracked; a keep-alive, without which a
unicast server stops; and echoes, which measure its clock (`clock`).
"""

from __future__ import annotations

from typing import Final, NamedTuple

from tgl_soar.link.messages import SEVERITY_INFO, SEVERITY_WARNING
from tgl_soar.link.natnet import layout
from tgl_soar.link.natnet.diagnostics import OptitrackLedger
from tgl_soar.link.natnet.layout import ServerInfo
from tgl_soar.link.natnet.settings import OptitrackSettings
from tgl_soar.types import NEVER_S

CONNECT_S: Final = 1.0
MODELS_S: Final = 0.5
KEEP_ALIVE_S: Final = 1.0
ECHO_S: Final = 1.0
FIRST_ECHOES: Final = 10  # so many in quick succession, to know the clock before flight
FIRST_ECHO_S: Final = 0.05

Address = tuple[str, int]


class MulticastStream(NamedTuple):
    """Where a multicast server says that it streams."""

    group: str
    port: int


class NatNetServer:
    """Which requests are due, and what their answers say."""

    def __init__(
        self, settings: OptitrackSettings, ledger: OptitrackLedger, *, lockstep: bool
    ) -> None:
        self.info: ServerInfo | None = None
        self.version = layout.NEWEST  # of NatNet, as it is read
        self.address = settings.server  # "": not known yet
        self.stream: MulticastStream | None = None
        self.models: dict[str, int] = {}  # streaming ids by name
        self.body_id: int | None = settings.body if isinstance(settings.body, int) else None
        self._settings = settings
        self._counters, self._notices = ledger
        self._lockstep = lockstep
        self._refresh = False  # request the definitions again, and use the old ones meanwhile
        self._models_requests = 0
        self._echoes = 0
        self.rebase()

    def rebase(self) -> None:
        """The loop's clock is another one from here on."""
        self._connect_due_s = self._models_due_s = NEVER_S
        self._keep_alive_due_s = self._echo_due_s = NEVER_S

    @property
    def is_ready(self) -> bool:
        """Whether frames can be used: the server is known, and which body is ours."""
        return self.info is not None and self.body_id is not None

    def poll(self, now_s: float, *, silent: bool) -> list[bytes]:
        """The requests that are due.  `silent`: no frames come."""
        requests: list[bytes] = []
        if (self.info is None or silent) and now_s >= self._connect_due_s:
            self._connect_due_s = now_s + CONNECT_S
            requests.append(layout.connect_request())
        if self.info is None:
            return requests
        if (self.body_id is None or self._refresh) and now_s >= self._models_due_s:
            self._models_due_s = now_s + MODELS_S
            requests.append(layout.models_request(masked=self._models_requests % 2 == 1))
            self._models_requests += 1
        if self._settings.unicast and now_s >= self._keep_alive_due_s:
            self._keep_alive_due_s = now_s + KEEP_ALIVE_S
            requests.append(layout.keep_alive())
        if not self._lockstep and now_s >= self._echo_due_s:
            self._echo_due_s = now_s + (FIRST_ECHO_S if self._echoes < FIRST_ECHOES else ECHO_S)
            self._echoes += 1
            requests.append(layout.echo_request(max(1, round(now_s * 1e9))))
        return requests

    def is_new(self, info: ServerInfo, sender: Address) -> bool:
        """Whether an answer is of a server that can be read and is not the known one."""
        if not layout.OLDEST <= info.version < (layout.NEWEST[0] + 1, 0):
            self._counters.wrong_version += 1
            known = f"{_number(layout.OLDEST)} to {_number(layout.NEWEST)}"
            text = f"{_description(info, sender)}: {known} can be read"
            self._notices.report("version", SEVERITY_WARNING, text)
            return False
        if info == self.info:
            self.refresh_models()  # it was silent: ids may have changed
            return False
        return True

    def accept(self, info: ServerInfo, sender: Address) -> None:
        """Talk with this server from now on."""
        self.info, self.version, self.address = info, info.version, sender[0]
        self._find_body()
        text = f"{_description(info, sender)}, clock {info.clock_hz} Hz"
        if info.version > layout.NEWEST:
            text += f", read as {_number(layout.NEWEST)}"
        self._notices.add(SEVERITY_INFO, text)
        if info.is_multicast:
            self.stream = MulticastStream(info.group, info.data_port)
        if info.is_multicast == self._settings.unicast:
            theirs = "multicast" if info.is_multicast else "unicast"
            text = f"it streams {theirs}, mocap.stream does not"
            self._notices.report("mode", SEVERITY_WARNING, text)

    def on_models(self, models: dict[str, int]) -> None:
        """The definitions of what is tracked."""
        self.models = models
        self._refresh = False
        self._find_body()

    def _find_body(self) -> None:
        """The streaming id of our body: as the site file gives it, or by its name."""
        body = self._settings.body
        if isinstance(body, int):
            self.body_id = body
            return
        found = self.models.get(body)
        if found is None and self.models:
            names = ", ".join(sorted(self.models))[:120]
            text = f"no rigid body {body!r}; there are {names}"
            self._notices.report("body", SEVERITY_WARNING, text)
        self.body_id = found

    def discard_models(self) -> None:
        """Ids have changed: nothing is used until the server has sent them again."""
        if not isinstance(self._settings.body, int):
            self.body_id = None
            self.models = {}
            self._models_due_s = NEVER_S

    def refresh_models(self) -> None:
        """The body's id may have changed."""
        self._refresh = not isinstance(self._settings.body, int)

    def reconnect(self) -> None:
        """Ask at once who is there."""
        self.info = None
        self._connect_due_s = NEVER_S

    def reset(self) -> None:
        """It has restarted, or is another one."""
        self.discard_models()
        self._echoes = 0


def _description(info: ServerInfo, sender: Address) -> str:
    return f"{info.name} at {sender[0]} speaks NatNet {_number(info.version)}"


def _number(version: layout.Version) -> str:
    return f"{version[0]}.{version[1]}"
