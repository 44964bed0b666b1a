"""A small cache on disk, keyed by content: results that were computed from the same input are read back.

It only saves time: an entry that is missing, damaged, unreadable or another one's is computed again, and a folder that
cannot be written is not used, which a warning says. Entries are written whole or not at all. The folder is
`$HDPLAN_CACHE`, or else the user's own. Where others may write in it or above it, it is not used: what they put there
would be believed.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import stat
import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import platformdirs

from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError

Value = TypeVar("Value")


def cache_dir() -> Path:
    """Return the cache's folder: `$HDPLAN_CACHE`, or the user's cache folder for hdplan. It need not exist."""
    return Path(os.environ.get("HDPLAN_CACHE") or platformdirs.user_cache_dir("hdplan"))


def content_key(*parts: str | bytes) -> str:
    """Return a key for these parts, in this order: equal parts give equal keys, others different ones."""
    digest = hashlib.blake2b(digest_size=20)
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        digest.update(len(data).to_bytes(8, "little"))
        digest.update(data)
    return digest.hexdigest()


def load(kind: str, key: str, read: Callable[[Any], Value | None]) -> Value | None:
    """Return the result of `read` for the JSON value stored under this kind and key; None if there is no intact one, or
    one of another structure, at which `read` fails."""
    if not trusted():
        return None
    try:
        checksum, _, text = (cache_dir() / kind / f"{key}.json").read_text(encoding="utf-8").partition("\n")
        return read(json.loads(text)) if checksum == content_key(kind, key, text) else None
    except (OSError, ValueError, TypeError, LookupError, AttributeError, OverflowError, RecursionError, InputError):
        return None


def finite(values: Any) -> Array:
    """Return the numbers of an entry, for its reader. Raises ValueError for one that is not finite."""
    numbers = np.array(values, dtype=np.float64)
    if not np.isfinite(numbers).all():
        raise ValueError("a number that is not finite")
    return numbers


def store(kind: str, key: str, value: Any) -> None:
    """Store a JSON value; does nothing where the folder cannot be written."""
    text = json.dumps(value)
    write_whole(cache_dir() / kind / f"{key}.json", f"{content_key(kind, key, text)}\n{text}".encode())


def trusted() -> bool:
    """True if nobody else may write to the cache's folder, which need not exist. Warns once if others may."""
    home = cache_dir()
    if home in _trusted:
        return True
    if (why := _open_to(home)) is not None:
        _warn_once(home, why)
    elif home.exists():
        _trusted.add(home)
    return why is None


_trusted: set[Path] = set()  # folders that exist and were examined in this process


def _open_to(home: Path) -> str | None:
    """Return the folder to which others may write, among the cache's and all above it; None if there is none. In a
    sticky folder such as /tmp, others can add files, but not change the user's."""
    if sys.platform == "win32":  # where a user's folders are the user's
        return None
    home = home.resolve()
    for folder in (home, *home.parents):
        try:
            about = folder.stat()
        except OSError:  # it does not exist yet, or cannot be used at all
            continue
        if about.st_uid not in (0, os.geteuid()):
            return f"is not used ({folder} belongs to another user)"
        if about.st_mode & 0o022 and (folder == home or not about.st_mode & stat.S_ISVTX):
            return f"is not used ({folder} can be written by others)"
    return None


def write_whole(path: Path, data: bytes) -> bool:
    """Write a file of the cache so that other processes see all of it or nothing; return whether that succeeded. Warns
    once where it did not."""
    if not trusted():
        return False
    try:
        if not cache_dir().exists():
            cache_dir().mkdir(mode=0o700, parents=True, exist_ok=True)
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=path.suffix)
    except OSError as error:
        _warn_once(cache_dir(), f"cannot be written ({error.strerror})")
        return False
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        os.replace(temporary, path)
    except OSError as error:
        Path(temporary).unlink(missing_ok=True)
        _warn_once(cache_dir(), f"cannot be written ({error.strerror})")
        return False
    return True


@functools.cache
def _warn_once(home: Path, why: str) -> None:
    warnings.warn(
        f"the cache {home} {why}, so expensive results are computed again each time: set HDPLAN_CACHE to a folder that "
        "only you can write",
        stacklevel=4,
    )
