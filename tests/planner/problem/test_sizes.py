"""Sizes of obstacles as parameters of the graph: to change them is to build the problem with others of other sizes."""

from __future__ import annotations

import dataclasses
import functools

import casadi as ca
import numpy as np
import pytest

import hdplan
from hdplan.distance.compiled.c_library import BY_COLUMNS, WAITING, quicker
from hdplan.distance.symbolic.row_function import RowFunction
from hdplan.planner.build import build
from hdplan.planner.collision.growth import sizes_of
from hdplan.planner.problem.problem import Problem
from hdplan.planner.problem.symbolic_penalty import SymbolicPenalty
from hdplan.scenes.errors import InputError
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Shape
from tests.planner.problem.whole_graph import agreed, graph_of, loops_at, motion

SHAPES: dict[str, Shape] = {
    "beam": hdplan.Box([0.3, 0.1, 0.2]),
    "ball": hdplan.Sphere(0.1),
    "post": hdplan.Cylinder(0.08, 0.4),
    "bar": hdplan.Capsule(0.05, 0.3),
}


def scene_of(moving: bool = False, **changes: object) -> Scene:
    """The planar arm among turned obstacles of every shape that can grow, and an ellipsoid."""
    scene, rng = hdplan.load_scene("planar_arm"), np.random.default_rng(5)
    obstacles = [
        hdplan.Obstacle(name, shape, hdplan.Pose.from_rpy([*rng.uniform(-0.8, 0.8, 2), 0.0], rng.uniform(-3, 3, 3)))
        for name, shape in {**SHAPES, "egg": hdplan.Ellipsoid([0.1, 0.2, 0.1])}.items()
    ]
    if moving:
        drift = hdplan.SteadyMotion((-0.2, 0.1, 0.0), (0.1, 0.0, 0.3))
        obstacles[0] = dataclasses.replace(obstacles[0], motion=drift)
        changes_of_scene: dict[str, object] = {"timing": hdplan.Timing(duration=2.0)}
    else:
        changes_of_scene = {}
    settings = dataclasses.replace(scene.planner, waypoints=4, **changes)
    return dataclasses.replace(scene, obstacles=tuple(obstacles), planner=settings, **changes_of_scene)


@functools.cache
def problem_of(moving: bool = False, **changes: object) -> Problem:
    return build(scene_of(moving, **changes))


def grown(shape: Shape, rng: np.random.Generator) -> Shape:
    """The same shape of other sizes, from a third to three times of what they were."""
    fields = {
        name: np.asarray(getattr(shape, name)) * 3.0 ** rng.uniform(-1, 1, np.shape(getattr(shape, name)))
        for name in {"Box": ("size",), "Sphere": ("radius",)}.get(type(shape).__name__, ("radius", "length"))
    }
    return dataclasses.replace(shape, **{name: value.tolist() for name, value in fields.items()})


def with_shapes(scene: Scene, shapes: dict[str, Shape]) -> Scene:
    obstacles = (dataclasses.replace(each, shape=shapes.get(each.name, each.shape)) for each in scene.obstacles)
    return dataclasses.replace(scene, obstacles=tuple(obstacles))


@pytest.mark.parametrize(
    "changes",
    [{}, {"moving": True}, {"normals": "faces"}, pytest.param({"swept": True}, marks=pytest.mark.slow)],
    ids=str,
)
def test_other_sizes_equal_those_of_a_new_problem(changes: dict[str, bool]) -> None:
    """Value, gradient and Hessian, exact and Gauss-Newton's; with and without the derivatives by sizes."""
    problem, rng, seen = problem_of(**changes), np.random.default_rng(6), 0.0
    for exact, movable in ((True, True), (True, False), (False, True)):
        graph = graph_of(problem, exact, movable)
        for _ in range(2):
            shapes = {name: grown(shape, rng) for name, shape in SHAPES.items()}
            rebuilt, positions = build(with_shapes(problem.scene, shapes)), motion(problem, rng, 0.8)
            expected = loops_at(rebuilt, positions, exact)
            agreed(graph(positions.ravel(), SymbolicPenalty(problem, exact).values({}, shapes)), expected)
            seen = max(seen, expected[0])
    assert seen > 0.0


