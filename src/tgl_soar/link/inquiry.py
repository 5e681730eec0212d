"""Asking the autopilot whether it will obey us, before somebody finds out in the air.

An ArduPilot ignores overrides of a sender that its parameters do not name, and does not say so.
The parameters are asked for when the autopilot is first heard and after it has restarted, a few
times; an autopilot that does not answer is believed to obey.
"""

from __future__ import annotations

from typing import Final

from .autopilots.base import Flavour
from .messages import COMPONENT_AUTOPILOT, ParamRequestRead, ParamValue, Said

ASK_S: Final = 0.75
ASK_TIMES: Final = 4


class SenderInquiry:
    """Whose commands does it obey?"""

    def __init__(self, flavour: Flavour, target_system: int, override_system: int) -> None:
        self._flavour = flavour
        self._target_system = target_system
        self._override_system = override_system
        self._answers: dict[str, float] = {}
        self._asked = 0
        self._due_s = float("-inf")
        self._told = ""

    def restart(self) -> None:
        """Ask again."""
        self._answers.clear()
        self._asked = 0
        self._due_s = float("-inf")

    def heard(self, message: ParamValue) -> None:
        """A parameter of the autopilot."""
        if message.param_id in self._flavour.asked:
            self._answers[message.param_id] = self._flavour.value_of(message)

    def poll(self, now_s: float) -> tuple[list[Said], str]:
        """What is to be asked, and what is to be told: each complaint once."""
        if self._asked > ASK_TIMES or now_s < self._due_s:
            return [], ""
        self._due_s = now_s + ASK_S
        self._asked += 1
        if self._answers:
            self._asked = ASK_TIMES + 1
            refusal = self._flavour.refusal(self._answers, self._override_system)
            told, self._told = self._told, refusal
            return [], refusal if refusal != told else ""
        if self._asked > ASK_TIMES:
            return [], ""
        return [
            ParamRequestRead(self._target_system, COMPONENT_AUTOPILOT, name, -1)
            for name in self._flavour.asked
        ], ""
