"""Files as the checker reads them: bytes with their hash, numbers in decimal digits, XML, YAML and JSON.

Nothing here is shared with hdplan's own readers. What could be read in two ways is rejected.
"""

from __future__ import annotations

import hashlib
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from .balls import need

DECIMAL = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")  # Python reads 1_0 as 10, too
SPACE = " \t\n\r\f\v"
LARGEST = 1e9  # of numbers
DEEPEST = 64  # levels of lists and mappings


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
    need(DECIMAL.fullmatch(text) and abs(float(text)) < LARGEST, f"{what}: '{word}' is no number")
    return float(text)


def row(text: Any, count: int, what: str) -> Any:
    """As many numbers, between spaces."""
    words = split(text) if type(text) is str else []
    need(len(words) == count, f"{what}: {count} numbers are expected, found '{text}'")
    return np.array([number(word, what) for word in words])


def table(words: Sequence[bytes | str], what: str) -> Any:
    """Many numbers."""
    found = [x.decode("ascii", "replace") if isinstance(x, bytes) else x for x in words]
    need(all(map(DECIMAL.fullmatch, found)), f"{what}: a word is no number")
    return np.array(found, dtype=np.float64)


def values(value: Any, count: int, what: str) -> Any:
    """As many finite numbers of a scene, in a list if they are several."""
    rows = value if isinstance(value, list) else [value]
    good = len(rows) == count and all(type(x) in (int, float) and abs(x) < LARGEST for x in rows)
    need(good, f"{what}: {count} finite numbers are expected")
    return np.array(rows, dtype=np.float64)


def mapping(value: Any, what: str, allowed: str) -> dict[str, Any]:
    """A mapping that has no other keys than those `allowed`, as others may change what is meant; without nulls."""
    need(isinstance(value, dict), f"{what}: a mapping is expected")
    for key in value:
        need(key in allowed.split(), f"{what}: the checker does not know '{key}' there, only {allowed}")
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
    need(not any(tags.count(tag) > 1 for tag in once.split()), f"{where}: an element stands twice in <{element.tag}>")
    return {tag: element.find(tag) for tag in once.split()}


def attributes(element: Any, where: str, allowed: str) -> dict[str, str]:
    """The attributes of an element, all of which must be known."""
    need({*element.attrib} <= {*allowed.split()}, f"{where}: <{element.tag}> has an attribute that is not known")
    return dict(element.attrib)


class Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Reads YAML without keys that stand twice, and without numbers that are none to other readers."""

    def __init__(self, stream: Any) -> None:
        """Read a stream."""
        super().__init__(stream)
        self.flat = set[Any]()

    def flatten_mapping(self, node: Any) -> None:
        """Put what is merged before a mapping's own keys, to which it gives way; once, as keys then stand twice."""
        if node not in self.flat:
            self.flat.add(node)
            keys = [key.value for key, _ in node.value]  # `<<`, too
            need(len(keys) == len({*keys}), f"a key stands twice among {keys[:9]}")
            super().flatten_mapping(node)

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        """A mapping of words."""
        self.flatten_mapping(node)
        found = {self.construct_object(key, True): self.construct_object(x, True) for key, x in node.value}
        need(all(type(key) is str for key in found), "a mapping has a key that is not a word")
        return found

    def construct_scalar(self, node: Any) -> Any:
        """A word, or a number in decimal digits."""
        numeric = node.tag in ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
        good = not numeric or DECIMAL.fullmatch(node.value) or node.value.lower() in (".inf", "+.inf", "-.inf")
        leading = numeric and re.match(r"[-+]?0[0-9]", node.value)
        need(good and not leading, f"'{node.value}' is no number in decimal digits")
        return super().construct_scalar(node)


def yaml_of(data: bytes) -> Any:
    """The content of a YAML file. What is nested too deeply would end the process; so it is counted first."""
    depth = 0
    for event in yaml.parse(data, Loader=Loader):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        need(depth <= DEEPEST, f"YAML: is nested more than {DEEPEST} levels deep")
    return yaml.load(data, Loader)
