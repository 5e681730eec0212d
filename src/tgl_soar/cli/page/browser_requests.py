"""What a browser may ask, and who holds the line.

Every request is JSON of one of the kinds below, with the token; anything else is garbage, and ends
the connection.  One page at a time holds the line: it takes it by dragging, and loses it when it
releases it, goes away, or does nothing for `HOLD_S`.
"""

from __future__ import annotations

import hmac
from typing import Annotated, Final

import msgspec
from msgspec import Meta, Struct

HOLD_S: Final = 5.0
LONGEST: Final = 1024  # bytes of a request
# A drag asks 20 times a second and keys repeat 30 times: twice that is no hand.
PER_S: Final = 60.0
AT_ONCE: Final = 120.0

Metres = Annotated[float, Meta(ge=-100_000, le=100_000)]
Degrees = Annotated[float, Meta(ge=-180, le=180)]


class _Request(Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", kw_only=True):
    token: Annotated[str, Meta(max_length=128)]


class Hello(_Request, frozen=True, tag="hello"):
    """The first one: who it is."""

    name: Annotated[str, Meta(max_length=24)] = ""


class Hold(_Request, frozen=True, tag="hold"):
    """Take the line in the hand."""


class Drop(_Request, frozen=True, tag="drop"):
    """Release it where it was."""


class _AtLine(_Request, frozen=True):
    x: Metres
    z: Metres
    lean: Degrees


class Look(_AtLine, frozen=True, tag="look"):
    """Where would it settle?"""


class Move(_AtLine, frozen=True, tag="move"):
    """Move it there, and release it."""

    at: float = 0.0  # the browser's clock, for measuring


class Preset(_Request, frozen=True, tag="preset"):
    """One of the site's lines."""

    number: Annotated[int, Meta(ge=1, le=99)]


class Undo(_Request, frozen=True, tag="undo"):
    """The line as before the last move."""


class Engage(_Request, frozen=True, tag="engage"):
    """Engage the module."""


class Release(_Request, frozen=True, tag="release"):
    """Disengage it."""


class Abort(_Request, frozen=True, tag="abort"):
    """Disengage it and block it."""


class SetParameter(_Request, frozen=True, tag="set"):
    """One parameter."""

    name: Annotated[str, Meta(max_length=16)]
    value: float


Request = (
    Hello | Hold | Drop | Look | Move | Preset | Undo | Engage | Release | Abort | SetParameter
)
_DECODER: Final = msgspec.json.Decoder(Request)


class Refused(Exception):
    """A request that is none; the message says why."""


def request_of(data: str | bytes, token: str) -> Request:
    """What is asked.  Errors: `Refused`."""
    if len(data) > LONGEST:
        raise Refused(f"a request has at most {LONGEST} bytes")
    try:
        request: Request = _DECODER.decode(data)
    except (msgspec.DecodeError, UnicodeEncodeError):
        raise Refused("this is no request") from None
    if not is_token(request.token, token):
        raise Refused("wrong token: open the address that was printed")
    return request


def is_token(given: str, token: str) -> bool:
    """Whether it is the token, in a time that says nothing of it."""
    return hmac.compare_digest(given.encode("utf-8", "replace"), token.encode())


class ClientAllowance:
    """So many requests a second, and a few at once."""

    def __init__(self) -> None:
        self._left, self._at_s = AT_ONCE, float("nan")

    def spend(self, now_s: float) -> bool:
        """One more; False: it was too many."""
        if self._at_s == self._at_s:
            self._left = min(AT_ONCE, self._left + (now_s - self._at_s) * PER_S)
        self._at_s = now_s
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


class Holder:
    """Which page has the line in its hand."""

    def __init__(self) -> None:
        self._page = 0  # none
        self._name = ""
        self._until_s = float("-inf")

    def take(self, page: int, name: str, now_s: float) -> bool:
        """A page takes the line, or goes on to hold it; False: another one holds it."""
        if self.page(now_s) not in (0, page):
            return False
        self._page, self._name, self._until_s = page, name, now_s + HOLD_S
        return True

    def drop(self, page: int) -> bool:
        """A page releases the line; whether it had held it."""
        had = self._page == page
        if had:
            self._page = 0
        return had

    def page(self, now_s: float) -> int:
        """Who holds it; 0: nobody."""
        if now_s > self._until_s:
            self._page = 0
        return self._page

    def name(self, now_s: float) -> str:
        """What they are called; "": nobody holds it."""
        return self._name if self.page(now_s) else ""
