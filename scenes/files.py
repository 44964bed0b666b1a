"""Input files: regular files of a bounded size. Anything else is refused before it is opened: reading a pipe without a
writer would block for ever, and reading a device might never end."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable
from pathlib import Path

from hdplan.scenes.errors import InputError

Stamps = tuple[tuple[str, int, int, int, int], ...]  # file, inode, times of change [ns], size [bytes]

MOST_BYTES = 100_000_000
_KINDS = {
    stat.S_IFDIR: "a directory",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def read_file(path: Path) -> bytes:
    """Return the content of a file.

    Raises:
        InputError: it is missing, not a regular file, too large, or unreadable; the message does not name the path.
    """
    check_file(path)
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error})") from None


def check_file(path: Path) -> None:
    """Raise what `read_file` raises before it reads."""
    try:
        about = os.stat(path)
    except FileNotFoundError:
        words = f"is a link to {os.readlink(path)}, which does not exist" if leads_nowhere(path) else "no such file"
        raise InputError(words) from None
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        raise InputError(f"cannot be read ({getattr(error, 'strerror', None) or error})") from None
    if not stat.S_ISREG(about.st_mode):
        kind = _KINDS.get(stat.S_IFMT(about.st_mode), "something else")
        raise InputError(f"is {kind}, not a file")
    if about.st_size > MOST_BYTES:
        raise InputError(f"is {about.st_size / 1e6:.0f} MB large; files of at most {MOST_BYTES / 1e6:.0f} MB are read")


def leads_nowhere(path: str | os.PathLike[str]) -> bool:
    """True if a path is a link to what does not exist."""
    return os.path.islink(path) and not os.path.exists(path)


def stamps_of(files: Iterable[str | Path]) -> Stamps:
    """Return the stamps by which files, and their content, differ from others; a missing file has no stamp.

    The inode is another one where a link leads elsewhere; the time when the inode changed (ctime) can be set by nobody,
    as that of the content (mtime) is by whatever copies or unpacks files.
    Caches of files use stamps taken *before* the files are read: one that changes meanwhile is read again.
    """
    found = []
    for file in files:
        try:
            about = os.stat(file)
        except (OSError, ValueError):
            continue
        found.append((str(file), about.st_ino, about.st_ctime_ns, about.st_mtime_ns, about.st_size))
    return tuple(found)
