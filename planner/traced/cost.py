"""Whole problems in JAX: the cost of motions, for any number of problems and guesses at once, on any device.

A pure function of arrays without callbacks, for `jit`, `vmap` and `grad` in any order. It has the planner's own pairs,
margins and samples, and is held to `Problem.evaluate`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp

from hdplan.planner.collision.hdsdf import HdsdfPairs
from hdplan.planner.problem.clearance import Clearance, PairTerm
from hdplan.planner.problem.moving_clearance import MovingClearance
from hdplan.planner.problem.problem import Problem
from hdplan.planner.traced import evaluation
from hdplan.planner.traced.tables import Structure, Tables, structure_of, tables_of
from hdplan.scenes.errors import InputError
from hdplan.scenes.values import instance

Array = Any  # NumPy's or JAX's

STRUCTURE = ("waypoints", "planned joints", *("joints",) * 4, "planner.gamma")  # its sizes


@partial(jax.tree_util.register_dataclass, data_fields=("tables",), meta_fields=("structure",))
@dataclass(frozen=True, eq=False, repr=False)
class JaxCost:
    """The cost of a problem in JAX, or of R problems at once; made by `jax_cost`. Arrays are JAX's, in their precision
    (`jax.enable_x64`).

    The smoothness, and the weighed squared hinge of the HD-SDF of pairs of bodies: links with static and moving
    obstacles and with links, held objects included. Terms of any other kind are refused, never left out.

    It is a pytree: as an argument of a function under `jit` it is compiled once for all costs of equal shapes, wherever
    the obstacles are; and `vmap` maps a cost of R problems to costs of one each.

    Raises InputError for motions and weights of another shape.
    """

    structure: Structure
    tables: Tables

    def __repr__(self) -> str:
        """Return the sizes, for display."""
        count = f"{len(self.tables.smoothness)} problems" if self._several else "one problem"
        pairs, samples = sum(table.place.shape[-1] for table in self.tables.pairs), self.tables.share.shape[-1]
        return f"<JaxCost of {count}: {self.structure.waypoints} waypoints, {pairs} pairs at {samples} samples>"

    def __call__(self, positions: Array, weight: float | Array) -> jax.Array:
        """Return the cost of motions: waypoints (..., N, n), both ends included, with a weight of the penalty [1/m²]
        -> (...). Of R problems: (..., R, N, n) -> (..., R). Weights broadcast to the result."""
        positions = self._motions(positions)
        weights = self._weights(weight, positions.shape[:-2])
        smooth, penalty = self._of_every(evaluation.parts, positions, -1)
        found: jax.Array = smooth + weights * penalty
        return found

    def distances(self, positions: Array) -> jax.Array:
        """Return D of every pair at the problem's samples of motions (..., N, n) -> (..., B, P) [m], of bodies enlarged
        by the clearances and by how much earlier the penalty begins. Of R problems: (..., R, N, n) -> (..., R, B, P);
        inf where one has fewer samples or pairs than the array."""
        found: jax.Array = self._of_every(evaluation.distances, self._motions(positions), -3)
        return found

    def curvature(self, positions: Array, weight: float | Array) -> jax.Array:
        """Return the Gauss-Newton Hessian of the cost by the M waypoints between the ends of one motion (N, n), one
        after another: (M n, M n), positive definite. Of R problems: (R, N, n) -> (R, M n, M n). `jax.vmap` makes it one
        of many motions."""
        positions = self._motions(positions, leading=False)
        weights = jnp.broadcast_to(self._weights(weight, positions.shape[:-2]), positions.shape[:-2])
        smooth, bent = self._of_every(evaluation.curvature, positions, 0)
        found: jax.Array = smooth + weights[..., None, None] * bent
        return found

    @property
    def _several(self) -> bool:
        """True if the tables are of several problems."""
        return self.tables.smoothness.ndim > 2

    def _of_every(self, of: Callable[..., Any], positions: jax.Array, axis: int) -> Any:
        """Return a function of the tables of a problem and its motions, of R problems along this axis of its values."""
        of = partial(of, self.structure)
        return (jax.vmap(of, (0, -3), axis) if self._several else of)(self.tables, positions)

    def _motions(self, positions: Array, leading: bool = True) -> jax.Array:
        """Return motions as an array of the right shape."""
        several = self.tables.smoothness.shape[:-2]
        shape, found = (*several, *self.structure[:2]), _numbers("positions", positions)
        if found.shape[-len(shape) :] != shape or (found.ndim > len(shape) and not leading):
            allowed = ", ".join([*(["..."] if leading else []), *map(str, shape)])
            named = "problems, waypoints, joints" if several else "waypoints, joints"
            raise InputError(f"positions: found an array of shape {found.shape}, allowed is ({allowed}): {named}")
        return found

    def _weights(self, weight: Array, shape: tuple[int, ...]) -> jax.Array:
        """Return weights as an array that broadcasts to a shape."""
        found = _numbers("weight", weight)
        last = zip(found.shape[::-1], shape[::-1], strict=False)
        if found.ndim > len(shape) or any(own not in (1, size) for own, size in last):
            raise InputError(f"weight: found an array of shape {found.shape}, allowed is one number, or {shape}")
        return found


def _numbers(name: str, values: Array) -> jax.Array:
    """Return an array of real numbers."""
    try:
        array = jnp.asarray(values)
    except (TypeError, ValueError):
        raise InputError(f"{name}: not an array of numbers") from None
    if array.dtype.kind == "c":
        raise InputError(f"{name}: found complex numbers, allowed are real ones")
    return array


def jax_cost(problem: Problem | list[Problem] | tuple[Problem, ...]) -> JaxCost:
    """Return the cost of a problem as a function in JAX: of waypoints (..., N, n) and the penalty's weight.

    Its value is `problem.evaluate(positions, weight).cost`, for any number of motions at once. Where the problem
    samples more densely (`problem.resampled`), so does it.

    Of a list of R problems it takes (..., R, N, n), a motion for each. They are of one robot, or of robots with the
    same joints, with equal numbers of waypoints; obstacles, sizes, clearances, held objects and samples may differ, in
    number too: missing ones are padded at no cost.

    Args:
        problem: made by `hdplan.build`, of a scene whose penalty has pairs of bodies alone; or a list of them.

    Raises:
        InputError: for a problem with other terms (path constraints, torques, limits of speed beside moving obstacles,
            your own terms, path speed), with ``planner.swept``, or with ``planner.distance: fcl``; for problems of
            unlike robots, numbers of waypoints or ``planner.gamma``, and for an empty list.
    """
    if isinstance(problem, list | tuple):
        several, names = list(problem), [f"problem[{row}]" for row in range(len(problem))]
    else:
        several, names = [problem], ["problem"]
    if not several:
        raise InputError("problem: found an empty list, allowed is a Problem, or a list of them")
    first, *others = (_structure(*each) for each in zip(several, names, strict=True))
    for name, other in zip(names[1:], others, strict=True):
        for what, own, found in zip(STRUCTURE, first, other, strict=True):
            if found != own:
                shown = f": {found}, not {own}" if isinstance(own, int) else ""
                raise InputError(f"{name}: has other {what} than problem[0]{shown}")
    tables = tables_of(several)
    return JaxCost(first, jax.tree.map(lambda table: table[0], tables) if isinstance(problem, Problem) else tables)


def _structure(problem: object, name: str) -> Structure:
    """Return the structure of a problem that is distances alone. Raises InputError."""
    instance(problem, Problem, name)
    assert isinstance(problem, Problem)
    where = f"{problem.scene.source or name}: "
    for cost in problem.terms.costs:
        raise InputError(f"{where}the term '{cost.name}' is not written in JAX: only distances of bodies are")
    for term in problem.terms:
        if not isinstance(term, PairTerm) or type(term) not in (Clearance, MovingClearance):
            raise InputError(f"{where}the term '{term.name}' is not written in JAX: only distances of bodies are")
        if not isinstance(term.distance, HdsdfPairs):
            raise InputError(f"{where}planner.distance: must be hdsdf for JAX, found {problem.scene.planner.distance}")
    if problem.path_speed is not None:
        raise InputError(f"{where}the path speed of a motion is not written in JAX: only distances of bodies are")
    return structure_of(problem)
