"""Which links can be opened, who can reach them, and what is reported of those that cannot."""

import pytest

from tgl_soar.link.open_link import check_link, is_open, open_link
from tgl_soar.link.transports.base import LinkError, LinkNotReadyError

LOCAL = "127.0.0.1"


def is_frame(data: bytes) -> bool:
    return data.startswith(b"frame")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "unknown kind"),
        ("carrier-pigeon:1", "unknown kind 'carrier-pigeon'"),
        ("udp:127.0.0.1", "needs a host and a port"),
        ("udp::14540", "needs a host and a port"),
        ("udp:127.0.0.1:abc", "needs a host and a port"),
        ("udp:127.0.0.1:0", "port 0 is not in 1 to 65535"),
        ("udp:127.0.0.1:99999", "port 99999 is not in 1 to 65535"),
        ("udp:no such host.invalid:14540", "is not known"),
        ("udp:192.0.2.1:14540", "no address of this computer"),
        ("serial:", "needs a device"),
        ("serial:/dev/tty-none:921600", "there is no /dev/tty-none"),
        ("serial:/dev/ttyS0:fast", "baud rate 'fast'"),
        ("serial:/dev/ttyS0:1", "baud rate '1'"),
        ("serial:/dev/null:921600", "cannot be opened as a serial line"),
        (f"tcp:{LOCAL}:1", "is something listening there?"),
    ],
)
def test_a_link_that_cannot_be_opened_is_named_with_the_way_out(text: str, words: str) -> None:
    with pytest.raises(LinkError) as caught:
        open_link(text, is_frame)
    assert words in str(caught.value)
    assert repr(text) in str(caught.value)


@pytest.mark.parametrize(
    "text",
    ["serial:", "serial:/dev/ttyAMA0:fast", "udp:127.0.0.1:0", "tcp:127.0.0.1", "carrier-pigeon:1"],
)
def test_a_wrong_form_is_reported_before_anything_is_opened(text: str) -> None:
    with pytest.raises(LinkError):
        check_link(text)


@pytest.mark.parametrize(
    "text", ["serial:/dev/tty-none:921600", "udpin:0.0.0.0:14550", f"tcp:{LOCAL}:1"]
)
def test_the_right_form_is_enough_whether_or_not_it_can_be_opened(text: str) -> None:
    check_link(text)


@pytest.mark.parametrize(
    ("text", "passes"),
    [
        ("serial:/dev/tty-none:921600", True),  # not enumerated yet
        ("serial:/dev/null:921600", False),
        ("serial:/dev/ttyS0:fast", False),
        ("udp:192.0.2.1:14540", True),  # its interface is not up yet
        ("udp:127.0.0.1:99999", False),
        ("udpout:255.255.255.255:14550", False),  # to all, which is not allowed
        (f"tcp:{LOCAL}:1", True),  # its program is not started yet
        ("carrier-pigeon:1", False),
    ],
)
def test_what_may_pass_is_distinguished_from_a_mistake(text: str, passes: bool) -> None:
    with pytest.raises(LinkError) as caught:
        open_link(text, is_frame)
    assert isinstance(caught.value, LinkNotReadyError) is passes


@pytest.mark.parametrize(
    ("link", "opened"),
    [
        ("udp:127.0.0.1:14540", False),
        ("udp:localhost:14540", False),
        ("udpout:127.0.0.7:1", False),
        ("tcp:[::1]:5760", False),
        ("serial:/dev/ttyAMA0:921600", False),
        ("udp:0.0.0.0:14540", True),
        ("udp:[::]:14540", True),
        ("udpout:192.0.2.1:14550", True),
        ("tcp:10.1.2.3:5760", True),
    ],
)
def test_which_links_others_can_reach(link: str, opened: bool) -> None:
    assert is_open(link) == opened
