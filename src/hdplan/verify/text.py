"""Files as the checker reads them: bytes with their hash, numbers in decimal digits, XML, YAML and JSON.

Nothing here is shared with hdplan's own readers. What could be read in two ways is rejected.
"""

from __future__ import annotations

import functools
import hashlib
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from .balls import RejectedError, need

DECIMAL = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")  # Python reads 1_0 as 10, too
USUAL = re.compile(r"-?(0|[1-9][0-9]*)\.[0-9]*([eE][-+][0-9]+)?")  # most of those that are numbers to YAML 1.1, too
SPACE = " \t\n\r\f\v"
LARGEST = 1e9  # of numbers
DEEPEST = 64  # levels of lists and mappings
RULES: Any = yaml.SafeLoader("")  # by which words without quotes are taken for numbers or other values
TAG, MERGE = "tag:yaml.org,2002:", object()  # of YAML's own kinds of values; the key `<<`


class Files:
    """The files that were read, with their hashes."""

    def __init__(self) -> None:
        self.hashes = dict[str, str]()

    def read(self, key: str, path: Path) -> bytes:
        """The content of a file; its hash is noted by a key."""
        need(path.is_file(), f"{path}: no such file")
        data = path.read_bytes()
        digest = hashlib.sha256(data).hexdigest()
        while self.hashes.setdefault(key, digest) != digest:  # two meshes of one name
            key += "'"
        return data


def split(text: str) -> list[str]:
    """The words between spaces of ASCII; Python knows more spaces, which others do not."""
    return re.findall(f"[^{SPACE}]+", text)


def number(word: Any, what: str) -> float:
    """A number in decimal digits."""
    text = word.strip(SPACE) if type(word) is str else ""
    need(DECIMAL.fullmatch(text) and abs(float(text)) < LARGEST, f"{what}: '{word}' is not a number")
    return float(text)


def row(text: Any, count: int, what: str) -> Any:
    """A fixed count of numbers, between spaces."""
    words = split(text) if type(text) is str else []
    need(len(words) == count, f"{what}: {count} numbers are expected, found '{text}'")
    return np.array([number(word, what) for word in words])


def table(words: Sequence[bytes | str], what: str) -> Any:
    """Many numbers."""
    found = [x.decode("ascii", "replace") if isinstance(x, bytes) else x for x in words]
    need(all(map(DECIMAL.fullmatch, found)), f"{what}: a word is not a number")
    return np.array(found, dtype=np.float64)


def values(value: Any, count: int, what: str) -> Any:
    """A fixed count of finite numbers of a scene, in a list if they are several."""
    rows = value if isinstance(value, list) else [value]
    good = len(rows) == count and {*map(type, rows)} <= {int, float} and all(abs(x) < LARGEST for x in rows)
    need(good, f"{what}: {count} finite numbers are expected")
    return np.array(rows, dtype=np.float64)


def mapping(value: Any, what: str, allowed: str) -> dict[str, Any]:
    """A mapping that has no other keys than those `allowed`, as others may change what is meant; without nulls."""
    need(isinstance(value, dict), f"{what}: a mapping is expected")
    known = allowed.split()
    for key in [x for x in value if x not in known][:1]:
        raise RejectedError(f"{what}: the checker does not know '{key}' there, only {allowed}")
    return {key: item for key, item in value.items() if item is not None}


def listing(value: Any, what: str) -> list[Any]:
    """A list; empty for nothing."""
    need(value is None or isinstance(value, list), f"{what}: a list is expected")
    return value or []


def strict_xml(data: bytes) -> Any:
    """The root of an XML file, without comments. A DTD could give attributes that are not to be seen where they act; a
    comment within a text would join its halves for some readers."""
    need(b"<!DOCTYPE" not in data and b"\0" not in data, "XML with a DTD, or in another encoding")
    builder = ElementTree.TreeBuilder(insert_comments=True, insert_pis=True)
    root = ElementTree.XML(data, ElementTree.XMLParser(target=builder))
    for parent in root.iter():
        kept = [x for x in parent if type(x.tag) is str]
        if len(kept) < len(parent):
            texts = [] if parent is root else [parent.text, *(x.tail for x in parent)]  # nobody reads the root's
            need(not any(x and x.strip() for x in texts), f"XML: a comment within the text of <{parent.tag}>")
            parent[:] = kept
    return root


