"""The JAX batch equals the reference, with its derivatives, for any set of normals; and what being a batch adds.

Compiling a Hessian takes seconds, so that few sets and numbers of poses are used. Agreement over all branches, and the
hard poses one by one, are in ``test_witnesses`` and ``test_hard_cases``.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hdplan.distance.batch.distance import MOST_POSES, hdsdf_batch
from hdplan.distance.bodies import ConvexBody
from hdplan.distance.normals import RUNGS
from hdplan.distance.numpy_reference.hdsdf import hdsdf, hdsdf_derivatives, separation
from hdplan.scenes.errors import InputError
from tests.distance.hard_cases import HARD
from tests.extras import jax, needs

pytestmark = needs("jax")

BOX, CAPSULE = ConvexBody.box([1.0, 0.6, 0.4]), ConvexBody.capsule(0.15, 0.8)
POINT = ConvexBody.from_points([[0.1, 0.0, 0.0]])
EVERYTHING = "paper-multiset+sphere-4+centre+edges"
COUNT = 8  # poses; one number, as every other one needs a compilation
ROUNDING = {"float64": 32 * float(np.finfo(np.float64).eps), "float32": 32 * float(np.finfo(np.float32).eps)}


@pytest.fixture
def poses(random_poses):
    """Return poses deep, near and apart."""
    spread = np.array([0.2, 0.5, 0.5, 1.0, 1.0, 1.0, 2.0, 2.0])[:, None]
    a, b = random_poses(61, COUNT, 1.0), random_poses(62, COUNT, 1.0)
    a[:, :3, 3] *= spread
    b[:, :3, 3] *= spread
    return a, b


def _check(found, right, gamma, dtype="float64"):
    """Compare (value, separation, ...): relative errors are those of lengths of a metre, amplified by size/gap."""
    noise = ROUNDING[dtype]
    assert np.all(np.abs(found[1] - right[1]) <= noise)
    relative = np.minimum(1.0, (gamma + 1) ** 2 * noise / np.abs(right[1]))
    for x, y in zip((found[0], *found[2:]), (right[0], *right[2:]), strict=True):
        assert np.all(np.isfinite(x))
        axes = tuple(range(1, y.ndim))
        assert np.all(np.abs(x - y).max(axis=axes) <= relative * np.abs(y).max(axis=axes) + noise**4)


def _truth(bodies, poses, witnesses=None, normals="paper", **settings):
    a, b = poses
    more = {"normals": normals, "witnesses": witnesses}
    right = hdsdf_derivatives(bodies[0], a, bodies[1], b, **settings, **more)
    return right.value, separation(bodies[0], a, bodies[1], b, **more), right.gradient, right.hessian


@pytest.mark.parametrize(
    ("dtype", "derivatives"),
    [
        ("float64", "gradient"),
        *(pytest.param(*row, marks=pytest.mark.slow) for row in (("float64", "hessian"), ("float32", "gradient"))),
    ],
)
def test_equals_the_reference_with_every_kind_of_axis(dtype, derivatives, poses):
    """All at once: both bodies' own, counted, more directions, line of centres, edges across, witness normals."""
    witnesses = np.random.default_rng(63).normal(size=(COUNT, 2, 3))
    settings = {"gamma": 2, "shaping_length": 0.02, "normals": EVERYTHING}
    distance = hdsdf_batch(BOX, CAPSULE, dtype=dtype, witness_count=2, **settings)
    found = getattr(distance, derivatives)(*poses, witnesses)
    assert all(part.dtype == dtype for part in found)
    _check(found, _truth((BOX, CAPSULE), poses, witnesses, **settings)[: len(found)], 2, dtype)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("normals", RUNGS)
def test_every_rung_equals_the_reference(normals, poses):
    found = hdsdf_batch(CAPSULE, BOX, normals=normals).value(*poses)
    _check(found, _truth((CAPSULE, BOX), poses, normals=normals)[:2], 2)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("gamma", [1, 3, 7, *(pytest.param(gamma, marks=pytest.mark.slow) for gamma in (4, 8, 32))])
