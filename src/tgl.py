"""`module load tgl` of MAVProxy finds this.

MAVProxy looks for `MAVProxy.modules.mavproxy_tgl`, a place inside its own package, and then for a
module of the bare name.
"""

from tgl_soar.cli.mavproxy_tgl import init

__all__ = ["init"]
