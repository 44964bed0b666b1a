"""Output files: refused before the work begins if they cannot be written, and written whole or not at all."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from hdplan.scenes.errors import InputError


def check_writable(path: Path, endings: tuple[str, ...]) -> None:
    """Raise early, before the work is done, if its output file cannot be written.

    Tries to write an empty file beside it and removes it again. Raises InputError for an ending other than `endings`, a
    folder of that name, a missing folder, or whatever error the system reports.
    """
    if ending_of(path, endings) is None:
        raise InputError(f"{path}: ending '{path.suffix}', allowed are {', '.join(endings)}")
    if os.path.isdir(path):
        raise InputError(f"{path}: is a folder, a file name is needed")
    if os.path.exists(path) and not os.path.isfile(path):
        raise InputError(f"{path}: is not a regular file, and would be replaced by one")
    if not os.path.isdir(path.parent):
        raise InputError(f"{path}: the folder {path.parent} does not exist")
    if os.path.exists(path) and not os.access(path, os.W_OK):
        raise InputError(f"{path}: cannot be written (permission denied)")
    with _beside(path):
        pass


def ending_of(path: Path, endings: Iterable[str]) -> str | None:
    """Return the one of some endings that a file's name has, in lower or upper case; None if none of them."""
    name = path.name.lower()
    return next((ending for ending in endings if name.endswith(ending) and name != ending), None)


def write_output(path: Path, data: bytes) -> None:
    """Write beside the target and rename, so that no reader sees half a file. Raises InputError if it cannot be
    written."""
    with _beside(path) as temporary:
        temporary.write_bytes(data)
        os.replace(temporary, path)


def check_new_folder(path: Path) -> None:
    """Raise early, before the work is done, if a folder cannot be made: there is something of this name already, or the
    folder around it is missing or cannot be written. Raises InputError."""
    if os.path.lexists(path):
        raise InputError(f"{path}: exists already, and is not replaced: name a new folder")
    if not os.path.isdir(path.parent):
        raise InputError(f"{path}: the folder {path.parent} does not exist")
    with _beside(path, folder=True):
        pass


def write_folder(path: Path, files: Mapping[str, bytes]) -> None:
    """Write files into a new folder: all of them or none. Raises InputError if they cannot be written."""
    with _beside(path, folder=True) as temporary:
        for name, data in files.items():
            (temporary / name).write_bytes(data)
        os.rename(temporary, path)  # refused if there is a file by now, or a folder with something in it


@contextlib.contextmanager
def _beside(path: Path, folder: bool = False) -> Iterator[Path]:
    """Yield an empty file, or folder, in the folder of `path`, removed at the end if it still exists."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.mkdir() if folder else temporary.touch()
        try:
            yield temporary
        finally:
            if folder:
                shutil.rmtree(temporary, ignore_errors=True)
            else:
                temporary.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from error
