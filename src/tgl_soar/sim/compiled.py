"""A compiled kernel of the laws and the model: the same source, taken by numba as it stands.

A kernel has the byte code of the plain one and a namespace of its own, in which every
function of the kernel's modules is compiled too.  Nothing that flies knows of it: no decorator,
no copy, no import.  Named tuples are the plain ones, so that a value made in plain Python goes
in, and what comes out is read as ever.

numba knows named tuples but neither their `_replace` nor their methods: both are taught below,
for the fields and methods of the modules' tuples.  So a function takes any object that has a
method where it runs plainly, and the tuples that have it where it is compiled.

Compiled functions raise what the plain ones raise (division by zero too) and let other threads
run meanwhile.  Each is inlined where it is called: otherwise handing over hundreds of numbers
would cost as much as the arithmetic.  What is called from outside is kept on disk
(`kernel_cache`).

numba counts who holds an array or a list, and does so again for all of them wherever a named tuple
is handed over or a field of it is read: five hundred atomic operations a tick, more than half of
its time.  Only what is called from outside counts them, once a call, and what hands them to
functions that numba itself compiles (`COUNTED`).  The others may not make nor return any.

Of an index into a tuple that is only known in flight numba makes a switch, at which LLVM may move
hundreds of numbers of the flight on the stack; so it may where branches that return a whole flight
come together.  What every tick reads has constant indices, where that was seen to cost.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from types import FunctionType, ModuleType
from typing import Any, Final, TypeVar, cast

from tgl_soar.sim.kernel_cache import kept

# Downward, as they import each other.
MODULES: Final = (
    "tgl_soar.types",
    "tgl_soar.geometry",
    "tgl_soar.control.pid",
    "tgl_soar.control.attitude",
    "tgl_soar.control.heading",
    "tgl_soar.control.soaring",
    "tgl_soar.control.gain_blend",
    "tgl_soar.control.pitch_schedule",
    "tgl_soar.control.lateral_schedule",
    "tgl_soar.control.target_line",
    "tgl_soar.control.supervisor",
    "tgl_soar.control.brake_watch",
    "tgl_soar.control.brake_shake",
    "tgl_soar.control.point_hold",
    "tgl_soar.control.envelope",
    "tgl_soar.control.throttle",
    "tgl_soar.control.excitation",
    "tgl_soar.control.line_room",
    "tgl_soar.control.forecast",
    "tgl_soar.estimation.inertial_track",
    "tgl_soar.estimation.fix_filter",
    "tgl_soar.estimation.attitude_track",
    "tgl_soar.estimation.motion_state",
    "tgl_soar.estimation.position_fixes",
    "tgl_soar.estimation.motion",
    "tgl_soar.estimation.ground_range",
    "tgl_soar.estimation.health",
    "tgl_soar.estimation.aerodynamics",
    "tgl_soar.estimation.body_axes",
    "tgl_soar.estimation.accelerometer_bias",
    "tgl_soar.estimation.pitot_watch",
    "tgl_soar.estimation.wind",
    "tgl_soar.estimation.cross_wind",
    "tgl_soar.control.laws",
    "tgl_soar.control.envelope_margins",
    "tgl_soar.control.conditions",
    "tgl_soar.control.point",
    "tgl_soar.control.estimates",
    "tgl_soar.control.launch",
    "tgl_soar.control.airspeed_error",
    "tgl_soar.control.wind_triangle",
    "tgl_soar.control.weaving",
    "tgl_soar.control.airspeed_hold",
    "tgl_soar.control.landing",
    "tgl_soar.control.ridge_beat",
    "tgl_soar.control.glide_home",
    "tgl_soar.control.surface_loops",
    "tgl_soar.control.launch_landing",
    "tgl_soar.control.power",
    "tgl_soar.autopilot",
    "tgl_soar.air.grid",
    "tgl_soar.air.hill",
    "tgl_soar.air.jet",
    "tgl_soar.air.polynomial",
    "tgl_soar.air.gusts",
    "tgl_soar.sim.propeller",
    "tgl_soar.sim.aircraft",
    "tgl_soar.sim.point_mass",
    "tgl_soar.sim.tether",
    "tgl_soar.sim.servos",
    "tgl_soar.sim.sensors",
    "tgl_soar.sim.sensor_sampling",
    "tgl_soar.sim.compiled_air",
    "tgl_soar.sim.world_step",
    "tgl_soar.sim.flight",
    "tgl_soar.sim.commanded_flight",
    "tgl_soar.sim.watched_flight",
    "tgl_soar.estimation.lift_map.extended_polar",
    "tgl_soar.control.search.ahead",
    "tgl_soar.sim.lines_ahead",
)

# Functions of these names, which write to a list, or a whole row of an array.
COUNTED: Final = frozenset({"keep_sample", "delivered", "fly_given", "fly_ticks"})
Plain = TypeVar("Plain", bound=Callable[..., Any])


def available() -> bool:
    """Whether numba is installed (the extra `fast`)."""
    return find_spec("numba") is not None


def compiled(function: Plain) -> Plain:
    """The compiled kernel of a function of `MODULES`; it compiles when it is first called,
    unless it has been compiled before.

    Errors: ImportError without numba; KeyError for a function of another module.
    """
    return cast(Plain, _entry(cast(FunctionType, function)))


def cell(value: object) -> Any:
    """A cell with one field, `value`, that compiled functions read and write.

    Handing a cell over costs as much as handing over a float, whatever lies in it.
    """
    from tgl_soar.sim.cells import NumbaCell

    return NumbaCell(value)


@cache
def _entry(function: FunctionType) -> Any:
    """A kernel that is called from outside."""
    return kept(_kernels()[function].py_func, (*MODULES, __name__, "tgl_soar.sim.cells"))


@cache
def _options() -> dict[str, Any]:
    """Of a function inside a kernel.

    Nothing calls it from Python: numba makes no wrapper for that, which would take longer than the
    function wherever it is handed hundreds of numbers, and no machine code.
    """
    from tgl_soar.sim.inlined_functions import InnerCompiler

    return {
        "nogil": True,
        "forceinline": True,
        "no_cpython_wrapper": True,
        "no_cfunc_wrapper": True,
        "pipeline_class": InnerCompiler,
    }


@cache
def _kernels() -> dict[FunctionType, Any]:
    try:
        from numba import njit
    except ImportError as error:
        raise ImportError(
            "compiled flights need numba: install tgl_soar[fast], or fly them plain"
        ) from error
    compiles: Callable[..., Any] = njit  # its annotations leave options out
    modules = [import_module(name) for name in MODULES]
    _teach_replace(modules)
    spaces = {module: dict(vars(module)) for module in modules}
    kernels: dict[FunctionType, Any] = {}
    for module, space in spaces.items():
        for name, value in vars(module).items():
            if isinstance(value, FunctionType) and value.__module__ == module.__name__:
                kernel = FunctionType(value.__code__, space, name, value.__defaults__)
                kernels[value] = compiles(**_options(), _nrt=name in COUNTED)(kernel)
    _teach_methods(spaces, compiles)
    named = {module: ModuleType(module.__name__) for module in modules}
    for module, space in spaces.items():
        for name, value in vars(module).items():
            if isinstance(value, FunctionType) and value in kernels:
                space[name] = kernels[value]
            elif isinstance(value, ModuleType) and value in named:
                space[name] = named[value]
        vars(named[module]).update(space)
    return kernels


def _teach_methods(spaces: dict[ModuleType, dict[str, Any]], njit: Callable[..., Any]) -> None:
    """Teach numba the methods of the modules' named tuples."""
    from numba.core import types
    from numba.extending import overload_method

    methods: dict[str, dict[type, Any]] = {}
    for module, space in spaces.items():
        for kind in _named_tuples(module):
            for name, method in vars(kind).items():
                if isinstance(method, FunctionType) and not name.startswith("_"):
                    kernel = FunctionType(method.__code__, space, name, method.__defaults__)
                    methods.setdefault(name, {})[kind] = njit(**_options(), _nrt=False)(kernel)
    for name, kernels in methods.items():
        teach: Any = overload_method(types.BaseNamedTuple, name, jit_options=_options())  # type: ignore[call-arg]
        teach(_method_of(kernels))


