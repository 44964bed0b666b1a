"""How much memory a process has had."""

from __future__ import annotations

import resource
import sys
from pathlib import Path


def most_memory() -> int:
    """The most memory [bytes] that this process has held; Linux's own count, as that of getrusage survives an exec and
    so may be the parent's."""
    status = Path("/proc/self/status")
    if status.is_file():
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
