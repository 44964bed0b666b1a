"""Stages of a job that go over into one another without a stop: their planned motions, as one.

Stages that are blended are timed as one motion from rest to rest, with marks at the middles of the blends, and
certified stage by stage as it is driven. Between two curves their blend is prescribed, to which the arm keeps; where
one of them is a move, a smaller radius is tried if the asked one does not lead to a certificate.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from hdplan.planner.certificate.verdict import Certificate, Status
from hdplan.planner.job.blends import UnblendedError
from hdplan.planner.job.certify import certified_stage
from hdplan.planner.job.compound import FEWEST, MOST, ROWS, Driven, Path, parts_of
from hdplan.planner.job.curves import corner_of, leg_of, link_of, radius_link, settled
from hdplan.planner.job.following import NotFollowedError
from hdplan.planner.job.joining import Piece, one_after_other
from hdplan.planner.job.places import link_pose
from hdplan.planner.job.stage_scenes import stage_setup
from hdplan.planner.job.world import World
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.setup import Setup
from hdplan.planner.timing.retiming import Retimer
from hdplan.scenes.array_types import Array
from hdplan.scenes.curve_stages import Curve
from hdplan.scenes.errors import HdplanError, InputError
from hdplan.scenes.job import Move, Stage
from hdplan.scenes.lazy_imports import scipy
from hdplan.scenes.path_constraints import Follow, PathConstraints
from hdplan.scenes.poses import Pose
from hdplan.scenes.stage import ArmStage
from hdplan.scenes.targets import JointTarget
from hdplan.scenes.timing import Timing

SHARES = (0.9, 0.6, 0.3, 0.1)  # of the radius around where a move begins or ends
FINER = (1, 4, 12)  # times as many configurations
SNAP = 2e-3  # of an interval between rows: closer to a row than that, none is put in
STEPS = 8  # of looking for a row


class NotBlendedError(Exception):
    """Stages that cannot be blended: the number of the first, and why."""

    def __init__(self, number: int, why: str) -> None:
        """Take them."""
        super().__init__(why)
        self.number = number


def groups_of(stages: Sequence[Stage]) -> Iterator[range]:
    """Yield the numbers of stages that are driven as one, where there are several."""
    first = 0
    for i, stage in enumerate(stages):
        if not (isinstance(stage, ArmStage) and stage.blend):
            if i > first:
                yield range(first, i + 1)
            first = i + 1


def blended(world: World, pieces: Sequence[Piece]) -> list[Piece]:
    """Return the pieces of stages, each planned from rest to rest, with those blended that are to be, as far as all
    that are driven as one are there; `world` is what there is at first. Raises NotBlendedError, and InputError as
    `certified_stage`."""
    assert world.scene.job is not None
    found = [*pieces]
    for group in groups_of(world.scene.job.stages):
        if len(pieces) <= group[-1]:
            return found[: group[0]]
        before = replace(pieces[group[0] - 1].after if group[0] else world, scene=world.scene)
        found[group[0] : group[-1] + 1] = _as_one(before, group, [pieces[k] for k in group])
    return found


def _as_one(world: World, group: range, pieces: Sequence[Piece]) -> list[Piece]:
    """Blend one group of stages."""
    assert world.scene.job is not None
    stages = [world.scene.job.stages[k] for k in group]
    rested, why = _driven(world, group, pieces), ""
    for share in SHARES if any(isinstance(stage, Move) for stage in stages) else (1.0,):
        for finer in FINER:
            try:
                motions = _timed(world, group, rested, share, finer)
            except UnblendedError as error:
                raise InputError(
                    f"{world.scene.source}: job[{group[0]}] ({world.scene.job.names[group[0]]}): {error}"
                ) from None
            except InputError:
                raise
            except (NotFollowedError, HdplanError) as error:
                raise NotBlendedError(group[0], str(error)) from None
            made, wrong = _certified(world, group, motions, pieces)
            if wrong is None:
                return made
            why = wrong.text
            if wrong.status is not Status.OFF_PATH:
                break
    raise NotBlendedError(group[0], why)


def _driven(world: World, group: range, pieces: Sequence[Piece]) -> list[Driven]:
    """Return the paths of stages as they were planned, curves as they follow one another where nothing rests."""
    assert world.scene.job is not None
    found, stages = [], world.scene.job.stages
    for number, piece in zip(group, pieces, strict=True):
        stage, robot = stages[number], stage_setup(world, number).robot
        if isinstance(stage, Curve):
            if world.corner is not None:
                (q,) = curve_of(robot, piece.motion).rows[:1]
                link = link_of(stage, world)
                world = replace(world, corner=settled(world.corner, link_pose(robot, q, link)[:3, :3]))
            found.append(Driven(robot, piece.motion, leg_of(world, number)[0], link_of(stage, world)))
        else:
            found.append(Driven(robot, piece.motion))
        if number != group[-1]:
            world = replace(piece.after, scene=world.scene, corner=corner_of(world, number))
    return found


def _timed(world: World, group: range, rested: Sequence[Driven], share: float, finer: int) -> list[Trajectory]:
    """Return the motions of stages that are driven as one, of which each begins as the last one ended."""
    assert world.scene.job is not None
    stages = world.scene.job.stages
    links = [radius_link(world, number) for number in group[:-1]]
    radii = [
        stages[number].blend * (1.0 if _are_curves(stages, number) else share)  # type: ignore[union-attr]
        for number in group[:-1]
    ]
    path = Path(rested[0].robot, parts_of(rested, list(zip(links, radii, strict=True))))
    setup = _as_one_motion(world, group)
    cuts = path.cuts
    count = int(np.clip(np.ceil(ROWS * cuts[-1] / max(path.shortest, 1e-9)), FEWEST, MOST)) * finer
    motions, marks, begins = [], [], 0.0
    for first, last in itertools.pairwise(cuts):
        rows = path.rows(first, last, max(5, int(np.ceil(count * (last - first) / cuts[-1])) + 1))
        waypoints = Trajectory(setup.robot.joint_names, rows, setup.robot.locked)
        spline = scipy.interpolate.make_interp_spline(np.linspace(0.0, 1.0, len(rows)), rows)
        timed = Retimer(setup).along(waypoints, spline)
        motion = timed.trajectory
        assert motion.times is not None
        for middle in path.middles:
            if first <= middle < last:
                row, fraction = timed.place_of((middle - first) / (last - first))
                near = float(motion.times[row] + fraction * (motion.times[row + 1] - motion.times[row]))
                marks.append(begins + _passes(motion, path.row(middle), near))
        motions.append(motion)
        begins += float(motion.times[-1])
    whole = _between(one_after_other(motions), rested[0].ends[0], rested[-1].ends[1])
    rows_at = [0]
    for mark in marks:
        whole, row = _with_row(whole, mark)
        rows_at.append(row)
    rows_at.append(len(whole) - 1)
    return [whole.between(*pair) for pair in itertools.pairwise(rows_at)]


def _between(motion: Trajectory, begins: Array, ends: Array) -> Trajectory:
    """Return the same motion from joint values (n,) to others, from which it differs by rounding: stages around it were
    planned to there, and from there."""
    positions = np.concatenate([begins[None], motion.positions[1:-1], ends[None]])
    return Trajectory(
        motion.joint_names, positions, motion.locked, motion.times, motion.velocities, motion.accelerations
    )


def _are_curves(stages: Sequence[Stage], number: int) -> bool:
    return all(isinstance(each, Curve) for each in stages[number : number + 2])


def _as_one_motion(world: World, group: range) -> Setup:
    """Return the scene in which stages are timed as one: within the least of what they ask for."""
    assert world.scene.job is not None
    stages = [world.scene.job.stages[k] for k in group]
    setup, timing = stage_setup(world, group[0]), world.scene.timing or Timing()
    curves = [stage for stage in stages if isinstance(stage, Curve)]
    rates = [
        min((rate for each in curves if (rate := getattr(each, name)) is not None), default=None)
        for name in ("tool_speed", "tool_acceleration")
    ]
    path = PathConstraints()
    if rates != [None, None]:
        anywhere = (Pose(), Pose((0.0, 0.0, 1.0)))  # of which the timing knows nothing
        path = PathConstraints(
            follow=Follow(link_of(curves[0], world), anywhere, speed=rates[0], acceleration=rates[1])
        )
    scaled = Timing(scale=timing.scale * min(stage.speed for stage in stages), rate=timing.rate)
    here = JointTarget("goal", positions=world.start.positions)
    return setup.changed(goal=here, path=path, timing=scaled)


def _passes(motion: Trajectory, q: Array, near: float) -> float:
    """Return the time at which a motion is nearest to joint values (n,), close to a time."""
    assert motion.times is not None
    time = near
    for _ in range(STEPS):
        at = motion.at_time(time)
        square = float(at.velocities @ at.velocities)
        if square == 0.0:
            return time
        time = float(np.clip(time + (q - at.positions) @ at.velocities / square, motion.times[0], motion.times[-1]))
    return time


def _with_row(motion: Trajectory, time: float) -> tuple[Trajectory, int]:
    """Return the same motion with a row at a time, and its number; one that is there already, if it is close."""
    times = motion.times
    assert times is not None
    assert motion.velocities is not None
    assert motion.accelerations is not None
    after = int(np.clip(np.searchsorted(times, time), 1, len(times) - 1))
    fraction = (time - times[after - 1]) / (times[after] - times[after - 1])
    if fraction < SNAP or fraction > 1.0 - SNAP:
        return motion, after - (fraction < SNAP)
    at = motion.at_time(time)
    rows = (
        np.insert(kept, after, put, axis=0)
        for kept, put in (
            (motion.positions, at.positions),
            (times, time),
            (motion.velocities, at.velocities),
            (motion.accelerations, at.accelerations),
        )
    )
    positions, instants, velocities, accelerations = rows
    found = Trajectory(motion.joint_names, positions, motion.locked, instants, velocities, accelerations)
    return found, after


def _certified(
    world: World, group: range, motions: Sequence[Trajectory], pieces: Sequence[Piece]
) -> tuple[list[Piece], Certificate | None]:
    """Return the pieces of stages that are driven as one, or the certificate of the first one that is not proven."""
    made = []
    for number, motion, piece in zip(group, motions, pieces, strict=True):
        found, world = certified_stage(world, number, motion)
        if not found.certificate.certified:
            return [], found.certificate
        notes = (*piece.notes, *found.certificate.notes)
        made.append(Piece(motion, piece.after, notes, blended=number != group[-1]))
    return made, None
