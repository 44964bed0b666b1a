"""One planning problem: waypoints to choose, a cost made of terms, and its exact derivatives.

`assemble` makes a `Problem`; solvers only evaluate it. The cost of waypoints q_0 … q_{N−1} with both ends fixed is

    smoothness(q) + w Σ_samples w_s Σ_pairs ½ min(D, 0)²

(CHOMP, Ratliff et al. 2009, with the HD-SDF, or the exact distance, in place of a distance field). Only the terms that
the scene calls for exist.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from hdplan.distance.compiled.loops import Record, twin_of
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody
from hdplan.planner.collision.link_bodies import LinkBody
from hdplan.planner.kinematics.forward import Kinematics, KinematicsBatch
from hdplan.planner.problem import loops
from hdplan.planner.problem.clearance import Clearance, PairTerm
from hdplan.planner.problem.path_speed import PathSpeed
from hdplan.planner.problem.samples import Samples
from hdplan.planner.problem.smoothness import Smoothness
from hdplan.planner.problem.terms import MotionPenalty, Penalty, Term, nowhere
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.errors import InputError
from hdplan.scenes.scene import Scene

if TYPE_CHECKING:
    from hdplan.planner.problem.gravity_torque import StaticTorque
    from hdplan.planner.problem.moving_clearance import MovingClearance
    from hdplan.planner.problem.own_term import OwnTerm, WrittenTerm
    from hdplan.planner.problem.path_duration import PathDuration
    from hdplan.planner.problem.path_terms import PathTerm
    from hdplan.planner.problem.program import Program
    from hdplan.planner.problem.velocity_penalty import VelocityPenalty


SPACING = 0.03  # [m] the most that a body's centre may move between two samples


@dataclass(frozen=True)
class Evaluation:
    """The cost at some waypoints, with derivatives with respect to the interior ones (M = N − 2 of them)."""

    cost: float
    smoothness: float  # and the path speed
    penalty: float  # without its weight
    depth: Array  # (B,) how far the worst pair at each sample may be inside its margin [m]
    gradient: Array  # (M, n)
    diagonal: Array  # (M, n, n) curvature of penalty and path_speed at each waypoint
    coupling: Array  # (M − 1, n, n) the same between neighbours
    at_goal: Array  # (n,) the derivative with respect to the goal


@dataclass(frozen=True)
class Terms:
    """The terms of the cost other than smoothness, by name: those that the scene calls for, and the user's own."""

    obstacles: PairTerm | None = None  # standing ones
    moving_obstacles: MovingClearance | None = None
    velocity: VelocityPenalty | None = None
    self_collision: Clearance | None = None
    path: tuple[PathTerm, ...] = ()
    static_torque: StaticTorque | None = None
    own: tuple[Term, ...] = ()
    costs: tuple[WrittenTerm, ...] = ()  # the user's own beside the smoothness; the others are weighed as contacts are

    def __iter__(self) -> Iterator[Term]:
        """All terms that are weighed as contacts are, in this order."""
        found = (self.obstacles, self.moving_obstacles, self.velocity, self.self_collision, *self.path)
        return (term for term in (*found, self.static_torque, *self.own) if term is not None)

    @property
    def pairs(self) -> tuple[PairTerm, ...]:
        """The terms that keep pairs of bodies apart."""
        return tuple(term for term in (self.obstacles, self.moving_obstacles, self.self_collision) if term is not None)


