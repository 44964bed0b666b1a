"""Files on disk that are read again when they change, as somebody edits them elsewhere: scenes, meshes, motions.

A file is read once it is the same at two looks, so that half of one is not; what cannot be read is reported in a line,
and changes nothing.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from hdplan.scenes.files import Stamps, stamps_of

EVERY = 0.3  # [s] between two looks


class Source:
    """Something that is read from files."""

    def __init__(self, files: Callable[[], Sequence[Path]], read: Callable[[], object]) -> None:
        """Take what names its files, and what reads them again. They were read just now."""
        self._files, self._read = files, read
        self._known: dict[Path, Stamps] = {}  # as they were read last
        self._seen: dict[Path, Stamps] = {}  # at the last look
        self.look()

    def look(self) -> None:
        """Read again if a file has changed and is no longer being written, or replaced."""
        now = {file: stamps_of([file]) for file in self._files()}
        changed = any(self._known.get(file, stamps) != stamps for file, stamps in now.items())
        if changed and now == self._seen and all(now.values()):
            self._known = now
            self._read()
        elif not changed:
            self._known |= now
        self._seen = now


class Watch:
    """The thread that looks."""

    def __init__(self, sources: Sequence[Source]) -> None:
        """Start it."""
        self._sources, self._ended = sources, threading.Event()
        self._thread = threading.Thread(target=self._run, name="hdplan-watch", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End it."""
        self._ended.set()
        self._thread.join(timeout=5.0)

    def _run(self) -> None:
        while not self._ended.wait(EVERY):
            for source in self._sources:
                source.look()
