"""A whole problem in JAX: the cost of motions, for any number of guesses at once, on whatever device JAX finds.

A pure function of arrays without callbacks, for `jit`, `vmap` and `grad` in any order: kinematics by walking the tree
of joints, the distance of `distance.batch.halfspaces` for all pairs, samples and guesses, the hinge, and the
smoothness. It has the planner's own pairs, margins and samples, and is held to `Problem.evaluate`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from hdplan.distance.batch.halfspaces import halfspace_distance
from hdplan.planner.collision.hdsdf import HdsdfPairs
from hdplan.planner.kinematics.forward import Kinematics
from hdplan.planner.problem.clearance import Clearance, PairTerm
from hdplan.planner.problem.moving_clearance import MovingClearance
from hdplan.planner.problem.problem import Problem
from hdplan.scenes.errors import InputError
from hdplan.scenes.values import instance

Array = Any  # NumPy's or JAX's
Pairs = Callable[[jax.Array, jax.Array], jax.Array]  # frames (..., F, 3, 3) and (..., F, 3) -> D (..., P)


@dataclass(frozen=True, eq=False, repr=False)
class JaxCost:
    """The cost of a problem in JAX; made by `jax_cost`. Arrays are JAX's, in their precision (`jax.enable_x64`).

    The smoothness, and the weighed squared hinge of the HD-SDF of pairs of bodies: links with standing and moving
    obstacles and with links, what is held included. Terms of any other kind are refused, never left out.
    """

    problem: Problem

    def __repr__(self) -> str:
        """Name the problem."""
        return f"<JaxCost of {self.problem!r}>"

    def __call__(self, positions: Array, weight: float | Array) -> jax.Array:
        """Return the cost of motions: waypoints (..., N, n), both ends included, with a weight of the penalty [1/m²]
        -> (...)."""
        positions, problem = jnp.asarray(positions), self.problem
        smooth = 0.5 * jnp.einsum("...ki,kl,...li->...", positions, jnp.asarray(problem.smoothness.matrix), positions)
        depth = jnp.minimum(self.distances(positions), 0.0)
        share = jnp.asarray(problem.samples.weight)
        return smooth + 0.5 * weight * jnp.einsum("s,...sp->...", share, depth * depth)

    def curvature(self, positions: Array, weight: float | Array) -> jax.Array:
        """Return the Gauss-Newton Hessian of the cost by the M waypoints between the ends of one motion (N, n), one
        after another: (M n, M n), positive definite. `jax.vmap` makes it one of many motions."""
        positions, samples = jnp.asarray(positions), self.problem.samples
        count, n = positions.shape
        rows = np.arange(len(samples.weight))
        spread = np.zeros((len(rows), count))  # from waypoints to samples
        spread[rows, samples.interval], spread[rows, samples.interval + 1] = 1 - samples.fraction, samples.fraction
        depth = jnp.minimum(self.distances(positions), 0.0)
        slope = jax.jacfwd(lambda by: self.distances(positions + by))(jnp.zeros(n))  # of each sample alone, (B, P, n)
        share = weight * jnp.asarray(samples.weight)[:, None] * (depth < 0)
        blocks = jnp.einsum("sp,spi,spj->sij", share, slope, slope)
        spread = spread[:, 1:-1]
        bent = jnp.einsum("sk,sl,sij->kilj", spread, spread, blocks).reshape((count - 2) * n, -1)
        return jnp.kron(jnp.asarray(self.problem.smoothness.matrix[1:-1, 1:-1]), jnp.eye(n)) + bent

    def distances(self, positions: Array) -> jax.Array:
        """Return D of every pair at the problem's samples of motions (..., N, n) -> (..., B, P) [m], of bodies enlarged
        by the clearances and by how much earlier the penalty sets in."""
        samples, positions = self.problem.samples, jnp.asarray(positions)
        fraction = jnp.asarray(samples.fraction)[:, None]
        before, after = positions[..., samples.interval, :], positions[..., samples.interval + 1, :]
        turns, origins = placements(self.problem, (1 - fraction) * before + fraction * after)
        found = [self._of_term(term, turns, origins) for term in self.problem.terms.pairs]
        return jnp.concatenate([jnp.zeros((*turns.shape[:-3], 0)), *found], axis=-1)

    def _of_term(self, term: PairTerm, turns: jax.Array, origins: jax.Array) -> jax.Array:
        """Return D (..., B, P) of a term's pairs, with moving obstacles where they are at the samples' times."""
        if isinstance(term, MovingClearance):
            times = term.law.time_at(self.problem.samples.parameter)
            poses = np.stack([motion.at(times) for motion in term.motions], axis=1)  # (B, m, 4, 4)
            leading = turns.shape[:-4]
            turns = jnp.concatenate(
                [turns, jnp.broadcast_to(poses[..., :3, :3], (*leading, *poses.shape[:2], 3, 3))], -3
            )
            origins = jnp.concatenate(
                [origins, jnp.broadcast_to(poses[..., :3, 3], (*leading, *poses.shape[:2], 3))], -2
            )
        return _distances(term)(turns, origins)


def jax_cost(problem: Problem) -> JaxCost:
    """Return the cost of a problem as a function in JAX: of waypoints (..., N, n) and the penalty's weight.

    Its value is `problem.evaluate(positions, weight).cost`, for any number of motions at once. Where the problem
    samples more densely (`problem.resampled`), so does it.

    Args:
        problem: made by `hdplan.build`, of a scene whose penalty is about pairs of bodies alone.

    Raises:
        InputError: for a problem with other terms (path constraints, torques, limits of speed beside moving obstacles,
            a term of one's own, path_speed), with ``planner.swept``, or with ``planner.distance: fcl``.
    """
    instance(problem, Problem, "problem")
    where = f"{problem.scene.source}: " if problem.scene.source else ""
    for cost in problem.terms.costs:
        raise InputError(f"{where}the term '{cost.name}' is not written in JAX: only distances of bodies are")
    for term in problem.terms:
        if not isinstance(term, PairTerm) or type(term) not in (Clearance, MovingClearance):
            raise InputError(f"{where}the term '{term.name}' is not written in JAX: only distances of bodies are")
        if not isinstance(term.distance, HdsdfPairs):
            raise InputError(f"{where}planner.distance: must be hdsdf for JAX, found {problem.scene.planner.distance}")
    if problem.path_speed is not None:
        raise InputError(f"{where}the path speed of a motion is not written in JAX: only distances of bodies are")
    return JaxCost(problem)


def placements(problem: Problem, q: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Return the frames of the world and of all joints at configurations (..., n): rotations (..., nj, 3, 3) and
    origins (..., nj, 3) [m]."""
    robot = problem.robot
    values = q if robot.linkage is None else q[..., robot.linkage.leader] * robot.linkage.factor + robot.linkage.offset
    _, joints, _, parents, coordinates, turning, placed, axes = _tree(problem.kinematics)
    leading = q.shape[:-1]
    turns, origins = [jnp.broadcast_to(jnp.eye(3), (*leading, 3, 3))], [jnp.zeros((*leading, 3))]
    for row in range(joints - 1):
        parent, value, axis = int(parents[row]), values[..., int(coordinates[row])], axes[row]
        turn = turns[parent] @ placed[row, :9].reshape(3, 3)
        origin = origins[parent] + turns[parent] @ placed[row, 9:]
        if turning[row]:
            cross = np.cross(axis, np.eye(3)).T  # [a]×
            outer = np.outer(axis, axis)
            angle = value[..., None, None]
            turn = turn @ (outer + jnp.cos(angle) * (np.eye(3) - outer) + jnp.sin(angle) * cross)
        else:
            origin = origin + (turn @ axis) * value[..., None]
        turns.append(turn)
        origins.append(origin)
    return jnp.stack(turns, axis=-3), jnp.stack(origins, axis=-2)


def _tree(kinematics: Kinematics) -> tuple[Any, ...]:
    """Return the tree of joints as `forward_loop` has it."""
    return (kinematics.tree.kind, *kinematics.tree.fields)


def _distances(term: PairTerm) -> Pairs:
    """Return the function of frames that gives D of a term's pairs, in their order."""
    pairs, settings = term.pairs, term.distance
    assert isinstance(settings, HdsdfPairs)
    order = np.argsort(np.concatenate([np.flatnonzero(pairs.plane_slots == slots) for slots in pairs.plane_tables]))

    def of(turns: jax.Array, origins: jax.Array) -> jax.Array:
        found = []
        for slots, table in pairs.plane_tables.items():
            chosen = np.flatnonzero(pairs.plane_slots == slots)
            a, b = pairs.joint_a[chosen], pairs.joint_b[chosen]
            body, planes = pairs.body_table[pairs.body[chosen]], table[pairs.plane_row[chosen]]
            split = 3 * pairs.vertex_slots
            vertices, weights = body[:, :split].reshape(len(chosen), -1, 3), body[:, split:-1]
            planes = np.concatenate(
                [planes[:, : 3 * slots].reshape(-1, slots, 3), planes[:, 3 * slots :, None]], axis=2
            )
            world = jnp.einsum("...pij,pvj->...pvi", turns[..., a, :, :], vertices) + origins[..., a, None, :]
            seen = jnp.einsum("...pij,...pvi->...pvj", turns[..., b, :, :], world - origins[..., b, None, :])
            bodies = jnp.asarray(weights), jnp.asarray(body[:, -1]), jnp.asarray(planes)
            found.append(halfspace_distance(seen, *bodies, settings.gamma, settings.shaping_length))
        return jnp.concatenate(found, axis=-1)[..., order]

    return of
