"""Files on disk that are read again when they change, as somebody edits them elsewhere: scenes, meshes, motions.

A file is read once it is the same at two looks, so that half of one is not; what cannot be read is reported in a line,
and changes nothing.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from hdplan.scenes.errors import HdplanError, MissingFileError
from hdplan.scenes.files import Stamps, stamps_of
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import files_of

EVERY = 0.3  # [s] between two looks
Seen = Mapping[Path, Stamps]
"""Files as they were at some moment: before they are read, so that no change after it is missed."""


def seen(files: Iterable[Path]) -> Seen:
    """Return files as they are now."""
    return {file: stamps_of([file]) for file in files}


def seen_meshes(scene: Scene) -> Seen:
    """Return the files of a scene's obstacles and held objects, which are read after the scene, as they are now."""
    shapes = [each.shape for each in scene.obstacles] + [each.shape for each in scene.attached]
    return seen(file for shape in shapes for file in files_of(shape))


class Source:
    """Something that is read from files."""

    def __init__(self, own: Seen, read: Callable[[], Seen | None], others: Seen | None = None) -> None:
        """Take its files and those that they name, as they were before they were read, and what reads them again: it
        returns the others that are named by then, or None where they are not known. It is called by the thread that
        looks."""
        self._own, self._read = tuple(own), read
        self._known = {**own, **(others or {})}
        self._at_last_look: Seen = self._known

    @classmethod
    def of_scene(
        cls,
        own: Seen,
        meshes: Seen,
        load: Callable[[], Scene],
        take: Callable[[Scene], object],
        refuse: Callable[[HdplanError], object],
    ) -> Source:
        """Return the source of a scene: `load` reads it, `take` shows it, and `refuse` reports why neither was
        possible."""

        def read() -> Seen | None:
            named: Seen | None = None
            try:
                scene = load()
                named = seen_meshes(scene)  # also of a scene that is not taken: what is wrong may be in them
                take(scene)
            except HdplanError as error:
                refuse(error)
                if isinstance(error, MissingFileError):
                    named = {Path(error.file): ()}  # which may come after the scene that names it
            return named

        return cls(own, read, meshes)

    def look(self) -> None:
        """Read the source again if a file has changed or gone, and no program is still writing or replacing it."""
        now = seen(self._known)
        if now != self._known and now == self._at_last_look:
            others = self._read()
            self._known = {**now} if others is None else {**others, **{file: now[file] for file in self._own}}
        self._at_last_look = now


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
