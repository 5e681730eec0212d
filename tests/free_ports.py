"""Ports of this machine for tests that must name one before it is bound."""

import socket


def free_port() -> int:
    """A UDP port of the loopback interface that is free."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
