"""The penalty of a problem as one graph of CasADi's: the definition, to which the loops are held.

    penalty = Σ_samples w_s Σ_terms penalty_term(q_s, frames_s) + Σ_terms penalty_term(motion)

In: waypoints and steps; poses and sizes of obstacles, which are parameters. Out: an expression without a callback.
Every term writes itself (`Term.written_at_sample`, `written_over_motion`); one that does not is refused.
"""

from __future__ import annotations

import copy
import functools
import math
import operator
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hdplan.distance.poses import check_poses, placement_rows
from hdplan.distance.symbolic.all_planes import MOST_SIZES
from hdplan.distance.symbolic.graph_poses import rigid_or_nan
from hdplan.planner.collision.growth import sizes_of
from hdplan.planner.problem.assemble import on_frames
from hdplan.planner.problem.closed_sum import closed_sum
from hdplan.planner.problem.symbolic_place import SymbolicMotion, SymbolicPlace
from hdplan.planner.problem.terms import Term
from hdplan.planner.problem.unknown import spans
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError, listed, nearest
from hdplan.scenes.obstacle_motion import ObstacleMotion
from hdplan.scenes.shapes import Shape

if TYPE_CHECKING:
    from hdplan.planner.problem.problem import Problem

FRAME = 12 + MOST_SIZES  # numbers of a frame, as in `pair_symbols`
HEIGHT = 11  # the place among them of the origin's z
GROWING_SHAPES = ("box", "sphere", "cylinder", "capsule")  # shapes with sizes as parameters
WRITTEN = {"at_samples": "written_at_sample", "over_motion": "written_over_motion"}


@dataclass(frozen=True, eq=False)
class ObstaclePlaces:
    """Pose and size of an obstacle: parameters of the graph."""

    name: str
    poses: Array  # (C, 4, 4) of the scene: one, or of a moving obstacle one for each sample
    home: Array  # (4, 4) in which its bodies are given
    shape: object  # of the scene

    @property
    def size(self) -> int:
        """Count of their numbers: 12 each, the rotation row by row, then the origin [m]."""
        return 12 * len(self.poses)

    @cached_property
    def sizes(self) -> Array:
        """Sizes of its shape in the scene (k,) [m], none where it cannot grow."""
        return sizes_of(self.shape)


@functools.cache
def _rigid() -> ca.Function:
    """Function from a pose (12) to 0, or NaN where it is not rigid."""
    pose = ca.MX.sym("pose", 12)
    return ca.Function("rigid", [pose], [rigid_or_nan(ca.reshape(pose[:9], 3, 3).T)])


@functools.cache
def _moved() -> ca.Function:
    """Function from a pose and the home of bodies to pose · home⁻¹, as rows of 12."""
    pose, home = ca.SX.sym("pose", 12), ca.SX.sym("home", 12)
    turn = ca.reshape(pose[:9], 3, 3).T @ ca.reshape(home[:9], 3, 3)
    moved = ca.vertcat(ca.vec(turn.T), pose[9:] - turn @ home[9:])
    return ca.Function("moved", [pose, home], [ca.densify(moved)], {"is_diff_in": [True, False]})


