"""Which modules a compiled kernel is made of: all that they take from one another is among them, in
plain Python, without compiling anything."""

from __future__ import annotations

import sys
from importlib import import_module
from types import FunctionType

import pytest

from tgl_soar.sim import compiled as module
from tgl_soar.sim.compiled import COUNTED, MODULES, available, compiled

# What prepares a flight, or fits something to one, and never runs in a kernel.
BEFORE_OR_AFTER = {
    "tgl_soar.air.field": {"broadcast"},
    "tgl_soar.air.freestream": {"solve_free_jet"},
    "tgl_soar.air.kept_jets": {"kept"},
    "tgl_soar.air.relief": {"relieve", "relieved_velocity"},
    "tgl_soar.estimation.polar": {"PolarFit", "fit_polar"},
    "tgl_soar.sim.white_noise": {"with_drift"},
}
# What nothing else of them takes anything from: an aircraft, an air, and what is called from plain
# Python.
ON_TOP = {
    "tgl_soar.sim.point_mass",
    "tgl_soar.sim.compiled_air",
    "tgl_soar.sim.commanded_flight",
    "tgl_soar.sim.watched_flight",
    "tgl_soar.sim.lines_ahead",
}


def taken() -> dict[str, set[str]]:
    """Functions and named tuples that the modules take from others, by the module they are of."""
    found: dict[str, set[str]] = {}
    for name in MODULES:
        for each, value in vars(import_module(name)).items():
            is_code = isinstance(value, FunctionType) or (
                isinstance(value, type) and issubclass(value, tuple)
            )
            of = getattr(value, "__module__", "") or ""
            if is_code and of.startswith("tgl_soar") and of != name:
                found.setdefault(of, set()).add(each)
    return found


def test_all_that_the_modules_take_from_one_another_is_compiled_with_them() -> None:
    others = {of: names for of, names in taken().items() if of not in MODULES}
    assert others == BEFORE_OR_AFTER


def test_nothing_is_compiled_that_nobody_calls() -> None:
    assert set(MODULES) - set(taken()) == ON_TOP
    assert len(set(MODULES)) == len(MODULES)


def test_what_counts_its_arrays_is_there() -> None:
    names = {
        name
        for each in MODULES
        for name, value in vars(import_module(each)).items()
        if isinstance(value, FunctionType)
    }
    assert names >= COUNTED
    assert {"keep_sample", "delivered", "fly_given", "fly_ticks"} == COUNTED


def test_without_numba_it_is_reported_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "find_spec", lambda _name: None)
    assert not available()
    monkeypatch.setattr(module, "find_spec", lambda name: object() if name == "numba" else None)
    assert available()
    monkeypatch.setitem(sys.modules, "numba", None)
    with pytest.raises(ImportError, match=r"install tgl_soar\[fast\], or fly them plain"):
        module._kernels.__wrapped__()
    assert callable(compiled)


def test_the_named_tuples_of_a_module_are_its_own() -> None:
    aircraft = import_module("tgl_soar.sim.aircraft")
    names = {kind.__name__ for kind in module._named_tuples(aircraft)}
    assert names == {"AircraftModel", "AircraftState", "AirData", "Glide"}
