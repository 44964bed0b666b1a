"""A closed form summed over the samples or intervals of a motion: one Function, with first and second derivatives.

    F(x, y) = Σ_k w_k f(x_k, y_k)

Values and slopes of all k come from one evaluation, which a cost and its gradient share; second derivatives, blocks on
a diagonal, are another, made only on request.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Sequence

import casadi as ca

from hdplan.distance.symbolic.closed import CLOSED_OPTIONS, ClosedForm, closed_function
from hdplan.planner.problem.symbolic_place import SymbolicPlace
from hdplan.scenes.array_types import Array


def closed_sum(name: str, places: Sequence[SymbolicPlace], form: ClosedForm, weights: Array) -> ca.Function:
    """Return the Function (x …, y) -> F of joint values at each of the places and of the frames, with as many times
    their columns as there are weights. The form has derivatives by these, or by joint values alone where frames are
    not movable."""
    given, movable = [*(place.q for place in places), places[0].frames], places[0].movable
    every, sizes = ca.DM(weights).T, [symbol.numel() for symbol in given[: len(places) + movable]]
    weight, count = ca.MX.sym("weight"), every.numel()
    symbols = [*given, weight]
    columns = [ca.MX.sym(f"x{k}", each.shape[0], each.shape[1] * count) for k, each in enumerate(given)]
    x = columns[: len(sizes)]

    slopes = [*form.slopes, *(ca.MX(1, size) for size in sizes[len(form.slopes) :])]
    each = ca.Function(f"{name}_known", symbols, [ca.densify(weight * part.T) for part in (form.value, *slopes)])
    known = each.map(count).call([*columns, every])
    once = ca.Function(f"{name}_evaluated", columns, known, CLOSED_OPTIONS | {"is_diff_in": [False] * len(columns)})

    # Handed over by a Function that has no derivative itself: CasADi searches expressions of its results for
    # their arguments, column by column.
    handed = [ca.MX.sym(f"known{k}", part.sparsity()) for k, part in enumerate(known)]
    squares = [ca.sum1(ca.reshape(part, size, count) ** 2) for part, size in zip(x, sizes, strict=True) if size]
    nothing = ca.fmin(functools.reduce(operator.add, squares), 0)
    by_x = [
        ca.vec(part + ca.repmat(nothing, size, 1)).T if size else ca.MX(1, 0)
        for part, size in zip(handed[1:], sizes, strict=True)
    ]

    blocks = [[ca.vec(ca.densify(weight * block)) for block in row] for row in form.curvatures]
    bent = ca.Function(f"{name}_bent", symbols, functools.reduce(operator.add, blocks)).map(count)
    found = iter(bent.call([*columns, every]))
    curvatures = [[ca.MX(of * count, by * count) for by in sizes] for of in sizes]
    for i, row in enumerate(blocks):
        for j in range(len(row)):
            pattern = ca.diagcat(*[ca.Sparsity.dense(sizes[i], sizes[j])] * count)
            curvatures[i][j] = ca.MX(pattern, ca.vec(next(found)))

    total = ClosedForm(ca.sum2(handed[0] + nothing), by_x, curvatures)
    whole = closed_function(name, x, total, [*columns[len(x) :], *handed])
    return ca.Function(name, columns, [whole(*columns, *once.call(columns))], {"always_inline": True})
