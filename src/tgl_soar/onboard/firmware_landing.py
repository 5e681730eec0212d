"""LND_BY: the firmware's own landing, asked for once the slope is left behind.

The module flies its own approach meanwhile.  It is the autopilot's heartbeat that ends it: in the
mode of its landing our commands do not act any more, and the supervisor disengages.  So nobody
waits for anybody; a firmware that does not take the landing leaves the module to land.

    read     the mission, where that lands: when LND_BY is set, and again when it breaks off.  One
             without a landing, or with one elsewhere than the landing place, is not asked for
    ask      right after a heartbeat, `TRIES` times, a request may be lost
    home     an ArduPlane that is not LAUNCHED_M over its home, and slower than 5 m/s over the
             ground, takes itself for one that was not launched yet, and lands nothing: it is not
             asked either
    wind     an estimator that began while the aircraft hovered may have the wind from the wrong
             side: hovering, airspeed and a side slip of zero fit a wind from ahead and one from
             behind alike (PX4's EKF2, docs/outdoors.md).  By that wind its modes turn downwind, so
             it is not asked; and it is reported while there is time.  What was found last holds
             until the two can be compared again; where they never could, `WAITS_S` after it was
             requested it is asked all the same
    done     a heartbeat shows the mode; an acknowledgement alone says nothing
    check    the item that it flies: a mission's mode may be anywhere in it.  Where the autopilot
             restarts meanwhile, or our clock is set, that starts again, by the mission as it was

ArduPlane's return circles over home, with a throttle that we do not have, unless RTL_AUTOLAND says
otherwise; that is not read.
"""

from __future__ import annotations

from math import hypot
from typing import Final

from tgl_soar.autopilot import Output
from tgl_soar.config.site import HomePosition
from tgl_soar.control.supervisor import (
    BREAKING_OFF,
    LANDING,
    READY,
    RELEASED,
    STANDBY,
    goes_home,
    is_flying,
)
from tgl_soar.geometry import ned_vector_from_soaring, soaring_from_ned
from tgl_soar.link.autopilots.ardupilot import MODE_AUTO
from tgl_soar.link.autopilots.px4 import MODE_MISSION, MODE_RETURN
from tgl_soar.link.messages import (
    COMMAND_DO_LAND_START,
    COMMAND_REQUEST_MESSAGE,
    COMPONENT_AUTOPILOT,
    ID_MISSION_CURRENT,
    SEVERITY_CRITICAL,
    SEVERITY_NOTICE,
    SEVERITY_WARNING,
    CommandLong,
)
from tgl_soar.link.mission import MissionLanding, landings_of
from tgl_soar.link.mode_change import ANSWER_S, TRIES
from tgl_soar.link.session import Session
from tgl_soar.link.tangent_plane import Home, TangentPlane
from tgl_soar.onboard.outbox import Outbox
from tgl_soar.onboard.settings import FlightSettings
from tgl_soar.onboard.setup import ModuleSetup

BY_MISSION: Final = 1
BY_RETURN: Final = 2
# custom_mode in which each firmware lands, by its name and LND_BY.
LANDING_MODES: Final = {
    "ardupilot": {BY_MISSION: MODE_AUTO},
    "px4": {BY_MISSION: MODE_MISSION, BY_RETURN: MODE_RETURN},
}
NO_PARAMS: Final = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
# Of a touch-down from the landing place, beside half of its strip: what two receivers differ by.
# The height left is that of the landing place; whether it reaches another one nobody has asked.
ELSEWHERE_M: Final = 10.0
LAUNCHED_M: Final = 10.0  # ArduPlane 4.6: below it its loop of speed and height does not run
# Of its wind against ours, along ours: beyond the noise of an estimate that is about nothing yet.
# The wrong solution is the mirrored wind, which is as fast as the aircraft hovers.
AGAINST_MPS: Final = 2.0
WINDY_MPS: Final = 4.0  # ours: below it neither has a side
WAITS_S: Final = 4.0  # its wind comes once a second, and a request may be lost
CHECK_S: Final = 3.0  # three requests and their answers
LATE_S: Final = 2.0  # after asking: a heartbeat a second, and the time to change the mode


