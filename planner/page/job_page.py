"""A job as a page: one motion of arm and fingers with its stages on the timeline, in a scene in which held objects move
with the hand and released objects stay.

That scene is for the eye alone. What is proven, and what is close, is that of each stage's own scene, in which some
pairs may touch.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Closest, Status
from hdplan.planner.html_page import HtmlPage
from hdplan.planner.job.certify import JobCertificate, StageCertificate
from hdplan.planner.job.places import pose_of
from hdplan.planner.job.stage_scenes import leaders_of
from hdplan.planner.job.world import World
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.page.recorded_page import page_of
from hdplan.planner.pictures.clearances import exact
from hdplan.planner.robot.link_frame import link_poses, links_of
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view.drawing.motion import ShownMotion, Tip, sample_parameters
from hdplan.scenes.array_types import Array
from hdplan.scenes.limits import Limits
from hdplan.scenes.obstacles import Obstacle, TimedPoses
from hdplan.scenes.scene import Scene, derived
from hdplan.scenes.targets import JointTarget
from hdplan.scenes.timing import Timing

HELD_RATE = 50.0  # [1/s] places of what is held


class ShownStage:
    """A stage on the timeline, and what is close in it."""

    def __init__(self, stage: StageCertificate) -> None:
        """Load its scenes: that of its motion, and of the arm that stands still while fingers move."""
        self.stage = stage
        setups = [Setup.of(each) for each in (stage.scene, stage.arm) if each is not None]
        self._certifiers = [Certifier(setup) for setup in setups]
        self._curves = [curve_of(setups[0].robot, stage.trajectory)]
        self._curves += [_resting(setup.robot, setup.scene, self._curves[0]) for setup in setups[1:]]
        self._around = {each.name for each in stage.scene.obstacles} | {
            each.name for each in stage.scene.attached if each.name not in stage.held
        }

    @property
    def data(self) -> dict[str, Any]:
        """The page's data of a stage."""
        stage = self.stage
        may = f"; may touch: {', '.join('-'.join(pair) for pair in stage.touch)}" if stage.touch else ""
        holds = f"holds {', '.join(stage.held) or 'nothing'}"
        times = {"begin": stage.begins, "end": stage.ends}
        verdict = stage.certificate
        return {"name": stage.name, **times, "certified": verdict.certified, "words": f"{holds}{may}"}

    def closest(self, seconds: float) -> tuple[Closest | None, Closest | None]:
        """Return the closest pair with what stands around, and between links and held objects, at a time [s]."""
        found: list[list[Closest]] = [[], []]
        for certifier, curve in zip(self._certifiers, self._curves, strict=True):
            for near in certifier.closest(curve.at_time(np.array([seconds]))[0]):
                if near is not None:
                    found[not {near.link, near.other} & self._around].append(near)
        to_obstacle, between = (min(each, key=lambda near: near.distance, default=None) for each in found)
        return to_obstacle, between

    def clearances(self, times: Array) -> tuple[Array, Array]:
        """Return the distances (k,) to obstacles that may not be touched, and of all others that are compared, infinite
        where there are none."""
        found = np.full((2, len(times)), np.inf)
        for certifier, curve in zip(self._certifiers, self._curves, strict=True):
            places, between = exact(certifier, curve.at_time(times), np.zeros(len(times)))
            if places:
                found[0] = np.minimum(found[0], [place.distance for place in places])
            if len(between):
                found[1] = np.minimum(found[1], between)
        return found[0], found[1]


def before_it(scene: Scene) -> Setup:
    """Return the drawing of a scene with a job without a motion: the robot at its start, and all objects where
    they are then. Raises InputError for a scene without a job that can be planned."""
    first = World.at_first(scene)
    return Setup.of(_drawn(scene, goal=replace(scene.start, field="goal"), obstacles=_at_first(first)))


def _drawn(scene: Scene, **fields: Any) -> Scene:
    """Return the scene in which a job is drawn, without what is for planning alone."""
    bare = {"limits": Limits(), "timing": Timing(), "payload": None, "attached": (), "obstacles": ()}
    return derived(scene, job=None, **(bare | fields))


def _at_first(world: World) -> tuple[Obstacle, ...]:
    """Return all objects where a job begins; what is held, where the hand is."""
    held = [Obstacle(each.name, each.shape, pose_of(world.place(each.name))) for each in world.held]
    return (*world.obstacles, *held)


