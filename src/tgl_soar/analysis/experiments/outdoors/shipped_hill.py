"""The shipped hill and the aircraft that flies there, as the experiments outdoors begin with it."""

from __future__ import annotations

from typing import Final, NamedTuple

import msgspec

from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import airframe_file, line_parameters, load_flight, site_file
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import HillAir, Line, Site, Start

AIRFRAME: Final = "eclipson_c"
SITE: Final = "hill"
BELOW_M: Final = 0.5  # its line, where it is released


class ShippedHill(NamedTuple):
    """The files, and what they set."""

    airframe: Airframe
    site: Site
    air: HillAir  # of the site
    values: ParameterSet

    def blown(self, wind_mps: float) -> ShippedHill:
        """The same in another wind."""
        air = msgspec.structs.replace(self.air, wind_mps=wind_mps)
        return self._replace(site=msgspec.structs.replace(self.site, air=air), air=air)

    def on_line(self, name: str) -> ShippedHill:
        """The same with one of its lines to be flown, released below it."""
        line: Line = self.site.lines[name]
        start = Start(x_m=line.x_m, z_m=line.z_m - BELOW_M)
        site = msgspec.structs.replace(self.site, start=start)
        return self._replace(site=site, values=self.values.changed(line_parameters(line)))


def shipped_hill(airframe_name: str = AIRFRAME) -> ShippedHill:
    """As shipped, with one of the shipped aircraft.  Errors: `ConfigError`."""
    airframe, site, values = load_flight(airframe_file(airframe_name), site_file(SITE))
    assert isinstance(site.air, HillAir)
    return ShippedHill(airframe=airframe, site=site, air=site.air, values=values)
