"""Output files: refused before the work begins if they cannot be written, and there whole or not at all."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from hdplan.scenes.errors import InputError


def check_writable(path: Path, endings: tuple[str, ...]) -> None:
    """Say early that an output file cannot be written, before the work whose result it is to hold.

    Tries it with an empty file beside it, which is taken away again. Raises InputError for another ending than
    `endings`, a folder in the way or missing, or whatever the system says.
    """
    if ending_of(path, endings) is None:
        raise InputError(f"{path}: ending '{path.suffix}', allowed are {', '.join(endings)}")
    if os.path.isdir(path):
        raise InputError(f"{path}: is a folder, a file name is needed")
    if os.path.exists(path) and not os.path.isfile(path):
        raise InputError(f"{path}: is no regular file, and would be replaced by one")
    if not os.path.isdir(path.parent):
        raise InputError(f"{path}: the folder {path.parent} does not exist")
    if os.path.exists(path) and not os.access(path, os.W_OK):
        raise InputError(f"{path}: cannot be written (permission denied)")
    with _beside(path):
        pass


def ending_of(path: Path, endings: Iterable[str]) -> str | None:
    """Return which of some endings a file's name has, in small letters or large; None for another one."""
    name = path.name.lower()
    return next((ending for ending in endings if name.endswith(ending) and name != ending), None)


def write_output(path: Path, data: bytes) -> None:
    """Write beside the target and rename: no reader meets half a file. Raises InputError saying why not."""
    with _beside(path) as temporary:
        temporary.write_bytes(data)
        os.replace(temporary, path)


@contextlib.contextmanager
def _beside(path: Path) -> Iterator[Path]:
    """Give an empty file in the folder of `path`, taken away at the end if it is still there."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.touch()
        try:
            yield temporary
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from error
