"""What operators ask for over the links: parameters, commands, files, keys; and who may.

Reading is answered where it was asked; a value that is set concerns every station.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from tgl_soar import autopilot
from tgl_soar.config.files import value_refusal
from tgl_soar.config.line_changes import STAGED, STAGING
from tgl_soar.config.parameters import INDEX
from tgl_soar.link.commands import ENGAGE, NOTHING, CommandServer
from tgl_soar.link.component_metadata import metadata_files
from tgl_soar.link.file_transfer import FileServer
from tgl_soar.link.messages import (
    SEVERITY_INFO,
    SEVERITY_WARNING,
    CommandInt,
    CommandLong,
    FileTransferProtocol,
    ParamRequestList,
    ParamRequestRead,
    ParamSet,
    Received,
    SetupSigning,
    Source,
)
from tgl_soar.link.routing import Route
from tgl_soar.link.signing import KEY_BYTES, Signing
from tgl_soar.link.telemetry import Budget
from tgl_soar.onboard.engage_switch import ENGAGED, EngageSwitch
from tgl_soar.onboard.outbox import Outbox
from tgl_soar.onboard.settings import FlightSettings
from tgl_soar.onboard.setup import ModuleSetup
from tgl_soar.onboard.surface_control import SurfaceControl
from tgl_soar.onboard.switches import Switches

ABSENT_S: Final = 5.0  # a station that was silent for longer may have missed a change
REFUSALS_S: Final = 0.25  # between two words about commands that were refused
COMPLAIN_S: Final = 5.0  # between two words about keys that were refused
STAGE_S: Final = 60.0  # from one staged value to the next; a move that was left nobody requests
FILES_FRACTION: Final = 0.5  # of the telemetry's budget: its numbers keep the other half


class Operators:
    """Answers them."""

    def __init__(
        self,
        setup: ModuleSetup,
        settings: FlightSettings,
        commands: CommandServer,
        engage_switch: EngageSwitch,
        switches: Switches,
        surfaces: SurfaceControl,
        outbox: Outbox,
        signing: Signing,
        keep_key: Callable[[bytes], None] | None,
    ) -> None:
        """`keep_key`: keeps a key that came over the air, or raises OSError; None: none is
        accepted."""
        self._setup = setup
        self._settings = settings
        self._parameters = settings.server
        self._commands = commands
        self._engage_switch = engage_switch
        self._switches = switches
        self._surfaces = surfaces
        self._outbox = outbox
        self._signing = signing
        self._keep_key = keep_key
        self._keys_refused_s = float("-inf")
        self._refused_s = float("-inf")
        self._staged_s = float("-inf")  # when one was set last, or staging began
        self._files = FileServer(metadata_files())
        self._files_budget = Budget()
        self._met: dict[tuple[int, Source], float] = {}  # when each station was received last

    def take(self, route: Route, received: Received, now_s: float) -> bool:
        """Whether a message was one of theirs."""
        source, message = received
        if isinstance(message, ParamSet):
            self._set(source, message, now_s)
        elif isinstance(message, ParamRequestRead | ParamRequestList):
            route.asked = True
            is_active = self._surfaces.is_active
            answer = self._parameters.handle(source, message, now_s, flying=is_active)
            self._outbox.say_all(answer, route)
        elif isinstance(message, CommandLong | CommandInt):
            self._obey(route, source, message, now_s)
        elif isinstance(message, FileTransferProtocol):
            self._take_file_request(route, source, message, now_s)
        else:
            return False
        return True

    def meet(self, route: Route, source: Source, now_s: float) -> None:
        """A station that was away is sent whether the module is engaged, and its mode."""
        if source.system not in self._setup.operators:
            return
        self._engage_switch.stations.received(now_s)
        before = self._met.get((route.number, source), now_s)
        self._met[route.number, source] = now_s
        if now_s - before > ABSENT_S:
            self._outbox.say(self._parameters.value_message(INDEX["OP_ENGAGE"]), route)
            mode = autopilot.mode_name(self._engage_switch.mode)
            self._outbox.say_words(SEVERITY_INFO, mode, route)

    def serve(self, now_s: float, *, sheds: bool) -> None:
        """What was asked for and waits: values, and pieces of files; what was staged and left.
        `sheds`: there is no time for files."""
        self._list_parameters(now_s)
        self._drop_left_stage(now_s)
        if self._files.is_reading and not sheds:
            self._send_file_piece(now_s)

    def _list_parameters(self, now_s: float) -> None:
        """Values go out where somebody has asked for any."""
        if not self._parameters.is_busy:
            for route in self._outbox.routes:
                route.asked = False
            return
        values = self._parameters.poll(now_s)
        for route in self._outbox.routes:
            if route.asked:
                self._outbox.say_all(values, route)
                route.asked = self._parameters.is_busy

    def _drop_left_stage(self, now_s: float) -> None:
        """A staged move whose station has gone: whoever sets 0 later would make a move that nobody
        has in mind, and whoever sets a value meanwhile would stage it."""
        if self._settings.values["TGL_STAGE"] != STAGING or now_s - self._staged_s < STAGE_S:
            return
        self._settings.drop_staged()
        text = f"staged move dropped: nothing was staged for {STAGE_S:g} s"
        self._outbox.tell(SEVERITY_WARNING, text)

    def acknowledge(self, now_s: float) -> None:
        """What is still to be said about commands."""
        for ack in self._commands.poll(now_s):
            self._outbox.say_to(Source(ack.target_system, ack.target_component), ack)

    def restart(self, now_s: float) -> None:
        """The clock was changed: what was timed by the old one is forgotten."""
        self._staged_s = now_s
        self._parameters.rebase()
        self._commands.rebase()
        self._files.rebase()
        self._files_budget.rebase()

    def _forbidden(self, source: Source) -> str:
        """Why a sender may neither set nor command; "" if it may."""
        if source.system in self._setup.operators:
            return ""
        return f"system {source.system} is not among autopilot.operators of the airframe file"

    # --- parameters and commands --------------------------------------------------------------

    def _set(self, source: Source, message: ParamSet, now_s: float) -> None:
        server, outbox = self._parameters, self._outbox
        if refusal := self._set_refusal(source, message, now_s):
            outbox.say_all(server.refuse(source, message, refusal, now_s))
            return
        refused = server.counters.refused
        answers = server.handle(source, message, now_s, flying=self._surfaces.is_active)
        accepted = bool(answers) and server.counters.refused == refused
        if accepted and message.param_id == "OP_ENGAGE" and message.param_value == 0.0:
            self._engage_switch.released(now_s, source)
        if server.values is not self._settings.values:
            self._settings.changed()
        # mypyc takes no tuple with a star after `in`.
        if accepted and (message.param_id in STAGED or message.param_id == "TGL_STAGE"):
            self._staged_s = now_s
        if accepted:
            self._switches.was_set(message.param_id)
        outbox.say_all(answers)

    def _set_refusal(self, source: Source, message: ParamSet, now_s: float) -> str:
        """Why a value may not be set by its sender, or not now; "" if it may."""
        engages = message.param_id == "OP_ENGAGE" and message.param_value >= 0.5
        refusal = self._forbidden(source)
        if engages:
            refusal = refusal or self._engage_switch.request_refusal(now_s, source)
        if engages and message.param_value == ENGAGED and not self._settings.engage:
            refusal = refusal or "2 is what a module shows that has engaged: set 1"
        name, value, setup = message.param_id, message.param_value, self._setup
        refusal = refusal or value_refusal(name, value, setup.surface_channels, setup.aerodynamics)
        return refusal or self._switches.refusal(name, value)

    def _obey(
        self, route: Route, source: Source, message: CommandLong | CommandInt, now_s: float
    ) -> None:
        commands = self._commands
        if not commands.is_for_us(source, message):
            return
        engages = message.command == ENGAGE
        held_back = self._engage_switch.request_refusal(now_s, source) if engages else ""
        answer = commands.handle(
            source,
            message,
            now_s,
            forbidden=self._forbidden(source),
            held_back=held_back,
            engaged=self._settings.engage,
        )
        self._outbox.say_all(answer.outbound, route)
        if answer.reason and not 0.0 <= now_s - self._refused_s < REFUSALS_S:
            self._refused_s = now_s
            self._outbox.tell(SEVERITY_WARNING, f"command refused: {answer.reason}")
        if answer.request != NOTHING:
            self._engage_switch.turn(answer.request, f"system {source.system}", now_s, source)

    # --- files --------------------------------------------------------------------------------

    def _take_file_request(
        self, route: Route, source: Source, message: FileTransferProtocol, now_s: float
    ) -> None:
        own = self._setup.own
        for_us = message.target_system in (0, own.system)
        if not for_us or message.target_component != own.component or source == own:
            return
        answer = self._files.handle(source, message, route.number, now_s)
        if answer is not None and self._commands.may_answer(now_s):
            self._outbox.say_metered(answer, route)

    def _send_file_piece(self, now_s: float) -> None:
        """One, if the files' part of the budget is not used up."""
        bytes_per_s = FILES_FRACTION * self._outbox.telemetry_bytes_per_s
        if not self._files_budget.fill(now_s, bytes_per_s):
            return
        piece = self._files.take()
        if piece is not None:
            size = self._outbox.say_metered(piece.message, self._outbox.routes[piece.link])
            self._files_budget.spend(size, bytes_per_s)

    # --- keys ---------------------------------------------------------------------------------

    def take_key(self, source: Source, message: SetupSigning, now_s: float) -> None:
        """A key over the air: everybody who listens knows it from then on."""
        own = self._setup.own
        if message.target_system != own.system or message.target_component != own.component:
            return
        refusal = self._key_refusal(source, message)
        if not refusal and self._keep_key is not None:
            try:
                self._keep_key(message.secret_key)
            except OSError as error:
                refusal = f"it cannot be kept: {error.strerror}"
        if not refusal:
            self._signing.replace_key(message.secret_key, message.initial_timestamp)
            self._outbox.tell(SEVERITY_WARNING, f"new signing key from system {source.system}")
        elif now_s - self._keys_refused_s > COMPLAIN_S:
            self._keys_refused_s = now_s
            self._outbox.tell(SEVERITY_WARNING, f"SETUP_SIGNING refused: {refusal}")

    def _key_refusal(self, source: Source, message: SetupSigning) -> str:
        """Why a key is not accepted; "" if it is."""
        if self._keep_key is None:
            return "not over the air (--allow-setup-signing)"
        if self._surfaces.is_active:
            return "not while flying"
        if len(message.secret_key) != KEY_BYTES or not any(message.secret_key):
            return "signing is not turned off over the air"
        if not self._signing.may_begin_with(message.initial_timestamp):
            return "initial_timestamp is years ahead: set the station's clock"
        return self._forbidden(source)
