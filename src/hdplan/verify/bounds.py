"""Bounds of the time and memory that a check takes, whatever the files say: of a process of its own."""

from __future__ import annotations

import json
import os
import sys
import threading
from pathlib import Path

MOST_MEMORY = 1 << 31  # bytes that a check may take beside Python itself
MOST_TIME, MOST_WAIT = 30, 60  # [s] of a processor, and by the clock


def bounded(parts: int = 1) -> None:
    """Let this process take at most MOST_MEMORY, and MOST_TIME and MOST_WAIT for as many parts, whatever the files say:
    beyond that, the proof is rejected."""
    most, wait = parts * MOST_TIME, parts * MOST_WAIT
    late = threading.Timer(wait, _give_up, (f"needs more than {wait} s",))
    late.daemon = True
    late.start()
    if sys.platform == "linux":
        import resource
        import signal

        def at_most(kind: int, soft: int, hard: int) -> None:
            allowed = resource.getrlimit(kind)[1]
            free = allowed == resource.RLIM_INFINITY
            resource.setrlimit(kind, (soft, hard) if free else (min(soft, allowed), min(hard, allowed)))

        signal.signal(signal.SIGXCPU, lambda *_: _give_up(f"needs more than {most} s of a processor"))
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        at_most(resource.RLIMIT_AS, used + MOST_MEMORY, used + MOST_MEMORY)
        at_most(resource.RLIMIT_CPU, most, most + 5)


def _give_up(words: str) -> None:
    as_json = "--json" in sys.argv
    os.write(1, (json.dumps([words, None]) if as_json else f"rejected: {words}\n").encode())
    os._exit(1)
