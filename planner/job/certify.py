"""The certificate of a job: each stage by itself, from the job's scene and the executed motion alone.

What a stage is certified in, its `World`, follows from where the stages before it really ended: the arm there, objects
held as they were taken, or lying where they were let go. Stages are parts of one curve, each of which begins at the row
at which the last one ended, so positions and velocities are the same there; that each begins and ends at rest, the
limits prove, and of those that are blended that rates do not jump where they meet. As a certificate follows from these
alone, one that was made while a stage was planned is kept where they are the same, to the last bit (`Proven`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Certificate, Status, proven, proven_length
from hdplan.planner.job.blends import UnblendedError
from hdplan.planner.job.changes import GRIP_REACH, after
from hdplan.planner.job.curves import corner_of, leg_of, radius_link, settled
from hdplan.planner.job.places import link_pose
from hdplan.planner.job.stage_scenes import moves_fingers, stage_certifier, stage_setup, stage_source, standing_scene
from hdplan.planner.job.stops import notes_on, stopping, with_stops
from hdplan.planner.job.touching import touched
from hdplan.planner.job.world import Corner, Rates, World
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.link_frame import end_effector, frames_of, link_poses
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.curve_stages import Curve as CurveStage
from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.job import Grip, Move, Release, Set, Wait
from hdplan.scenes.scene import Scene
from hdplan.scenes.stage import ArmStage, Touch
from hdplan.scenes.targets import AllOf, JointTarget, PoseTarget
from hdplan.scenes.values import instance

NOTED_OVERLAP = 1e-3  # [m] by which two bodies that may touch overlap before a note says so
TURN_TRIES = 4  # tries to find the turn about a free axis; one is enough where curves turn about that axis
SAME_TIME = 1e-6  # [s] by which a wait may be shorter: rounding of times that are counted from the beginning of a job


@dataclass(frozen=True)
class StageCertificate:
    """The certificate of one stage."""

    name: str
    kind: str  # "move", "line", "circle", "along", "grip", "release", "set" or "wait"
    begins: float  # [s]
    ends: float  # [s]
    held: tuple[str, ...]  # objects that are held in it
    touch: Touch  # pairs that may touch in it
    scene: Scene  # the scene of its motion, like any other
    trajectory: Trajectory  # its part of the motion, at its own times
    certificate: Certificate
    arm: Scene | None = None  # the scene of the arm, which stands still where fingers move
    notes: tuple[str, ...] = ()  # on pairs that may touch: far from each other, or overlapping
    blend: float = 0.0  # [m] radius of the blend into the next one; 0: it ends at rest
    passing: tuple[str, ...] = ()  # ends, "start" or "goal", where the robot does not stop


@dataclass(frozen=True)
class Proven:
    """A stage that was certified while it was planned, with what there was before it and after it."""

    before: World
    stage: StageCertificate
    after: World

    def of(self, world: World, number: int, part: Trajectory) -> tuple[StageCertificate, World] | None:
        """Return the same of a stage of a job, at its own times; None where anything that it follows from is not equal
        to the last bit: the scene, what there is before it, and its curve but for the time at which that begins. Nor is
        it the same where torques are limited, as its words say when they are largest."""
        certificate = self.stage.certificate
        timeless = all(use.quantity != "torque" for use in certificate.uses)
        if not certificate.certified or not timeless or not _are_alike(self.before, world, number):
            return None
        robot = load_scene_robot(self.stage.scene)
        with naming(f"stage '{self.stage.name}'"):
            curve, known = curve_of(robot, part), curve_of(robot, self.stage.trajectory)
        assert curve.times is not None
        assert known.times is not None
        ends = _rates_at_end(curve, robot, part), _rates_at_end(known, robot, self.stage.trajectory)
        if not (
            all(map(np.array_equal, (curve.control, *curve.given), (known.control, *known.given)))
            and np.array_equal(curve.times - curve.times[0], known.times - known.times[0])
            and (self.after.rates is None or ends[0] == ends[1])
        ):
            return None
        worst, own = (
            each and replace(each, seconds=float(curve.time_of(each.parameter)))
            for each in (certificate.worst, certificate.self_worst)
        )
        first, last = float(curve.times[0]), float(curve.times[-1])
        later = replace(self.stage, begins=first, ends=last, trajectory=part)
        later = replace(later, certificate=replace(certificate, worst=worst, self_worst=own))
        return later, replace(self.after, scene=world.scene)


def _are_alike(one: World, other: World, number: int) -> bool:
    """True if a stage is the same in two worlds, whatever other stages their jobs have: its curve and its radii depend
    on those that it is blended with, and, as to how far the chords of arcs may be from these, on those behind them."""
    job, named = one.scene.job, other.scene.job
    assert job is not None
    assert named is not None
    stage = job.stages[number]
    alone = one.corner is None and one.rates is None and not getattr(stage, "blend", 0.0)
    near = slice(number, number + 1) if alone else slice(max(number - 1, 0), number + 3)
    scenes = ([getattr(each.scene, key.name) for key in fields(Scene) if key.name != "job"] for each in (one, other))
    return (
        (job.names[number], stage, job.stages[near]) == (named.names[number], named.stages[number], named.stages[near])
        and replace(one, scene=other.scene) == other
        and next(scenes) == next(scenes)
        and one.scene.source == other.scene.source
    )


@dataclass(frozen=True)
class JobCertificate:
    """The verdict on a whole job."""

    job: str  # the scene's name
    stages: tuple[StageCertificate, ...]  # the stages that the motion has
    missing: tuple[str, ...] = ()  # the stages that the motion does not have
    seen: tuple[str, ...] = ()  # notes on the whole job: points of clouds that were left out, stops

    @property
    def certified(self) -> bool:
        """True if all stages are there and proven."""
        return not self.missing and all(stage.certificate.certified for stage in self.stages)

    @property
    def failed(self) -> StageCertificate | None:
        """The first stage that is not proven; None if all that there are are proven."""
        return next((stage for stage in self.stages if not stage.certificate.certified), None)

    @property
    def clearance(self) -> float | None:
        """The least clearance that is proven over all stages [m]; None without obstacles or without proof."""
        found = [stage.certificate.clearance for stage in self.stages if stage.scene.obstacles]
        return None if None in found or not found or self.missing else min(each for each in found if each is not None)

    @property
    def text(self) -> str:
        """One sentence: what was found."""
        if (stage := self.failed) is not None:
            return f"stage '{stage.name}': {stage.certificate.text}"
        if self.missing:
            return f"not whole: {len(self.stages)} stages are proven, '{self.missing[0]}' has no motion"
        away = ""
        if (clearance := self.clearance) is not None:
            away = f", at least {proven_length(clearance)} to every obstacle that may not be touched"
        duration = self.stages[-1].ends - self.stages[0].begins
        joined = sum(bool(getattr(stage, "blend", 0.0)) for stage in self.stages)
        ends = f"{joined} of them blended" if joined else "each from rest to rest"
        return f"certified: all {len(self.stages)} stages, {duration:.3f} s{away}, {ends}"

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on what was assumed, left out, and may touch, over all stages."""
        noted = (note for stage in self.stages for note in (*stage.certificate.notes, *stage.notes))
        return tuple(dict.fromkeys((*self.seen, *noted)))

    def __repr__(self) -> str:
        """Say the verdict."""
        return f"<JobCertificate: {self.text}>"


