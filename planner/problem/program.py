"""The problem as a CasADi program, for interior-point solvers and for the user's own costs and constraints.

It is written stage by stage, as optimal control is: stage k = 0 … N − 2 has the waypoint q_k and the step d_k = q_{k+1}
− q_k as states and the change of step a_k as control, with h = 1/(N − 1) and α as in `Smoothness`:

    minimize    Σ_k |d_k|²/(2 h) + α Σ_k |a_k|²/(2 h³) + p penalty(q)
    subject to  q_{k+1} = q_k + d_k,  d_{k+1} = d_k + a_k,  q_0 = start,  q_{N−2} + d_{N−2} = goal,  joint limits

The penalty comes in two forms. In symbols (`symbolic_penalty`) it is part of the graph: what lies between q_k and
q_{k+1} is a function of q_k and d_k, and poses and sizes of obstacles are parameters. The external form calls
`Problem.penalty`, which is the same in loops, through a function with declared derivatives; as the stages may not be
coupled by a Hessian, the block between q_k and q_{k+1} is written at stage k with δq_{k+1} = δq_k + δd_k, so that the
step of a solver is the same. Gradients are exact, and so are Hessians, unless the Gauss-Newton curvature is to stand in
their place: positive semidefinite, so that near a minimum solvers converge linearly.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.problem.own_term import hard_constraints
from hdplan.planner.problem.penalty_function import PenaltyFunction, places
from hdplan.planner.problem.symbolic_penalty import SymbolicPenalty, linear
from hdplan.planner.problem.warm_start import waypoints_of
from hdplan.scenes.array_types import Array
from hdplan.scenes.arrays import as_numbers
from hdplan.scenes.errors import InputError
from hdplan.scenes.shapes import Shape

if TYPE_CHECKING:
    from hdplan.planner.problem.problem import Problem

FORMS = ("external", "symbolic")  # of the penalty
HESSIANS = ("exact", "gauss_newton")  # of it


@dataclass(frozen=True, eq=False, repr=False)
class Program:
    """A nonlinear program min f(x, p) subject to lbx ≤ x ≤ ubx, lbg ≤ g(x, p) ≤ ubg, as `casadi.nlpsol` takes it.

    With an external penalty, keep it as long as anything made from it: CasADi does not keep that function alive, and a
    solver whose program is gone raises RuntimeError ("Callback object has been deleted").
    """

    problem: Problem
    x: ca.MX  # the stages one after another: q_k (n), d_k (n), a_k (n), and no a at the last one
    p: ca.MX  # weight of the penalty [1/m²]; in symbols then poses and sizes of obstacles, as `values` gives them
    f: ca.MX
    added: ca.MX  # to f by `with_cost`
    rows: tuple[ca.MX, ...]  # the constraints of each stage (N − 1): those of its dynamics, then the user's own
    lower: tuple[Array, ...]  # bounds of `rows`
    upper: tuple[Array, ...]
    lbx: Array
    ubx: Array
    penalty: PenaltyFunction | SymbolicPenalty

    def __repr__(self) -> str:
        """Name the scene and the size."""
        rows = sum(part.numel() for part in self.rows)
        return f"<Program of {self.problem.scene.name}: {self.x.numel()} variables, {rows} constraints>"

    @property
    def nlp(self) -> dict[str, ca.MX]:
        """Objective and constraints, for `casadi.nlpsol`."""
        return {"x": self.x, "p": self.p, "f": self.f, "g": ca.vertcat(*self.rows)}

    @property
    def standing(self) -> dict[str, ca.MX]:
        """`nlp` without derivatives by poses and sizes of obstacles, which stay as they are while a solver runs: the
        same numbers, and Hessians several times as fast. An external penalty has none anyway."""
        if not isinstance(self.penalty, SymbolicPenalty):
            return self.nlp
        return self.nlp | {"f": _cost(self.problem, self.penalty.standing, self.x, self.p) + self.added}

    @property
    def bounds(self) -> dict[str, Array]:
        """The bounds, for a call of the solver."""
        lower, upper = np.concatenate(self.lower), np.concatenate(self.upper)
        return {"lbx": self.lbx, "ubx": self.ubx, "lbg": lower, "ubg": upper}

    @property
    def stages(self) -> dict[str, Any]:
        """Options of `casadi.nlpsol` by which fatrop finds the stages."""
        equal = np.concatenate(self.lower) == np.concatenate(self.upper)
        return {"structure_detection": "auto", "equality": equal.tolist()}

    def values(
        self,
        weight: float,
        poses: Mapping[str, ArrayLike] | None = None,
        sizes: Mapping[str, Shape] | None = None,
    ) -> Array:
        """The p of a weight of the penalty [1/m²], and of other poses (4, 4) of obstacles by name than the scene's; of
        a moving one (B, 4, 4), one for each sample of the problem; and of boxes, spheres, cylinders and capsules of
        other sizes in place of the scene's. Raises InputError for a weight below 0, for what is no obstacle, no pose or
        no such shape, and for any of them where the penalty is external."""
        number = as_numbers(weight)
        if number is None or number.ndim or not 0 <= number < np.inf:
            raise InputError(f"weight: found {weight!r}, allowed is a number that is not negative [1/m²]")
        if isinstance(self.penalty, SymbolicPenalty):
            return np.append(weight, self.penalty.values(poses or {}, sizes or {}))
        for name, given in (("poses", poses), ("sizes", sizes)):
            if given:
                raise InputError(f"{name}: are parameters of form symbolic alone; this program's form is external")
        return np.array([weight])

    def pose_of(self, obstacle: str) -> ca.MX:
        """The pose of an obstacle, a part of p: twelve numbers, the rotation row by row, then the origin [m]; of a
        moving one for each sample. Raises InputError where the pose is not a parameter."""
        return self._part_of_p(obstacle, "pose")

    def size_of(self, obstacle: str) -> ca.MX:
        """The sizes of an obstacle [m], a part of p, in the order of its shape's fields. Raises InputError where they
        are not parameters."""
        return self._part_of_p(obstacle, "size")

    def _part_of_p(self, obstacle: str, what: str) -> ca.MX:
        if not isinstance(self.penalty, SymbolicPenalty):
            raise InputError(f"{what}: is a parameter of form symbolic alone; this program's form is external")
        first, last = self.penalty.place_of(obstacle, what)
        return self.p[1 + first : 1 + last]

    def between(self, start: ArrayLike, goal: ArrayLike) -> Program:
        """A copy of the program from another start to another goal (n,): the same x, p, f and g with other `bounds`, so
        that what was made from it serves both. Raises InputError for other shapes, for values beyond the joint limits,
        and where the penalty is external."""
        if not isinstance(self.penalty, SymbolicPenalty):
            raise InputError("start: is a part of form external; the form that takes another is symbolic")
        problem, (low, high) = self.problem, self.problem.robot.inner
        ends = []
        for name, given in (("start", start), ("goal", goal)):
            end = as_numbers(given)
            if end is None or end.shape != problem.start.shape:
                raise InputError(f"{name}: {len(problem.start)} numbers are expected, found {given!r}")
            if beyond := [
                joint
                for joint, x, *of in zip(problem.robot.joint_names, end, low, high, strict=True)
                if not of[0] <= x <= of[1]
            ]:
                raise InputError(f"{name}: joint '{beyond[0]}' is beyond its limits")
            ends.append(end.copy())
        moved = replace(problem, start=ends[0], goal=ends[1])
        lower, upper = ((*rows[:-1], np.append(ends[1], rows[-1][len(ends[1]) :])) for rows in (self.lower, self.upper))
        bounds = [np.append(ends[0], bound[len(ends[0]) :]) for bound in (self.lbx, self.ubx)]
        return replace(self, problem=moved, lower=lower, upper=upper, lbx=bounds[0], ubx=bounds[1])

    @property
    def weight(self) -> ca.MX:
        """The weight of the penalty, a part of p."""
        return self.p[0]

    @property
    def waypoints(self) -> ca.MX:
        """The waypoints (n, N), both ends included, as expressions of x."""
        q, step, _ = _columns(self.problem, self.x)
        return ca.horzcat(q, q[:, -1] + step[:, -1])

    def with_cost(self, cost: ca.MX) -> Program:
        """A copy of the program with `cost`, an expression of x and p, added to f. Raises InputError for anything else.

        Of its Hessian fatrop sees only what lies within a stage.
        """
        if not isinstance(cost, ca.MX) or not cost.is_scalar():
            raise InputError(f"cost: a scalar casadi.MX is expected, found {_words(cost)}")
        self._refuse_strangers("cost", cost)
        return replace(self, f=self.f + cost, added=self.added + cost)

    def with_constraint(
        self, each: Callable[[ca.MX, ca.MX], ca.MX], lower: ArrayLike = -np.inf, upper: ArrayLike = np.inf
    ) -> Program:
        """A copy of the program with lower ≤ each(q_k, d_k) ≤ upper at the waypoints k = 1 … N − 2 that are to be
        found: of the waypoint (n,) and the step to the next (n,) a column (m,). Nothing is required between waypoints.
        Raises InputError for another expression, and for bounds that do not fit it."""
        rows, low, high = list(self.rows), list(self.lower), list(self.upper)
        waypoints, steps, _ = (ca.horzsplit(part) for part in _columns(self.problem, self.x))
        for k in range(1, len(rows)):
            value = each(waypoints[k], steps[k])
            if not isinstance(value, ca.MX) or not value.is_column():
                raise InputError(f"constraint: a column casadi.MX is expected, found {_words(value)}")
            self._refuse_strangers("constraint", value)
            bounds = [_bound(name, given, value.numel()) for name, given in (("lower", lower), ("upper", upper))]
            if not np.all(bounds[0] <= bounds[1]):
                raise InputError(f"constraint: lower {bounds[0].tolist()} is above upper {bounds[1].tolist()}")
            rows[k] = ca.vertcat(rows[k], value)
            low[k], high[k] = np.append(low[k], bounds[0]), np.append(high[k], bounds[1])
        return replace(self, rows=tuple(rows), lower=tuple(low), upper=tuple(high))

    def solver(
        self, plugin: str = "ipopt", options: Mapping[str, Any] | None = None, *, compiled: bool = False
    ) -> ca.Function:
        """A solver of this program: `casadi.nlpsol` with the plugin's name and options; fatrop receives the stages.

        compiled: whether its functions are written to C and compiled, once, and kept where compiled code is kept: some
        seconds the first time, and about thirty times as fast as CasADi's interpreter. Without a C compiler they are
        interpreted. While they run, obstacles stand: there are no multipliers of p. Raises InputError for these, and
        for a function of Python in the program, as in form external.
        """
        given = {**(self.stages if plugin == "fatrop" else {}), **(options or {})}
        try:
            found = self._compiled(plugin, given) if compiled else None
            return ca.nlpsol("solver", plugin, self.nlp, given) if found is None else found
        except RuntimeError as error:  # CasADi's: the place in its source, then what is wrong
            raise InputError(f"solver '{plugin}': {str(error).strip().splitlines()[0].split(': ', 1)[-1]}") from None

    def _compiled(self, plugin: str, given: Mapping[str, Any]) -> ca.Function | None:
        from hdplan.planner.problem.compiled_solver import compiled_solver

        if given.get("calc_lam_p"):
            raise InputError("options: calc_lam_p: while a compiled solver runs, obstacles stand; allowed is False")
        complete = plugin == "ipopt" and not any(given.get(name) for name in ("calc_f", "calc_g", "calc_lam_x"))
        options = {"calc_lam_p": False, "no_nlp_grad": complete, **given}  # of results that Ipopt has itself
        return compiled_solver(plugin, self.standing, options)

    def guess(self, positions: Trajectory | ArrayLike) -> Array:
        """The x of waypoints (N, n), whose ends are taken to be start and goal, or of a motion of the robot: the first
        iterate of a solver."""
        if isinstance(positions, Trajectory):
            positions = waypoints_of(self.problem, positions)
        given = as_numbers(positions)
        shape = self.problem.waypoints, len(self.problem.start)
        if given is None:
            raise InputError(f"guess: numbers of shape {shape} are expected")
        if given.shape != shape:
            raise InputError(f"guess: shape {given.shape}, expected {shape}: waypoints by joints")
        q = given.copy()
        q[0], q[-1] = self.problem.start, self.problem.goal
        step = np.diff(q, axis=0)
        stages = np.hstack([q[:-2], step[:-1], np.diff(step, axis=0)])
        return np.concatenate([stages.ravel(), q[-2], step[-1]])

    def positions(self, x: ArrayLike) -> Array:
        """The waypoints (N, n) of an x, within the joint limits. Raises InputError for another number of values."""
        problem, values = self.problem, np.asarray(x, dtype=np.float64).ravel()
        if len(values) != self.x.numel():
            raise InputError(f"x: {self.x.numel()} numbers are expected, found {len(values)}")
        inside = values[places(len(problem.start), problem.waypoints)]
        return problem.clip(np.vstack([problem.start, inside, problem.goal]))

    def _refuse_strangers(self, name: str, expression: ca.MX) -> None:
        known = {self.x.__hash__(), self.p.__hash__()}
        if strange := [symbol.name() for symbol in ca.symvar(expression) if symbol.__hash__() not in known]:
            raise InputError(f"{name}: depends on '{strange[0]}'; allowed are the program's x and p")


def program(problem: Problem, hessian: str, form: str) -> Program:
    """Write a problem as a CasADi program; `hessian` is one of HESSIANS, `form` one of FORMS."""
    for name, allowed, found in (("hessian", HESSIANS, hessian), ("form", FORMS, form)):
        if found not in allowed:
            raise InputError(f"{name}: must be one of {', '.join(allowed)}, found {found!r}")
    exact = hessian == "exact"
    if exact and form == "external":
        problem.second_order(
            problem.polyline()
        )  # an error in it is raised here; a solver would see a failed evaluation
    n = len(problem.start)
    x = ca.MX.sym("x", n * (3 * problem.waypoints - 4))
    penalty = SymbolicPenalty(problem, exact) if form == "symbolic" else PenaltyFunction(problem, exact)
    p = ca.MX.sym("p", 1 + penalty.size)
    dynamics = _dynamics(problem, x)
    starts = range(0, 2 * n * (problem.waypoints - 1), 2 * n)
    rows = tuple(ca.vertsplit(dynamics, [*starts, dynamics.numel()]))
    equal = (*[np.zeros(2 * n)] * (problem.waypoints - 2), problem.goal)
    lbx, ubx = np.full(x.numel(), -np.inf), np.full(x.numel(), np.inf)
    for bound, limit in ((lbx, problem.robot.inner[0]), (ubx, problem.robot.inner[1])):
        bound[places(n, problem.waypoints)] = limit
        bound[:n] = problem.start
    result = Program(problem, x, p, _cost(problem, penalty, x, p), ca.MX(0), rows, equal, equal, lbx, ubx, penalty)
    for term in hard_constraints(problem.terms.own):
        result = result.with_constraint(term.definition.each, *term.bounds)
    return result


def _cost(problem: Problem, penalty: PenaltyFunction | SymbolicPenalty, x: ca.MX, p: ca.MX) -> ca.MX:
    """The objective."""
    settings, h = problem.smoothness, 1 / (problem.waypoints - 1)
    weight, places = ca.vertsplit(p, [0, 1, p.numel()])
    q, step, change = _columns(problem, x)
    smooth = settings.velocity * ca.sumsqr(step) / (2 * h) + settings.acceleration * ca.sumsqr(change) / (2 * h**3)
    bent, _ = ca.Function("smooth", [x], list(ca.hessian(smooth, x)))(0)
    penalized = penalty(q, step, places, x) if isinstance(penalty, SymbolicPenalty) else penalty.function(x)
    cost = ca.bilin(bent, x, x) / 2 + weight * penalized
    if problem.path_speed:
        cost += problem.path_speed.expression(step)
    return sum((term.written(q, step) for term in problem.terms.costs), cost)


def _dynamics(problem: Problem, x: ca.MX) -> ca.MX:
    """Residuals of each stage, and at the last the waypoint after it; linear in x, and written as a product."""
    q, step, change = _columns(problem, x)
    defects = ca.vertcat(q[:, 1:] - q[:, :-1] - step[:, :-1], step[:, 1:] - step[:, :-1] - change)  # (2 n, N − 2)
    return linear(ca.vertcat(ca.vec(defects), q[:, -1] + step[:, -1]), x)


def _columns(problem: Problem, x: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX]:
    """The waypoints and steps of every stage (n, N − 1), and the changes of step (n, N − 2)."""
    n, stages = len(problem.start), problem.waypoints - 1
    first = 3 * n * np.arange(stages)[:, None] + np.arange(n)
    found = [x[(first + shift).ravel().tolist()] for shift in (0, n)]
    change = x[(first[:-1] + 2 * n).ravel().tolist()]
    return ca.reshape(found[0], n, stages), ca.reshape(found[1], n, stages), ca.reshape(change, n, stages - 1)


def _bound(name: str, given: ArrayLike, size: int) -> Array:
    try:
        bound = np.broadcast_to(np.asarray(given, dtype=np.float64), size)
    except (TypeError, ValueError):
        raise InputError(f"constraint: {name}: a number or {size} of them are expected, found {given!r}") from None
    if np.isnan(bound).any():
        raise InputError(f"constraint: {name}: NaN")
    return bound


def _words(found: object) -> str:
    return f"casadi.MX of shape {found.shape}" if isinstance(found, ca.MX) else repr(found)