def children(element: Any, where: str, once: str, many: str = "", harmless: str = "") -> dict[str, Any]:
    """The children of an element that may stand there once, by their words; all others must be known."""
    known = {*once.split(), *many.split(), *harmless.split()}
    tags = [x.tag for x in element]
    for tag in tags:
        need(tag in known, f"{where}: <{tag}> is not known there")
    need(not any(tags.count(tag) > 1 for tag in once.split()), f"{where}: an element appears twice in <{element.tag}>")
    return {tag: element.find(tag) for tag in once.split()}


def attributes(element: Any, where: str, allowed: str) -> dict[str, str]:
    """The attributes of an element, all of which must be known."""
    need({*element.attrib} <= {*allowed.split()}, f"{where}: <{element.tag}> has an attribute that is not known")
    return dict(element.attrib)


class Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Reads YAML without keys that stand twice, and without numbers that are none to other readers. It builds values as
    the parser comes to them, so that nothing recurses however deeply a file is nested."""

    def content(self) -> Any:
        """The value of the only document."""
        made: list[list[Any]] = [[]]  # the documents, and what is read of each open collection; keys and values in turn
        begun: list[Any] = [None]  # the events with which these begin
        anchors = dict[str, Any]()
        for event in iter(self.get_event, None):
            begins = event
            if type(event) is yaml.ScalarEvent:
                value = self.scalar(event)
                if value is MERGE:
                    good = len(made[-1]) % 2 == 0 and type(begun[-1]) is yaml.MappingStartEvent
                    need(good, "YAML: the word << stands where no key does")
            elif isinstance(event, yaml.CollectionStartEvent):
                need(len(begun) <= DEEPEST, f"YAML: is nested more than {DEEPEST} levels deep")
                need(event.tag in (None, "!", TAG + "map", TAG + "seq"), f"YAML: the tag {event.tag}")
                made.append([])
                begun.append(event)
                continue
            elif isinstance(event, yaml.CollectionEndEvent):
                value, begins = made.pop(), begun.pop()
                value = merged(value) if isinstance(event, yaml.MappingEndEvent) else value
            elif isinstance(event, yaml.AliasEvent):
                need(str(event.anchor) in anchors, "YAML: an alias of what is not there, or not yet")
                made[-1].append(anchors[str(event.anchor)])
                continue
            else:
                continue
            if begins.anchor is not None:
                need(begins.anchor not in anchors, "YAML: an anchor appears twice")
                anchors[begins.anchor] = value
            made[-1].append(value)
        need(len(made[0]) <= 1, "YAML: holds a second document")
        return made[0][0] if made[0] else None

    def scalar(self, event: Any) -> Any:
        """A word, or a number in decimal digits; MERGE for a key that merges."""
        word, tag = event.value, event.tag
        if tag is None and event.implicit[0] and USUAL.fullmatch(word):
            return float(word)
        if tag in (None, "!"):
            tag = plain_tag(word) if event.implicit[0] else f"{TAG}str"
        kind = tag.removeprefix(TAG)
        if kind == "str":
            return word
        if kind == "merge":
            return MERGE
        if kind == "bool":
            return self.bool_values[word.lower()]
        if kind not in ("int", "float"):
            return self.construct_object(yaml.ScalarNode(tag, word))
        infinite = word.lower() in (".inf", "+.inf", "-.inf")
        good = DECIMAL.fullmatch(word) or (infinite and kind == "float")
        need(good and not re.match(r"[-+]?0[0-9]", word), f"'{word}' is not a number in decimal digits")
        return int(word) if kind == "int" else float(word.replace(".", "") if infinite else word)


@functools.lru_cache(maxsize=4096)  # keys are the same in every file
def plain_tag(word: str) -> str:
    """The tag of a word without quotes."""
    return str(RULES.resolve(yaml.ScalarNode, word, (True, False)))


def merged(parts: list[Any]) -> dict[str, Any]:
    """A mapping of words, by its keys and values in turn; what is merged gives way to its own keys."""
    merges = MERGE in parts[::2]
    keys = ["<<" if key is MERGE else key for key in parts[::2]] if merges else parts[::2]
    need({*map(type, keys)} <= {str}, "a mapping has a key that is not a word")
    own, found = dict(zip(keys, parts[1::2], strict=True)), dict[str, Any]()
    if len(keys) != len(own):
        raise RejectedError(f"a key appears twice among {keys[:9]}")
    if merges:
        more = own.pop("<<")
        for each in reversed(more if isinstance(more, list) else [more]):
            need(isinstance(each, dict), "YAML: what is merged must be a mapping")
            found |= each
    return found | own


def yaml_of(data: bytes) -> Any:
    """The content of a YAML file."""
    return Loader(data).content()
