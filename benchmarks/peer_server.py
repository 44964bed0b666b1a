"""The far side of `peer_process`: a planner that answers requests, one JSON object a line, from its own process.

Imports nothing but the standard library, as what is loaded first decides which C++ runtime a process has.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from typing import Any

READY = "ready\n"


def serve(solve: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
    """Say that all is imported, then answer until the input ends; what libraries print goes to the error stream."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    print(READY, end="", file=answers, flush=True)
    for line in sys.stdin:
        try:
            reply = solve(json.loads(line))
        except Exception as error:  # whatever a planner raises is its answer
            reply = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(reply), file=answers, flush=True)