def _named_tuples(module: ModuleType) -> list[type]:
    """Those that a module defines."""
    return [
        value
        for value in vars(module).values()
        if isinstance(value, type)
        and issubclass(value, tuple)
        and value.__module__ == module.__name__
    ]


def _method_of(kernels: dict[type, Any]) -> Callable[..., Any]:
    """The method of one name, of whichever named tuple it is called."""

    # No annotations: numba compares the signature with that of what is returned.
    def choose(self, *arguments):  # type: ignore[no-untyped-def]  # noqa: ARG001
        kernel = kernels.get(self.instance_class)
        if kernel is None:
            return None
        return lambda self, *arguments: kernel(self, *arguments)

    return choose


def _teach_replace(modules: list[ModuleType]) -> None:
    """Teach numba `_replace` with any of the fields of the modules' named tuples."""
    from numba.core import types
    from numba.extending import overload_method

    fields: set[str] = set()
    for module in modules:
        for kind in _named_tuples(module):
            fields.update(getattr(kind, "_fields", ()))
    # numba wants every keyword in the signature: it is written here and not by hand.
    signature = "self, " + ", ".join(f"{field}=None" for field in sorted(fields))

    def implementation(given: dict[str, Any]) -> Any:
        kind = given["self"].instance_class
        changed = {name for name, value in given.items() if value is not None} - {"self"}
        values = (field if field in changed else f"self.{field}" for field in kind._fields)
        space: dict[str, Any] = {"_kind": kind}  # no field's name begins so
        exec(f"def replaced({signature}): return _kind({', '.join(values)})", space)
        return space["replaced"]

    def omitted(value: Any) -> bool:
        return value is None or isinstance(value, types.NoneType | types.Omitted)

    space: dict[str, Any] = {"implementation": implementation, "omitted": omitted}
    exec(
        f"def choose({signature}):\n"
        "    given = locals()\n"
        "    return implementation({k: None if omitted(v) else v for k, v in given.items()})",
        space,
    )
    overload_method(types.BaseNamedTuple, "_replace")(space["choose"])
