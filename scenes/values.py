"""Checks of values, written once: files and scenes made in Python go through the same ones.

A check takes a value and returns it in its one form (a float for a whole number, a tuple for a list or an array), or
raises a `FieldError` that says what is allowed and what was found. A `Checked` dataclass finds the checks of its fields
in their annotations, such as ``radius: Annotated[float, Number(above=0.0, unit="m")]``.
"""

from __future__ import annotations

import math
import numbers
import os
import re
import reprlib
import types
import typing
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Annotated, Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from hdplan.scenes.errors import FieldError, nearest

Check = Callable[[Any], Any]
NEEDED: Any = None  # default of a required field after optional ones: its check refuses it and says what is needed

FilePath = str | os.PathLike[str]
Numbers = Sequence[float] | NDArray[Any]
"""Types that a program may pass for a tuple of numbers. A class that accepts more types than its fields declares them
in an ``__init__`` that only type checkers see; the fields hold the types of their annotations."""

LARGEST_NUMBER = 1e6  # in size, of any number [m, rad]: beyond it distances are lost in rounding
# of a number above 0: its square, and LARGEST_NUMBER divided by it, stay well within the range of floats
SMALLEST_NUMBER = 1e-100
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]")
_SHOWN = 60  # characters of a value that an error repeats


def wrong(allowed: str, value: object, kind: str = "") -> FieldError:
    """Return the error that a value is not `allowed`."""
    return FieldError(f"must be {allowed}, found {describe(value)}", value=value, kind=kind)


@dataclass(frozen=True)
class Number:
    """A finite number, at most LARGEST_NUMBER in size, with low <= value <= high and value > above; not a boolean.

    A number that must be above 0 is at least SMALLEST_NUMBER, as it divides others.
    """

    low: float = -math.inf
    high: float = math.inf
    above: float = -math.inf
    unit: str = ""

    def __call__(self, value: object) -> float:
        """The value as a float."""
        if type(value) is not float and (isinstance(value, bool) or not isinstance(value, numbers.Real)):
            raise wrong(self._allowed, value, "number")
        try:
            number = float(value)
        except OverflowError:  # an integer beyond the floats
            raise wrong(self._allowed, value) from None
        if not (self.low <= number <= self.high and number > self.above and math.isfinite(number)):
            raise wrong(self._allowed, value)
        if abs(number) > LARGEST_NUMBER:
            raise wrong(f"{self._allowed}, at most {LARGEST_NUMBER:g} in size", value)
        if self.above == 0.0 and number < SMALLEST_NUMBER:
            raise wrong(f"{self._allowed}, at least {SMALLEST_NUMBER:g}", value)
        return number

    @property
    def range(self) -> str:
        """The bounds and the unit, in words."""
        bounds = [f"greater than {self.above:g}"] * math.isfinite(self.above)
        if math.isfinite(self.low):
            bounds.append(f"{self.low:g} to {self.high:g}" if math.isfinite(self.high) else f"at least {self.low:g}")
        elif math.isfinite(self.high):
            bounds.append(f"{'and ' * bool(bounds)}at most {self.high:g}")
        return " ".join([*bounds, *([f"[{self.unit}]"] if self.unit else [])])

    @property
    def _allowed(self) -> str:
        return f"a finite number {self.range}".rstrip()


JointValue = Number(unit="rad or m")


@dataclass(frozen=True)
class Whole:
    """A whole number with low <= value <= high."""

    low: int
    high: int

    def __call__(self, value: object) -> int:
        """The value as an int."""
        if (
            isinstance(value, bool)
            or not isinstance(value, numbers.Integral)
            or not self.low <= (whole := int(value)) <= self.high
        ):
            raise wrong(f"a whole number {self.low} to {self.high}", value)
        return whole


