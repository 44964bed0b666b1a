"""The place where a motion fails in its scene: the worst pair of bodies, named beside it."""

from __future__ import annotations

import numpy as np
import viser

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.view.drawing.labels import Label
from hdplan.planner.view.drawing.motion import ShownMotion, Tip, millimetres, shortened
from hdplan.planner.view.drawing.nodes import LABEL_HEIGHT
from hdplan.scenes.array_types import Array


class ClashNode:
    """A label at the place, hidden where nothing fails."""

    def __init__(self, server: viser.ViserServer) -> None:
        """Send it."""
        self.label = Label(server, "/clash")

    def show(self, motion: ShownMotion | None, certifier: Certifier) -> None:
        """Name the worst contact of a motion, or the place where it comes too close; hide the label for any other."""
        found = None if motion is None or motion.scene is not certifier.setup.requested else clash_of(motion, certifier)
        self.label.visible = found is not None
        if found is not None:
            self.label.text, self.label.place = found


def clash_of(motion: ShownMotion, certifier: Certifier) -> tuple[str, Array] | None:
    """Return the pair that touches or comes too close, with its distance, in words, and where (3,) [m]; None if none
    does. The place is for the picture: between the closest points of the two bodies."""
    failures = motion.certificate.failures
    if motion.certificate.status not in (Status.IN_CONTACT, Status.TOO_CLOSE) or not failures:
        return None
    worst = min(failures, key=lambda place: place.distance)
    q = motion.curve.at_parameter(worst.parameter)
    pairs = certifier.closest(q, worst.seconds or 0.0)
    points = [
        pair.points for pair in pairs if pair is not None and (pair.link, pair.other) == (worst.link, worst.other)
    ]
    at = points[0].mean(axis=0) if points else Tip.of(certifier.robot).placement(q).translation
    words = shortened(f"{worst.link} – {worst.other}: {millimetres(worst.distance)}")
    return words, np.asarray(at + [0.0, 0.0, LABEL_HEIGHT])