def test_every_gamma_equals_the_reference(gamma, poses):
    settings = {"gamma": gamma, "shaping_length": 0.05}
    found = hdsdf_batch(BOX, POINT, **settings).gradient(*poses)
    _check(found, _truth((BOX, POINT), poses, **settings)[:3], gamma)


def test_epsilon_is_a_shaping_length(poses):
    found = hdsdf_batch(BOX, POINT, gamma=3, epsilon=1e-6).gradient(*poses)
    for x, y in zip(found, hdsdf_batch(BOX, POINT, gamma=3, shaping_length=0.01).gradient(*poses), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-13)


def test_derivatives_are_those_of_the_value(poses, tolerance):
    """Central differences of the reference's value along rigid motions of either body."""
    length, h = 0.1, 1e-6
    distance = hdsdf_batch(BOX, CAPSULE, shaping_length=length)
    a, b = poses
    _, _, gradient, hessian = distance.hessian(a, b)
    eye = h * np.eye(12)
    right = (_at(a, b, eye, length) - _at(a, b, -eye, length)) / (2 * h)
    np.testing.assert_allclose(gradient, right, atol=tolerance["difference"])
    # second differences of a value lose half the digits: take the gradient along translations, which commute
    for k in range(3):
        turned, back = (distance.hessian(_moved(a, sign * eye[k, :6]), b)[2] for sign in (1, -1))
        step = (turned - back) / (2 * h)
        scale = np.abs(hessian).max()
        np.testing.assert_allclose(hessian[:, k, :3], step[:, :3], atol=50 * tolerance["difference"] * scale)
        np.testing.assert_allclose(hessian[:, k, 6:], step[:, 6:], atol=50 * tolerance["difference"] * scale)


def _at(a, b, twists, length):
    moved = [(_moved(a, twist[:6]), _moved(b, twist[6:])) for twist in twists]
    return np.stack([hdsdf(BOX, x, CAPSULE, y, shaping_length=length) for x, y in moved], axis=-1)


def _moved(poses, twist):
    step = np.eye(4)
    step[:3, :3], step[:3, 3] = Rotation.from_rotvec(twist[3:]).as_matrix(), twist[:3]
    return poses @ step


def test_hessian_is_symmetric_and_the_relative_motion_alone_counts(poses):
    """Moving both bodies by one motion of the world changes nothing."""
    a, b = poses
    _, _, gradient, hessian = hdsdf_batch(BOX, CAPSULE, shaping_length=0.1).hessian(a, b)
    np.testing.assert_allclose(hessian, hessian.swapaxes(-1, -2), atol=1e-14 * np.abs(hessian).max())
    both = np.concatenate([_seen_from_the_world(pose) for pose in (a, b)], axis=-2)
    np.testing.assert_allclose(gradient[..., None, :] @ both, 0.0, atol=1e-11)
    np.testing.assert_allclose(both.swapaxes(-1, -2) @ hessian @ both, 0.0, atol=1e-9 * np.abs(hessian).max())


def _seen_from_the_world(poses):
    """Return the twists (..., 6, 6) in the body's frame of the six motions of the world."""
    back = poses[..., :3, :3].swapaxes(-1, -2)
    x, y, z = np.moveaxis(poses[..., :3, 3], -1, 0)
    o = np.zeros_like(x)
    skew = np.moveaxis(np.array([[o, -z, y], [z, o, -x], [-y, x, o]]), (0, 1), (-2, -1))
    return np.concatenate(
        [np.concatenate([back, -back @ skew], -1), np.concatenate([np.zeros_like(back), back], -1)], axis=-2
    )


@pytest.mark.core
def test_a_batch_is_a_loop(poses):
    distance = hdsdf_batch(BOX, CAPSULE)
    whole = distance.gradient(*poses)
    for k in range(COUNT):
        one = distance.gradient(poses[0][k], poses[1][k])
        assert [np.shape(part) for part in one] == [(), (), (12,)]
        for x, y in zip(one, whole, strict=True):
            np.testing.assert_allclose(x, y[k], rtol=1e-13, atol=1e-280)


