"""Small airframe, site and scenario files: what the fuzzer begins from beside those that ship."""

from __future__ import annotations

from typing import Final


def without_words(toml: bytes) -> bytes:
    """A file without its comments."""
    lines = (line.partition(b" #")[0].rstrip() for line in toml.splitlines())
    return b"\n".join(line for line in lines if line and not line.startswith(b"#"))


# Files of one table each: what stands there is looked at before it is missed what does not.
SMALL_FILES: Final = (
    b"[site]\nname = 'a'\norigin_north_m = 1.5\nwind_from_deg = 90\n",
    b"site.name = 'a'\nlines.a = { x_m = 0.2, z_m = 1.15, lean_deg = 3 }\nlines.b.x_m = 1\n",
    b"[parameters]\nTGL_X = 0.5\nRHO_P = 1.0\nOP_RC_CHAN = 8\n",
    b"[surfaces.elevator]\nchannel = 2\npwm_min = 1000\npwm_trim = 1500\nreversed = true\n",
    b"[autopilot]\nfirmware = 'px4'\nsystem = 1\noperators = [255]\n",
    b"[polar]\npoints = [[8.0, 0.5], [9.0, 0.6]]\n",
    b"faults = ['position.dropout start=12 for=0.5']\nduration_s = 1e1\nseed = 0x7f\n",
    b'[[wind]]\ntime_s = 0.5\nspeed = inf\n[ground]\nfile = "../x.csv"\n',
)
