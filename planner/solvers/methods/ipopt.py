"""Ipopt: an interior-point method with a filter line search, for any nonlinear program (Wächter & Biegler, On the
implementation of an interior-point filter line-search algorithm, Mathematical Programming 106, 2006)."""

from __future__ import annotations

import functools

from hdplan.planner.solvers import interior_point
from hdplan.planner.solvers.solution import Solver

OPTIONS = {
    "print_level": 0,
    "sb": "yes",  # no banner
    "mu_init": interior_point.FIRST_BARRIER,
    "bound_relax_factor": 0.0,  # joint limits are kept to the last digit
}

SOLVER = Solver(functools.partial(interior_point.solve, "ipopt", OPTIONS))
