"""What a user can cause. Every message is one line that names the file, the field, the value and what is allowed."""

from __future__ import annotations

import contextlib
import difflib
from collections.abc import Iterable, Iterator


class HdplanError(Exception):
    """Base of every error that hdplan raises on purpose; its text is meant for the user."""


class InputError(HdplanError):
    """Bad input: a file, a field, a name or a number. The command line ends with exit code 2."""


def nearest(name: str, allowed: Iterable[str], otherwise: str = "") -> str:
    """Return `` (did you mean 'x'?)`` for the closest allowed name; if none is close, `otherwise`, or all of them."""
    names = sorted(allowed)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    if close:
        return f" (did you mean '{close[0]}'?)"
    if otherwise:
        return f" ({otherwise})"
    return f" (allowed: {', '.join(names)})" if names else " (none is allowed here)"


@contextlib.contextmanager
def naming(where: object) -> Iterator[None]:
    """Put the file that is being read in front of what is wrong within: ``where: error``."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