def test_a_far_speck_that_grows_to_be_in_the_way() -> None:
    """The loops leave its pairs out, as none can meet; the graph has them."""
    speck = hdplan.Obstacle("speck", hdplan.Sphere(0.01), hdplan.Pose([4.0, 0.0, 0.0]))
    scene = dataclasses.replace(scene_of(), obstacles=(speck,))
    problem, shapes = build(scene), {"speck": hdplan.Sphere(3.5)}
    assert problem.terms.obstacles is None
    positions = motion(problem, np.random.default_rng(0))
    expected = loops_at(build(with_shapes(scene, shapes)), positions)
    assert expected[0] > 0.0
    graph, penalty = graph_of(problem), SymbolicPenalty(problem, exact=True)
    agreed(graph(positions.ravel(), penalty.values({}, shapes)), expected)
    assert float(graph(positions.ravel(), penalty.values({}))[0]) == 0.0


def test_generated_c_takes_other_sizes() -> None:
    program, rng = problem_of().casadi(form="symbolic"), np.random.default_rng(7)
    cost = program.standing["f"]
    given = [program.x, program.p]
    compiled = RowFunction(ca.Function("sizes_in_c", given, [cost, ca.gradient(cost, program.x)]))
    for _ in range(3):
        shapes = {name: grown(shape, rng) for name, shape in SHAPES.items()}
        rebuilt, positions = build(with_shapes(program.problem.scene, shapes)), motion(program.problem, rng, 0.8)
        positions[[0, -1]] = program.problem.start, program.problem.goal
        x, p = program.guess(positions), program.values(1e4, sizes=shapes)
        value, _ = compiled.once(x, p)
        assert float(value[0]) == pytest.approx(rebuilt.evaluate(positions, 1e4).cost, rel=1e-9)


@pytest.mark.parametrize("changes", [{}, {"moving": True}, {"swept": True}], ids=str)
def test_derivatives_by_sizes_and_poses(changes: dict[str, bool]) -> None:
    """The penalty and its gradient by waypoints, and its second derivatives by parameters, by differences."""
    problem, rng = problem_of(**changes), np.random.default_rng(9)
    penalty = SymbolicPenalty(problem, exact=True)
    x, p = ca.MX.sym("x", problem.start.size * problem.waypoints), ca.MX.sym("p", penalty.size)
    waypoints = ca.reshape(x, -1, problem.waypoints)
    value = penalty(waypoints[:, :-1], waypoints[:, 1:] - waypoints[:, :-1], p)
    by_x, by_p = ca.gradient(value, x), ca.gradient(value, p)
    first = ca.Function("first", [x, p], [value, by_x, by_p])
    second = ca.Function("second", [x, p], [ca.jacobian(by_x, p), ca.jacobian(by_p, p)])
    q, at, step, checked = motion(problem, rng, 0.8).ravel(), penalty.values({}), 1e-6, 0
    found, bent = first(q, at), second(q, at)
    for name in SHAPES:
        for k in range(*penalty.place_of(name, "size")):
            there, back = (first(q, at + sign * step * np.eye(len(at))[k]) for sign in (1, -1))
            slope = [np.array(a - b).ravel() / (2 * step) for a, b in zip(there, back, strict=True)]
            scale = max(1e-6, *(np.abs(each).max() for each in slope))
            np.testing.assert_allclose(float(found[2][k]), slope[0][0], rtol=0, atol=1e-6 * scale)
            np.testing.assert_allclose(np.array(bent[0][:, k]).ravel(), slope[1], rtol=0, atol=1e-5 * scale)
            np.testing.assert_allclose(np.array(bent[1][:, k]).ravel(), slope[2], rtol=0, atol=1e-5 * scale)
            checked += abs(slope[0][0]) > 1e-6
    assert checked >= 2


