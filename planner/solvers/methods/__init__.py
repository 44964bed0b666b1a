"""The solvers, one module each: its `SOLVER` describes it."""
