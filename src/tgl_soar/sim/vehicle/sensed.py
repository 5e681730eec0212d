"""What the sensors and the estimator of the autopilot have at one step."""

from __future__ import annotations

from typing import Final, NamedTuple

from tgl_soar.types import (
    NO_AIRSPEED,
    NO_IMU,
    NO_RANGE,
    AirspeedSample,
    AttitudeSample,
    ImuSample,
    PositionFix,
    RangeSample,
)


class Sensed(NamedTuple):
    """What the autopilot's sensors and estimator have at one step."""

    attitude: AttitudeSample  # the latest delivered; sequence 0: none yet
    position: PositionFix
    airspeed_mps: float
    flying: bool  # False while held or lying on the ground: no failsafe acts
    imu: ImuSample = NO_IMU  # sequence 0: it has none
    pitot: AirspeedSample = NO_AIRSPEED
    rangefinder: RangeSample = NO_RANGE  # a sample without a number: nothing comes back


GROUNDED: Final = Sensed(
    attitude=AttitudeSample(
        sequence=0,
        time_s=0.0,
        qw=1.0,
        qx=0.0,
        qy=0.0,
        qz=0.0,
        roll_rate_frd_radps=0.0,
        pitch_rate_frd_radps=0.0,
        yaw_rate_frd_radps=0.0,
    ),
    position=PositionFix(
        sequence=0,
        time_s=0.0,
        north_m=0.0,
        east_m=0.0,
        down_m=0.0,
        velocity_north_mps=0.0,
        velocity_east_mps=0.0,
        velocity_down_mps=0.0,
    ),
    airspeed_mps=0.0,
    flying=False,
)
_MEASURED: Final = ("attitude", "position", "imu", "pitot", "rangefinder")


def known_since(sensed: Sensed, booted_s: float) -> Sensed:
    """What an autopilot that booted at a time [s] knows of it: nothing that was measured before.

    Until its first sample there are numbers to show, but none that is streamed.
    """
    for name in _MEASURED:
        sample = getattr(sensed, name)
        if sample.sequence == 0 or sample.time_s < booted_s:
            sensed = sensed._replace(**{name: getattr(GROUNDED, name)})
    return sensed
