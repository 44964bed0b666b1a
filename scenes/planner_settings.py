"""Settings of the planner: the `planner` section of a scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from hdplan.scenes.values import Checked, Choice, Number, Whole

DISTANCES = ("hdsdf", "fcl")
OBJECTIVES = ("time", "smoothness", "energy")
LINK_BODIES = ("fitted", "capsule", "outer-4", "outer-12", "box", "hull")


@dataclass(frozen=True, repr=False)
class PlannerSettings(Checked):
    """The `planner` section. Every value has a default; `hdplan explain` shows the ones in force."""

    waypoints: Annotated[int, Whole(3, 1000)] = 32  # number of rows of the trajectory, start and goal included
    clearance: Annotated[float, Number(0.0, 1.0)] = 0.0  # to be proven around the robot [m]
    activation: Annotated[float, Number(0.0, 1.0)] = 0.02  # beyond the clearance; where the penalty sets in [m]
    gamma: Annotated[int, Whole(1, 32)] = 2  # order of smoothness of the distance
    shaping_length: Annotated[float, Number(1e-9, 1.0)] = 1e-3  # width of the distance's flat spot at contact [m]
    distance: Annotated[str, Choice(DISTANCES)] = "hdsdf"  # used by the obstacle penalty; fcl is exact
    link_bodies: Annotated[str, Choice(LINK_BODIES)] = "fitted"  # the bodies that enclose a link
    swept: bool = False  # hulls of link bodies at neighbouring waypoints instead of samples between them
    normals: Annotated[str, Choice(("faces", "box", "sphere"))] = "box"
    """Candidate normals of an obstacle: faces (6 for a box), box (26) or sphere (122)."""
    polish: Annotated[int, Whole(0, 10_000)] | None = (
        None  # rounds that try to improve the first motion; None: `Scene.polish`
    )
    objective: Annotated[str, Choice(OBJECTIVES)] | None = (
        None  # the measure that selects among certified motions; None: `Scene.objective`
    )
