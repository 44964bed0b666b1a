"""Tasks of a controller: a quadratic in the joint velocity, ½ uᵀ H u + fᵀ u, minimal at the nominal velocity.

Several are one (`together`): those of equal rank are added with their weights, and a lower rank only says how to use
what the higher ones leave free, u = u₁ + N z, with u₁ the least of the higher ranks and N their null space (Siciliano &
Slotine, "A general framework for managing multiple tasks in highly redundant robotic systems", ICAR 1991).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from hdplan.planner.kinematics.inverse import LinkPose
from hdplan.planner.kinematics.relative import RelativePose
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.arrays import joint_numbers, quadratic
from hdplan.scenes.targets import PoseTarget
from hdplan.scenes.values import Number, Whole, checked, instance, is_row, text, wrong

GAIN = Number(0.0, 1e3, unit="1/s")
WEIGHT = Number(high=1e6, above=0.0)
CURVATURE_SHARE = 1e-6  # of a rank's curvatures, a share of the greatest: where it is least, only regularization acts


class Task(Protocol):
    """A nominal velocity, as a quadratic with its minimum there."""

    def objective(self, q: Array, time: float) -> tuple[Array, Array]:
        """Return H (n, n), positive definite, and f (n,) at configuration q (n,) and a time [s]."""
        ...

    def met(self, q: Array, time: float) -> bool:
        """True if the task is done."""
        ...


@dataclass(frozen=True, eq=False)
class PoseTask:
    """Bring a link to a pose, in the world or in the frame of another link, which may move: min ‖J u − k e‖² + λ ‖u‖²,
    with e the error in position and orientation."""

    robot: Robot
    target: PoseTarget
    gain: float = 4.0  # k: relative decrease of the error per second [1/s]
    regularization: float = 0.01  # λ: keeps u small near singular configurations
    to: str | None = None  # the link in whose frame the target's pose is; None: in the world

    def __post_init__(self) -> None:
        """Refuse invalid arguments."""
        instance(self.robot, Robot, "robot")
        instance(self.target, PoseTarget, "target")
        checked(GAIN, self.gain, "gain")
        checked(Number(high=1e3, above=0.0), self.regularization, "regularization")
        if self.to is not None:
            checked(text, self.to, "to")

    @cached_property
    def _pose(self) -> LinkPose | RelativePose:
        if self.to is None:
            return LinkPose.of(self.robot, self.target)
        return RelativePose.of(self.robot, self.target, self.to)

    def objective(self, q: Array, time: float) -> tuple[Array, Array]:
        """Return the quadratic at q; it does not depend on the time."""
        error, jacobian = self._pose.linearized(q[None])
        return least_squares(jacobian[0], self.gain * error[0], self.regularization)

    def met(self, q: Array, time: float) -> bool:
        """True if the link is within the target's tolerances."""
        error = self._pose.linearized(q[None])[0][0]
        position, angle = float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
        return position <= self.target.position_tolerance and angle <= self.target.orientation_tolerance


@dataclass(frozen=True, eq=False)
class TrackTask:
    """Follow a moving configuration r(t): min ‖u − ṙ − k (r − q)‖²."""

    reference: Callable[[float], tuple[Array, Array]]  # time [s] -> r (n,), ṙ (n,)
    gain: float = 2.0  # k [1/s]
    end: float = 0.0  # from which time on the reference is at rest [s]
    tolerance: float = 1e-3  # [rad] or [m] for each joint

    def __post_init__(self) -> None:
        """Refuse invalid arguments."""
        if not callable(self.reference):
            raise wrong("a function of the time [s]", self.reference).within("reference")
        checked(GAIN, self.gain, "gain")
        checked(Number(unit="s"), self.end, "end")
        checked(Number(low=0.0, unit="rad or m"), self.tolerance, "tolerance")

    def objective(self, q: Array, time: float) -> tuple[Array, Array]:
        """Return the quadratic at q and a time."""
        joints, found = _counted(q), self.reference(time)
        if not is_row(found) or len(found) != 2:
            raise wrong("a configuration and its velocity", found).within("reference")
        wanted, speed = (joint_numbers("reference", row, joints) for row in found)
        return np.eye(len(q)), -(speed + self.gain * (wanted - q))

    def met(self, q: Array, time: float) -> bool:
        """True if the reference is at rest and reached."""
        return time >= self.end and bool(np.abs(self.reference(time)[0] - q).max() <= self.tolerance)


