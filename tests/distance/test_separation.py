"""The law of D̃: a lower bound of the exact signed distance in metres, on every rung, apart and in overlap.

Poses deep, near and apart, aligned to the last digit or nearly, centres on each other: where axes are short.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hdplan.distance.baselines.coal import signed_distances
from hdplan.distance.normals import RUNGS
from hdplan.distance.numpy_reference.hdsdf import separation
from hdplan.distance.studies.random_poses import touching_poses
from hdplan.distance.symbolic.compiled_pair import hdsdf_compiled
from tests.distance.conftest import BODIES

ULP = float(np.finfo(float).eps)
ORACLE = 2e-9  # of the size: how exact the exact distance is
SETS = (*RUNGS, "paper-multiset", "paper+centre+edges")
PAIRS = (
    ("box", "box"),
    ("box", "capsule"),
    ("tetrahedron", "swept octahedron"),
    ("cylinder", "plate"),
    ("sphere", "swept triangle"),
)


def hostile_poses(body_a, body_b, rng, count):
    """A third share a point, a third anywhere within the bodies' size, a third centre on centre, nearly or aligned."""
    third = count // 3
    size = body_a.reach + body_b.reach
    a, b = (np.tile(np.eye(4), (count, 1, 1)) for _ in range(2))
    a[:third], b[:third] = touching_poses(body_a, body_b, rng, third)
    for poses in (a, b):
        poses[third:, :3, :3] = Rotation.from_quat(rng.normal(size=(count - third, 4))).as_matrix()
    a[third : 2 * third, :3, 3] = rng.uniform(-size, size, (third, 3))
    centred, left = slice(2 * third, count), count - 2 * third
    tilts = Rotation.from_rotvec(rng.normal(size=(left, 3)) * 10.0 ** rng.uniform(-17, 0, (left, 1)))
    a[centred, :3, :3] = np.where(
        rng.random((left, 1, 1)) < 0.7, tilts.as_matrix() @ b[centred, :3, :3], a[centred, :3, :3]
    )
    apart = rng.normal(size=(left, 3)) * size * 10.0 ** rng.uniform(-17, 0, (left, 1)) * rng.integers(0, 2, (left, 1))
    offset = b[centred, :3, :3] @ body_b.centre - a[centred, :3, :3] @ body_a.centre
    a[centred, :3, 3] = offset + apart
    return a, b


def _check(found, body_a, a, body_b, b):
    exact = signed_distances(body_a, a, body_b, b)
    size = body_a.reach + body_b.reach + np.abs(a[:, :3, 3] - b[:, :3, 3]).max(1)
    over = found - exact
    worst = int(np.argmax(over / size))
    assert over[worst] <= ORACLE * size[worst], (a[worst], b[worst], found[worst], exact[worst])


@pytest.mark.core
@pytest.mark.parametrize("names", PAIRS, ids="-".join)
def test_never_more_than_the_exact_distance(names):
    body_a, body_b = (BODIES[name] for name in names)
    number = PAIRS.index(names)
    for normals in (SETS[number], "paper+centre+edges"):
        a, b = hostile_poses(body_a, body_b, np.random.default_rng(number), 600)
        _check(separation(body_a, a, body_b, b, normals=normals), body_a, a, body_b, b)


@pytest.mark.slow
@pytest.mark.parametrize("normals", SETS)
def test_never_more_than_the_exact_distance_at_half_a_million_poses(normals):
    """Generated C: 500,000 poses over all sets and pairs."""
    count = -(-500_000 // (len(SETS) * len(PAIRS)))
    for number, names in enumerate(PAIRS):
        body_a, body_b = (BODIES[name] for name in names)
        a, b = hostile_poses(body_a, body_b, np.random.default_rng([number, SETS.index(normals)]), count)
        _, found = hdsdf_compiled(body_a, body_b, normals=normals).value(a, b)
        _check(found, body_a, a, body_b, b)
        value, _ = hdsdf_compiled(body_a, body_b, normals=normals, gamma=1, shaping_length=1e-9).value(a, b)
        assert np.all((value == 0) | (np.sign(value) == np.sign(found)))
        assert np.all(value[found > 1e-60] > 0)


def test_separation_has_the_sign_of_the_distance_and_no_jump_at_one_centre():
    """A box on a box of the same centre: the axis between the centres has no direction there and says nothing."""
    cube = BODIES["box"]
    here = np.eye(4)
    at_rest = float(separation(cube, here, cube, here, normals="paper+centre+edges"))
    for step in (1e-300, 1e-17, 1e-9, 1e-4):
        there = np.eye(4)
        there[:3, 3] = [step, -step, 0.5 * step]
        assert abs(float(separation(cube, here, cube, there, normals="paper+centre+edges")) - at_rest) <= 2 * step
