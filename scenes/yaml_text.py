"""Values in YAML's flow style, which is nearly JSON: texts in double quotes, numbers with the fewest digits that read
back bit for bit, infinity as `.inf`, paths in full, objects of a scene's classes by their fields."""

from __future__ import annotations

import json
import math
import numbers
import re
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from hdplan.scenes.errors import InputError

LONG_KEY = 1000  # characters; YAML parsers seek the colon within 1024
_HALF = re.compile("[\ud800-\udfff]")


def by_fields(value: Any) -> dict[str, Any]:
    """Return the fields of a dataclass's object by name, without those that are None."""
    return {each.name: part for each in fields(value) if (part := getattr(value, each.name)) is not None}


def flow_style(value: object) -> str:
    """Return a value in YAML 1.1's flow style, which reads 1e-05 as a text and 1.0e-05 as a number."""
    if is_dataclass(value):
        value = by_fields(value)
    if isinstance(value, Path):
        value = str(value.absolute())  # not resolved: the name of a symbolic link tells the kind of file
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_key(str(key))}: {flow_style(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(flow_style(item) for item in value) + "]"
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, bool) or value is None:
        return json.dumps(value)
    if isinstance(value, numbers.Integral):
        return str(int(value))
    number = float(value)  # type: ignore[arg-type]
    if number == math.inf:
        return ".inf"
    digits, mark, exponent = repr(number).partition("e")
    return digits if not mark else f"{digits if '.' in digits else digits + '.0'}e{int(exponent):+d}"


def _key(name: str) -> str:
    """Return a key; YAML marks long ones with a question mark."""
    key = _text(name)
    return key if len(key) < LONG_KEY else f"? {key}"


def _text(text: str) -> str:
    """Return a text in double quotes, with unprintable characters escaped as in YAML, which does not know JSON's
    surrogate pairs. Raises InputError for a lone surrogate, which no file can hold."""
    if _HALF.search(text):
        raise InputError(f"the text {text!r} holds half a character (a lone surrogate), which no file can hold")
    return "".join(char if char.isprintable() else _escape(ord(char)) for char in json.dumps(text, ensure_ascii=False))


def _escape(code: int) -> str:
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"
