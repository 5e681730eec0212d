"""Parameters by topic, for pages and lists: every parameter's prefix is in exactly one group."""

from __future__ import annotations

from typing import Final, NamedTuple


class Group(NamedTuple):
    """Parameters that share a topic: every parameter's prefix is in exactly one group."""

    title: str
    prefixes: tuple[str, ...]  # names up to the first underscore
    sentence: str


GROUPS: Final[tuple[Group, ...]] = (
    Group("Engaging", ("OP",), "The operator's and the pilot's switches."),
    Group(
        "The target gradient line", ("TGL",),
        "Where the aircraft is held, and how fast the line moves there when it is moved.",
    ),
    Group(
        "Line to pitch", ("RHO", "PITCH"),
        "The outer loop: the distance e_rho to the line becomes a pitch setpoint.",
    ),
    Group("Pitch to elevator", ("ELE",), "The inner loop, and the airframe it was tuned on."),
    Group(
        "The airframe in pitch", ("DYN", "CMD"),
        "The airframe that flies, to which the schedule adapts the gains; filled in from the"
        " airframe file.",
    ),
    Group(
        "Roll to aileron", ("AIL", "LAT"),
        "The bank setpoint, or wings level; and where the gains of roll and heading were found.",
    ),
    Group(
        "Heading to rudder", ("RUD", "WPT", "PSI", "VEER", "BANK"),
        "The nose is held towards a virtual waypoint upwind.",
    ),
    Group(
        "Sideways to bank", ("SIDE",),
        "A little bank holds the aircraft at y = 0, against gusts and errors of the roll angle.",
    ),
    Group(
        "The point on the line", ("BRK",),
        "The brake holds a point of the line: the second axis, where TGL_HOLD is 1 or 2.",
    ),
    Group(
        "The throttle", ("THR",),
        "A propeller in reserve, for where the air does not carry.",
    ),
    Group("Surfaces", ("SURF",), "The last limit of every command."),
    Group(
        "The envelope", ("ALPHA", "SPEED", "SINK", "CLEAR", "FENCE"),
        "Limits of the aircraft and its place, independent of the laws.",
    ),
    Group("Estimation", ("EST",), "How position and velocity follow from delayed fixes."),
    Group(
        "The receiver", ("GPS",),
        "How accurate satellites have to be, by the receiver's own word.",
    ),
    Group(
        "The rangefinder", ("RNG",),
        "Height over the ground, measured: a bound, and a correction of the receiver's.",
    ),
    Group(
        "The air", ("WIND",),
        "Airspeed, angle of attack, wind and updraft, estimated from all that is measured.",
    ),
    Group(
        "Disengaging", ("AGE", "REC", "CAPTURE", "TILT"),
        "Beyond these limits the module holds, recovers or disengages by itself and says why.",
    ),
    Group(
        "The forecast", ("FC",),
        "Whether the aircraft will settle on its line, foreseen from what it has flown through.",
    ),
    Group("Telemetry", ("TEL",), "What the module sends to ground stations unasked."),
    Group("The process", ("LOOP",), "How the module runs."),
    Group(
        "Margins in flight", ("EXC",),
        "A known motion of the pitch setpoint, from which a log shows the loop's margins.",
    ),
    Group(
        "The search for lift", ("SRCH",),
        "The module looks for a place to soar without knowing the wind.",
    ),
    Group(
        "The survey", ("SRV",),
        "A slow slide there and back, from which the contour is drawn.",
    ),
    Group(
        "Launching", ("LNC",),
        "From the hand to the line.",
    ),
    Group(
        "Beating along the ridge", ("BEAT",),
        "To and fro in the lift, where the wind is too slow or too oblique to stand in.",
    ),
    Group(
        "Breaking off and landing", ("ESC", "LND"),
        "The way home without a propeller, and the height that it needs.",
    ),
)  # fmt: skip


def group_of(name: str) -> Group:
    """The group of a parameter.  Errors: KeyError for one that has none."""
    for group in GROUPS:
        if name.partition("_")[0] in group.prefixes:
            return group
    raise KeyError(name)
