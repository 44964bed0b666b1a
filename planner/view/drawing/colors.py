"""Colours of the viewer, which the colour-blind can distinguish, and how clearance becomes colour.

After Okabe & Ito (2008) for what has a name; for clearance from red, near, by ochre to blue, far. Lines have a contrast
of 3 : 1 at least to a white page and to a dark one (WCAG 2.2, 1.4.11), which has the same nodes: none is pale or dark.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdplan.planner.view.drawing.mesh_parts import Color
from hdplan.scenes.limits import QUANTITIES
from hdplan.scenes.once import read_only

START: Color = (0, 117, 183)  # blue
GOAL: Color = (213, 94, 0)  # vermillion
OUTER: Color = (0, 158, 115)  # bluish green
COLLISION: Color = (204, 121, 167)  # reddish purple
OBSTACLE: Color = (160, 150, 130)
LEFT_OUT: Color = (120, 120, 120)  # points of clouds
SELECTED: Color = (230, 159, 0)  # orange
PLANE: Color = (0, 158, 115)  # bluish green
REGION: Color = (86, 180, 233)  # sky blue: where a point of a link is to stay
CONTACT: Color = (214, 48, 39)  # the near end of the scale below
INK: Color = (110, 110, 120)
LINKS: Color = (150, 120, 80)  # between links
ITERATE: Color = (130, 130, 130)  # a path that is still optimized
MOTIONS: tuple[Color, ...] = (  # of motions, on path, plot and line
    (0, 158, 115),
    (204, 121, 167),
    (40, 148, 205),
    (200, 125, 0),
    (120, 94, 240),
    (162, 98, 56),
)

LINES: tuple[Color, ...] = (  # of joints
    START,
    GOAL,
    (0, 158, 115),
    (204, 121, 167),
    (200, 125, 0),
    (40, 148, 205),
    (128, 128, 128),
)
SHADES: tuple[Color, ...] = (START, (0, 158, 115), (200, 125, 0), (204, 121, 167), (40, 148, 205))
SHARES: dict[str, Color] = dict(zip(QUANTITIES, itertools.cycle(SHADES), strict=False))
"""By quantity: the greatest of all joints."""
FAR_CLEARANCE = 0.1  # [m] clearance above which the colour stays the same
SCALE = read_only(  # from contact to FAR_CLEARANCE, at equal steps
    np.array(
        [[214, 48, 39], [226, 85, 40], [212, 108, 25], [185, 127, 25], [150, 138, 95], [100, 145, 180], [65, 135, 205]]
        + [[60, 112, 215]]
    )
)
HEIGHTS = read_only(  # matplotlib's cividis without its ends, which a dark or a light page would swallow
    np.array([[47, 68, 107], [87, 93, 109], [122, 119, 119], [156, 145, 118], [194, 173, 105], [230, 204, 84]])
)


def clearance_colors(clearance: ArrayLike) -> NDArray[np.uint8]:
    """Return colours (..., 3) for clearances (...) [m]; contact and beyond is the first of the scale."""
    return _along(SCALE, np.clip(np.asarray(clearance, dtype=np.float64) / FAR_CLEARANCE, 0.0, 1.0))


def height_colors(share: ArrayLike) -> NDArray[np.uint8]:
    """Return colours (..., 3) for heights (...), 0 to 1 from the lowest to the highest."""
    return _along(HEIGHTS, np.asarray(share, dtype=np.float64))


def _along(scale: NDArray[np.int64], share: NDArray[np.float64]) -> NDArray[np.uint8]:
    steps = np.linspace(0.0, 1.0, len(scale))
    channels = [np.interp(share, steps, scale[:, channel]) for channel in range(3)]
    return np.stack(channels, axis=-1).round().astype(np.uint8)


def intensities(colors: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the intensities (…, 3) that colours stand for (sRGB, IEC 61966-2-1), both from 0 to 255: browsers take the
    colours of a line's points for intensities, and would draw them pale."""
    share = colors / 255.0
    intensity = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.asarray(255.0 * intensity).round().astype(np.uint8)


def hex_of(color: Color) -> str:
    """Return a colour as browsers write it."""
    return "#{:02x}{:02x}{:02x}".format(*color)


def clearance_legend() -> str:
    """Return the clearance scale as HTML."""
    stops = ", ".join(hex_of((int(r), int(g), int(b))) for r, g, b in SCALE)
    return (
        '<div class="hd" style="display:flex;gap:0.5em;align-items:center"><span>path: 0</span>'
        f'<div style="flex:1;height:0.6em;border-radius:3px;background:linear-gradient(to right, {stops})"></div>'
        f"<span>≥ {FAR_CLEARANCE * 1000:g} mm clear</span></div>"
    )


def color_legend(color: Color, means: str) -> str:
    """Return the legend of one colour of a path as HTML; `means` is HTML."""
    return f'<div class="hd">path: <span style="color:{hex_of(color)}">▬</span> {means}</div>'
