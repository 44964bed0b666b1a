"""The solvers, one module each: its `SOLVER` says what it is and what it can handle."""