@dataclass(frozen=True, eq=False)
class ShownJob:
    """A job's motion, and the scene in which it is drawn."""

    scene: Scene  # with the job
    trajectory: Trajectory
    certificate: JobCertificate

    @cached_property
    def setup(self) -> Setup:
        """The drawn bodies: the robot with all joints that move, and objects that are carried."""
        spec, motion = self.scene.robot, self.trajectory
        leaders = leaders_of(spec)
        held = {**spec.locked, **motion.locked}
        locked = {x: at for x, at in held.items() if leaders.get(x, x) not in motion.joint_names}
        ends = [
            JointTarget(end, by_name=dict(zip(motion.joint_names, motion.positions[row].tolist(), strict=True)))
            for end, row in (("start", 0), ("goal", -1))
        ]
        robot = replace(spec, group=motion.joint_names, locked=locked)
        bare = _drawn(self.scene, robot=robot, start=ends[0], goal=ends[1])
        carried = self._carried(load_scene_robot(bare))
        obstacles = [
            replace(each, pose=carried[each.name].poses[0], motion=carried[each.name], clearance=None)
            if each.name in carried
            else each
            for each in _at_first(World.at_first(self.scene))
        ]
        return Setup.of(derived(bare, obstacles=tuple(obstacles)))

    @property
    def page(self) -> HtmlPage:
        """The page."""
        return page_of(self.setup, [self.motion], [stage.data for stage in self.stages], self.closest)

    @cached_property
    def stages(self) -> list[ShownStage]:
        """The stages that there are."""
        return [ShownStage(stage) for stage in self.certificate.stages]

    @cached_property
    def motion(self) -> ShownMotion:
        """The whole of it, with what is close in each stage."""
        robot = self.setup.robot
        curve = curve_of(robot, self.trajectory)
        parameter = sample_parameters(len(curve))
        joints, times = curve.at_parameter(parameter), curve.time_of(parameter)
        number = self._number(times)
        clearance = np.full((2, len(times)), np.inf)
        for i in np.unique(number).tolist():  # a short stage may lie between two times
            clearance[:, number == i] = self.stages[i].clearances(times[number == i])
        whole = self.certificate
        one = (whole.failed or whole.stages[0]).certificate
        status = one.status if whole.failed or whole.certified else Status.WRONG_ENDS
        certificate = replace(one, status=status, text=whole.text, clearance=whole.clearance)
        known = (*clearance, None, certificate, self.setup.requested)
        return ShownMotion("job", self.trajectory, curve, parameter, joints, Tip.of(robot).path(joints), *known)

    def closest(self, seconds: float) -> tuple[Closest | None, Closest | None]:
        """Return the closest pairs at a time [s], in the stage at that time."""
        return self.stages[self.number_at(seconds)].closest(seconds)

    def number_at(self, seconds: float) -> int:
        """Return the number of the stage that there is at a time [s]."""
        return int(self._number(np.array([seconds]))[0])

    def _number(self, times: Array) -> Array:
        begins = [stage.begins for stage in self.certificate.stages]
        return np.asarray(np.searchsorted(begins, times, side="right") - 1)

    def _carried(self, robot: Robot) -> dict[str, TimedPoses]:
        """Return the motion of each object that is held at some time, by the joints' places then."""
        curve, links = curve_of(robot, self.trajectory), links_of(robot)
        found: dict[str, tuple[list[float], list[Any]]] = {}
        for stage in self.certificate.stages:
            count = max(2, int(np.ceil(HELD_RATE * (stage.ends - stage.begins))) + 1)
            times = np.linspace(stage.begins, stage.ends, count)
            joints = curve.at_time(times)
            for each in stage.scene.attached:
                if each.name in stage.held:
                    when, poses = found.setdefault(each.name, ([], []))
                    places = link_poses(robot, joints, links[each.link]) @ each.pose.matrix
                    kept = slice(1 if when and times[0] <= when[-1] else 0, None)
                    when += times[kept].tolist()
                    poses += [pose_of(place) for place in places[kept]]
        return {name: TimedPoses(tuple(when), tuple(poses)) for name, (when, poses) in found.items()}


def _resting(robot: Robot, scene: Scene, like: Curve) -> Curve:
    """Return the curve of an arm that stands still as long as another one moves."""
    assert like.times is not None
    q = robot.configuration(scene.start)
    return Curve.through(np.stack([q, q]), like.times[[0, -1]], np.zeros((2, robot.n)), np.zeros((2, robot.n)))
