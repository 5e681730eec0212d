"""A MAVSDK client as a process: `mavsdk_metadata.py PORT`, the parameters' metadata on its output.

It asks component 191 for COMPONENT_METADATA and reads by MAVLink FTP what that names, as a program
written with MAVSDK would; the first try that comes through ends it.
"""

from __future__ import annotations

import sys
import time

from mavsdk.component_type import ComponentType
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.component_metadata import (
    ComponentMetadata,
    ComponentMetadataError,
    MetadataType,
)

COMPONENT = 191
PATIENCE_S = 60.0


def main(port: str) -> None:
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    mavsdk.add_any_connection(f"udpout://127.0.0.1:{port}")
    until = time.monotonic() + PATIENCE_S
    while not mavsdk.get_systems():
        assert time.monotonic() < until, "no system"
        time.sleep(0.1)
    metadata = ComponentMetadata(mavsdk.get_systems()[0])
    metadata.request_component(COMPONENT)
    while True:
        try:
            print(metadata.get_metadata(COMPONENT, MetadataType.PARAMETER).json_metadata)
        except ComponentMetadataError:
            assert time.monotonic() < until, "no metadata"
            time.sleep(0.2)
        else:
            return


if __name__ == "__main__":
    main(*sys.argv[1:])
