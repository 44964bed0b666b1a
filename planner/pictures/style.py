"""Colours of the pictures, distinct also for the colour-blind and in grey (M. Okabe, K. Ito, "Color Universal Design",
2008)."""

from __future__ import annotations

from typing import Any

INK = "#222222"
START = "#0072B2"  # blue
GOAL = "#D55E00"  # vermillion
BETWEEN = "#56B4E9"  # sky blue
OBSTACLE = "#877D6B"  # grey, warm
MOVING = "#E69F00"  # orange
ROBOT_TO_OBSTACLES = "#009E73"  # bluish green
BETWEEN_LINKS = "#CC79A7"  # reddish purple
OUTER = "#0072B2"
CONTACT = "#D55E00"
DEPTH = "#E69F00"  # orange
GOOD = "#009E73"
FIXED = "#5A5A5A"
GREY = "#E9E9E9"
FRAME = "#BBBBBB"

# Many curves in one panel: distinct in grey by their dashes.
CURVES: tuple[dict[str, Any], ...] = (
    {"color": INK, "linestyle": "-"},
    {"color": DEPTH, "linestyle": "-"},
    {"color": START, "linestyle": "--"},
    {"color": GOAL, "linestyle": "--"},
    {"color": GOOD, "linestyle": "-."},
    {"color": BETWEEN_LINKS, "linestyle": "-."},
    {"color": BETWEEN, "linestyle": ":"},
    {"color": OBSTACLE, "linestyle": ":"},
)

# Sets of normals, from cheap to tight: colour and marker of each.
RUNG_STYLES = {
    "paper": (INK, "o"),
    "paper+centre": (GOAL, "D"),
    "paper+sphere-26": (DEPTH, "^"),
    "paper+sphere-256": (BETWEEN, "s"),
    "paper+edges": (GOOD, "*"),
    "paper+centre+edges": (BETWEEN_LINKS, "P"),
}
OTHER_RUNG = (OBSTACLE, "X")


def plain(text: str, most: int) -> str:
    """Return text that matplotlib prints literally, with dollar signs escaped, cut to at most so many characters."""
    return (text if len(text) <= most else f"{text[: most - 1]}…").replace("$", r"\$")


RC = {
    "font.size": 8.5,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.linewidth": 0.7,
    "axes.edgecolor": INK,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
}
