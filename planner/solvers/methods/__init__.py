"""The ways to solve a problem, one module each: its `SOLVER` says what it is and what it can take."""
