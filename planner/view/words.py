"""What the panel says, as HTML: verdicts, contacts and clearances in words."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any

from hdplan.planner.certificate.verdict import Contact
from hdplan.planner.view.drawing.colors import hex_of
from hdplan.planner.view.drawing.motion import millimetres
from hdplan.planner.view.drawing.skins import Color

OUTDATED = "the scene is being changed: nothing is known of this motion in it yet"


def small(text: str, size: float = 0.8) -> str:
    """Return HTML in the panel's small print; nothing for no text."""
    return f'<div style="padding:0 0.9em;font-size:{size}em">{text}</div>' if text else ""


def coloured(text: str, color: Color) -> str:
    """Return a text in a colour."""
    return f'<span style="color:{hex_of(color)}">{html.escape(text)}</span>'


def contact_words(contacts: Sequence[Contact]) -> str:
    """Say which bodies touch, the deepest first, three at most."""
    return "; ".join(
        f"{c.link} and {c.other} " + (f"overlap by {c.depth * 1e3:.3g} mm" if c.depth else "touch")
        for c in contacts[:3]
    )


def clearance_words(now: str, pairs: Sequence[Any]) -> str:
    """Say how close the robot is to obstacles and to itself at a moment."""
    words = [
        f"{name} <b>{millimetres(pair.distance)}</b> ({html.escape(pair.link)} – {html.escape(pair.other)})"
        for name, pair in zip(("to obstacles", "between links"), pairs, strict=True)
        if pair is not None
    ]
    return small(f"clearance at {now}, exact:<br/>{'<br/>'.join(words) or 'nothing to touch'}")
