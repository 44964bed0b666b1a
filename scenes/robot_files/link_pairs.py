"""Pairs of links, in one spelling."""

from __future__ import annotations

LinkPair = tuple[str, str]  # two different links, in alphabetical order


def link_pair(a: str, b: str) -> LinkPair:
    """Return the pair in alphabetical order."""
    return (a, b) if a <= b else (b, a)
