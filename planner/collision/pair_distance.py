"""What any distance of many body pairs looks like to the problem and to the controller."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hdplan.planner.collision.broad_phase import Rows
from hdplan.planner.kinematics.forward import KinematicsBatch

Floats = NDArray[np.float64]


class PairDistance(Protocol):
    """The distance of body pairs at samples, as a penalty needs it."""

    @property
    def how(self) -> str:
        """What computes it, in words."""
        ...

    def __call__(self, kinematics: KinematicsBatch, sample: Rows, pair: Rows) -> tuple[Floats, Floats, Floats]:
        """Return, for S pairs (rows of the term's pairs) at samples, less the margin: the distance D (S,) [m] whose
        hinge is taken; its derivative under a motion of the first body, as a wrench (S, 6), force and torque about the
        world's origin; and a lower bound of the true distance (S,) [m]."""
        ...