class SymbolicPenalty:
    """The penalty of a problem in symbols."""

    def __init__(self, problem: Problem, exact: bool, movable: bool = True) -> None:
        """Take a problem, whether second derivatives are exact or Gauss-Newton's, and whether there are derivatives by
        the obstacles' poses. Raises InputError for a term that is not written in symbols."""
        for term in problem.terms:
            refuse_unwritten(term)
        self.problem, self.exact, self.movable = on_frames(problem), exact, movable
        scene, moving, found = problem.scene, problem.terms.moving_obstacles, []
        self._away: list[Array] = []  # of each moving obstacle, how far (S, B) each of its S frames is above it [m]
        if moving is not None:
            times = moving.law.time_at(problem.samples.parameter)
            for each in scene.moving:
                poses = ObstacleMotion.of(each).at(times)
                found.append(ObstaclePlaces(each.name, poses, np.eye(4), each.shape))
                placed = np.array([span.at(times)[:, 2, 3] for span in spans(each, scene.end_time)])
                self._away.append(placed - poses[:, 2, 3])
        for each in scene.standing:
            found.append(ObstaclePlaces(each.name, each.pose.matrix[None], each.pose.matrix, each.shape))
        self.obstacles = tuple(found)

    @property
    def standing(self) -> SymbolicPenalty:
        """The penalty without derivatives by the obstacles' poses, as a solver needs it: several times as fast."""
        found = copy.copy(self)
        found.movable = False
        return found

    @property
    def size(self) -> int:
        """The number of parameters."""
        return self._ends[-1]

    @property
    def _ends(self) -> list[int]:
        """Offsets of the obstacles' parameters: their poses, then their sizes."""
        each = [*(each.size for each in self.obstacles), *(len(each.sizes) for each in self.obstacles)]
        return [int(end) for end in np.cumsum([0, *each])]

    def place_of(self, obstacle: str, what: str) -> tuple[int, int]:
        """Slice of the "pose" or the "size" of an obstacle among the parameters. Raises InputError where there is
        none."""
        known = [each.name for each in self.obstacles]
        if obstacle not in known:
            raise InputError(f"{what}: no obstacle is named {obstacle!r}{nearest(str(obstacle), known)}")
        row = known.index(obstacle)
        if what == "size" and not len(self.obstacles[row].sizes):
            raise InputError(f"size: {self._cannot_grow(self.obstacles[row])}")
        row += len(known) * (what == "size")
        return self._ends[row], self._ends[row + 1]

    @staticmethod
    def _cannot_grow(each: ObstaclePlaces) -> str:
        shape = type(each.shape).__name__.lower()
        return (
            f"{each.name}: the sizes of this shape ({shape}) are not parameters; allowed are {listed(GROWING_SHAPES)}"
        )

    def values(self, poses: Mapping[str, ArrayLike], sizes: Mapping[str, Shape] | None = None) -> Array:
        """The parameters, with other poses for some obstacles: (4, 4), or of a moving one (B, 4, 4), one for each
        sample; and other sizes for some, as shapes. Raises InputError for what is no obstacle, no pose or no such
        shape."""
        sizes, known = sizes or {}, {each.name: each for each in self.obstacles}
        for what, names in (("poses", poses), ("sizes", sizes)):
            if strange := [name for name in names if name not in known]:
                raise InputError(f"{what}: no obstacle is named {strange[0]!r}{nearest(str(strange[0]), known)}")
        found = []
        for name, each in known.items():
            given, count = check_poses(f"poses: {name}", poses.get(name, each.poses)), len(each.poses)
            if given.shape not in {(4, 4), (1, 4, 4), (count, 4, 4)}:
                allowed = "(4, 4)" if count == 1 else f"(4, 4) or ({count}, 4, 4)"
                raise InputError(f"poses: {name}: found an array of shape {given.shape}, allowed is {allowed}")
            found.append(placement_rows(np.broadcast_to(given, each.poses.shape)).ravel())
        for name, each in known.items():
            shape = sizes.get(name, each.shape)
            if name in sizes and not len(each.sizes):
                raise InputError(f"sizes: {self._cannot_grow(each)}")
            if type(shape) is not type(each.shape):
                words = type(each.shape).__name__
                raise InputError(f"sizes: {name}: a {words} of other sizes is expected, found {shape!r}")
            found.append(sizes_of(shape))
        return np.concatenate(found) if found else np.empty(0)

    def __call__(self, first: ca.MX, step: ca.MX, places: ca.MX, x: ca.MX | None = None) -> ca.MX:
        """The penalty of intervals that begin at `first` (n, N − 1) and lead on by `step`, with obstacles at `places`,
        numbers as in `values`. Where these are linear in an x, the configurations are one product of it."""
        problem, samples = self.problem, self.problem.samples
        kinematics, terms = problem.kinematics, tuple(problem.terms)
        linkage, count = problem.robot.linkage, len(samples.weight)
        moving, standing, mark = self._frames(places)
        if linkage is not None:
            first = ca.DM(linkage.matrix) @ first + ca.repmat(ca.DM(linkage.offset), 1, first.shape[1])
            step = ca.DM(linkage.matrix) @ step
        interval = samples.interval.tolist()
        looks = first[:, interval] + step[:, interval] @ ca.diag(ca.DM(samples.fraction))
        if x is not None:
            looks = ca.reshape(linear(ca.vec(looks), x), looks.shape)

        frames_count = len(moving) + standing.shape[1]
        q, carried = ca.MX.sym("q", kinematics.n), ca.MX.sym("frames", FRAME, frames_count)
        place = SymbolicPlace(kinematics, q, carried, self.exact, self.movable)
        at_sample = [part for term in terms if (part := term.written_at_sample(place)) is not None]
        result = mark
        if at_sample:
            frames = ca.vertcat(ca.MX(0, count), *moving, ca.repmat(ca.vec(standing), 1, count))
            by_sample = ca.reshape(frames, FRAME, frames_count * count)
            form = functools.reduce(operator.add, at_sample)
            result += closed_sum("samples", [place], form, samples.weight)(looks, by_sample)
        still = ca.horzcat(ca.MX.zeros(FRAME, len(moving)), standing)
        motion = SymbolicMotion(kinematics, first, step, still, self.exact, self.movable)
        over_motion = [whole for term in terms if (whole := term.written_over_motion(motion)) is not None]
        return sum(over_motion, result)

    def _frames(self, places: ca.MX) -> tuple[list[ca.MX], ca.MX, ca.MX]:
        """The frames of every moving obstacle at the samples (15, B), several of one that may leave its place; those of
        the standing ones (15, F); and 0, or NaN where a pose is not rigid or a size is no length: a graph cannot raise
        an error, and far away no distance shows it."""
        every, counts = self.obstacles, [len(each.poses) for each in self.obstacles]
        if not every:
            return [], ca.MX(FRAME, 0), ca.MX(0)
        poses, sizes = ca.vertsplit(places, [0, self._ends[len(every)], places.numel()])
        homes = placement_rows(np.array([each.home for each in every]))
        frames = _moved().map(sum(counts))(ca.reshape(poses, 12, -1), ca.DM(np.repeat(homes, counts, axis=0).T))
        mark = ca.sum2(_rigid().map(sum(counts))(ca.reshape(poses, 12, -1)))
        change = ca.MX.zeros(MOST_SIZES, len(every))
        if sizes.numel():
            spread = np.zeros((MOST_SIZES * len(every), sizes.numel()))
            rows = [MOST_SIZES * row + k for row, each in enumerate(every) for k in range(len(each.sizes))]
            spread[rows, np.arange(len(rows))] = 1.0
            at_home = np.concatenate([each.sizes for each in every])
            change = ca.reshape(ca.sparsify(ca.DM(spread)) @ (sizes - at_home), MOST_SIZES, len(every))
            mark += ca.sum1(ca.if_else(sizes >= 0, 0, math.nan))
        columns, changes, found, moving = np.cumsum([0, *counts]).tolist(), ca.horzsplit(change), [], len(self._away)
        for row, away in enumerate(self._away):
            whole = ca.vertcat(frames[:, columns[row] : columns[row + 1]], ca.repmat(changes[row], 1, counts[row]))
            for each in away:
                raised = np.zeros((FRAME, counts[row]))
                raised[HEIGHT] = each
                found.append(whole + ca.sparsify(ca.DM(raised)) if each.any() else whole)
        return found, ca.vertcat(frames[:, columns[moving] :], change[:, moving:]), mark


def linear(expression: ca.MX, x: ca.MX) -> ca.MX:
    """The column A x + b as one product: its derivatives are a fraction of those of what makes it up."""
    at_zero = ca.Function("linear", [x], [ca.jacobian(expression, x), expression])
    matrix, offset = at_zero(0)
    product = ca.mtimes(ca.sparsify(matrix), x)
    return product + offset if np.array(offset).any() else product


def refuse_unwritten(term: Term) -> None:
    """Raise InputError for a term of which a penalty is not written in symbols by the class that has it in numbers."""
    for numbers, symbols in WRITTEN.items():
        owner = next(each for each in type(term).__mro__ if {numbers, symbols} & set(vars(each)))
        if symbols not in vars(owner):
            raise InputError(f"form: the term '{term.name}' is not written in symbols; allowed: external")