@dataclass(frozen=True)
class Row:
    """A list, a tuple or an array of values that a check allows, of a given length if there is one."""

    item: Check
    length: int | None = None
    of: str = "numbers"

    def __call__(self, value: object) -> tuple[Any, ...]:
        """Return them as a tuple."""
        if not is_row(value):
            raise wrong(f"a list of {self.of}" if self.length is None else f"a list of {self.length} {self.of}", value)
        if self.length is not None and len(value) != self.length:
            raise wrong(f"a list of {self.length} {self.of}", value)
        found: list[Any] = []
        try:
            for item in value:
                found.append(self.item(item))
        except FieldError as error:
            raise error.within(f"[{len(found)}]") from None
        return tuple(found)


def require_fields(kind: type, known: str) -> None:
    """Raise TypeError if a class has other fields than those named: for code that takes its objects apart, so that a
    field that somebody adds is not passed over there."""
    if unknown := [each.name for each in fields(kind) if each.name not in known.split()]:
        raise TypeError(f"{kind.__name__} has fields that are not dealt with here: {', '.join(unknown)}")


def is_row(value: object) -> TypeGuard[list[Any] | tuple[Any, ...]]:
    """Tell whether a value is a list, a tuple or an array."""
    return isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim > 0)


@dataclass(frozen=True)
class Named:
    """A mapping from names to values that a check allows."""

    item: Check

    def __call__(self, value: object) -> dict[str, Any]:
        """The mapping as a new dictionary."""
        if not isinstance(value, Mapping):
            raise wrong("a mapping", value)
        if strange := [name for name in value if not isinstance(name, str)]:
            raise FieldError(f"keys must be names, found {describe(strange[0])}; put it in quotes if it is one")
        return {str(name): checked(self.item, item, name) for name, item in value.items()}


FORMS = "a number, a list of numbers, or a mapping from joint names to numbers"


@dataclass(frozen=True)
class PerJoint:
    """Numbers of the joints: one for all if `single`, one each in the order of the planned joints, or by name."""

    number: Number
    allowed: str  # in words
    single: bool = True

    def __call__(self, value: object) -> Any:
        """Return a float, a tuple or a dictionary."""
        if isinstance(value, Mapping) and value:
            return Named(self.number)(value)
        if is_row(value) and len(value):
            return Row(self.number)(value)
        try:
            if self.single:
                return self.number(value)
        except FieldError as error:  # of a text meant as a number, its own words say how to write it
            if not error.kind or (isinstance(value, str) and value[:1] in "+-.0123456789"):
                raise
        raise wrong(self.allowed, value)


@dataclass(frozen=True)
class Choice:
    """One of several words."""

    allowed: Collection[str]

    def __call__(self, value: object) -> str:
        """The value."""
        if not isinstance(value, str):
            raise wrong(f"one of {', '.join(self.allowed)}", value)
        if value not in self.allowed:
            raise FieldError(f"unknown value {shorten(repr(value))}{nearest(value, self.allowed)}", value=value)
        return value


def text(value: object) -> str:
    """Return a text that is not empty and holds no control characters, such as line breaks."""
    if isinstance(value, str) and _CONTROL.search(value):
        raise FieldError(f"must be a text without control characters, found {shorten(repr(value))}", value=value)
    if not isinstance(value, str) or not value.strip():
        raise wrong("a text that is not empty", value, "text")
    return str(value)


Name = Annotated[str, text]


def boolean(value: object) -> bool:
    """Return a boolean."""
    if not isinstance(value, bool | np.bool_):
        raise wrong("true or false", value)
    return bool(value)


def path_of(value: object) -> Path:
    """Return a path, given as a path or as a text."""
    if not isinstance(value, str | os.PathLike):
        raise wrong("a path", value)
    if "\0" in str(value):
        raise FieldError("must be a path without null characters", value=value)
    return Path(value)


def absolute_path(value: object) -> Path:
    """Return an absolute path, which does not depend on the working directory."""
    return path_of(value).absolute()


_shown = reprlib.Repr()
_shown.maxtuple = _shown.maxlist = _shown.maxdict = 16
_shown.maxstring, _shown.maxother = 100, 2000