def test_leading_axes_broadcast(poses):
    a, b = poses[0][:4], poses[1][:2]
    distance = hdsdf_batch(BOX, CAPSULE, witness_count=1)
    witnesses = np.random.default_rng(64).normal(size=(4, 1, 1, 3))
    found = distance.gradient(a[:, None], b, witnesses)
    assert [part.shape for part in found] == [(4, 2), (4, 2), (4, 2, 12)]
    every = [
        np.broadcast_to(x, (4, 2, *x.shape[2:])).reshape(8, *x.shape[2:]) for x in (a[:, None], b[None], witnesses)
    ]
    for x, y in zip(found, distance.gradient(*every), strict=True):
        np.testing.assert_array_equal(x.reshape(y.shape), y)


def test_any_number_of_poses(random_poses):
    """None, and more than go at once."""
    distance = hdsdf_batch(POINT, POINT)
    a, b = random_poses(65, 50, 1.0), random_poses(66, MOST_POSES // 50 + 1, 1.0)
    value, least = distance.value(a[:, None], b)
    assert value.size > MOST_POSES
    np.testing.assert_allclose(least, separation(POINT, a[:, None], POINT, b), atol=1e-14)
    np.testing.assert_allclose(value[-1], distance.value(a[-1], b)[0], rtol=1e-13)
    assert [part.shape for part in distance.value(a[:0], b[:0])] == [(0,), (0,)]


def test_pairs_of_equal_shapes_and_any_shaping_length_share_what_is_compiled(poses):
    from hdplan.distance.batch import unions

    evaluate: Any = unions.evaluate
    hdsdf_batch(BOX, POINT).value(*poses)
    compiled = evaluate._cache_size()
    hdsdf_batch(BOX, POINT, shaping_length=0.1).value(*poses)
    hdsdf_batch(ConvexBody.box([0.1, 0.2, 0.3]).inflated(0.05), POINT, shaping_length=1e-6).value(*poses)
    assert evaluate._cache_size() == compiled


def test_float64_needs_and_changes_no_global_setting(poses):
    distance = hdsdf_batch(BOX, POINT)
    right = distance.value(*poses)[0]
    assert right.dtype == np.float64
    assert not jax.config.jax_enable_x64
    assert jax.numpy.ones(1).dtype == np.float32
    for allowed in (True, False):
        with jax.enable_x64(allowed):
            for dtype in ("float64", "float32"):
                found = hdsdf_batch(BOX, POINT, dtype=dtype).value(*poses)[0]
                assert found.dtype == dtype
                np.testing.assert_allclose(found, right, rtol=1e-12 if dtype == "float64" else 1e-2)


def test_numpy_in_numpy_out_and_jax_in_jax_out(poses):
    distance = hdsdf_batch(BOX, POINT)
    right = distance.value(*poses)
    assert all(isinstance(part, np.ndarray) and part.flags.writeable for part in right)
    with jax.enable_x64(True):
        found = distance.value(jax.numpy.asarray(poses[0]), poses[1])
    assert all(isinstance(part, jax.Array) and part.dtype == np.float64 for part in found)
    for x, y in zip(found, right, strict=True):
        np.testing.assert_array_equal(x, y)
    assert distance.device == jax.devices()[0].platform or jax.devices()[0].device_kind in distance.device


SHAPES = {  # the hard cases' pairs of equal numbers of vertices and normals, which share what is compiled
    key: [case for case in HARD if (len(case.body_a.vertices), len(case.body_b.vertices)) == key]
    for key in dict.fromkeys((len(case.body_a.vertices), len(case.body_b.vertices)) for case in HARD)
}


def _finite_at_hard_poses(cases, gamma, dtype):
    for length in (1e-9, 1e-3, 1.0):
        for case in cases:
            distance = hdsdf_batch(case.body_a, case.body_b, gamma=gamma, shaping_length=length, dtype=dtype)
            found = distance.hessian(case.pose_a, case.pose_b)
            assert all(np.all(np.isfinite(part)) for part in found), f"{case.name}, shaping length {length}"


def test_finite_at_hard_poses():
    """Points in the wildest setting; ``test_hard_cases`` has boxes and others, and whether it is right."""
    _finite_at_hard_poses(SHAPES[1, 1], 32, "float32")


@pytest.mark.slow
@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("gamma", [1, 2, 4, 8, 32])
@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: f"{shape[0]}-{shape[1]}")
def test_finite_at_every_hard_pose(shape, gamma, dtype):
    _finite_at_hard_poses(SHAPES[shape], gamma, dtype)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"dtype": "float16"}, "did you mean 'float"),
        ({"dtype": "double"}, "dtype: unknown value 'double'"),
        ({"gamma": 0}, "gamma"),
        ({"shaping_length": -1.0}, "shaping_length"),
        ({"normals": "papers"}, "did you mean 'paper'"),
        ({"witness_count": -1}, "witness_count: must be a whole number 0 to 1000, found -1"),
        ({"witness_count": 1.5}, "witness_count: must be a whole number 0 to 1000, found 1.5"),
    ],
    ids=str,
)
def test_bad_settings_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        hdsdf_batch(BOX, POINT, **settings)


