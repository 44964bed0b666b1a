"""Errors that a user can cause. Every message is one line that names the file, the field, the value and what is
allowed.
"""

from __future__ import annotations

import contextlib
import difflib
import os
from collections.abc import Collection, Iterable, Iterator


def one_line(text: str) -> str:
    """Return a text as one line, whatever names it repeats: characters that do not print are escaped."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


class HdplanError(Exception):
    """Base class of every error that hdplan raises on purpose; its text is meant for the user."""

    def __str__(self) -> str:
        """Return the message, on one line."""
        return one_line(super().__str__())


class InputError(HdplanError):
    """Bad input: a file, a field, a name or a number. The command line ends with exit code 2."""


class MissingFileError(InputError):
    """A file that another one names, and that does not exist: it may come later, where files are followed."""

    def __init__(self, text: str, file: str) -> None:
        """Take the message and the file's path."""
        super().__init__(text)
        self.file = file

    def __reduce__(self) -> tuple[type, tuple[str, str]]:
        """Pickle both."""
        return type(self), (self.args[0], self.file)


class UnsolvableError(InputError):
    """A valid problem that has no solution as it stands: `cause` is the code of the reason, such as "end_in_contact",
    and `by` names the obstacles that shut a goal off."""

    def __init__(self, text: str, cause: str, by: tuple[str, ...] = ()) -> None:
        """Take the message, the cause and the names."""
        super().__init__(text)
        self.cause, self.by = cause, by

    def __reduce__(self) -> tuple[type, tuple[str, str, tuple[str, ...]]]:
        """Pickle all of them."""
        return type(self), (self.args[0], self.cause, self.by)


class MisplacedError(InputError):
    """A stage of a job that cannot be done from where the robot is: it may be from elsewhere, where a stage
    before it leaves a choice."""


class NotProvenError(HdplanError):
    """No proof of a motion can be written; the text gives the reason."""


class TimeLimitError(HdplanError):
    """The time limit passed before anything was found, so more time may help: neither bad input nor a problem that has
    no solution. The command line ends with exit code 1."""


class FieldError(InputError):
    """A value that its field does not allow. The reader that knows the file, and the field's place in it, adds them."""

    def __init__(self, problem: str, where: str = "", value: object = None, kind: str = "") -> None:
        """Describe the `problem` of the field `where` ("size[1]"). `kind` is the kind of value expected ("number",
        "text"), by which a reader may add a hint."""
        super().__init__(f"{where}: {problem}" if where else problem)
        self.problem, self.where, self.value, self.kind = problem, where, value, kind

    def within(self, where: str) -> FieldError:
        """Return this error as an error of a field inside `where`."""
        path = where if not self.where else f"{where}{'' if self.where.startswith('[') else '.'}{self.where}"
        return FieldError(self.problem, path, self.value, self.kind)

    def of(self, owner: str) -> FieldError:
        """Return this error with the name of the field's class."""
        error = FieldError(self.problem, self.where, self.value, self.kind)
        error.args = (f"{owner}{'.' if self.where else ': '}{self}",)
        return error


DEBUG = "HDPLAN_DEBUG"  # in the environment: shows an internal error whole, not only its line


def debugging() -> bool:
    """True if whoever runs this requires internal errors whole."""
    return os.environ.get(DEBUG, "0") not in ("", "0")


def nearest(name: str, allowed: Iterable[str], otherwise: str = "") -> str:
    """Return `` (did you mean 'x'?)`` for the closest allowed name, whatever its case; if none is close, `otherwise`,
    or all of them."""
    names = sorted(allowed)
    by_lower = {each.lower(): each for each in names}
    close = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=0.6)
    if close:
        return f" (did you mean '{by_lower[close[0]]}'?)"
    if otherwise:
        return f" ({otherwise})"
    return f" (allowed: {', '.join(names)})" if names else " (none is allowed here)"


LISTED_NAMES = 8  # names that an error or a note lists


def listed(names: Collection[str], most: int = LISTED_NAMES) -> str:
    """Return the first names, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(list(names)[:most]) + more


@contextlib.contextmanager
def naming(where: object) -> Iterator[None]:
    """Prefix every InputError of the block with the file being read: ``where: error``."""
    try:
        yield
    except UnsolvableError as error:
        raise UnsolvableError(f"{where}: {error}", error.cause, error.by) from None
    except MisplacedError as error:
        raise MisplacedError(f"{where}: {error}") from None
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
