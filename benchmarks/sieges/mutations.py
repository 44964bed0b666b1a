"""Files made wrong: bytes flipped and cut, fields renamed, doubled and dropped, values replaced by hostile ones."""

from __future__ import annotations

import copy
import re
from typing import Any

import numpy as np

NUMBERS: list[Any] = [
    *(float("nan"), float("inf"), -float("inf"), 1e308, -1e308, 5e-324, -0.0, 1e6, 1e15, 1e-9, 1e-300, 1e100),
    *(0, -1, 10**30, -(10**400), 2**63),
]
OTHERS: list[Any] = [
    *(None, True, False, "", "nan", "1e3", "\U0001f680", "\x00", "\u202e", "a" * 5000, "../../etc", "-1", "0x10", "{}"),
    *([], {}, [[]], [None], {"a": {"b": []}}, [1, 2], [1e308, 1e308, 1e308], [0, 0, 0], [0, 0, 0, 0], {"": 0}),
]
WORDS = (
    *("nan", "inf", "-inf", "1e308", "-1e308", "1e999", "0", "-0", "-1", "5e-324", "1e15", "99999999999999999999", "x"),
    *("", "1 2", "0 0 0", "nan nan nan", "1e300 0 0", "\U0001f600", "&#0;", "1,5", "0x1p3", "1_000", "１"),
    *(".nan", ".inf", "null", "true", "[]", "{}"),
)
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")


def of_tree(rng: np.random.Generator, content: Any) -> Any:
    """Return a tree of mappings and lists with one to three places made wrong."""
    found = copy.deepcopy(content)
    for _ in range(int(rng.choice([1, 1, 1, 2, 3]))):
        places = list(_places(found))
        if not places:
            break
        holder, key = places[int(rng.integers(len(places)))]
        _spoil(rng, holder, key)
    return found


def _places(tree: Any) -> Any:
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in list(items):
        yield tree, key
        yield from _places(value)


def _spoil(rng: np.random.Generator, holder: Any, key: Any) -> None:
    value, what = holder[key], int(rng.integers(0, 9))
    if rng.random() < 0.3 and isinstance(value, float):
        holder[key] = value * float(rng.uniform(0.9, 1.1))
    elif what <= 2:
        holder[key] = copy.deepcopy(NUMBERS[int(rng.integers(len(NUMBERS)))])
    elif what == 3:
        holder[key] = copy.deepcopy(OTHERS[int(rng.integers(len(OTHERS)))])
    elif what == 4:
        del holder[key]
    elif what == 5 and isinstance(holder, dict):
        letters = list(str(key)) or ["x"]
        letters[int(rng.integers(len(letters)))] = str(rng.choice(list("aeXz _9é")))
        holder["".join(letters)] = holder.pop(key)
    elif what == 6 and isinstance(value, list):
        holder[key] = value[:-1] if rng.random() < 0.5 else [*value, *value[:1]]
    elif what == 7:
        deep: Any = value
        for _ in range(int(rng.choice([1, 3, 200]))):
            deep = [deep] if rng.random() < 0.5 else {"x": deep}
        holder[key] = deep
    elif isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300:
        holder[key] = value * float(rng.choice([-1.0, 1e3, 1e-3, 1e9, 1e-12, 1.0 + 1e-9]))
    else:
        holder[key] = str(value)


def of_text(rng: np.random.Generator, text: str) -> str:
    """Return a text with a number, a line, a piece or an element's name made wrong."""
    for _ in range(int(rng.choice([1, 1, 2, 4]))):
        what = int(rng.integers(0, 7))
        if what <= 2:
            found = list(NUMBER.finditer(text))
            if found:
                at = found[int(rng.integers(len(found)))]
                text = text[: at.start()] + str(rng.choice(WORDS)) + text[at.end() :]
        elif what == 3:
            lines = text.splitlines(keepends=True)
            if lines:
                k = int(rng.integers(len(lines)))
                lines[k : k + 1] = [] if rng.random() < 0.5 else [lines[k]] * int(rng.choice([2, 2, 50]))
            text = "".join(lines)
        elif what == 4:
            text = text[: int(rng.integers(len(text) + 1))]
        elif what == 5:
            a, b = sorted(rng.integers(0, len(text) + 1, 2).tolist())
            text = text[:a] + text[b:]
        else:
            names = list(re.finditer(r"[A-Za-z_]{3,}", text))
            if names:
                at = names[int(rng.integers(len(names)))]
                text = text[: at.end()] + str(rng.choice(["x", "_", "\u00e9", "Name"])) + text[at.end() :]
    return text


def of_bytes(rng: np.random.Generator, data: bytes) -> bytes:
    """Return bytes with some flipped, cut, doubled or inserted."""
    found = bytearray(data)
    for _ in range(int(rng.choice([1, 2, 8, 64]))):
        what, at = int(rng.integers(0, 5)), int(rng.integers(len(found) + 1))
        if what <= 1 and at < len(found):
            found[at] = int(rng.integers(256))
        elif what == 2 and rng.random() < 0.3:
            found = found[:at]
        elif what == 3:
            found[at:at] = bytes(rng.integers(0, 256, int(rng.choice([1, 4, 100])), dtype=np.uint8))
        else:
            found[at : at + int(rng.choice([1, 4, 50]))] = b""
    return bytes(found)