@dataclass(frozen=True)
class Damping:
    """Keep still: min ½ w ‖u‖²."""

    n: int  # joints

    def objective(self, q: Array, time: float) -> tuple[Array, Array]:
        """Return the quadratic, the same everywhere."""
        return np.eye(self.n), np.zeros(self.n)

    def met(self, q: Array, time: float) -> bool:
        """Always True: a posture is never in the way of an end."""
        return True


@dataclass(frozen=True, eq=False)
class Ranked:
    """A task among several, with its weight in its rank; rank 0 comes first."""

    task: Task
    weight: float = 1.0
    rank: int = 0

    def __post_init__(self) -> None:
        """Refuse invalid arguments."""
        checked(WEIGHT, self.weight, "weight")
        checked(Whole(0, 100), self.rank, "rank")


@dataclass(frozen=True, eq=False)
class Together:
    """Several tasks as one."""

    tasks: tuple[Ranked, ...]

    def objective(self, q: Array, time: float) -> tuple[Array, Array]:
        """Return the sum of each rank's quadratics, in what the ranks before leave free."""
        names = _counted(q)
        hessian, linear, free = np.zeros((len(names), len(names))), np.zeros(len(names)), np.eye(len(names))
        for rank in sorted({each.rank for each in self.tasks}):
            same = [each for each in self.tasks if each.rank == rank]
            parts = [quadratic(each.task.objective(q, time), names) for each in same]
            own = np.sum([each.weight * part[0] for each, part in zip(same, parts, strict=True)], axis=0)
            pull = np.sum([each.weight * part[1] for each, part in zip(same, parts, strict=True)], axis=0)
            best = -np.linalg.solve(hessian, linear) if hessian.any() else linear  # of the ranks before
            inside = free.T @ own @ free
            hessian = hessian + free @ inside @ free.T
            linear = linear + free @ (free.T @ (pull + own @ best))
            size, ways = np.linalg.eigh(inside)
            level = size - size[0] <= CURVATURE_SHARE * size[-1]
            free = free @ ways[:, level & ~level.all()]
            if not free.shape[1]:
                break
        return hessian, linear

    def met(self, q: Array, time: float) -> bool:
        """True if all of the first rank are done; the others have no say in that."""
        first = min(each.rank for each in self.tasks)
        return all(each.task.met(q, time) for each in self.tasks if each.rank == first)


def together(tasks: Task | Sequence[Task | Ranked]) -> Task:
    """Return a list of tasks as one; a single one as it is. Raises InputError for an empty list, and for what is no
    task."""
    if not isinstance(tasks, Sequence):
        tasks = [tasks]
    elif not tasks:
        raise wrong("a task, or a list of at least one", tasks).within("task")
    ranked = tuple(each if isinstance(each, Ranked) else Ranked(each) for each in tasks)
    for index, each in enumerate(ranked):
        if not hasattr(each.task, "objective"):
            raise wrong("a task", each.task).within(f"task[{index}]")
    return ranked[0].task if len(ranked) == 1 else Together(ranked)


def standing(q: Array, gain: float = 2.0) -> TrackTask:
    """Return the task of going to a configuration q (n,) [rad or m] and staying there; `gain` is the relative decrease
    of the error per second [1/s]. Raises InputError for an invalid configuration or gain."""
    goal = joint_numbers("q", q, _counted(q))
    return TrackTask(_Still(goal), gain)


@dataclass(frozen=True, eq=False)
class _Still:
    """A configuration that does not move, as a reference."""

    goal: Array

    def __call__(self, time: float) -> tuple[Array, Array]:
        """The position with zero velocity."""
        return self.goal, np.zeros_like(self.goal)


def least_squares(jacobian: Array, wanted: Array, regularization: float) -> tuple[Array, Array]:
    """Return H and f of ½ ‖J u − wanted‖² + ½ λ ‖u‖², up to a constant."""
    return jacobian.T @ jacobian + regularization * np.eye(jacobian.shape[1]), -jacobian.T @ wanted


def _counted(q: ArrayLike) -> list[str]:
    """Return names for joints that a task knows only by number."""
    return [str(joint) for joint in range(np.size(q))]
