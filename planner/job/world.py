"""What there is when a stage of a job begins, the scene of a single motion that the stage makes of it, and what there
is when it has ended.

A stage's scene is one like any other: it is planned, certified, proven and drawn as such. The arm starts where the last
stage ended. What is held is `attached`, what was let go is an obstacle where it was let go. Fingers that are not moved
are held. An obstacle that something may touch is `attached` to a link that stands fast in the world, with these as its
`touch_links`: it is kept out of contact with everything else, without planner.clearance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, assert_never

import numpy as np
from numpy.typing import NDArray

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.job.line import as_constraints
from hdplan.planner.job.places import fixed_link, link_pose, pose_of
from hdplan.planner.robot.link_frame import end_effector, links_of
from hdplan.planner.robot.linkage import rules_of
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.attached import Attached
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.errors import InputError, naming, nearest
from hdplan.scenes.job import TOOL, WORLD, Grip, Job, Line, Move, Release, Stage, Wait, stage_name
from hdplan.scenes.limits import QUANTITIES, Limits
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.robot_files.description import read_words
from hdplan.scenes.robot_files.library import description_of, source_of
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.scene import Scene, derived
from hdplan.scenes.shapes import Solid
from hdplan.scenes.targets import JointTarget
from hdplan.scenes.timing import Timing

Array = NDArray[np.float64]

REACH = 5e-3  # [m] from what is to hold an object, beyond which it cannot be taken hold of


@dataclass(frozen=True)
class World:
    """The robot, what it holds, and what stands around it."""

    scene: Scene  # of the job
    arm: tuple[tuple[str, float], ...]  # the planned joints and their values [rad] or [m]
    hand: tuple[tuple[str, float], ...]  # joints that are held, as far as the job says where
    obstacles: tuple[Obstacle, ...]
    held: tuple[Attached, ...]
    notes: tuple[str, ...] = ()  # on points of clouds that were left out

    @classmethod
    def at_first(cls, scene: Scene) -> World:
        """Return what there is before the first stage. Raises InputError for a scene that no job can be planned in."""
        if scene.job is None:
            raise InputError(f"{scene.source}: job: is missing; hdplan.plan is for a single motion")
        if scene.limits.acceleration is None:
            raise InputError(f"{scene.source}: limits.acceleration: is missing: a job is timed, and a URDF has none")
        bare = derived(scene, job=None)
        bare.check_effects()
        setup = Setup.of(bare)  # leaves out of clouds what they are to ignore: once, where the job begins
        robot = setup.robot
        with naming(scene.source):
            q = robot.configuration(scene.start)
        named = {joint: robot.locked[joint] for joint in scene.start.by_name or () if joint in robot.locked}
        arm = tuple(zip(robot.joint_names, q.tolist(), strict=True))
        return cls(scene, arm, tuple(named.items()), _as_seen(setup), scene.attached, setup.ignored)

    @property
    def things(self) -> dict[str, Obstacle | Attached]:
        """Obstacles and held objects by name."""
        found: tuple[Obstacle | Attached, ...] = (*self.obstacles, *self.held)
        return {each.name: each for each in found}

    def touched(self, number: int, rows: Array) -> dict[tuple[str, str], float]:
        """Return the least distance [m] of each pair that may touch in a stage, by its `touch` or as a finger that
        moves and what is held, at some configurations (k, n) of its scene's robot: negative where they overlap,
        infinite beyond REACH."""
        assert self.scene.job is not None
        stages = list(self.scene.job.stages)
        stages[number] = replace(stage := stages[number], touch=(), name=stage_name(stage, number))
        held = tuple(replace(each, touch_links=()) for each in self.held)
        world = replace(self, scene=derived(self.scene, goal=None, job=Job(stages)), held=held)
        looked, pairs = [(world.stage_scene(number), rows)], stage.touch
        if moves_fingers(stage):
            looked.append((world.standing_scene(number), self._q[None]))
            pairs += tuple((each.name, link) for each in self.held for link in each.touch_links)
        near: dict[frozenset[str], float] = {}
        for scene, configurations in looked:
            certifier = Certifier(Setup.of(scene))
            for q in configurations:
                found = [(each.link, each.other, each.distance) for each, _ in certifier.too_close(q, REACH)]
                found += [(each.link, each.other, -each.depth) for each in certifier.contacts(q)]
                for one, other, distance in found:
                    pair = frozenset((one, other))
                    near[pair] = min(distance, near.get(pair, np.inf))
        standing = {each.name for each in self.obstacles}
        return {pair: near.get(frozenset(pair), np.inf) for pair in pairs if not standing.issuperset(pair)}

    def stage_scene(self, number: int) -> Scene:
        """Return the scene of the motion of a stage. Raises InputError, naming the stage, for names that there are not,
        and for what cannot be done from here."""
        assert self.scene.job is not None
        stage = self.scene.job.stages[number]
        with naming(stage_source(self.scene, number)):
            match stage:
                case Move():
                    return self._of_arm(number, stage, goal=stage.goal, path=stage.path)
                case Line():
                    return self._line(number, stage)
                case Grip() | Release() if stage.joints:
                    return self._of_hand(number, stage)
                case Grip() | Release():
                    self._check_object(stage)
                    return self._of_arm(number, stage, goal=self._start)
                case Wait():
                    return self._of_arm(number, stage, goal=self._start)
                case _:
                    assert_never(stage)

    def standing_scene(self, number: int) -> Scene:
        """Return the scene in which the arm stands still when a stage of the fingers begins: theirs compares nothing
        that does not move with them."""
        assert self.scene.job is not None
        stage = replace(self.scene.job.stages[number], limits=None)
        with naming(stage_source(self.scene, number)):
            scene = self._of_arm(number, stage, goal=self._start)
        return derived(scene, limits=Limits(position=scene.limits.position), payload=None, timing=None)

    def after(self, number: int, q: Array) -> World:
        """Return what there is after a stage whose motion ends at joint values q of its own scene's robot. Raises
        InputError for an object that is out of reach."""
        assert self.scene.job is not None
        stage = self.scene.job.stages[number]
        match stage:
            case Move() | Line():
                return replace(self, arm=tuple(zip((joint for joint, _ in self.arm), q.tolist(), strict=True)))
            case Wait():
                return self
            case Grip() | Release():
                world = self._with_hand(load_scene_robot(self.stage_scene(number)), q) if stage.joints else self
                if stage.object is None:
                    return world
                with naming(stage_source(self.scene, number)):
                    if isinstance(stage, Grip):
                        return world._taken(stage, stage.object)
                return world._let_go(stage.object)
            case _:
                assert_never(stage)

    def _with_hand(self, robot: Robot, q: Array) -> World:
        moved = dict(zip(robot.unfolded.joint_names, robot.expand(q).tolist(), strict=True))
        return replace(self, hand=tuple({**dict(self.hand), **moved}.items()))

    # --- scenes -------------------------------------------------------------------------------------------------------

    @property
    def _start(self) -> JointTarget:
        return JointTarget("start", positions=tuple(value for _, value in self.arm))

    def _of_arm(self, number: int, stage: Stage, **fields: Any) -> Scene:
        """Return a scene in which the arm moves and the hand is held."""
        spec = self.scene.robot
        robot = replace(spec, locked={**spec.locked, **dict(self.hand)})
        limits = self.scene.limits if stage.limits is None else stage.limits
        return self._made(number, stage, {"robot": robot, "start": self._start, "limits": limits, **fields})

    def _of_hand(self, number: int, stage: Grip | Release) -> Scene:
        """Return a scene in which the hand moves and the arm is held."""
        spec, robot, leaders = self.scene.robot, self._robot(), leaders_of(self.scene.robot)
        for joint in stage.joints:
            if joint in robot.joint_names:
                raise InputError(f"joints: '{joint}' is one of the arm's, which stands still while fingers move")
            if joint not in robot.locked:
                raise InputError(f"joints: unknown joint '{joint}'{nearest(joint, robot.locked)}")
            if leaders.get(joint, joint) not in stage.joints:
                raise InputError(f"joints: '{joint}' follows '{leaders[joint]}': name that one")
        self._check_object(stage)
        group = tuple(joint for joint in stage.joints if joint not in leaders)
        fixed = {**spec.locked, **dict(self.hand), **dict(self.arm)}
        locked = {joint: at for joint, at in fixed.items() if leaders.get(joint, joint) not in group}
        fields: dict[str, Any] = {
            "robot": replace(spec, group=group, locked=locked),
            "start": JointTarget("start", by_name={joint: robot.locked[joint] for joint in group}),
            "goal": JointTarget("goal", by_name=stage.joints),
            "limits": _of_fingers(self.scene.limits) if stage.limits is None else stage.limits,
        }
        return self._made(number, stage, fields)

    def _line(self, number: int, stage: Line) -> Scene:
        robot = self._robot()
        link = end_effector(robot, "line") if stage.link is None else stage.link
        begins = link_pose(robot, self._q, link)
        goal, path = as_constraints(stage, robot, link, begins, self._line_end(stage, begins))
        return self._of_arm(number, stage, goal=goal, path=path)

    def _line_end(self, stage: Line, begins: Array) -> Array:
        ends = begins.copy()
        if stage.to is not None:
            ends[:3, 3] = stage.to
            return ends
        turned = np.eye(3)
        if stage.frame == TOOL:
            turned = begins[:3, :3]
        elif stage.frame != WORLD:
            if stage.frame not in self.things:
                raise InputError(
                    f"line.frame: unknown {stage.frame!r}{nearest(stage.frame, [WORLD, TOOL, *self.things])}"
                )
            turned = self._place(stage.frame)[:3, :3]
        ends[:3, 3] += turned @ np.array(stage.by)
        return ends

    def _made(self, number: int, stage: Stage, fields: dict[str, Any]) -> Scene:
        """Return the scene with these fields, with what is held, and with what may touch."""
        scene, timing = self.scene, self.scene.timing or Timing()
        obstacles, attached = self._touching(stage)
        limits = fields["limits"]
        if limits.acceleration is None:  # without it no proof says that a stage begins and ends at rest
            raise InputError("limits.acceleration: is missing in the stage's own limits")
        found = derived(
            scene,
            job=None,
            name=f"{scene.name} {number} {stage_name(stage, number)}",
            obstacles=obstacles,
            attached=attached,
            payload=scene.payload if limits.torque is not None else None,
            timing=Timing(scale=timing.scale * stage.speed, rate=timing.rate),
            **fields,
        )
        object.__setattr__(found, "source", Path(stage_source(scene, number)))
        return found

    def _touching(self, stage: Stage) -> tuple[tuple[Obstacle, ...], tuple[Attached, ...]]:
        """Return obstacles and held objects as they are in a stage, in which some pairs may touch."""
        if not stage.touch:
            return self.obstacles, self.held
        robot = self._robot()
        links, held = set(links_of(robot)), {each.name: each for each in self.held}
        standing = {each.name: each for each in self.obstacles}
        # a held object or an obstacle -> what it may touch, of what moves with the robot
        may: dict[str, list[str]] = {}
        for pair in stage.touch:
            for name in pair:
                if name not in links and name not in self.things:
                    raise InputError(f"touch: unknown body '{name}'{nearest(name, [*self.things, *links])}")
            one, other = sorted(pair, key=lambda name: (name in standing, name in held), reverse=True)
            if one in links:
                raise InputError(f"touch: '{one}' and '{other}' are links both; robot.ignore_pairs names such pairs")
            if other not in standing:  # two obstacles are not compared
                may.setdefault(one, []).append(other)
        root, fixed = fixed_link(robot)
        attached = [
            replace(each, touch_links=tuple(dict.fromkeys((*each.touch_links, *may.get(each.name, ())))))
            for each in self.held
        ]
        for name in [name for name in may if name in standing]:
            obstacle = self._standing(name)
            if obstacle.clearance is not None:
                raise InputError(f"touch: '{name}' has a clearance of its own, which nothing may fall below")
            pose = pose_of(np.linalg.inv(fixed) @ obstacle.pose.matrix)
            attached.append(Attached(name, root, _shape_of(obstacle), pose, may[name]))
        return tuple(each for each in self.obstacles if each.name not in may), tuple(attached)

    # --- objects ------------------------------------------------------------------------------------------------------

    def _standing(self, name: str) -> Obstacle:
        """Return an obstacle that can be touched, or taken hold of."""
        standing = {each.name: each for each in self.obstacles}
        if name in {each.name for each in self.held}:
            raise InputError(f"'{name}' is held already")
        if name not in standing:
            raise InputError(f"there is no object '{name}'{nearest(name, standing)}")
        _shape_of(standing[name])
        return standing[name]

    def _check_object(self, stage: Grip | Release) -> None:
        """Refuse to take hold of what is not there, and to let go of what is not held."""
        if stage.object is not None and isinstance(stage, Release):
            self._held(stage.object)
        elif stage.object is not None:
            self._standing(stage.object)

    def _held(self, name: str) -> Attached:
        held = {each.name: each for each in self.held}
        if name not in held:
            raise InputError(f"release.object: '{name}' is not held; held: {', '.join(held) or 'nothing'}")
        return held[name]

    def _taken(self, stage: Grip, name: str) -> World:
        """Take hold of an object where it stands."""
        obstacle, robot = self._standing(name), self._robot()
        links, frames = links_of(robot), robot.model.frames
        link = end_effector(robot, "grip") if stage.link is None else stage.link
        if link not in links:
            raise InputError(f"grip.link: unknown link '{link}'{nearest(link, links)}")
        touching = [other for pair in stage.touch if name in pair for other in pair if other in links]
        for other in touching:
            if frames[links[other]].parentJoint != frames[links[link]].parentJoint:
                raise InputError(
                    f"grip.link: '{link}' is to carry '{name}', but '{other}', which holds it (`touch`), moves "
                    "relative to that when the arm moves"
                )
        self._check_reach(name, touching or [link])
        pose = pose_of(np.linalg.inv(link_pose(robot, self._q, link)) @ obstacle.pose.matrix)
        held = Attached(name, link, _shape_of(obstacle), pose, tuple(dict.fromkeys(touching)), stage.mass)
        return replace(
            self, obstacles=tuple(each for each in self.obstacles if each is not obstacle), held=(*self.held, held)
        )

    def _check_reach(self, name: str, holding: list[str]) -> None:
        """Refuse to take hold of an object that one of the links which are to hold it is not close to."""
        bare = replace(self.scene.robot, locked={**self.scene.robot.locked, **dict(self.hand)})
        scene = derived(
            self.scene,
            job=None,
            robot=bare,
            start=self._start,
            goal=self._start,
            payload=None,
            attached=(),
            limits=Limits(),
            timing=None,
            obstacles=tuple(replace(each, clearance=None) for each in self.obstacles if each.name == name),
        )
        near = {place.link for place, _ in Certifier(Setup.of(scene)).too_close(self._q, REACH)}
        if far := [link for link in holding if link not in near]:
            raise InputError(
                f"grip.object: '{name}' is out of reach: {', '.join(far)} is not within {REACH * 1e3:g} mm of it when "
                "the fingers have closed (what is to hold it stands under `touch`, or else it is the link)"
            )

    def _let_go(self, name: str) -> World:
        """Leave a held object where it is."""
        held = self._held(name)
        before = next((each for each in self.scene.obstacles if each.name == name), None)
        pose = pose_of(self._place(name))
        left = Obstacle(name, held.shape, pose) if before is None else replace(before, pose=pose)
        others = tuple(  # it is no held object any more that they may touch
            replace(each, touch_links=tuple(link for link in each.touch_links if link != name))
            for each in self.held
            if each is not held
        )
        return replace(self, obstacles=(*self.obstacles, left), held=others)

    def _place(self, name: str) -> Array:
        """Return the pose (4, 4) of an object in the world."""
        thing = self.things[name]
        if isinstance(thing, Obstacle):
            return thing.pose.matrix
        return np.asarray(link_pose(self._robot(), self._q, thing.link) @ thing.pose.matrix)

    @property
    def _q(self) -> Array:
        return np.array([value for _, value in self.arm])

    def _robot(self) -> Robot:
        """Return the robot with the hand as it is, holding nothing."""
        robot = replace(self.scene.robot, locked={**self.scene.robot.locked, **dict(self.hand)})
        limits = Limits(position=self.scene.limits.position)
        bare = {"job": None, "attached": (), "obstacles": (), "payload": None, "timing": None, "limits": limits}
        return load_scene_robot(derived(self.scene, robot=robot, start=self._start, goal=self._start, **bare))


def moves_fingers(stage: Stage) -> bool:
    """Whether the fingers move in a stage, while the arm stands still."""
    return isinstance(stage, Grip | Release) and bool(stage.joints)


def stage_source(scene: Scene, number: int) -> str:
    """Return where a stage stands, for error messages: "jobs.yaml: job[2] (descend)"."""
    assert scene.job is not None
    return f"{scene.source}: job[{number}] ({scene.job.names[number]})"


def _as_seen(setup: Setup) -> tuple[Obstacle, ...]:
    """Return obstacles whose clouds have nothing more to ignore: later, the robot and what it moves are elsewhere, and
    what is near them there is no image of theirs."""
    return tuple(
        replace(each, shape=replace(each.shape, ignore_robot=0.0, ignore=())) if isinstance(each.shape, Cloud) else each
        for each in setup.asked.obstacles
    )


def leaders_of(spec: RobotSpec) -> dict[str, str]:
    """Return the joints of a robot that follow another one, and which."""
    _, _, srdf, _ = description_of(spec)
    tree, _ = read_words(source_of(spec), srdf)
    rules = rules_of(tree, list(tree.joints))
    return {joint: rules[joint].leader if joint in rules else tree.mimics[joint][0] for joint in tree.mimics}


def _shape_of(obstacle: Obstacle) -> Solid:
    """Return the shape of an obstacle that can be touched, or taken hold of. Raises InputError for all others."""
    if not isinstance(obstacle.shape, Solid):
        what = f"'{obstacle.name}' is what a camera or a map saw, not an object"
        raise InputError(f"{what}: only shapes and meshes can be touched, or held")
    return obstacle.shape


def _of_fingers(limits: Limits) -> Limits:
    """Return what limits of the arm say of fingers: values that are for all joints. Raises InputError for accelerations
    and jerks that are not."""
    given = {name: getattr(limits, name) for name in QUANTITIES if name != "torque"}
    kept: dict[str, Any] = {name: value for name, value in given.items() if isinstance(value, float | str)}
    for name in ("acceleration", "jerk"):  # velocities are the URDF's then
        if given[name] is not None and name not in kept:
            raise InputError(f"limits: the scene's {name} is by joints of the arm: give the fingers' in this stage")
    return Limits(**kept)
