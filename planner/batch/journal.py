"""The results of a run as they come: one file, to which every outcome is added whole.

A line is a checksum and an outcome as JSON. What a killed process left half-written at the end has no right checksum
and is cut off when the run resumes.
"""

from __future__ import annotations

import base64
import json
import os
import sys
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from hdplan.planner.batch.outcome import Outcome
from hdplan.planner.motion.trajectory import StageMark, Trajectory
from hdplan.scenes.errors import InputError

LOCKED = 1 << 40  # the byte that is locked where a lock keeps readers away too; beyond all that is written
ARRAYS = ("positions", "times", "velocities", "accelerations")


class Journal:
    """Outcomes by their problems' numbers, on disk."""

    def __init__(self, path: Path) -> None:
        """Open a journal, or begin one. Raises InputError if another process has it, or if it cannot be written."""
        self.path, self.places = path, dict[int, tuple[int, int]]()  # number of a problem -> offset and size [bytes]
        self.end = 0
        try:
            path.touch(0o644)
            self.file = path.open("r+b", buffering=0)
            try:
                _lock(self.file)
            except OSError:
                self.file.close()
                raise InputError(f"{path.parent}: another process is writing this run") from None
            for number, line in _whole_lines(path):
                self.places[number] = self.end, len(line)
                self.end += len(line)
            self.file.truncate(self.end)
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({error.strerror})") from None

    def add(self, number: int, outcome: Outcome) -> None:
        """Add an outcome. Raises InputError if it cannot be written, such as on a full disk; what is there stays."""
        content = json.dumps({"number": number, **_plain(outcome)}, allow_nan=False).encode()
        line = b"%08x %s\n" % (zlib.crc32(content), content)
        try:
            self.file.seek(self.end)
            if self.file.write(line) != len(line):
                raise OSError(28, os.strerror(28))
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written ({error.strerror})") from None
        self.places[number] = self.end, len(line)
        self.end += len(line)

    def __iter__(self) -> Iterator[tuple[int, Outcome]]:
        """Yield all outcomes in the order of their problems."""
        for number in sorted(self.places):
            offset, size = self.places[number]
            self.file.seek(offset)
            yield number, _outcome(json.loads(self.file.read(size)[9:]))

    def close(self) -> None:
        """Close the file."""
        self.file.close()


def _lock(file: BinaryIO) -> None:
    """Keep a file from other writers until it is closed. Raises OSError if one has it."""
    if sys.platform == "win32":
        import msvcrt

        file.seek(LOCKED)
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
    else:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def read_journal(path: Path) -> list[Outcome]:
    """Return all outcomes so far, without their motions, in the order of their problems; of a finished or running run.
    Raises InputError."""
    try:
        found = {number: json.loads(line[9:]) for number, line in _whole_lines(path)}
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    return [_outcome({**found[number], "trajectory": None}) for number in sorted(found)]


def _whole_lines(path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield the lines up to the first that is not whole, with their problems' numbers."""
    with open(path, "rb") as lines:
        for line in lines:
            if not line.endswith(b"\n") or line[:9] != b"%08x " % zlib.crc32(line[9:-1]):
                break
            yield json.loads(line[9:])["number"], line


def _plain(outcome: Outcome) -> dict[str, Any]:
    record = {key: value for key, value in vars(outcome).items() if key not in ("trajectory", "files")}
    motion = outcome.trajectory
    if motion is None:
        return record
    given = {key: getattr(motion, key) for key in ARRAYS}
    arrays = {key: base64.b64encode(x.astype("<f8").tobytes()).decode() for key, x in given.items() if x is not None}
    marks = [[mark.name, mark.row] for mark in motion.stages]
    about = {"joint_names": motion.joint_names, "locked": dict(motion.locked), "stages": marks}
    return {**record, "trajectory": {**about, **arrays}}


def _outcome(record: dict[str, Any]) -> Outcome:
    del record["number"]
    motion = record.pop("trajectory", None)
    if motion is not None:
        names = tuple(motion["joint_names"])
        arrays = {key: np.frombuffer(base64.b64decode(motion[key]), "<f8") for key in ARRAYS if key in motion}
        shaped: dict[str, Any] = {key: x if key == "times" else x.reshape(-1, len(names)) for key, x in arrays.items()}
        marks = tuple(StageMark(*mark) for mark in motion.get("stages", ()))
        motion = Trajectory(names, locked=motion["locked"], stages=marks, **shaped)
    return Outcome(**record, trajectory=motion)
