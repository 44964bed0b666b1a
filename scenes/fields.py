"""A YAML document as fields that know their file and their path, so that every complaint can name both.

What enters: a file. What leaves: plain, checked Python values, or an `InputError` of one line that names the file, the
field, what was found and what is allowed.
"""

from __future__ import annotations

import contextlib
import math
import os
import re
from collections.abc import Collection, Hashable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml

from hdplan.scenes.errors import InputError, nearest

_MERGE = "tag:yaml.org,2002:merge"
LARGEST = 1e6  # in size, of any number [m, rad]: beyond it distances drown in rounding
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]")
_SHOWN = 60  # characters of a found value that an error repeats


class _UniqueKeyLoader(yaml.CSafeLoader):
    """YAML forbids a key twice in one mapping; PyYAML would silently keep the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[tuple[str, str]] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.tag != _MERGE:
                if (key.tag, key.value) in seen:
                    raise yaml.MarkedYAMLError(
                        problem=f"the key {key.value!r} stands twice", problem_mark=key.start_mark
                    )
                seen.add((key.tag, key.value))
        return super().construct_mapping(node, deep)


@dataclass(frozen=True)
class Document:
    """Where a field comes from, and what is said while it is read."""

    file: Path
    notes: list[str] = field(default_factory=list)  # words for the user, for what was changed and not refused
    text_numbers: bool = False  # accept 1e-05, which YAML 1.1 reads as text but MoveIt's writer puts out


@dataclass(frozen=True)
class Field:
    """One value of a document; `key` is its path, such as ``obstacles[2].shape.radius``, and empty at the top."""

    value: object
    key: str
    document: Document

    def error(self, message: str) -> InputError:
        """Return the error that says `message` about this field."""
        return InputError(
            f"{self.document.file}: {self.key}: {message}" if self.key else f"{self.document.file}: {message}"
        )

    def wrong(self, allowed: str) -> InputError:
        """Return the error that this value is not what is allowed."""
        return self.error(f"must be {allowed}, found {describe(self.value)}")

    def note(self, message: str) -> None:
        """Leave a word for the user about this field."""
        self.document.notes.append(f"{self.document.file.name}: {self.key}: {message}")

    def with_text_numbers(self) -> Field:
        """Return the same field, of a document that may hold numbers as text."""
        return replace(self, document=replace(self.document, text_numbers=True))

    # Containers

    def mapping(self, allowed: Collection[str] | None = None, required: Collection[str] = ()) -> dict[str, Field]:
        """Return the fields of a mapping; its keys are all in `allowed` (any if None) and hold all `required`.

        Where the keys are known, one with nothing behind it counts as absent.
        """
        if not isinstance(self.value, Mapping):
            inside = (
                f" with {'the' if required else 'some of the'} keys {', '.join(required or allowed)}" if allowed else ""
            )
            raise self.wrong(f"a mapping{inside}")
        fields = {}
        for name, value in self.value.items():
            if not isinstance(name, str):
                raise self.error(f"keys must be names, found {describe(name)}; put it in quotes if it is one")
            if allowed is not None and name not in allowed:
                raise self.error(f"unknown key {shorten(repr(name))}{nearest(name, allowed)}")
            if value is not None or allowed is None:
                fields[name] = Field(value, f"{self.key}.{name}" if self.key else name, self.document)
        for name in required:
            if name not in fields:
                raise self.error(f"the key '{name}' is missing (required: {', '.join(required)})")
        return fields

    def items(self, length: int | None = None, of: str = "values") -> list[Field]:
        """Return the fields of a list of the given length (any if None)."""
        if not isinstance(self.value, list) or (length is not None and len(self.value) != length):
            raise self.wrong(f"a list of {of}" if length is None else f"a list of {length} {of}")
        return [Field(value, f"{self.key}[{i}]", self.document) for i, value in enumerate(self.value)]

    # Numbers. Truth values are no numbers, and neither NaN nor infinity is a value.

    def number(self, low: float = -math.inf, high: float = math.inf, above: float = -math.inf, unit: str = "") -> float:
        """Return a finite number, at most LARGEST in size, with low <= value <= high and value > above."""
        bounds = [f"greater than {above:g}"] * math.isfinite(above)
        bounds += [f"{low:g} to {high:g}" if math.isfinite(high) else f"at least {low:g}"] * math.isfinite(low)
        bounds += [f"{'and ' * bool(bounds)}at most {high:g}"] * (math.isfinite(high) and not math.isfinite(low))
        allowed = " ".join(["a finite number", *bounds, *([f"[{unit}]"] if unit else [])])
        value = self.value
        if isinstance(value, str) and self.document.text_numbers:
            with contextlib.suppress(ValueError):
                value = float(value)
        if isinstance(value, str) and (plain := _as_yaml_number(value)):
            raise self.error(
                f"must be {allowed}, found {describe(value)}, which YAML does not read as a number: write {plain}"
            )
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.wrong(allowed)
        try:
            number = float(value)
        except OverflowError:  # an integer beyond the floats
            raise self.wrong(allowed) from None
        if not (math.isfinite(number) and low <= number <= high and number > above):
            raise self.wrong(allowed)
        if abs(number) > LARGEST:
            raise self.wrong(f"{allowed}, at most {LARGEST:g} in size")
        return number

    def integer(self, low: int, high: int) -> int:
        """Return a whole number with low <= value <= high."""
        if isinstance(self.value, bool) or not isinstance(self.value, int) or not low <= self.value <= high:
            raise self.wrong(f"a whole number {low} to {high}")
        return self.value

    def numbers(self, length: int | None = None, above: float = -math.inf, unit: str = "") -> tuple[float, ...]:
        """Return a list of finite numbers, each greater than `above`."""
        return tuple(item.number(above=above, unit=unit) for item in self.items(length, "numbers"))

    # Words

    def text(self) -> str:
        """Return a text that is not empty and holds no control characters, such as ends of lines."""
        if isinstance(self.value, str) and _CONTROL.search(self.value):
            raise self.error(f"must be a text without control characters, found {shorten(repr(self.value))}")
        if not isinstance(self.value, str) or not self.value.strip():
            quotes = "" if isinstance(self.value, str | list | dict) else "; put it in quotes if it is a name"
            raise self.error(f"must be a text that is not empty, found {describe(self.value)}{quotes}")
        return self.value

    def choice(self, allowed: Collection[str]) -> str:
        """Return one of the allowed words."""
        if not isinstance(self.value, str):
            raise self.wrong(f"one of {', '.join(allowed)}")
        if self.value not in allowed:
            raise self.error(f"unknown value {shorten(repr(self.value))}{nearest(self.value, allowed)}")
        return self.value

    def boolean(self) -> bool:
        """Return a truth value."""
        if not isinstance(self.value, bool):
            raise self.wrong("true or false")
        return self.value

    def path(self, directory: bool = False) -> Path:
        """Return an existing file (or directory), by its whole path; a relative one is looked up beside the document
        that names it."""
        path = self.document.file.parent / self.text()
        if not (os.path.isdir(path) if directory else os.path.isfile(path)):
            kind, other = ("directory", os.path.isfile(path)) if directory else ("file", os.path.isdir(path))
            state = f"is not a {kind}" if other else "does not exist"
            raise self.error(f"must be a {kind}, but {self.value!r} {state} (looked for {path})")
        return path.absolute()


def read_document(file: Path) -> Field:
    """Read a YAML file whose top is a mapping.

    Raises:
        InputError: the file is missing, a directory, unreadable, not UTF-8, empty, not YAML (with the line), or has a
            key twice.
    """
    document = Document(file)
    top = Field(None, "", document)
    try:
        content = file.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise top.error("no such file") from None
    except IsADirectoryError:
        raise top.error("is a directory; a YAML file is wanted") from None
    except UnicodeDecodeError as error:
        raise top.error(f"is not UTF-8 text (byte {error.start} is 0x{error.object[error.start]:02x})") from None
    except OSError as error:
        raise top.error(f"cannot be read: {error.strerror}") from None
    try:
        value = yaml.load(content, _UniqueKeyLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        what = ", ".join(filter(None, [error.context, error.problem]))
        raise top.error(f"{where}YAML syntax: {' '.join(what.split())}") from None
    except yaml.reader.ReaderError as error:
        line = content.count("\n", 0, error.position) + 1
        raise top.error(f"line {line}: YAML syntax: the character {chr(error.character)!r} is not allowed") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # such as the date 2026-99-99
        raise top.error(f"YAML syntax: {' '.join(str(error).split())}") from None
    if value is None:
        raise top.error("is empty")
    if not isinstance(value, dict):
        raise top.error(f"must hold a mapping of sections, found {describe(value)}")
    return Field(value, "", document)


def describe(value: object) -> str:
    """Say in a few words, on one line, what a YAML value is."""
    match value:
        case None:
            return "nothing"
        case bool():
            return str(value).lower()
        case str():
            return f"the text {shorten(repr(value))}"
        case list():
            return f"a list of {len(value)}"
        case dict():
            return "a mapping"
        case _:
            return shorten(str(value))


def shorten(text: str) -> str:
    """Cut a long text for an error line."""
    return text if len(text) <= _SHOWN else text[: _SHOWN - 3] + "..."


def _as_yaml_number(text: str) -> str | None:
    """Return how YAML 1.1 wants a number that it took for a text, or None if the text is no number."""
    match = re.fullmatch(r"\s*([-+]?\d+)(?:\.(\d*))?(?:[eE]([-+]?\d+))?\s*", text)
    if match is None:
        return None
    whole, fraction, exponent = match.groups()
    if exponent is None:
        return f"{text.strip()} without quotes"
    return f"{whole}.{fraction or '0'}e{int(exponent):+d}"
