"""fatrop: Ipopt's method, with the linear algebra of optimal control, stage by stage, so that a step costs O(N n³)
(Vanroye et al., FATROP, IROS 2023)."""

from __future__ import annotations

import functools

from hdplan.planner.solvers import interior_point
from hdplan.planner.solvers.solution import Solver

OPTIONS = {"print_level": 0, "mu_init": interior_point.FIRST_BARRIER}

SOLVER = Solver(functools.partial(interior_point.solve, "fatrop", OPTIONS))
