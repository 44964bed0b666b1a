"""Files of shapes by their endings: a file is read whole, or it is refused; and NumPy's own formats."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.files import read_file

_OBJECT = re.compile(r" ?<[^<>]* at 0x[0-9a-f]+>")  # as Python shows an object, with its address


def read_by_ending(path: Path, readers: Mapping[str, Callable[..., Any]], *more: Any) -> Any:
    """Return what the reader of a file's ending makes of its content, its path and `more`. Raises InputError for a file
    that is missing, not regular, too large, of an unknown format, or damaged."""
    data = read_file(path)  # first: a folder's name has no ending either, and "is a directory" says more
    ending = path.suffix.lower().lstrip(".")
    if ending not in readers:
        raise InputError(f"format '{path.suffix}' is not known{nearest(ending, readers)}")
    try:
        return readers[ending](data, path, *more)
    except InputError:
        raise
    except Exception as error:  # each reader fails in its own way, none in words for the user
        words = _OBJECT.sub("", " ".join(str(error).split())).partition(". ")[0][:100]  # more is for programmers
        why = f" ({words})" if words else ""
        raise InputError(f"cannot be read, its content is not that of a .{ending} file{why}") from error


def numpy_readers(name: str, what: str) -> dict[str, Callable[[bytes, Path], np.ndarray]]:
    """Return the readers of NumPy's files, by ending; of several arrays in one, `what` is needed is the one of a
    `name`."""

    def npz(data: bytes, _: Path) -> np.ndarray:
        with np.load(io.BytesIO(data), allow_pickle=False) as held:
            names = held.files
            if name not in names and len(names) != 1:
                raise InputError(f"holds the arrays {', '.join(names) or 'none'}: the {what} must be named `{name}`")
            return np.asarray(held[name if name in names else names[0]])

    return {"npz": npz, "npy": lambda data, _: np.asarray(np.load(io.BytesIO(data), allow_pickle=False))}