def certify_job(scene: Scene, trajectory: Trajectory) -> JobCertificate:
    """Certify the motion of a job: return the verdict on every stage.

    Args:
        scene: one with a job.
        trajectory: of all joints that the job moves, with marks where its stages begin (`Trajectory.stages`), as
            `plan_job` returns it. One that has only the first stages is certified as far as it goes, which is not
            whole.

    Raises:
        InputError: a scene without a job, or in which none can be done; a motion without marks, or with other stages
            than the job's; an object that is taken out of reach, or released without being held.
    """
    return certified_job(scene, trajectory, ())


def certified_job(scene: Scene, trajectory: Trajectory, known: Sequence[Proven | None]) -> JobCertificate:
    """Certify the motion of a job as `certify_job` does. What was proven of its first stages, as they were planned, is
    kept where these are equal to the last bit: a certificate is a function of what there is before a stage and of the
    curve."""
    instance(scene, Scene, "scene")
    instance(trajectory, Trajectory, "trajectory")
    world = World.at_first(scene)
    assert scene.job is not None
    names = scene.job.names
    marks = tuple(mark.name for mark in trajectory.stages)
    if not marks:
        raise InputError("trajectory: has no marks of stages; a job is checked with its planned JSON file")
    if marks != names[: len(marks)]:
        wrong = next((i for i, pair in enumerate(zip(marks, names, strict=False)) if pair[0] != pair[1]), len(names))
        expected = f"the job's is '{names[wrong]}'" if wrong < len(names) else "the job has no more"
        raise InputError(f"trajectory: its stage {wrong} is '{marks[wrong]}', {expected}")
    for mark, each in zip(trajectory.stages, scene.job.stages, strict=False):
        outputs = each.outputs if isinstance(each, Set) else {}
        if repr(dict(mark.outputs)) != repr(dict(outputs)):  # True is no 1.0
            sets = f"sets {dict(mark.outputs) or 'nothing'} in the motion, and {dict(outputs) or 'nothing'} in the job"
            kept = "" if mark.outputs else ": of files only JSON holds outputs"
            raise InputError(f"trajectory: stage '{mark.name}' {sets}{kept}")
    stops = stopping(scene, trajectory)
    seen = (*world.notes, *notes_on(scene, stops))
    world = replace(world, scene=with_stops(scene, stops)) if stops else world
    found = []
    for number in range(len(marks)):
        part, before, made = stage_motion(trajectory, number), world, next(iter(known[number:]), None)
        again = made and made.of(before, number, part)
        stage, world = again or certified_stage(before, number, part)
        found.append(replace(stage, notes=_on_touch(before, number, part)))
    return JobCertificate(scene.name, tuple(found), names[len(marks) :], seen)


