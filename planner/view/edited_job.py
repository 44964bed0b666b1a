"""A scene with a job as it is edited in the browser: a value that is replaced by every change.

A motion is part of it only as long as the scene is the very one in which the motion was certified: no verdict can be
shown of another scene.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hdplan.planner.job.certify import JobCertificate
from hdplan.planner.job.spots import Spot, moved, positions_of, spots_of
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.page.job_page import ShownJob, before_it
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.errors import InputError
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene, derived


class Movable(NamedTuple):
    """Something that can be dragged: an object that stands there at first, a place where one is taken or left, or
    both."""

    label: str
    obstacle: str | None
    spot: Spot | None


@dataclass(frozen=True, eq=False)
class EditedJob:
    """A scene with a job, and its motion if there is one."""

    scene: Scene
    shown: ShownJob | None = None  # in this scene
    failure: str = ""  # why not all stages could be planned

    @classmethod
    def of(cls, scene: Scene) -> EditedJob:
        """Take a scene without a motion. Raises InputError for one without a job that can be planned."""
        edited = cls(scene)
        _ = edited.setup
        return edited

    def done(self, trajectory: Trajectory, certificate: JobCertificate, failure: str = "") -> EditedJob:
        """Return this scene with a motion of its job, which was certified in it, measured and ready to be drawn."""
        shown = ShownJob(self.scene, trajectory, certificate)
        _ = shown.setup, shown.motion  # now, so that drawing does not wait
        return replace(self, shown=shown, failure=failure)

    @cached_property
    def setup(self) -> Setup:
        """The drawn scene."""
        return before_it(self.scene) if self.shown is None else self.shown.setup

    @property
    def certified(self) -> bool:
        """True if there is a motion of the whole job, and all its stages are proven."""
        return self.shown is not None and not self.failure and self.shown.certificate.certified

    @cached_property
    def movables(self) -> tuple[Movable, ...]:
        """Things that can be dragged: places with all stages that lead there, and objects that no stage grips."""
        job = self.scene.job
        assert job is not None
        spots = spots_of(self.scene)
        taken = {spot.object for spot in spots if spot.stands}
        found = [Movable(each.name, each.name, None) for each in self.scene.obstacles if each.name not in taken]
        for spot in spots:
            label = spot.object if spot.stands else f"place of {spot.object} in '{job.names[spot.number]}'"
            if spot.stands or self._positions(spot):
                found.append(Movable(label, spot.object if spot.stands else None, spot))
        return tuple(found)

    def place_of(self, thing: Movable) -> Pose:
        """Return the point at which a thing is grasped (world frame). Raises InputError if it is gone."""
        if thing.obstacle is not None:
            return self._obstacle(thing.obstacle).pose
        assert thing.spot is not None
        return Pose(self._positions(thing.spot)[-1])

    def turns(self, thing: Movable) -> bool:
        """True if a thing can be turned: of what is taken, the grasp would be another."""
        return thing.spot is None

    def dragged(self, thing: Movable, pose: Pose) -> EditedJob:
        """Return the scene with a thing at another place, without a motion. Raises InputError for what the scene does
        not allow."""
        if thing.spot is not None:
            by = np.array(pose.position) - np.array(self.place_of(thing).position)
            return EditedJob.of(moved(self.scene, thing.spot, by))
        assert thing.obstacle is not None
        mine = self._obstacle(thing.obstacle)
        others = tuple(replace(each, pose=pose) if each is mine else each for each in self.scene.obstacles)
        return EditedJob.of(derived(self.scene, obstacles=others))

    def _obstacle(self, name: str) -> Obstacle:
        for each in self.scene.obstacles:
            if each.name == name:
                return each
        raise InputError(f"{name}: is no longer in the scene")

    def _positions(self, spot: Spot) -> list[tuple[float, float, float]]:
        """The positions to which the stages of a spot go; none if one of them cannot be moved."""
        try:
            found = [positions_of(self.scene, number) for number in spot.stages if number < spot.number]
        except InputError:
            return []
        return [each[0][1] for each in found if each]
