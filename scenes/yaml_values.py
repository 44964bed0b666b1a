"""YAML text becomes plain values: one pass over the parser's events, which also refuses what is nested too deeply or
too large. What needs more than the values' own text (tags, aliases, merged and doubled keys) is left to PyYAML."""

from __future__ import annotations

import re
from typing import Any

import yaml

from hdplan.scenes.errors import InputError
from hdplan.scenes.number_text import read_number
from hdplan.scenes.values import describe, shorten

DEEPEST_LEVEL = 64  # levels of lists and mappings in a document
MOST_VALUES = 1_000_000  # in a document
_TAG = "tag:yaml.org,2002:"
_FLOAT = re.compile(r"[-+]?[0-9]+\.[0-9]*(?:[eE][-+][0-9]+)?")  # the usual form of those that YAML 1.1 knows
_INT = re.compile(r"-?(?:0|[1-9][0-9]*)")
_WORDS = {"": None, "null": None, "true": True, "false": False}
_RULES = yaml.SafeLoader("")
_MAKERS = {
    f"{_TAG}null": _RULES.construct_yaml_null,
    f"{_TAG}bool": _RULES.construct_yaml_bool,
    f"{_TAG}int": _RULES.construct_yaml_int,
    f"{_TAG}float": _RULES.construct_yaml_float,
}
_END = re.compile(r"^---\s*\Z", re.MULTILINE)  # which `ros2 topic echo` prints after each message
_MORE = object()  # a value that is left to PyYAML


class _UniqueKeyLoader(yaml.CSafeLoader):
    """YAML forbids duplicate keys in a mapping; PyYAML would silently keep the last."""

    def __init__(self, stream: str) -> None:
        super().__init__(stream)
        self._flat = set[yaml.MappingNode]()  # mappings that hold what they merge: keys may stand twice there

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        if node in self._flat:
            return
        self._flat.add(node)
        seen: set[tuple[str, str]] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):  # of two merges some readers take the first, and others the last
                if (key.tag, key.value) in seen:
                    raise yaml.MarkedYAMLError(
                        problem=f"the key {key.value!r} appears twice", problem_mark=key.start_mark
                    )
                seen.add((key.tag, key.value))
        super().flatten_mapping(node)