def stage_motion(trajectory: Trajectory, number: int) -> Trajectory:
    """Return the part of a job's motion that is one stage, at its own times."""
    rows = [*(mark.row for mark in trajectory.stages), len(trajectory) - 1]
    return trajectory.between(rows[number], rows[number + 1])


def certified_stage(world: World, number: int, part: Trajectory) -> tuple[StageCertificate, World]:
    """Certify the motion of one stage from what there is before it; also return what there is after it."""
    stage, name = world.job.stages[number], world.job.names[number]
    assert part.times is not None
    begins, ends = float(part.times[0]), float(part.times[-1])
    if world.corner is not None and isinstance(stage, CurveStage):
        with naming(stage_source(world.scene, number)):
            world = replace(world, corner=_settled(world, number, part))
    setup, blend = stage_setup(world, number), isinstance(stage, ArmStage) and stage.blend
    with naming(f"stage '{name}'"):
        curve = curve_of(setup.robot, part)
        if blend:
            setup = setup.changed(goal=_passed(curve, _rates_at_end(curve, setup.robot, part)))
        scene, certifier = setup.requested, Certifier(setup) if blend else stage_certifier(world, number)
        passing = tuple(end for end, passed in (("start", world.rates), ("goal", blend)) if passed)
        certificate = certifier.certify(part, passing=passing)
    fingers = moves_fingers(stage)
    arm = standing_scene(world, number) if fingers else None
    if arm is not None and certificate.certified:
        certificate = _with_the_arm(certificate, Setup.of(arm))
    wrong = ""
    if isinstance(stage, Set | Wait | Grip | Release) and not fingers and np.ptp(curve.control, axis=(0, 1)).any():
        wrong = "the robot moves where it is to stand still"
    elif isinstance(stage, Wait) and not ends - begins >= stage.seconds - SAME_TIME:
        wrong = f"the robot waits {ends - begins:g} s, the job has {stage.seconds:g} s"
    elif isinstance(stage, Move) and blend:
        wrong = _beyond_radius(world, number, setup.robot, curve.rows[-1])
    if wrong:
        text = f"{Status.WRONG_ENDS.value.replace('_', ' ')}: {wrong}"
        certificate = replace(certificate, status=Status.WRONG_ENDS, text=text)
    held = tuple(each.name for each in world.held)
    shown = begins, ends, held, stage.touch, scene, part, certificate, arm
    found = StageCertificate(name, stage.kind, *shown, blend=float(blend), passing=passing)
    there = after(world, number, certifier.robot, curve.rows[-1])
    if blend:
        there = replace(there, rates=_rates_at_end(curve, setup.robot, part), corner=corner_of(world, number))
    return found, there


def _passed(curve: Curve, rates: Rates) -> JointTarget:
    """Return the end of a stage that is blended into the next one, and the robot's rates there: the middle of the
    blend, of which its path constraints or its radius say where it may be."""
    return JointTarget("goal", tuple(curve.rows[-1].tolist()), velocity=rates[0], acceleration=rates[1])


def _rates_at_end(curve: Curve, robot: Robot, part: Trajectory) -> Rates:
    """Return velocities and accelerations of a motion's last row: as the row has them, or else those of its curve."""
    columns = [part.joint_names.index(joint) for joint in robot.joint_names]
    velocity, acceleration = (
        tuple((curve.over_time(order).rows[-1] if rows is None else rows[-1, columns]).tolist())
        for order, rows in enumerate((part.velocities, part.accelerations), 1)
    )
    return velocity, acceleration


