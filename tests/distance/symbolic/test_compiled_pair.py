"""The CasADi Function equals the reference; its derivatives are exact and finite, by any route through a graph."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.compiled import c_library
from hdplan.distance.numpy_reference.hdsdf import hdsdf, hdsdf_derivatives, separation
from hdplan.distance.symbolic import compiled_pair
from hdplan.distance.symbolic.compiled_pair import hdsdf_compiled, twist_function
from hdplan.distance.symbolic.graph_distance import hdsdf_function
from hdplan.distance.symbolic.row_function import RowFunction
from hdplan.scenes.errors import InputError
from tests.distance.witnesses import evaluator

SMALL = [  # pairs whose Hessians build in a moment
    (ConvexBody.box([1.0, 0.6, 0.4]), ConvexBody.box([0.5, 0.5, 0.5])),
    (ConvexBody.box([1.0, 0.6, 0.4]), ConvexBody.capsule(0.15, 0.8)),
    (ConvexBody.platonic("tetrahedron", 0.7).inflated(0.05), ConvexBody.capsule(0.15, 0.8)),
    (ConvexBody.sphere(0.3), ConvexBody.sphere(0.2)),
]


def _step(pose, axis, size):
    """Return pose after an exact rigid motion of ``size`` along its own axis 0-2 (translation) or 3-5 (rotation)."""
    move = np.eye(4)
    if axis < 3:
        move[axis, 3] = size
    else:
        i, j = [(1, 2), (2, 0), (0, 1)][axis - 3]
        move[i, i] = move[j, j] = np.cos(size)
        move[i, j], move[j, i] = -np.sin(size), np.sin(size)
    return pose @ move


def _differences(bodies, a, b, h, **settings):
    """Return central differences of the reference by the twelve twists."""
    moved = [(_step(a, k, s), b) for k in range(6) for s in (h, -h)]
    moved += [(a, _step(b, k, s)) for k in range(6) for s in (h, -h)]
    values = hdsdf(bodies[0], np.array([m[0] for m in moved]), bodies[1], np.array([m[1] for m in moved]), **settings)
    return (values[::2] - values[1::2]) / (2 * h)


@pytest.mark.sampled(13)
def test_values_equal_the_reference(pair, random_poses, tolerance):
    function = hdsdf_function(*pair)
    for spread in (0.15, 0.5, 2.0):  # deep, near, apart
        a, b = random_poses(31, 10, spread), random_poses(32, 10, spread)
        truth = hdsdf(pair[0], a, pair[1], b)
        found = [float(function(x, y)) for x, y in zip(a, b, strict=True)]
        np.testing.assert_allclose(found, truth, rtol=tolerance["witness"], atol=1e-15)


@pytest.mark.parametrize(
    "settings", [{"gamma": 1}, {"gamma": 3, "epsilon": 1e-4}, {"gamma": 8, "shaping_length": 0.01}], ids=str
)
def test_values_equal_the_reference_for_all_settings(settings, random_poses, tolerance):
    for body_a, body_b in SMALL:
        function = hdsdf_function(body_a, body_b, **settings)
        a, b = random_poses(33, 20, 0.7), random_poses(34, 20, 0.7)
        found = [float(function(x, y)) for x, y in zip(a, b, strict=True)]
        np.testing.assert_allclose(
            found, hdsdf(body_a, a, body_b, b, **settings), rtol=tolerance["witness"], atol=1e-15
        )


@pytest.mark.sampled(4)
@pytest.mark.parametrize("gamma", [1, 2, 4])
@pytest.mark.parametrize("bodies", SMALL, ids=lambda b: f"{len(b[0].vertices)}x{len(b[1].vertices)}")
def test_derivatives_are_those_of_the_reference(bodies, gamma, random_poses, tolerance):
    """Gradient against central differences of the reference, Hessian against central differences of the gradient."""
    settings = {"gamma": gamma, "shaping_length": 0.1}
    evaluate = evaluator("graph", *bodies, **settings)
    h = 1e-5 * settings["shaping_length"]
    for spread in (0.2, 0.7):
        for a, b in zip(random_poses(35, 6, spread), random_poses(36, 6, spread), strict=True):
            _, _, gradient, hessian = evaluate(a, b)
            np.testing.assert_allclose(
                gradient,
                _differences(bodies, a, b, h, **settings),
                rtol=tolerance["difference"],
                atol=tolerance["difference"],
            )
            assert np.all(np.isfinite(hessian))
            if gamma > 1:  # translations of A commute: their block is the derivative of their gradient
                columns = [
                    (evaluate(_step(a, k, h), b).gradient - evaluate(_step(a, k, -h), b).gradient)[:3] / (2 * h)
                    for k in range(3)
                ]
                scale = max(1.0, np.abs(hessian).max())
                np.testing.assert_allclose(hessian[:3, :3].T, columns, atol=50 * tolerance["difference"] * scale)


@pytest.mark.sampled(25)
@pytest.mark.parametrize("gamma", [1, 2, 4])
def test_finite_and_right_at_hard_poses(hard, gamma, tolerance):
    """Touching, parallel, identical, deep, tiny gaps, extreme scales: value as the reference, derivatives finite."""
    evaluate = evaluator("graph", hard.body_a, hard.body_b, gamma=gamma)
    value, _, gradient, hessian = evaluate(hard.pose_a, hard.pose_b)
    truth = hdsdf(hard.body_a, hard.pose_a, hard.body_b, hard.pose_b, gamma=gamma)
    np.testing.assert_allclose(value, truth, rtol=tolerance["witness"], atol=1e-15 * np.abs(hard.pose_a).max())
    assert np.all(np.isfinite(gradient))
    assert np.all(np.isfinite(hessian))


def test_derivatives_are_the_hand_written_ones_in_sx_and_mx(random_poses, tolerance):
    function = hdsdf_function(*SMALL[1])
    a, b = random_poses(37, 2, 0.5)
    found = []
    for kind in (ca.SX, ca.MX):
        pose = kind.sym("pose", 4, 4)
        value = function(pose @ a, b)
        assert "hdsdf" in str(value), "a call, which CasADi cannot look into"
        jacobian = ca.jacobian(value, pose)
        assert "jac_hdsdf" in str(jacobian) or kind is ca.SX  # SX takes the Jacobian's own instructions
        graph = ca.Function("graph", [pose], [jacobian, ca.densify(ca.jacobian(jacobian, pose))])
        found.append([np.array(part) for part in graph(np.eye(4))])
    for in_sx, in_mx in zip(*found, strict=True):
        np.testing.assert_allclose(in_sx, in_mx, rtol=tolerance["exact"], atol=tolerance["exact"])


def test_an_mx_graph_has_hessians(random_poses):
    function = hdsdf_function(*SMALL[1])
    a, b = random_poses(38, 2, 0.5)
    shift = ca.MX.sym("shift", 3)
    pose = ca.MX(ca.DM(a)) + ca.vertcat(ca.horzcat(ca.MX(3, 3), shift), ca.MX(1, 4))
    hessian = np.array(ca.Function("graph", [shift], [ca.hessian(function(pose, b), shift)[0]])(np.zeros(3)))
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-12)
    assert np.abs(hessian).max() > 0


def test_bad_arguments_are_refused():
    cube = ConvexBody.box([1, 1, 1])
    with pytest.raises(InputError, match="did you mean 'paper'"):
        hdsdf_function(cube, cube, normals="papers")
    with pytest.raises(InputError, match="gamma"):
        hdsdf_function(cube, cube, gamma=0)


def test_compiled_distance_is_the_reference_with_its_derivatives(random_poses, tolerance):
    """Once, with every kind of axis; the interpreter, which runs the same instructions, is tried everywhere."""
    settings = {"gamma": 2, "shaping_length": 0.1, "normals": "paper+centre+edges+sphere-6"}
    body_a, body_b = SMALL[2]
    compiled = hdsdf_compiled(body_a, body_b, witness_count=2, **settings)
    a, b, axes = random_poses(41, 8, 0.6), random_poses(42, 8, 0.6), random_poses(43, 8, 1.0)[:, :2, :3]
    truth = hdsdf_derivatives(body_a, a, body_b, b, witnesses=axes, **settings)
    gap = separation(body_a, a, body_b, b, normals=settings["normals"], witnesses=axes)
    found = compiled.hessian(a, b, axes)
    close = {"rtol": tolerance["witness"], "atol": tolerance["witness"]}
    for part, expected in zip(found, (truth.value, gap, truth.gradient, truth.hessian), strict=True):
        np.testing.assert_allclose(part, expected, **close)
    np.testing.assert_allclose(compiled.value(a, b, axes)[0], found[0], **close)
    np.testing.assert_allclose(compiled.gradient(a, b, axes)[2], found[2], **close)


def test_one_pose_at_a_time_is_the_table_of_poses(random_poses):
    compiled = hdsdf_compiled(*SMALL[1])
    a, b = random_poses(44, 3, 0.7), random_poses(45, 4, 0.7)
    table = compiled.hessian(a[:, None], b[None])
    assert [part.shape for part in table] == [(3, 4), (3, 4), (3, 4, 12), (3, 4, 12, 12)]
    for i, j in np.ndindex(3, 4):
        for one, many in zip(compiled.hessian(a[i], b[j]), table, strict=True):
            np.testing.assert_array_equal(one, many[i, j])
    assert compiled.value(a[:0], b[0])[0].shape == (0,)


def test_the_interpreter_says_the_same(random_poses, monkeypatch, tolerance):
    a, b = random_poses(46, 5, 0.7), random_poses(47, 5, 0.7)
    compiled = [part.copy() for part in hdsdf_compiled(*SMALL[0], normals="paper+edges").hessian(a, b)]
    monkeypatch.setattr(compiled_pair, "_row_function", lambda *key: _interpreted(*key))
    for c, i in zip(compiled, hdsdf_compiled(*SMALL[0], normals="paper+edges").hessian(a, b), strict=True):
        np.testing.assert_allclose(i, c, rtol=tolerance["exact"], atol=tolerance["exact"])


def _interpreted(*key):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(c_library, "_loaded", lambda *_: None)
        function = RowFunction(twist_function(*key))
    assert not function.is_compiled
    return function


@pytest.mark.parametrize("order", [0, 1, 2])
def test_large_pairs_are_loops(order):
    """The instructions of a pair grow with its vertices, not with vertices times normals."""
    small, large = (
        twist_function(ConvexBody.platonic(name), ConvexBody.platonic(name), 2, "paper+edges", 0, order)
        for name in ("cube", "dodecahedron")
    )
    assert large.n_instructions() < 3 * small.n_instructions()


def test_another_shaping_length_compiles_nothing(random_poses):
    a, b = random_poses(48, 1, 0.7)[0], random_poses(49, 1, 0.7)[0]
    first, second = (hdsdf_compiled(*SMALL[0], shaping_length=length) for length in (1e-3, 0.2))
    assert first.function(0) is second.function(0)
    assert first.value(a, b)[0] != second.value(a, b)[0]


def test_witnesses_are_as_many_as_announced():
    with pytest.raises(InputError, match="witnesses: found 0 at each pose, allowed are 2"):
        hdsdf_compiled(*SMALL[0], witness_count=2).value(np.eye(4), np.eye(4))
