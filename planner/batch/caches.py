"""Cached results, sent to the workers of a cluster: outer bodies, pieces of meshes, proven pairs.

Entries of the disk cache are keyed by what they were made from, so one that does not fit is never read. A worker keeps
what it has. Data travel, never code: what is compiled stays on the machine that compiled it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from distributed import WorkerPlugin

from hdplan.distance.compiled.cache import cache_dir, write_whole

MOST_BYTES = 64_000_000  # that travel to each worker; the entries written last come first


def packed() -> dict[str, bytes]:
    """Return the entries of this machine's cache by their names in it, as many as may travel."""
    home = cache_dir()
    found = []
    for file in home.glob("*/*.json"):
        try:
            about = file.stat()
        except OSError:  # it is gone again
            continue
        if file.is_file() and not file.name.startswith("."):
            found.append((-about.st_mtime_ns, file, about.st_size))
    entries, left = {}, MOST_BYTES
    for _, file, size in sorted(found):
        left -= size
        if left < 0:
            break
        try:
            entries[f"{file.parent.name}/{file.name}"] = file.read_bytes()
        except OSError:
            continue
    return entries


class Caches(WorkerPlugin):  # type: ignore[misc]  # dask has no types
    """Writes entries into the cache of each worker, before its first problem."""

    name = "hdplan-caches"

    def __init__(self, entries: dict[str, bytes]) -> None:
        """Take the entries by their names in the cache."""
        self.entries = entries

    def setup(self, worker: Any) -> None:
        """Write what the worker's cache does not have. A folder that cannot be written is not used, as ever."""
        home: Path = cache_dir()
        for name, data in self.entries.items():
            if not (home / name).exists():
                write_whole(home / name, data)
        self.entries = {}  # the scheduler keeps them for others
