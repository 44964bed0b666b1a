"""A motion as one page that opens without a server: viser's client with what it was sent, moment by moment, inside.

Only the scene is recorded, not the panels: what they say is in the labels. The page plays by itself, again and again,
in real time where the motions have times.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hdplan.scenes.output import write_output

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

RATE = 25  # frames a second
REST = 0.8  # [s] for which the goal is shown at the end


def record(viewer: Viewer, page: Path) -> None:
    """Write the viewer's motions as they are shown. Raises InputError if the page cannot be written."""
    timeline = viewer.panel.player.timeline
    times = np.linspace(timeline.begin, timeline.end, max(round(RATE * timeline.duration), 1) + 1)
    viewer.show(timeline.begin)
    serializer = viewer.server.get_scene_serializer()
    for now in times.tolist():
        viewer.show(now)
        serializer.insert_sleep(1.0 / RATE)
    serializer.insert_sleep(REST)
    write_output(page, serializer.as_html().encode())