def test_bad_poses_and_witnesses_are_refused():
    distance, one = hdsdf_batch(BOX, POINT, witness_count=1), np.eye(4)
    with pytest.raises(InputError, match="witnesses: found 0 at each pose, allowed are 1"):
        distance.value(one, one)
    with pytest.raises(InputError, match="witnesses: found 2 at each pose, allowed are 1"):
        distance.value(one, one, np.eye(3)[:2])
    with pytest.raises(InputError, match="nonzero"):
        distance.value(one, one, np.zeros((1, 3)))
    plain = hdsdf_batch(BOX, POINT)
    with pytest.raises(InputError, match="pose_b: found an array of shape"):
        plain.value(one, np.eye(3))
    for dtype, number, message in (
        ("float64", np.nan, "pose_a: found nan in row 0, column 3"),
        ("float32", 1e39, "allowed in float32 is up to 1e"),
    ):
        far = np.eye(4)
        far[0, 3] = number
        with pytest.raises(InputError, match=message):
            hdsdf_batch(BOX, POINT, dtype=dtype).value(far, one)


def test_without_jax_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "jax", None)
    with pytest.raises(InputError, match=r"needs jax, which is not installed: pip install jax"):
        hdsdf_batch(BOX, POINT)


def _at_rest(shift):
    """A pose moved by a shift, in whatever precision that has."""
    return jax.numpy.eye(4, dtype=shift.dtype).at[:3, 3].set(shift)


@pytest.mark.parametrize(  # float64 is in ``test_aligned`` too; without jit, JAX compiles hundreds of single operations
    ("allowed", "bodies", "whole"),
    [
        pytest.param(False, (POINT, POINT), None, id="float32 alone, to the first derivative"),
        pytest.param(False, (POINT, POINT), lambda f: jax.jit(f), id="float32 alone", marks=pytest.mark.slow),
        pytest.param(False, (BOX, CAPSULE), lambda f: f, id="float32 alone, without jit", marks=pytest.mark.slow),
        pytest.param(True, (BOX, CAPSULE), lambda f: f, id="float64 allowed, without jit", marks=pytest.mark.slow),
    ],
)
def test_the_batch_composes_with_the_transformations_of_jax(allowed, bodies, whole):
    """grad, hessian, jit, vmap and scan, in any order, aligned as the bodies are: what the closed forms say."""
    distance, place = hdsdf_batch(*bodies), np.eye(4)
    place[:3, 3] = [0.75, 0.1, 0.1]
    value, _, gradient, *hessian = (distance.hessian if whole else distance.gradient)(np.eye(4), place)
    with jax.enable_x64(allowed):
        numpy = jax.numpy
        shift = numpy.asarray(place[:3, 3])
        close = {"rtol": 1e-12 if allowed else 1e-5, "atol": 1e-13 if allowed else 1e-6}

        def loss(x):
            return distance.value(numpy.eye(4), _at_rest(x))[0]

        rows = numpy.stack([shift] * 3)
        alone = ((jax.jit(loss)(shift), value), (jax.jit(jax.grad(loss))(shift), gradient[6:9])) if whole else ()
        for found, right in (
            *alone,  # both are also within the others, each of which compiles for a second
            (jax.vmap(jax.jit(loss))(rows)[2], value),
            *((whole(jax.vmap(jax.hessian(loss)))(rows)[1], second[6:9, 6:9]) for second in hessian),
            (jax.lax.scan(lambda total, x: (total + loss(x), jax.grad(loss)(x)), shift[0] * 0, rows)[0], 3 * value),
        ):
            assert found.dtype == shift.dtype
            np.testing.assert_allclose(found, right, **close)
        if whole:
            with pytest.raises(InputError, match="a third derivative is not available"):
                whole(jax.jacfwd(jax.hessian(loss)))(shift)
        scaled = jax.jit(lambda factor: distance.value(numpy.eye(4), factor * numpy.eye(4)))(numpy.asarray(2.0))
        assert all(np.isnan(part) for part in scaled), "a graph cannot refuse"