def _settled(world: World, number: int, part: Trajectory) -> Corner:
    """Return the corner before a curve, its free axis turned as the motion says: as the link is where it first leaves
    the radius, less what the curve itself has turned it up to there."""
    corner, robot = world.corner, world.robot
    assert corner is not None
    poses = link_poses(robot, curve_of(robot, part).rows, frames_of(robot)[corner.link])
    away = np.linalg.norm(poses[:, :3, 3] - corner.pose.position, axis=1)
    row = int((away > corner.radius).argmax()) if (away > corner.radius).any() else -1
    found = settled(corner, poses[row, :3, :3])
    for _ in range(TURN_TRIES if found is not corner else 0):
        leg, _ = leg_of(replace(world, corner=found), number)
        try:
            (there,) = leg.at(np.array([leg.leaves(float(away[row]))]))
        except UnblendedError:  # the curve ends earlier
            break
        found = settled(corner, found.pose.matrix[:3, :3] @ there[:3, :3].T @ poses[row, :3, :3])
    return found


def _beyond_radius(world: World, number: int, robot: Robot, q: Array) -> str:
    """Return the distance, in words, from its goal at which a move passes into the next stage; empty if that is within
    its radius."""
    stage = world.job.stages[number]
    assert isinstance(stage, Move)
    link = radius_link(world, number)

    def off(target: JointTarget | PoseTarget | AllOf) -> float:
        """Greatest distance of a goal's links from it [m]; of joint values the link of the radius."""
        if isinstance(target, JointTarget):
            places = [(link, link_pose(robot, robot.configuration(target), link)[:3, 3])]
        else:
            poses = target.poses
            places = [(each.link or end_effector(robot, "blend"), np.array(each.pose.position)) for each in poses]
        return max(float(np.linalg.norm(link_pose(robot, q, each)[:3, 3] - at)) for each, at in places)

    goal = stage.goal
    away = min(off(each) for each in ((goal,) if isinstance(goal, JointTarget) else goal.targets))
    if away <= stage.blend:
        return ""
    return f"it passes into the next stage {away:.4g} m from its goal, {stage.blend:g} m are allowed"


def standing(robot: Robot, q: Array, seconds: float) -> Trajectory:
    """Return the motion of a robot that stands still."""
    still = np.zeros((2, robot.n))
    return Trajectory(robot.joint_names, np.stack([q, q]), robot.locked, np.array([0.0, seconds]), still, still)


def _with_the_arm(certificate: Certificate, setup: Setup) -> Certificate:
    """Return the certificate of a motion of the fingers with what is proven of the arm that stands still meanwhile, or
    that of the arm if it is not certified."""
    robot = setup.robot
    arm = Certifier(setup).certify(standing(robot, robot.configuration(setup.scene.start), 1.0))
    if not arm.certified:
        return arm
    both = [(each.clearance, each.self_clearance) for each in (certificate, arm)]
    clearance, own = (
        min((each for each in found if each is not None), default=None) for found in zip(*both, strict=True)
    )
    text = f"{Status.CERTIFIED.value}: {proven(clearance, own, (), ())}"
    notes = tuple(dict.fromkeys((*certificate.notes, *arm.notes)))
    return replace(certificate, text=text, clearance=clearance, self_clearance=own, notes=notes)


def _on_touch(world: World, number: int, part: Trajectory) -> tuple[str, ...]:
    """Return notes on pairs that may touch in a stage: those that are far apart at its beginning and at its end, and
    those that overlap there, which no proof examines."""
    stage, name = world.job.stages[number], world.job.names[number]
    if not stage.touch and not (world.held and moves_fingers(stage)):
        return ()
    notes = []
    rows = curve_of(stage_setup(world, number).robot, part).rows
    for (one, other), least in touched(world, number, rows[[0, -1]]).items():
        if least > GRIP_REACH and (one, other) in stage.touch:
            notes.append(f"{name}: {one} and {other} may touch, and are apart at its beginning and its end")
        elif least < -NOTED_OVERLAP:
            notes.append(f"{name}: {one} and {other} may touch, and overlap by {-least * 1e3:.3g} mm")
    return tuple(notes)


def as_json(stage: StageCertificate) -> dict[str, object]:
    """Return a stage's verdict for JSON."""
    return {
        "stage": stage.name,
        "kind": stage.kind,
        "begins_s": stage.begins,
        "ends_s": stage.ends,
        **({"blend_m": stage.blend} if stage.blend else {}),
        "held": list(stage.held),
        "touch": [list(pair) for pair in stage.touch],
        "status": stage.certificate.status.value,
        "text": stage.certificate.text,
        "clearance_m": stage.certificate.clearance,
        "notes": [*stage.certificate.notes, *stage.notes],
    }
