"""XML of robot descriptions: parsed, and refused where its readers would fail or differ.

Comments and processing instructions (`<?xml-model ..?>`) say nothing of the robot and are passed over; a DTD may give
attributes and texts that are not to be seen where they act, so it is refused.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Collection

from hdplan.scenes.errors import InputError
from hdplan.scenes.number_text import read_numbers

Element = ElementTree.Element

DEEPEST_LEVEL = 64  # levels of elements
_XACRO = re.compile(r"/xacro/?$")  # of the namespaces that xacro has had


class _Builder(ElementTree.TreeBuilder):
    """A tree of elements, without DTD."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        """Refuse the DTD that begins here."""
        raise InputError("holds a document type definition (<!DOCTYPE ..>), which is not read")


def parse(data: bytes, allowed: Collection[str]) -> Element:
    """Return the root element. Raises InputError for what is no XML, has a DTD, is nested too deeply, or has another
    root."""
    try:
        root: Element = ElementTree.fromstring(data, ElementTree.XMLParser(target=_Builder()))
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(f"not well-formed XML: {error}") from None
    check_depth(root)
    if root.tag not in allowed:
        expected = " or ".join(f"<{tag}>" for tag in allowed)
        namespace, name = split(root.tag)
        where = f", in the namespace '{namespace}'" if namespace else ""
        raise InputError(f"the root element is <{name}>{where}, expected {expected}")
    return root


def split(name: str) -> tuple[str, str]:
    """Return the namespace, empty for none, and the local name of an element or attribute."""
    namespace, _, local = name.rpartition("}")
    return namespace.removeprefix("{"), local


def is_xacro(namespace: str) -> bool:
    """True if a namespace is that of xacro, which has had several."""
    return bool(_XACRO.search(namespace))


def stray_text(element: Element) -> str:
    """Return the beginning of the first text between the tags of an element and of its children; empty for white space
    alone."""
    texts = (element.text, *(child.tail for child in element))
    return next((found[:40] for text in texts if text and (found := text.strip())), "")


def finite_numbers(text: str, where: str, count: int | None = None, largest: float = math.inf) -> tuple[float, ...]:
    """Return the numbers of a text: `count` of them, or one and more. Raises InputError for anything else."""
    try:
        values = read_numbers(text.split())
    except ValueError:
        values = ()
    finite = all(math.isfinite(value) and abs(value) <= largest for value in values)
    if not values or not finite or (count is not None and len(values) != count):
        expected = {None: "finite numbers", 1: "a finite number"}.get(count, f"{count} finite numbers")
        bound = f" of at most {largest:g} in size" if math.isfinite(largest) else ""
        raise InputError(f"{where} must be {expected}{bound}, found '{text}'")
    return values


def check_depth(root: Element) -> None:
    """Raise InputError for elements that are nested too deeply: readers of them are recursive."""
    level = [root]
    for _ in range(DEEPEST_LEVEL):
        level = [below for element in level for below in element]
    if level:
        raise InputError(f"not well-formed XML: elements are nested more than {DEEPEST_LEVEL} levels deep")
