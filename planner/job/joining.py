"""Motions of stages one after the other, as one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hdplan.planner.job.certify import Proven
from hdplan.planner.job.overlap import columns_of
from hdplan.planner.job.world import World
from hdplan.planner.motion.trajectory import StageMark, Trajectory
from hdplan.scenes.array_types import Array
from hdplan.scenes.job import Job, Set

TIME_GRID = 2.0**-46  # [s]


@dataclass(frozen=True)
class Piece:
    """The motion of one stage, and what there is after it."""

    motion: Trajectory
    after: World
    notes: tuple[str, ...] = ()
    blended: bool = False  # whether it goes over into the next one without a stop
    proven: Proven | None = None  # what was certified of just this motion


def exactly_timed(motion: Trajectory) -> Trajectory:
    """Return this motion from time 0 on, at multiples of TIME_GRID: sums and differences of such times are no
    rounding, so that each piece of a joined motion of up to two minutes is the motion that it was, to the last bit."""
    assert motion.times is not None
    return replace(motion, times=np.round((motion.times - motion.times[0]) / TIME_GRID) * TIME_GRID)


def joined(pieces: Sequence[Piece], job: Job) -> Trajectory:
    """Return one motion of all joints that the pieces move, one piece after the other, with marks where they begin. A
    piece begins with the row with which the last one ended; there everything rests, unless they are blended."""
    joints = tuple(dict.fromkeys(joint for piece in pieces for joint in piece.motion.joint_names))
    held = [piece.motion.locked for piece in pieces]
    at = {
        joint: next(each[joint] for each in held if joint in each)
        for joint in joints
        if joint not in pieces[0].motion.joint_names
    }
    blocks, marks, times, begins, row = [], [], [], 0.0, 0
    for i, (piece, name, stage) in enumerate(zip(pieces, job.names, job.stages, strict=False)):
        motion = piece.motion
        assert motion.times is not None
        rows = np.zeros((3, len(motion), len(joints)))
        for column, joint in enumerate(joints):
            if joint in motion.joint_names:
                own = motion.joint_names.index(joint)
                values = (motion.positions, motion.velocities, motion.accelerations)
                for block, given in zip(rows, values, strict=True):
                    block[:, column] = 0.0 if given is None else given[:, own]
                at[joint] = float(motion.positions[-1, own])
            else:
                rows[0, :, column] = at[joint]
        if not (i and pieces[i - 1].blended):  # at rest: what is left there is rounding
            rows[1:, 0] = 0.0
        if not piece.blended:
            rows[1:, -1] = 0.0
        first = 0 if i == 0 else 1
        blocks.append(rows[:, first:])
        times.append((begins + (motion.times - motion.times[0]))[first:])
        marks.append(StageMark(name, row, stage.outputs if isinstance(stage, Set) else {}))
        row += len(motion) - 1
        begins = float(times[-1][-1])
    positions, velocities, accelerations = np.concatenate(blocks, axis=1)
    last = {joint: value for joint, value in held[-1].items() if joint not in joints}
    steady = {joint: value for joint, value in last.items() if all(each.get(joint) == value for each in held)}
    return Trajectory(joints, positions, steady, np.concatenate(times), velocities, accelerations, stages=tuple(marks))


def one_after_other(motions: Sequence[Trajectory]) -> Trajectory:
    """Return motions of the same joints, each of which begins with the row with which the last one ended, as one."""
    rows: list[list[Array]] = [[], [], [], []]
    begins = 0.0
    for i, motion in enumerate(motions):
        positions, times, *rates = columns_of(motion)
        times = begins + (times - times[0])
        for kept, given in zip(rows, (positions, times, *rates), strict=True):
            kept.append(given[min(i, 1) :])
        begins = float(times[-1])
    positions, times, velocities, accelerations = (np.concatenate(each) for each in rows)
    return Trajectory(motions[0].joint_names, positions, motions[0].locked, times, velocities, accelerations)