def read_mapping(data: bytes) -> dict[Any, Any]:
    """Read YAML that holds a mapping; `---` at its end, as ROS prints it after a message, begins nothing.

    Raises:
        InputError: it is not UTF-8, empty, nested too deeply, too large, not YAML (with the line), not a mapping, or
            has a duplicate key or a second document. The message does not name the file.
    """
    try:
        content = _END.sub("", data.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise InputError(f"is not UTF-8 text (byte {error.start} is 0x{error.object[error.start]:02x})") from None
    try:
        value = _built(content)
        if value is _MORE:
            value = yaml.load(content, _UniqueKeyLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        what = ", ".join(filter(None, [error.context, error.problem]))
        raise InputError(f"{where}YAML syntax: {' '.join(what.split())}") from None
    except yaml.reader.ReaderError as error:
        line = content.count("\n", 0, error.position) + 1
        raise InputError(f"line {line}: YAML syntax: the character {chr(error.character)!r} is not allowed") from None
    except InputError:
        raise
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # such as the date 2026-99-99
        raise InputError(f"YAML syntax: {' '.join(str(error).split())}") from None
    except (AttributeError, LookupError, TypeError):  # from PyYAML, for `!!int ""` or `!!timestamp x`
        raise InputError("YAML syntax: a value is not of the type that its tag (!!) says") from None
    if value is None:
        raise InputError("is empty")
    if not isinstance(value, dict):
        raise InputError(f"must hold a mapping of sections, found {describe(value)}")
    return value


def _built(content: str) -> object:
    """Return the value of a document, or _MORE. Refuses one that is nested too deeply, or too large once what its
    aliases repeat is counted: its content is walked through many times, also by recursive functions."""
    count, sizes = 0, dict[str, int]()  # values under each anchor
    begun: list[tuple[str | None, int]] = []  # anchors of the open collections, and the count before each
    made: list[list[Any]] = [[]]  # the documents, and what is read of each open collection; keys and values in turn
    own = True  # whether nothing has to be left to PyYAML
    for event in iter(yaml.CSafeLoader(content).get_event, None):
        fault, value = None, _MORE
        if isinstance(event, yaml.ScalarEvent):
            count += 1
            value = _of_scalar(event)
            if event.anchor:
                sizes[event.anchor] = 1
        elif isinstance(event, yaml.CollectionStartEvent):
            begun.append((event.anchor, count))
            made.append([])
            own = own and event.anchor is None and event.tag is None
            if len(begun) > DEEPEST_LEVEL:
                fault = f"is nested more than {DEEPEST_LEVEL} levels deep"
        elif isinstance(event, yaml.CollectionEndEvent):
            count += 1
            anchor, before = begun.pop()
            if anchor:
                sizes[anchor] = count - before
            value = made.pop()
            if isinstance(event, yaml.MappingEndEvent):
                value = _mapping(value)
        elif isinstance(event, yaml.AliasEvent):
            count += sizes.get(event.anchor or "", 0)
            if event.anchor in [name for name, _ in begun]:
                fault = f"the alias '*{event.anchor}' lies within its own anchor"
        elif isinstance(event, yaml.DocumentStartEvent) and made[0]:
            fault = "begins a second document ('---'), and a file holds one"
        else:
            continue
        if not isinstance(event, yaml.CollectionStartEvent):
            own = own and value is not _MORE
            made[-1].append(value)
        if count > MOST_VALUES:
            fault = f"holds more than {MOST_VALUES} values, those that aliases repeat counted"
        if fault:
            raise InputError(f"{_line(event)}{fault}")
    return made[0][0] if own and made[0] else _MORE


def _of_scalar(event: yaml.ScalarEvent) -> object:
    """Return a text, or what YAML 1.1 reads from one without quotes; _MORE for what else it knows, such as dates."""
    word: str = event.value
    if event.tag or (event.anchor and event.implicit[0]):
        _check_number(word, event.tag or _resolved(word), event)
        return _MORE
    if event.anchor:
        return _MORE
    if not event.implicit[0]:
        return word
    if word in _WORDS:
        return _WORDS[word]
    if word[0] not in _RULES.yaml_implicit_resolvers:
        return word
    if _FLOAT.fullmatch(word):
        return float(word)
    if _INT.fullmatch(word):
        return int(word)
    tag = _resolved(word)
    if tag == f"{_TAG}str":
        return word
    _check_number(word, tag, event)
    return _MAKERS[tag](yaml.ScalarNode(tag, word)) if tag in _MAKERS else _MORE


def _line(event: yaml.Event) -> str:
    return f"line {event.start_mark.line + 1}: " if event.start_mark else ""


def _resolved(word: str) -> str:
    """Return the tag that YAML 1.1 gives a word without quotes."""
    return str(_RULES.resolve(yaml.ScalarNode, word, (True, False)))  # type: ignore[no-untyped-call]


def _check_number(word: str, tag: str, event: yaml.ScalarEvent) -> None:
    """Refuse what YAML 1.1 takes for another number than its digits say: 1_0 (10), 010 (8), 1:30 (90), 0x10 (16)."""
    if tag not in (f"{_TAG}int", f"{_TAG}float") or word.lower().lstrip("+-") in (".inf", ".nan"):
        return
    try:
        value = _MAKERS[tag](yaml.ScalarNode(tag, word))
        same = value is not None and read_number(word) == float(value)
    except (ValueError, LookupError, OverflowError):
        same = False
    if not same:
        raise InputError(
            f"{_line(event)}{shorten(repr(word))} is not a number in decimal digits; a text or a name like that stands "
            "in quotes"
        )


def _mapping(parts: list[Any]) -> object:
    """Return the mapping of keys and values in turn, _MORE if a key appears twice or cannot be one."""
    keys = parts[::2]
    if any(isinstance(key, (list, dict)) for key in keys):
        return _MORE
    value = dict(zip(keys, parts[1::2], strict=True))
    return value if len(value) == len(keys) else _MORE
