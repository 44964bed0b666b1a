"""A YAML document as fields that know their file and their path, so that every error can name both.

Input: a file. Output: plain, checked Python values, or an `InputError` of one line that names the file, the field, what
was found and what is allowed.
"""

from __future__ import annotations

import contextlib
import math
import os
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeVar

from hdplan.scenes.errors import FieldError, InputError, MissingFileError, naming, nearest
from hdplan.scenes.files import read_file
from hdplan.scenes.number_text import read_number
from hdplan.scenes.values import Choice, Number, Row, Whole, boolean, describe, shorten, text
from hdplan.scenes.yaml_values import read_mapping

T = TypeVar("T")


@dataclass(frozen=True)
class Document:
    """The document that fields come from, and the notes made while it is read."""

    file: Path
    notes: list[str] = field(default_factory=list)  # for the user: what was changed rather than refused
    text_numbers: bool = False  # accept 1e-05, which YAML 1.1 reads as text but MoveIt's writer puts out


@dataclass(frozen=True)
class Field:
    """One value of a document; `key` is its path, such as ``obstacles[2].shape.radius``, and empty at the top."""

    value: object
    key: str
    document: Document

    def error(self, message: str) -> InputError:
        """Return an error with a `message` about this field."""
        return InputError(
            f"{self.document.file}: {self.key}: {message}" if self.key else f"{self.document.file}: {message}"
        )

    def wrong(self, allowed: str) -> InputError:
        """Return the error that this value is not `allowed`."""
        return self.error(f"must be {allowed}, found {describe(self.value)}")

    def note(self, message: str) -> None:
        """Add a note for the user about this field."""
        self.document.notes.append(f"{self.document.file.name}: {self.key}: {message}")

    def with_text_numbers(self) -> Field:
        """Return this field, in a document that may hold numbers as text."""
        return replace(self, document=replace(self.document, text_numbers=True))

    # Mappings and lists

    def mapping(self, allowed: Collection[str] | None = None, required: Collection[str] = ()) -> dict[str, Field]:
        """Return the fields of a mapping; its keys are all in `allowed` (any if None) and hold all `required`.

        Where the allowed keys are known, a key without a value counts as absent.
        """
        if not isinstance(self.value, Mapping):
            inside = (
                f" with {'the' if required else 'some of the'} keys {', '.join(required or allowed)}" if allowed else ""
            )
            raise self.wrong(f"a mapping{inside}")
        found = {}
        for name, value in self.value.items():
            if not isinstance(name, str):
                raise self.error(f"keys must be names, found {describe(name)}; put it in quotes if it is one")
            if allowed is not None and name not in allowed:
                raise self.error(f"unknown key {shorten(repr(name))}{nearest(name, allowed)}")
            if value is not None or allowed is None:
                found[name] = Field(value, f"{self.key}.{name}" if self.key else name, self.document)
        for name in required:
            if name not in found:
                raise self.error(f"the key '{name}' is missing (required: {', '.join(required)})")
        return found

    def items(self, length: int | None = None, of: str = "values") -> list[Field]:
        """Return the fields of a list of the given length (any if None)."""
        if not isinstance(self.value, list) or (length is not None and len(self.value) != length):
            raise self.wrong(f"a list of {of}" if length is None else f"a list of {length} {of}")
        return [Field(value, f"{self.key}[{i}]", self.document) for i, value in enumerate(self.value)]

    # Numbers

    def number(self, low: float = -math.inf, high: float = math.inf, above: float = -math.inf, unit: str = "") -> float:
        """Return a finite number, at most LARGEST in size, with low <= value <= high and value > above."""
        return self.checked(Number(low, high, above, unit), self._number(self.value))

    def _number(self, value: object) -> object:
        """Return the number that a text holds, in a document that may hold numbers as text."""
        if isinstance(value, str) and self.document.text_numbers:
            with contextlib.suppress(ValueError):
                return read_number(value)
        return value

    def integer(self, low: int, high: int) -> int:
        """Return a whole number with low <= value <= high."""
        return self.checked(Whole(low, high), self.value)

    def numbers(self, length: int | None = None, above: float = -math.inf, unit: str = "") -> tuple[float, ...]:
        """Return a list of finite numbers, each greater than `above`."""
        given = [self._number(item) for item in self.value] if isinstance(self.value, list) else self.value
        return self.checked(Row(Number(above=above, unit=unit), length), given)

    # Texts

    def text(self) -> str:
        """Return a text that is not empty and holds no control characters, such as line breaks."""
        return self.checked(text, self.value)

    def choice(self, allowed: Collection[str]) -> str:
        """Return one of the allowed words."""
        return self.checked(Choice(allowed), self.value)

    def boolean(self) -> bool:
        """Return a boolean."""
        return self.checked(boolean, self.value)

    def texts(self) -> tuple[str, ...]:
        """Return a list of texts, each as `text` has it."""
        return self.checked(Row(text, of="values"), self.value)

    def booleans(self, length: int | None = None) -> tuple[bool, ...]:
        """Return a list of booleans."""
        return self.checked(Row(boolean, length, "booleans"), self.value)

    # The checks of a scene's classes

    def checked(self, check: Callable[[Any], T], value: object) -> T:
        """Return a value of this field after its check."""
        try:
            return check(value)
        except FieldError as error:
            raise self._named(error) from None

    def make(self, kind: Callable[..., T], /, **values: object) -> T:
        """Return an object of one of a scene's classes, made of fields or of values read from them. What the class
        refuses is reported at the field in the file, as its attributes have the names of the keys."""
        given = {name: value.value if isinstance(value, Field) else value for name, value in values.items()}
        try:
            return kind(**given)
        except FieldError as error:
            raise self._named(error) from None

    def read(self, kind: Callable[..., T], /, **readers: Callable[[Field], object]) -> T:
        """Return an object of one of a scene's classes, from a mapping with the names of its fields as keys; some have
        a reader of their own."""
        known = [each for each in fields(kind) if each.init]  # type: ignore[arg-type]
        required = [each.name for each in known if each.default is MISSING and each.default_factory is MISSING]
        keys = self.mapping([each.name for each in known], required)
        return self.make(kind, **{**keys, **{name: read(keys[name]) for name, read in readers.items() if name in keys}})

    def _named(self, error: FieldError) -> InputError:
        """Return an error about a value with the file and key added, and how YAML would have it written."""
        found, hint = error.within(self.key) if self.key else error, ""
        if error.kind == "number" and isinstance(error.value, str) and (plain := _as_yaml_number(error.value)):
            hint = f", which YAML does not read as a number: write {plain}"
        elif error.kind == "text" and not isinstance(error.value, str | list | dict):
            hint = "; put it in quotes if it is a name"
        return Field(None, found.where, self.document).error(found.problem + hint)

    def path(self, directory: bool = False) -> Path:
        """Return the absolute path of an existing file (or directory); a relative path is relative to the document that
        names it."""
        path = self.document.file.parent / self.text()
        if not (os.path.isdir(path) if directory else os.path.isfile(path)):
            kind, exists = "directory" if directory else "file", os.path.exists(path)
            state = f"is not a {kind}" if exists else "does not exist"
            error = self.error(f"must be a {kind}, but {self.value!r} {state} (looked for {path})")
            raise error if exists else MissingFileError(error.args[0], str(path.absolute()))
        return path.absolute()


def read_document(file: Path) -> Field:
    """Read a YAML file that holds a mapping.

    Raises:
        InputError: the file is missing, a directory, unreadable, not UTF-8, empty, not YAML (with the line), or has a
            duplicate key.
    """
    with naming(file):
        content = read_mapping(read_file(file))
    return Field(content, "", Document(file))


def _as_yaml_number(text: str) -> str | None:
    """Return the spelling of a number that YAML 1.1 took for a text, or None if the text is not a number."""
    match = re.fullmatch(r"\s*([-+]?[0-9]+)(?:\.([0-9]*))?(?:[eE]([-+]?[0-9]+))?\s*", text)
    if match is None:
        return None
    whole, fraction, exponent = match.groups()
    if exponent is None:
        return f"{text.strip()} without quotes"
    return f"{whole}.{fraction or '0'}e{int(exponent):+d}"