@dataclass(frozen=True, eq=False)
class Problem:
    """A planning problem, ready for a solver. It never changes; `refined` and others return a new one."""

    setup: Setup
    start: Array  # (n,)
    goal: Array  # (n,)
    kinematics: Kinematics
    bodies: tuple[LinkBody, ...]  # the links' outer bodies
    halfspace_bodies: tuple[HalfspaceBody, ...]  # the obstacles' convex pieces, moving ones last
    smoothness: Smoothness
    terms: Terms
    samples: Samples
    unresolved: tuple[tuple[str, str], ...]  # link pairs left to the certificate, as their outer bodies overlap anyway
    apart: tuple[tuple[int, int], ...]  # pairs of bodies left out, proven to keep their margin within the joint limits
    notes: tuple[str, ...]  # for the user
    closely: bool = False  # whether clouds, and meshes that are not split, are enclosed by many small boxes
    exact: bool = False  # true if distances are exact, those of the enclosed geometry
    path_speed: PathSpeed | PathDuration | None = None  # the cost's part for quick motions

    def __repr__(self) -> str:
        """Name the scene, the robot and the terms."""
        terms = ", ".join(["smoothness", *(term.name for term in (*self.terms.costs, *self.terms))])
        return f"<Problem of {self.scene.name} with {self.robot.name}: {self.waypoints} waypoints; {terms}>"

    @property
    def scene(self) -> Scene:
        """The scene of the problem."""
        return self.setup.scene

    @property
    def robot(self) -> Robot:
        """The robot whose motion is planned."""
        return self.setup.robot

    @property
    def waypoints(self) -> int:
        """N, both ends included."""
        return self.scene.planner.waypoints

    def clip(self, positions: Array) -> Array:
        """Move interior waypoints into the joint limits and set the ends."""
        result = np.clip(positions, *self.robot.inner)
        result[0], result[-1] = self.start, self.goal
        return result

    def polyline(self, via: Array | None = None) -> Array:
        """The straight line from start to goal, or the polyline through `via` (C, n), as waypoints (N, n) at equal
        steps of joint-space length."""
        corners = np.vstack([self.start, self.goal] if via is None else [self.start, via, self.goal])
        lengths = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
        if lengths[-1] == 0:
            return np.repeat(corners[:1], self.waypoints, axis=0)
        wanted = np.linspace(0, lengths[-1], self.waypoints)
        return self.clip(np.stack([np.interp(wanted, lengths, column) for column in corners.T], axis=1))

    def evaluate(self, positions: Array, weight: float) -> Evaluation:
        """Cost and derivatives at waypoints (N, n) with penalty weight w [1/m²]."""
        smoothness, gradient = self.smoothness.value(positions)
        found = self.penalty(positions)
        gradient += weight * found.gradient
        diagonal, coupling = weight * found.diagonal, weight * found.coupling
        for more in (*([self.path_speed.value(positions)] if self.path_speed else []), *self._costs(positions)):
            smoothness, gradient = smoothness + more.cost, gradient + more.gradient
            diagonal, coupling = diagonal + more.diagonal, coupling + more.coupling
        return Evaluation(
            cost=smoothness + weight * found.cost,
            smoothness=smoothness,
            penalty=found.cost,
            depth=found.depth,
            gradient=gradient[1:-1],
            diagonal=diagonal[1:-1],
            coupling=coupling[1:-1],
            at_goal=gradient[-1],
        )

    def _costs(self, positions: Array) -> list[MotionPenalty]:
        return [term.planned(positions) for term in self.terms.costs]

    def own_cost(self, positions: Array) -> float:
        """Values of the user's own costs of waypoints (N, n), in the unit of the smoothness."""
        return sum(found.cost for found in self._costs(positions))

    def left(self, positions: Array) -> tuple[str, ...]:
        """The user's own constraints that waypoints (N, n) violate, in words."""
        if not self.terms.own:
            return ()
        from hdplan.planner.problem.own_term import left

        return left(self.terms.own, positions)

    def penalty(self, positions: Array) -> MotionPenalty:
        """All terms but the smoothness at waypoints (N, n), without their weight; the depth is that of the samples
        (B,)."""
        linkage = self.robot.linkage
        found = self._penalty(self.robot.expand(positions))
        if linkage is None:
            return found
        diagonal, coupling = linkage.fold_blocks(found.diagonal), linkage.fold_blocks(found.coupling)
        return MotionPenalty(found.cost, linkage.fold(found.gradient), diagonal, coupling, found.depth)

    def _penalty(self, positions: Array) -> MotionPenalty:
        """The penalty with waypoints (N, m) and derivatives of all joints of the model, the variables of the terms."""
        found = self._at_samples(positions)
        penalty, depth = found.cost, found.depth
        slope, diagonal, coupling = self.samples.to_waypoints(found.gradient, found.curvature)
        for spanning in (term.over_motion(positions, self.kinematics) for term in self.terms):
            if spanning:
                penalty, slope = penalty + spanning.cost, slope + spanning.gradient
                diagonal, coupling = diagonal + spanning.diagonal, coupling + spanning.coupling
                depth = np.maximum(depth, spanning.depth[self.samples.interval])
        return MotionPenalty(penalty, slope, diagonal, coupling, depth)

    def second_order(self, positions: Array) -> tuple[Array, Array]:
        """Second-order part of the penalty's Hessian at waypoints (N, n): blocks (N, n, n) of each
        waypoint, and (N − 1, n, n) of q_{k+1} (rows) with q_k. Raises InputError for a term without one."""
        positions, linkage = self.robot.expand(positions), self.robot.linkage
        kinematics = self.kinematics.evaluate(self.samples.configurations(positions))
        nothing = nowhere(*kinematics.columns.shape[:2])
        found = [
            second_order
            for term in self.terms
            if (second_order := term.second_order(kinematics, self.samples)) is not None
        ]
        _, diagonal, coupling = self.samples.to_waypoints(nothing.gradient, sum(found, nothing.curvature))
        for term in self.terms:
            if spanning := term.second_order_over_motion(positions, self.kinematics):
                diagonal, coupling = diagonal + spanning[0], coupling + spanning[1]
        if linkage is None:
            return diagonal, coupling
        return linkage.fold_blocks(diagonal), linkage.fold_blocks(coupling)

    @twin_of(loops.at_samples)
    def _at_samples(self, positions: Array) -> Penalty:
        """The sum of the penalties at the samples of waypoints (N, m)."""
        kinematics = self.kinematics.evaluate(self.samples.configurations(positions))
        found = (term.at_samples(kinematics, self.samples) for term in self.terms)
        return sum(filter(None, found), nowhere(*kinematics.columns.shape[:2]))

    @cached_property
    def loop(self) -> tuple[Record, tuple[Term, ...]]:
        """The C struct `motion` of the terms that one loop of C evaluates together, and the other terms."""
        records = {term: term.record for term in self.terms if type(term) is Clearance and term.record}
        others, samples = tuple(term for term in self.terms if term not in records), self.samples
        given = self.kinematics.tree, np.array(samples.counts), samples.fraction, samples.weight
        return Record("motion", *given, tuple(records.values())), others

    def casadi(self, hessian: str = "exact", *, form: str = "external") -> Program:
        """The problem as a CasADi program, for Ipopt, fatrop and other solvers of CasADi's.

        form: of the penalty, "external" or "symbolic". The former calls the fast loops and is for planning here; the
        latter is one graph without a callback, whose parameters include the poses of obstacles: it can be inspected,
        saved, written to C and compiled, and serves a moving scene.

        hessian: of the penalty, "exact" or "gauss_newton", its positive semidefinite part. To a given tolerance,
        solvers take half as many steps with the exact one; in runs of a few steps the other gets further.

        `nlp` is the dictionary of x, p, f and g that `casadi.nlpsol` takes, `bounds` holds lbx, ubx, lbg and ubg, and
        `stages` the options by which fatrop finds the stages. `guess(positions)` gives the x of waypoints (N, n),
        `positions(x)` the waypoints of an x, `values(weight, poses)` the p; `with_cost` and `with_constraint` add
        expressions of your own. Keep a reference to a program of form external as long as anything made from it is in
        use.

        Raises InputError for another `hessian` or `form`; for an exact Hessian of a term that has none: the distance by
        FCL, and your own term without `second_order`; and in symbols for a term without a symbolic form: the distance
        by FCL, and your own term without `written_at_sample` or `written_over_motion`.
        """
        from hdplan.planner.problem.program import program

        return program(self, hessian, form)

    def depth(self, configurations: Array, parameter: Array | None = None) -> Array:
        """Depth of the worst term inside its margin at single configurations (B, n) -> (B,) [m]: at no particular
        point of the motion, or at path parameters (B,)."""
        kinematics = self.placed(configurations)
        depths = [term.depth(kinematics, parameter) for term in self.terms]
        result: Array = np.max([np.zeros(len(configurations)), *depths], axis=0)
        return result

    def placed(self, configurations: Array) -> KinematicsBatch:
        """The kinematics at configurations (B, n), or at one (n,)."""
        return self.kinematics.evaluate(self.robot.expand(configurations))

    def with_term(self, term: Term | OwnTerm) -> Problem:
        """A copy of the problem with one more term in its cost, the user's own: an `OwnTerm` in symbols, of the planned
        joints, or a `Term` in numbers, of all joints of the model, those that follow others included. Raises InputError
        for an `OwnTerm` of other sizes, that is not twice differentiable, calls back into Python or has the name of
        another one."""
        from hdplan.planner.problem.own_term import OwnTerm, WrittenTerm

        if isinstance(term, OwnTerm):
            others = (*self.terms.costs, *self.terms.own)
            if any(isinstance(other, WrittenTerm) and other.name == term.name for other in others):
                raise InputError(f"term '{term.name}': the name is taken by another term")
            n, linkage = len(self.start), self.robot.linkage
            own = np.arange(n) if linkage is None else linkage.own
            written = term.of(n, own, self.scene.planner.activation, self.polyline())
            if written.is_cost:
                return replace(self, terms=replace(self.terms, costs=(*self.terms.costs, written)))
            term = written
        return replace(self, terms=replace(self.terms, own=(*self.terms.own, term)))

    def with_cloud(self, points: ArrayLike | Cloud, name: str | None = None) -> Problem:
        """A copy of the problem with other points (m, 3) [m] in a cloud, as the next picture of a camera gives them, or
        with another cloud in its place; its pose and, of points, its radius and all else stay, and what depends on the
        robot alone is not built again.

        Points near the robot at the start of the problem's scene are left out if the cloud has `ignore_robot`. `name`
        says which cloud if there are several. Raises InputError for points that a `Cloud` refuses, and for a name that
        no cloud has.
        """
        from hdplan.planner.problem.assemble import with_seen_points

        return with_seen_points(self, points, name)

    def refined(self, intervals: list[int]) -> Problem:
        """A copy of the problem, sampled twice as densely on the given intervals."""
        counts = np.array(self.samples.counts)
        counts[intervals] *= 2
        return replace(self, samples=self.samples.raised(counts))

    def resampled(self, positions: Array) -> Problem:
        """A copy of the problem, sampled densely enough for a motion (N, n): no body's centre moves farther than
        SPACING from one sample to the next."""
        kinematics = self.placed(positions)
        joints = [body.joint for body in self.bodies]
        centres = np.array([body.body.vertices.mean(axis=0) for body in self.bodies]).reshape(-1, 3)
        places = (
            np.einsum("kbij,bj->kbi", kinematics.rotations[:, joints], centres) + kinematics.translations[:, joints]
        )
        moved = np.linalg.norm(np.diff(places, axis=0), axis=2).max(axis=1, initial=0.0)
        return replace(self, samples=self.samples.raised(np.ceil(moved / SPACING).astype(np.int64)))