def test_separation_has_a_gradient_and_witnesses_are_held(poses):
    distance = hdsdf_batch(POINT, CAPSULE, witness_count=1)
    h, axes = 1e-6, np.random.default_rng(67).normal(size=(COUNT, 1, 3))
    with jax.enable_x64(True):
        numpy = jax.numpy
        a, b = (numpy.asarray(pose) for pose in poses)

        @jax.jit
        def gap(shift, normals):
            return distance.value(a.at[:, :3, 3].add(shift), b, normals)[1].sum()

        found, zero = jax.jit(jax.grad(gap, argnums=(0, 1)))(numpy.zeros(3), numpy.asarray(axes))
        right = [(gap(h * e, axes) - gap(-h * e, axes)) / (2 * h) for e in np.eye(3)]
    np.testing.assert_allclose(found, right, atol=1e-8)
    np.testing.assert_array_equal(zero, 0.0)


def test_float32_far_from_the_origin_is_float32_at_the_origin():
    """Positions are subtracted before digits are cut: cubes that touch, 100 km away, read contact."""
    cube, rng = ConvexBody.box([1.0, 1.0, 1.0]), np.random.default_rng(68)
    distance = hdsdf_batch(cube, cube, dtype="float32", gamma=1, shaping_length=1e-6)
    for away in (0.0, 2.0**10, 2.0**17):
        a, b = (np.tile(np.eye(4), (64, 1, 1)) for _ in range(2))
        a[:, :3, 3] = b[:, :3, 3] = away
        b[:, 1:3, 3] += rng.uniform(-0.2, 0.2, (64, 2))
        b[:, 0, 3] += 1.0 - 2.0 ** rng.integers(-30, -8, 64)
        value, least = distance.value(a, b)
        assert np.all(value <= 0)
        np.testing.assert_allclose(least, b[:, 0, 3] - away - 1.0, atol=2e-7)


def test_values_beyond_a_type_are_refused_and_all_others_are_finite():
    """A size of 1e38 m gave NaN in float32, a shaping length of 1e-40 m a touch that read as apart."""
    for size, length in ((1e14, 1e-3), (1e-15, 1e-30), (1.0, 1e6)):
        cube = ConvexBody.box(np.full(3, size))
        distance = hdsdf_batch(cube, cube, dtype="float32", shaping_length=length, normals="paper+centre")
        poses = np.tile(np.eye(4), (3, 1, 1))
        poses[:, 0, 3] = size, 1.5 * size, 5e14
        found = distance.gradient(np.eye(4), poses)
        assert all(np.isfinite(part).all() for part in found)
        assert found[0][0] <= 0
        assert (found[0][1:] >= 0).all()
        poses[2, 0, 3] = 2e15
        with pytest.raises(
            InputError, match="pose_b: found a body too far from the other, allowed in float32 is up to"
        ):
            distance.value(np.eye(4), poses)
    cube = ConvexBody.box(np.full(3, 1e16))
    with pytest.raises(InputError, match=r"body_a: found a size of 5e\+15 m, allowed in float32 is up to 1e\+15 m"):
        hdsdf_batch(cube, BOX, dtype="float32")
    with pytest.raises(InputError, match="shaping_length: found 1e-40 m, allowed in float32 is 1e-30 m or more"):
        hdsdf_batch(BOX, BOX, dtype="float32", shaping_length=1e-40)