class Checked:
    """Base class of frozen dataclasses whose fields are checked, and brought to their one form, when an object is
    made."""

    def __post_init__(self) -> None:
        """Check every field by itself, then all of them together."""
        try:
            for name, check in checks_of(type(self)).items():
                try:
                    object.__setattr__(self, name, check(getattr(self, name)))
                except FieldError as error:
                    raise error.within(name) from None
            self._check_whole()
        except FieldError as error:
            raise error.of(type(self).__name__) from None

    def _check_whole(self) -> None:
        """Raise a FieldError for fields that contradict each other."""

    def __repr__(self) -> str:
        """Show the fields that differ from their defaults; long values are cut. For dataclasses with ``repr=False``."""
        parts = []
        for each in fields(self):  # type: ignore[arg-type]
            value = getattr(self, each.name)
            usual = each.default if each.default_factory is MISSING else each.default_factory()
            if each.repr and value != usual:
                parts.append(f"{each.name}={_shown.repr(value)}")
        return f"{type(self).__name__}({', '.join(parts)})"


def checked(check: Check, value: object, where: str) -> Any:
    """Return a value after its check; an error names the field `where`."""
    try:
        return check(value)
    except FieldError as error:
        raise error.within(where) from None


def instance(value: object, kind: type, where: str) -> None:
    """Raise a FieldError unless an argument is of a class."""
    if not isinstance(value, kind):
        raise wrong(f"of the class {kind.__name__}", value).within(where)


def functions(**given: object) -> None:
    """Raise a FieldError unless arguments, by their names, can be called."""
    for where, value in given.items():
        if not callable(value):
            raise wrong("a function", value).within(where)


def shorten(text: str) -> str:
    """Cut a long text for an error message."""
    return text if len(text) <= _SHOWN else text[: _SHOWN - 3] + "..."


def describe(value: object) -> str:
    """Describe a value in a few words, on one line."""
    match value:
        case None:
            return "nothing"
        case bool():
            return str(value).lower()
        case str():
            return f"the text {shorten(repr(value))}"
        case list() | tuple():
            return f"a list of {len(value)}"
        case dict():
            return "a mapping"
        case np.ndarray():
            return f"an array of shape {value.shape}"
    try:
        return shorten(" ".join(str(value).split()))
    except ValueError:  # more digits than Python prints
        return "a number of thousands of digits"


@dataclass(frozen=True)
class Maybe:
    """Nothing, or a value that a check allows."""

    item: Check

    def __call__(self, value: object) -> Any:
        """The value."""
        return None if value is None else self.item(value)


@dataclass(frozen=True)
class Instance:
    """An object of one of some classes."""

    kinds: tuple[type, ...]

    def __call__(self, value: object) -> object:
        """The value."""
        if not isinstance(value, self.kinds):
            raise wrong(f"of the class {' or '.join(kind.__name__ for kind in self.kinds)}", value)
        return value


_known: dict[Any, dict[str, Check]] = {}


def checks_of(kind: Any) -> dict[str, Check]:
    """Return the checks of a class's fields, which are found once."""
    if kind not in _known:
        hints = typing.get_type_hints(kind, include_extras=True)
        _known[kind] = {field.name: _check_of(hints[field.name]) for field in fields(kind) if field.init}
    return _known[kind]


def _check_of(hint: Any) -> Check:
    """Return the check for an annotation: the one it carries, or else one for its type."""
    if typing.get_origin(hint) is Annotated:
        return typing.cast(Check, hint.__metadata__[0])
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        members = typing.get_args(hint)
        given = [member for member in members if member is not type(None)]
        check = _check_of(given[0]) if len(given) == 1 else Instance(tuple(given))
        return Maybe(check) if len(given) < len(members) else check
    if typing.get_origin(hint) is tuple:
        return Row(_check_of(typing.get_args(hint)[0]), of="values")
    plain: Mapping[Any, Check] = {bool: boolean, str: _any_text, Path: path_of}
    return plain.get(hint) or Instance((hint,))


def _any_text(value: object) -> str:
    if not isinstance(value, str):
        raise wrong("a text", value)
    return value