class FirmwareLanding:
    """Asks for it from tick to tick."""

    def __init__(
        self, setup: ModuleSetup, settings: FlightSettings, session: Session, outbox: Outbox
    ) -> None:
        self._setup, self._settings = setup, settings
        self._session, self._outbox = session, outbox
        self._tries = 0
        self._asked_for = -1  # custom_mode
        self._asked_s = self._looked_s = float("-inf")
        self._by = 0  # LND_BY in the last tick
        self._mode = -1
        self._unfit: str | None = None  # why the mission does not land there; None: not known yet
        self._reported = False  # that we land, on this way home
        self._wrong_wind: str | None = None  # "": from the right side; None: never compared
        self._wind_wanted_s = float("nan")  # since then its wind is requested
        self._wind_reported = False  # in this flight
        self._handed_over_s = float("nan")  # since then the item is looked for
        self._checked_s = float("-inf")  # it was asked for last
        self._currents = 0  # MISSION_CURRENT that had come by then
        self._landings: list[MissionLanding] = []  # of the mission as it was read last
        self._restarts = session.mission.restarts  # of the conversation, in the last tick

    def refusal(self, value: float) -> str:
        """Why LND_BY may not be set so; "" if it may."""
        modes = LANDING_MODES.get(self._setup.flavour.name, {})
        if value == 0.0 or value in modes:
            return ""
        return f"{self._unknown()}: {' or '.join(map(str, (0, *modes)))}"

    def _unknown(self) -> str:
        """What another LND_BY than those that are known would ask for."""
        name = self._setup.flavour.name
        if name in LANDING_MODES:
            return f"the return of {name} does not land, unless RTL_AUTOLAND says so"
        return f"no landing of {name} is known"

    def tick(self, output: Output) -> None:
        """A tick has gone by."""
        by = int(self._settings.values["LND_BY"])
        modes = LANDING_MODES.get(self._setup.flavour.name, {})
        self._begin_again(output)
        self._read(by, output, known=by in modes)
        self._check(output)
        if by in modes:
            self._compare_winds(output)
        if output.mode != LANDING or by not in modes:
            self._ended(output, by)
            return
        if not self._unfit:
            if by == BY_MISSION and self._unfit == "" and self._tries == 0:
                self._unfit = self._too_near_home(output)
            if self._wrong_wind and not self._unfit:
                self._unfit = self._wrong_wind
            if self._wrong_wind is None and output.time_s - self._wind_wanted_s < WAITS_S:
                return
        if self._unfit or (by == BY_MISSION and self._unfit is None):
            if self._unfit and not self._reported:
                self._reported = True
                self._outbox.tell(SEVERITY_WARNING, f"{self._unfit}: we land")
            return
        received_s = self._session.status.time_s
        if not received_s > self._looked_s or self._tries > TRIES:
            return
        self._looked_s = received_s
        if output.time_s - self._asked_s < ANSWER_S:
            return
        self._tries += 1
        self._asked_s = output.time_s
        if self._tries > TRIES:
            self._outbox.tell(
                SEVERITY_WARNING, f"the autopilot does not land ({TRIES} times asked): we do"
            )
            return
        self._asked_for = modes[by]
        self._outbox.say_all((self._request(by, modes[by]),), self._outbox.autopilot)

    def _begin_again(self, output: Output) -> None:
        """Whose clock was reset: times of before say nothing, and what was asked is lost."""
        mission = self._session.mission
        if mission.restarts == self._restarts:
            return
        self._restarts = mission.restarts
        self._asked_s = self._looked_s = self._checked_s = float("-inf")
        self._wrong_wind, self._wind_wanted_s = None, output.time_s
        if self._handed_over_s == self._handed_over_s:  # not NaN
            self._handed_over_s, self._currents = output.time_s, mission.current_count

    def _read(self, by: int, output: Output, *, known: bool) -> None:
        """The mission, where it is to land; `known`: this firmware can land so."""
        mission = self._session.mission
        breaks_off = output.mode in (BREAKING_OFF, LANDING)
        begins = breaks_off and self._mode not in (BREAKING_OFF, LANDING)
        self._mode = output.mode
        if by != self._by and known:
            self._wind_reported = False
            self._wrong_wind, self._wind_wanted_s = None, output.time_s
            self._session.wind.want()
        if by != self._by or begins:
            self._unfit, self._reported = None, False
            if by and not known:  # of a file: an operator is refused it
                self._outbox.tell(SEVERITY_WARNING, f"LND_BY {by}: {self._unknown()}: we land")
            elif by == BY_MISSION:
                mission.begin()
        self._by = by
        if (
            by == BY_MISSION
            and known
            and self._unfit is None
            and (mission.is_known or mission.failed)
        ):
            self._unfit = self._unfitness()
            if self._unfit and not breaks_off:
                self._outbox.tell(SEVERITY_WARNING, f"LND_BY {by}: {self._unfit}: we land")

    def _unfitness(self) -> str:
        """Why the mission does not land where it should; "" if it does, or nobody can say."""
        mission = self._session.mission
        if mission.failed:
            return mission.failed
        landings = self._landings = landings_of(mission.items)
        if not landings:
            return "its mission has no landing (DO_LAND_START, then NAV_LAND)"
        for landing in landings:  # the firmware chooses the nearest one
            off_m = self._off(landing)
            if off_m > 0.5 * self._settings.values["LND_LEN"] + ELSEWHERE_M:
                return (
                    f"the landing of its mission, item {landing.touches}, is {off_m:.0f} m from"
                    " LND_X and LND_Y"
                )
        return ""

    def _off(self, landing: MissionLanding) -> float:
        """How far its touch-down is from the landing place [m]; 0 where either is not known."""
        origin, values = self._setup.position.home, self._settings.values
        if origin is None or not values["LND_LEN"] > 0.0:
            return 0.0
        x, y, _ = self._place(origin, landing.latitude_deg, landing.longitude_deg)
        return hypot(x - values["LND_X"], y - values["LND_Y"])

    def _too_near_home(self, output: Output) -> str:
        """Why an ArduPlane would not land from here; "" if it would, or nobody can say."""
        origin, home = self._setup.position.home, self._session.mission.home
        if self._setup.flavour.name != "ardupilot" or origin is None or home is None:
            return ""
        _, _, z = self._place(
            origin, 1e-7 * home.latitude, 1e-7 * home.longitude, 1e-3 * home.altitude
        )
        over_m = output.vehicle.z_m - z
        if not over_m < LAUNCHED_M:  # true for NaN
            return ""
        return (
            f"its home is {over_m:.0f} m below us, and within {LAUNCHED_M:.0f} m of that it takes"
            " itself for not launched"
        )

    def _compare_winds(self, output: Output) -> None:
        """What is wrong with the autopilot's wind, as far as it can be said; reported in flight."""
        found = self._against_ours(output)
        if found is not None:
            self._wrong_wind = found
        if output.mode in (STANDBY, READY):
            self._wind_reported = False
        elif self._wind_reported or not self._wrong_wind:
            return
        elif is_flying(output.mode) and not goes_home(output.mode):
            self._wind_reported = True
            text = f"of the autopilot: {self._wrong_wind}; its own modes fly downwind"
            self._outbox.tell(SEVERITY_WARNING, text)

    def _against_ours(self, output: Output) -> str | None:
        """ "": its wind is from our side; None: nobody can say."""
        air, frame = output.air, self._setup.frame
        north, east, _ = ned_vector_from_soaring(frame, air.wind_mps, air.cross_wind_mps, 0.0)
        north_theirs, east_theirs = self._session.wind.known(output.time_s)
        ours = hypot(north, east)
        if not ours >= WINDY_MPS or north_theirs != north_theirs:  # the first is true for NaN
            return None
        along = (north * north_theirs + east * east_theirs) / ours
        return f"its wind is {-along:.0f} m/s from the wrong side" if along < -AGAINST_MPS else ""

    def _place(
        self,
        origin: HomePosition,
        latitude_deg: float,
        longitude_deg: float,
        altitude_m: float | None = None,
    ) -> tuple[float, float, float]:
        """x, y, z in the soaring frame; altitude_m: None: as high as the frame's origin."""
        plane = TangentPlane(Home(origin.latitude_deg, origin.longitude_deg, origin.altitude_m))
        height_m = origin.altitude_m if altitude_m is None else altitude_m
        return soaring_from_ned(
            self._setup.frame, *plane.ned_m(latitude_deg, longitude_deg, height_m)
        )

    def _request(self, by: int, custom_mode: int) -> CommandLong:
        if by == BY_RETURN:
            return self._setup.flavour.ask_for_mode(custom_mode)
        return self._command(COMMAND_DO_LAND_START, NO_PARAMS)

    def _command(
        self, command: int, params: tuple[float, float, float, float, float, float, float]
    ) -> CommandLong:
        return CommandLong(
            target_system=self._session.autopilot.system,
            target_component=COMPONENT_AUTOPILOT,
            command=command,
            confirmation=0,
            params=params,
        )

    def _ended(self, output: Output, by: int) -> None:
        taken = self._session.custom_mode == self._asked_for
        released = output.mode in (STANDBY, READY, RELEASED)
        if self._tries and not taken and released and output.time_s - self._asked_s < LATE_S:
            return  # surfaces that do not obey any more may be seen before the mode is
        if self._tries and taken:
            if by == BY_MISSION:
                self._handed_over_s = output.time_s
                self._currents = self._session.mission.current_count
            else:
                self._outbox.tell(SEVERITY_NOTICE, "the autopilot lands")
        self._tries = 0
        self._asked_s = self._looked_s = float("-inf")

    def _check(self, output: Output) -> None:
        """Which item it flies, after it was handed over."""
        since_s = output.time_s - self._handed_over_s
        if since_s != since_s:  # NaN
            return
        mission = self._session.mission
        item = mission.current if mission.current_count != self._currents else -1
        lands = any(land.begins <= item <= land.touches for land in self._landings)
        if self._session.custom_mode != self._asked_for:  # somebody has taken over
            self._handed_over_s = float("nan")
        elif lands:
            self._handed_over_s = float("nan")
            self._outbox.tell(SEVERITY_NOTICE, f"the autopilot lands: item {item} of its mission")
        elif since_s > CHECK_S:
            self._handed_over_s = float("nan")
            where = f"at item {item}" if item >= 0 else "at an item that it does not tell"
            self._outbox.tell(
                SEVERITY_CRITICAL,
                f"the autopilot is in its mission {where}, not landing: take over",
            )
        elif output.time_s - self._checked_s >= ANSWER_S:
            self._checked_s = output.time_s
            asked = (float(ID_MISSION_CURRENT), *NO_PARAMS[1:])
            request = self._command(COMMAND_REQUEST_MESSAGE, asked)
            self._outbox.say_all((request,), self._outbox.autopilot)
