"""Whole problems in JAX: the cost of motions, for any number of problems and guesses at once, on whatever device there
is.

A pure function of arrays without callbacks, for `jit`, `vmap` and `grad` in any order. It has the planner's own pairs,
margins and samples, and is held to `Problem.evaluate`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from hdplan.planner.collision.hdsdf import HdsdfPairs
from hdplan.planner.problem.clearance import Clearance, PairTerm
from hdplan.planner.problem.moving_clearance import MovingClearance
from hdplan.planner.problem.problem import Problem
from hdplan.planner.traced import evaluation
from hdplan.planner.traced.tables import Structure, Tables, structure_of, tables_of
from hdplan.scenes.errors import InputError
from hdplan.scenes.values import instance, is_row

Array = Any  # NumPy's or JAX's

SAID = ("waypoints", "planned joints", *("joints",) * 4, "planner.gamma")  # of a structure


@partial(jax.tree_util.register_dataclass, data_fields=("tables",), meta_fields=("structure",))
@dataclass(frozen=True, eq=False, repr=False)
class JaxCost:
    """The cost of a problem in JAX, or of R problems at once; made by `jax_cost`. Arrays are JAX's, in their precision
    (`jax.enable_x64`).

    The smoothness, and the weighed squared hinge of the HD-SDF of pairs of bodies: links with standing and moving
    obstacles and with links, what is held included. Terms of any other kind are refused, never left out.

    It is a pytree: as an argument of a function under `jit` it is compiled once for all costs of equal shapes, wherever
    the obstacles are; and `vmap` maps a cost of R problems to costs of one each.

    Raises InputError for motions and weights of another shape.
    """

    structure: Structure
    tables: Tables

    def __repr__(self) -> str:
        """Say the sizes."""
        count = f"{len(self.tables.smoothness)} problems" if self._several else "one problem"
        pairs, samples = sum(table.place.shape[-1] for table in self.tables.pairs), self.tables.share.shape[-1]
        return f"<JaxCost of {count}: {self.structure.waypoints} waypoints, {pairs} pairs at {samples} samples>"

    def __call__(self, positions: Array, weight: float | Array) -> jax.Array:
        """Return the cost of motions: waypoints (..., N, n), both ends included, with a weight of the penalty [1/m²]
        -> (...). Of R problems: (..., R, N, n) -> (..., R). Weights broadcast to the result."""
        smooth, penalty = self._of_every(evaluation.parts, self._motions(positions), -1)
        return smooth + self._weights(weight, smooth.shape) * penalty

    def distances(self, positions: Array) -> jax.Array:
        """Return D of every pair at the problem's samples of motions (..., N, n) -> (..., B, P) [m], of bodies enlarged
        by the clearances and by how much earlier the penalty sets in. Of R problems: (..., R, N, n) -> (..., R, B, P);
        inf where one has fewer samples or pairs than there is room for."""
        return self._of_every(evaluation.distances, self._motions(positions), -3)

    def curvature(self, positions: Array, weight: float | Array) -> jax.Array:
        """Return the Gauss-Newton Hessian of the cost by the M waypoints between the ends of one motion (N, n), one
        after another: (M n, M n), positive definite. Of R problems: (R, N, n) -> (R, M n, M n). `jax.vmap` makes it one
        of many motions."""
        positions = self._motions(positions, leading=False)
        weights = jnp.broadcast_to(self._weights(weight, positions.shape[:-2]), positions.shape[:-2])
        smooth, bent = self._of_every(evaluation.curvature, positions, 0)
        return smooth + weights[..., None, None] * bent

    @property
    def _several(self) -> bool:
        """Whether the tables are of several problems."""
        return self.tables.smoothness.ndim > 2

    def _of_every(self, of: Callable[..., Any], positions: jax.Array, axis: int) -> Any:
        """Return a function of the tables of a problem and its motions, of R problems along this axis of its values."""
        of = partial(of, self.structure)
        return (jax.vmap(of, (0, -3), axis) if self._several else of)(self.tables, positions)

    def _motions(self, positions: Array, leading: bool = True) -> jax.Array:
        """Return motions as an array, of the right shape."""
        structure, several = self.structure, self.tables.smoothness.shape[:-2]
        shape = *several, structure.waypoints, structure.joints
        found = np.shape(positions)
        if found[-len(shape) :] != shape or (len(found) > len(shape) and not leading):
            allowed = ", ".join([*(["..."] if leading else []), *map(str, shape)])
            named = "problems, waypoints, joints" if several else "waypoints, joints"
            raise InputError(f"positions: found an array of shape {found}, allowed is ({allowed}): {named}")
        return jnp.asarray(positions)

    def _weights(self, weight: float | Array, shape: tuple[int, ...]) -> jax.Array:
        """Return weights as an array that broadcasts to a shape."""
        found = np.shape(weight)
        if len(found) > len(shape) or any(a not in (1, b) for a, b in zip(found[::-1], shape[::-1], strict=False)):
            raise InputError(f"weight: found an array of shape {found}, allowed is one number, or {shape}")
        return jnp.asarray(weight)


def jax_cost(problem: Problem | Sequence[Problem]) -> JaxCost:
    """Return the cost of a problem as a function in JAX: of waypoints (..., N, n) and the penalty's weight.

    Its value is `problem.evaluate(positions, weight).cost`, for any number of motions at once. Where the problem
    samples more densely (`problem.resampled`), so does it.

    Of a list of R problems it takes (..., R, N, n), a motion for each. They are of one robot, or of robots that are
    built alike, with as many waypoints; obstacles, sizes, clearances, what is held and the samples may differ, in
    number too: what one has fewer of is filled with what costs nothing.

    Args:
        problem: made by `hdplan.build`, of a scene whose penalty is about pairs of bodies alone; or a list of them.

    Raises:
        InputError: for a problem with other terms (path constraints, torques, limits of speed beside moving obstacles,
            a term of one's own, pace), with ``planner.swept``, or with ``planner.distance: fcl``; for problems of
            unlike robots, numbers of waypoints or ``planner.gamma``, and for an empty list.
    """
    if not is_row(problem):
        structure = _structure(problem, "problem")
        return JaxCost(structure, jax.tree.map(lambda table: table[0], tables_of([problem])))
    if not problem:
        raise InputError("problem: found an empty list, allowed is a Problem, or a list of them")
    first, *others = (_structure(each, f"problem[{row}]") for row, each in enumerate(problem))
    for row, other in enumerate(others, 1):
        for what, own, found in zip(SAID, first, other, strict=True):
            if found != own:
                shown = f": {found}, not {own}" if isinstance(own, int) else ""
                raise InputError(f"problem[{row}]: has other {what} than problem[0]{shown}")
    return JaxCost(first, tables_of(problem))


def _structure(problem: Problem, name: str) -> Structure:
    """Return the structure of a problem that is distances alone. Raises InputError."""
    instance(problem, Problem, name)
    where = f"{problem.scene.source}: " if problem.scene.source else ""
    for cost in problem.terms.costs:
        raise InputError(f"{where}the term '{cost.name}' is not written in JAX: only distances of bodies are")
    for term in problem.terms:
        if not isinstance(term, PairTerm) or type(term) not in (Clearance, MovingClearance):
            raise InputError(f"{where}the term '{term.name}' is not written in JAX: only distances of bodies are")
        if not isinstance(term.distance, HdsdfPairs):
            raise InputError(f"{where}planner.distance: must be hdsdf for JAX, found {problem.scene.planner.distance}")
    if problem.pace is not None:
        raise InputError(f"{where}the pace of a motion is not written in JAX: only distances of bodies are")
    return structure_of(problem)
