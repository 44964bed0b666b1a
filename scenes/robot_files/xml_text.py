"""XML of robot descriptions: parsed, and refused where its readers would fail."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Collection

from hdplan.scenes.errors import InputError

DEEPEST = 64  # levels of elements


def parse(data: bytes, allowed: Collection[str]) -> ElementTree.Element:
    """Return the root element. Raises InputError for what is no XML, nested too deeply, or has another root."""
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(f"not well-formed XML: {error}") from None
    check_depth(root)
    if root.tag not in allowed:
        expected = " or ".join(f"<{tag}>" for tag in allowed)
        raise InputError(f"the root element is <{root.tag}>, expected {expected}")
    return root


def check_depth(root: ElementTree.Element) -> None:
    """Raise InputError for elements that are nested too deeply: readers of them are recursive."""
    level = [root]
    for _ in range(DEEPEST):
        level = [below for element in level for below in element]
    if level:
        raise InputError(f"not well-formed XML: elements are nested more than {DEEPEST} levels deep")
