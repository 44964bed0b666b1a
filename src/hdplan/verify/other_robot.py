"""A robot whose description the checker does not read (xacro, MJCF), as the world of a proof has it.

What a scene says of it in numbers is read all the same: start and goal by joints, poses of links, what it holds, what
stands around it. Only what needs the description's own words, such as a named state, is the proof's.
"""

from __future__ import annotations

from typing import Any

from .balls import Pose, need
from .world import placed


class NotClaimedError(Exception):
    """A request for what only the robot's description holds."""


class NoSemantics:
    """In place of the description's semantics: where these are needed, the reader takes the proof's claim."""

    def states(self, group: str | None) -> dict[str, dict[str, float]]:
        """Named states."""
        raise NotClaimedError


class OtherRobot:
    """Joints and links of the world that a proof claims, as `Joints` and `Tree` have those of a description."""

    def __init__(self, claimed: Any, spec: dict[str, Any]) -> None:
        """Take them."""
        need(type(claimed) is dict, "robot: cannot be read by the checker, and there is no proof that has it")
        self.claimed, self.spec, self.semantics, self.group = claimed, spec, NoSemantics(), None
        self.moving = [x["name"] for x in claimed["joints"]]
        rules = {x["name"]: x["follows"] for x in claimed["joints"] if x["follows"] is not None}
        self.rules = {name: (self.moving[other], factor, add) for name, (other, factor, add) in rules.items()}
        self.lead = [x for x in self.moving if x not in rules]
        self.held = dict(claimed["held"])
        self.movable = [*self.moving, *self.held]
        links = placed([(f"links.{link}", entry) for link, entry in claimed["links"].items()], "joint")
        self.at: dict[str, tuple[int, Pose]] = dict(zip(claimed["links"], links, strict=True))
        self.bodies = [x for x in claimed["bodies"] if x["kind"] == "link"]
        self.links, self.solid = [*self.at], {x["name"] for x in self.bodies}
