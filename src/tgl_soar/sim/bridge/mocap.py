"""Motion capture as the bridge's command line asks for it."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace

from tgl_soar.config.site import Mocap
from tgl_soar.sim.motive import HALL_FAULTS, HallFault, Motive, MotiveOptions, MotiveServer
from tgl_soar.sim.natnet_frames import VERSIONS


@dataclass(frozen=True)
class MocapOptions:
    """The stand-in's own command port, and how it streams where the site file does not say."""

    local: str  # HOST:PORT
    motive: MotiveOptions


def add_mocap_options(parser: argparse.ArgumentParser) -> None:
    """What can be chosen of the stand-in."""
    versions = [f"{major}.{minor}" for major, minor in VERSIONS]
    add = parser.add_argument_group("motion capture").add_argument
    add("--mocap", choices=("none", "natnet"), default="none", help="stream poses as Motive does")
    add(
        "--mocap-local", default="127.0.0.1:1510", metavar="HOST:PORT",
        help="own command port of NatNet (default 127.0.0.1:1510; port 0: any)",
    )  # fmt: skip
    add("--mocap-version", choices=versions, default="4.1", help="of NatNet (default 4.1)")
    add("--mocap-rate", type=int, default=100, metavar="HZ", help="(default 100)")
    add(
        "--mocap-latency", type=float, default=0.01, metavar="S",
        help="from exposure to sending (default 0.01)",
    )  # fmt: skip
    add("--mocap-jitter", type=float, default=0.0, metavar="S", help="at most so much more")
    add("--mocap-noise", type=float, default=0.0005, metavar="M", help="(default 0.0005)")
    add("--mocap-loss", type=float, default=0.0, metavar="FRACTION", help="of the frames")
    add(
        "--mocap-fault", type=_hall_fault, action="append", default=[], metavar="KIND:FROM:UNTIL",
        help=f"what goes wrong and when, KIND one of {', '.join(HALL_FAULTS)}; repeat for more",
    )  # fmt: skip


def _hall_fault(text: str) -> HallFault:
    kind, *times = text.split(":")
    try:
        from_s, until_s = (float(number) for number in times)
    except ValueError:
        from_s = until_s = 0.0
    if kind not in HALL_FAULTS or not 0.0 <= from_s < until_s:
        raise argparse.ArgumentTypeError(
            f"{text!r}: write KIND:FROM:UNTIL, such as untracked:10:11.5, KIND one of"
            f" {', '.join(HALL_FAULTS)}"
        )
    return HallFault(kind, from_s, until_s)


def mocap_options(arguments: argparse.Namespace) -> MocapOptions | None:
    """What the command line asks for; None: no motion capture."""
    if arguments.mocap == "none":
        return None
    major, minor = arguments.mocap_version.split(".")
    return MocapOptions(
        arguments.mocap_local,
        MotiveOptions(
            version=(int(major), int(minor)),
            rate_hz=arguments.mocap_rate,
            latency_s=arguments.mocap_latency,
            jitter_s=arguments.mocap_jitter,
            noise_m=arguments.mocap_noise,
            loss=arguments.mocap_loss,
            faults=tuple(arguments.mocap_fault),
            seed=arguments.seed,
            restarted_clock=arguments.speed != "lockstep",  # there every clock is the vehicle's
        ),
    )


def motive_server(
    options: MocapOptions, site: Mocap, clock_s: Callable[[], float], *, step_hz: int
) -> MotiveServer:
    """The stand-in for the hall of a site file.  Errors: `PortError`, ValueError."""
    motive = options.motive
    for name, value in (
        ("latency", motive.latency_s),
        ("jitter", motive.jitter_s),
        ("noise", motive.noise_m),
        ("loss", motive.loss),
    ):
        if not 0.0 <= value <= 1.0:
            raise ValueError(f"--mocap-{name} {value:g}: a number from 0 to 1")
    host, _, port = options.local.rpartition(":")
    if not host or not port.isdecimal():
        raise ValueError(f"--mocap-local {options.local!r}: write HOST:PORT")
    motive = replace(
        motive,
        multicast=site.stream == "multicast",
        group=site.group,
        data_port=site.data_port,
    )
    server = Motive(motive, site.hall(), site.body)
    return MotiveServer(server, (host, int(port)), clock_s, step_hz=step_hz)
