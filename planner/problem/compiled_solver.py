"""Solvers of CasADi's whose functions are generated C: what `nlpsol` evaluates, compiled once and kept on disk.

In: a nonlinear program that is one graph. Out: its solver, with the functions loaded from a library. What calls back
into Python cannot be written to C, and is refused by name.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from hdplan.distance.compiled.c_library import QUICK_FLAGS, loaded
from hdplan.scenes.errors import InputError

IN_C = frozenset(  # classes of functions that CasADi's CodeGenerator writes
    ("MXFunction", "SXFunction", "Map", "OmpMap", "ThreadMap", "Switch", "BSplineInterpolant", "LinearInterpolant")
    + ("FastNewton", "RungeKutta")
)


def compiled_solver(plugin: str, nlp: Mapping[str, ca.MX], options: Mapping[str, Any]) -> ca.Function | None:
    """Return the solver of a program; None where there is no C compiler. Raises InputError for a program that calls
    functions which cannot be written to C."""
    for name in ("f", "g"):
        if called := not_in_c(nlp[name]):
            raise InputError(
                f"compiled: {name} calls '{called[0]}', which CasADi cannot write to C; allowed is form symbolic"
            )
    interpreted = ca.nlpsol("solver", plugin, nlp, options)
    generator = ca.CodeGenerator("nlp.c", {"verbose": False})
    generator.add(interpreted.oracle())
    for name in interpreted.get_function():
        generator.add(interpreted.get_function(name))
    return loaded("nlp", generator.dump(), lambda path: ca.nlpsol("solver", plugin, path, options), QUICK_FLAGS)


def not_in_c(expression: ca.MX) -> list[str]:
    """Names of functions in an expression that CasADi cannot write to C: Python's, other libraries', some of its own
    solvers."""
    whole = ca.Function("whole", ca.symvar(expression), [expression])
    every = [whole, *whole.find_functions()]
    return [each.name() for each in every if each.class_name() not in IN_C]