def test_parameters_of_sizes_are_found_by_name() -> None:
    program = problem_of(moving=True).casadi(form="symbolic")
    shapes: dict[str, Shape] = {"post": hdplan.Cylinder(0.2, 0.7), "beam": hdplan.Box([1, 2, 3])}
    p = program.values(2.0, sizes=shapes)
    for name, shape in (SHAPES | shapes).items():
        part = ca.Function("part", [program.p], [program.size_of(name)])(p)
        np.testing.assert_array_equal(np.array(part).ravel(), sizes_of(shape))
        assert program.pose_of(name).numel() == 12 * (len(program.problem.samples.weight) if name == "beam" else 1)


def test_invalid_sizes_are_refused() -> None:
    program = problem_of().casadi(form="symbolic")
    ball = hdplan.Sphere(0.2)
    for sizes, message in (
        ({"bell": ball}, r"sizes: no obstacle is named 'bell'"),
        ({"beam": ball}, r"sizes: beam: a Box of other sizes is expected, found Sphere"),
        ({"beam": 0.3}, r"sizes: beam: a Box of other sizes is expected, found 0.3"),
        ({"egg": hdplan.Ellipsoid([1, 1, 1])}, r"sizes: egg: the sizes of this shape \(ellipsoid\) are not"),
    ):
        with pytest.raises(InputError, match=message):
            program.values(1.0, sizes=sizes)
    with pytest.raises(InputError, match="size: egg: the sizes of this shape"):
        program.size_of("egg")
    with pytest.raises(InputError, match="pose: no obstacle is named 'bell'"):
        program.pose_of("bell")
    external = problem_of().casadi()
    with pytest.raises(InputError, match="sizes: are parameters of form symbolic alone"):
        external.values(1.0, sizes={"ball": ball})
    with pytest.raises(InputError, match="size: is a parameter of form symbolic alone"):
        external.size_of("ball")
    cost, x = ca.Function("cost", [program.x, program.p], [program.f]), program.guess(program.problem.polyline())
    at = ca.Function("at", [program.p], [ca.jacobian(program.size_of("ball"), program.p)])(0).sparsity().get_col()[0]
    for wrong in (-0.1, np.nan):  # not checked by `values`: never a penalty of 0
        p = program.values(1.0)
        assert np.isfinite(float(cost(x, p)))
        p[at] = wrong
        assert np.isnan(float(cost(x, p)))


def test_products_are_vectors_in_generated_c_with_the_same_bits() -> None:
    """CasADi's product of matrices is found in its code and replaced; the sums keep their order."""
    a, b = ca.MX.sym("a", 5, 7), ca.MX.sym("b", 7, 3)
    function, rng = ca.Function("product_of_matrices", [a, b], [a @ b]), np.random.default_rng(0)
    generator = ca.CodeGenerator("product.c")
    generator.add(function)
    assert WAITING in generator.dump()
    assert quicker(generator.dump()).count(BY_COLUMNS) == 1
    one, other = rng.normal(size=(5, 7)), rng.normal(size=(7, 3))
    (found,) = RowFunction(function).once(one.ravel(order="F"), other.ravel(order="F"))
    np.testing.assert_array_equal(found.reshape(5, 3, order="F"), np.array(function(one, other)))


def test_helpers_are_inlined_in_generated_c_with_the_same_bits() -> None:
    """All of CasADi's helpers of one or two numbers are found, wherever else it has functions of numbers."""
    x, y = ca.MX.sym("x", 9), ca.MX.sym("y", 9)
    found = ca.vertcat(ca.fmin(x, y), ca.fmax(x, y), ca.fabs(x), x * x, ca.sign(y), ca.mmax(x))
    function, rng = ca.Function("helpers", [x, y], [found]), np.random.default_rng(0)
    generator = ca.CodeGenerator("helpers.c")
    generator.add(function)
    assert quicker(generator.dump()).count("always_inline") == 5
    one, other = rng.normal(size=9), rng.normal(size=9)
    one[:3], other[1:4] = (0.0, -0.0, np.inf), (-0.0, 0.0, -np.inf)
    np.testing.assert_array_equal(RowFunction(function).once(one, other)[0], np.array(function(one, other)).ravel())
