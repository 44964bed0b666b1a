"""Poses that are not rigid are refused at every door, by their place in the table; and what the sign's rounding is."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hdplan.distance import (
    ConvexBody,
    hdsdf,
    hdsdf_compiled,
    hdsdf_derivatives,
    hdsdf_function,
    separating_axis_distance,
    separation,
    signed_distance,
    signed_distances,
)
from hdplan.distance.baselines.gdf import gdf
from hdplan.distance.poses import check_poses
from hdplan.distance.studies.random_poses import touching_poses
from hdplan.distance.symbolic.box_kernel import box_distance
from hdplan.distance.symbolic.halfspaces import halfspace_distance, swept_halfspace_distance
from hdplan.scenes.errors import InputError
from tests.distance.conftest import BODIES

CUBE, HERE = ConvexBody.box([1.0, 1.0, 1.0]), np.eye(4)
ULP = float(np.finfo(float).eps)


def _batch(pose_a, pose_b):
    pytest.importorskip("jax")
    from hdplan.distance import hdsdf_batch

    return hdsdf_batch(CUBE, CUBE).value(pose_a, pose_b)


def _on_device(pose_a, pose_b):
    jax = pytest.importorskip("jax")
    with jax.enable_x64(True):
        return _batch(jax.numpy.asarray(pose_a), jax.numpy.asarray(pose_b))


DOORS = {
    "hdsdf": lambda a, b: hdsdf(CUBE, a, CUBE, b),
    "hdsdf_derivatives": lambda a, b: hdsdf_derivatives(CUBE, a, CUBE, b),
    "separation": lambda a, b: separation(CUBE, a, CUBE, b),
    "separating_axis_distance": lambda a, b: separating_axis_distance(CUBE, a, CUBE, b),
    "hdsdf_compiled": lambda a, b: hdsdf_compiled(CUBE, CUBE).value(a, b),
    "signed_distance": lambda a, b: signed_distance(CUBE, a, CUBE, b),
    "signed_distances": lambda a, b: signed_distances(CUBE, a[None], CUBE, b[None]),
    "gdf": lambda a, b: gdf(CUBE, a, CUBE, b),
    "hdsdf_batch": _batch,
    "hdsdf_batch on the device": _on_device,
}


def _place(*position, dtype=float):
    pose = np.eye(4, dtype=dtype)
    pose[:3, 3] = position
    return pose


def _with(row, column, number):
    pose = np.eye(4)
    pose[row, column] = number
    return pose


WRONG = {
    "scaled": (np.diag([4.0, 4.0, 4.0, 1.0]), "columns have lengths 4, 4, 4"),
    "scaled, turned": (Rotation.random(random_state=0).as_matrix() * 0.7, "columns have lengths 0.7, 0.7, 0.7"),
    "one entry": (_with(0, 0, 0.8), "columns have lengths 0.8, 1, 1"),
    "sheared": (_with(0, 1, 1e-3), "allowed is a rigid transform"),
    "mirrored": (np.diag([1.0, -1.0, 1.0, 1.0]), "a reflection"),
    "last row": (_with(3, 0, 0.1), r"last row \[0.1"),
    "weight": (_with(3, 3, 2.0), "last row"),
    "nan": (_with(1, 3, np.nan), "found nan in row 1, column 3"),
    "nan below": (_with(3, 1, np.nan), "found nan in row 3, column 1"),
    "infinite": (_with(2, 3, np.inf), "found inf in row 2, column 3"),
    "huge": (_with(2, 3, 1e200), "allowed is up to 1e"),
    "transposed": (_place(0.9, 0.2, 0.1).T, "last row"),
    "complex": (np.eye(4) + 0j, "not an array of numbers"),
}
WRONG = {
    name: (np.block([[pose, np.zeros((3, 1))], [np.zeros((1, 3)), 1.0]]) if len(pose) == 3 else pose, message)
    for name, (pose, message) in WRONG.items()
}


@pytest.mark.parametrize("door", DOORS)
def test_every_door_refuses_what_is_not_rigid(door):
    for pose, message in WRONG.values():
        with pytest.raises(InputError, match=message):
            DOORS[door](HERE, pose)
        with pytest.raises(InputError, match=r"poses?_a"):
            DOORS[door](pose, HERE)


@pytest.mark.parametrize("door", DOORS)
def test_numbers_of_any_kind_are_the_numbers_that_they_are(door):
    """Small integers whose difference is none of their kind, single precision: what counts is what is written."""
    for dtype, first, second in (
        (np.uint8, (0, 0, 0), (2, 0, 0)),
        (np.int8, (-100, 0, 0), (100, 0, 0)),
        (np.int64, (0, 0, 0), (0, 3, 0)),
        (np.bool_, (0, 0, 0), (1, 0, 0)),
        (np.float32, (0.1, 0, 0), (1.1000001, 0.3, 0)),
    ):
        for a, b in ((first, second), (second, first)):
            poses = _place(*a, dtype=dtype), _place(*b, dtype=dtype)
            found, right = (DOORS[door](*(pose.astype(kind) for pose in poses)) for kind in (dtype, float))
            assert str(found) == str(right), (dtype, door)


def test_a_list_of_poses_is_refused_where_one_is_requested():
    with pytest.raises(InputError, match="pose_a: found an array of shape"):
        separating_axis_distance(CUBE, np.tile(HERE, (3, 1, 1)), CUBE, HERE)


def test_no_poses_have_no_distances():
    fast, none = hdsdf_compiled(CUBE, CUBE), np.empty((0, 4, 4))
    assert [part.shape for part in fast.hessian(none, HERE)] == [(0,), (0,), (0, 12), (0, 12, 12)]


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_under_jit_poses_that_are_not_rigid_give_nan(dtype):
    jax = pytest.importorskip("jax")
    from hdplan.distance import hdsdf_batch

    value = jax.jit(lambda a, b: hdsdf_batch(CUBE, CUBE, dtype=dtype).value(a, b)[0])
    with jax.enable_x64(True):
        for name, (pose, message) in WRONG.items():
            if name == "complex":
                with pytest.raises(InputError, match="real numbers"):
                    value(HERE, pose)
            else:
                assert np.isnan([value(HERE, pose), value(pose, HERE)]).all(), (name, message)


@pytest.mark.parametrize("count", [2, 12, 13, 5000])
def test_the_row_is_named(count):
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[count - 1, 0, 0] = 1.1
    with pytest.raises(InputError, match=rf"pose_b\[{count - 1}\]: found a rotation"):
        check_poses("pose_b", poses)
    with pytest.raises(InputError, match=rf"pose_b\[0, {count - 1}\]: found a rotation"):
        check_poses("pose_b", poses[None])


def test_rounding_passes():
    """Six decimals, float32, and long products of rotations."""
    turns = Rotation.random(500, random_state=1).as_matrix()
    poses = np.tile(np.eye(4), (500, 1, 1))
    for rotations in (np.round(turns, 6), turns.astype(np.float32), turns @ turns @ turns):
        poses[:, :3, :3] = rotations
        check_poses("poses", poses)
        check_poses("poses", poses[3])
    with pytest.raises(InputError, match="not an array of numbers"):
        check_poses("poses", "a pose")


def test_a_graph_reads_nan():
    """CasADi's functions, which can refuse nothing, at either body."""
    flat = {True: np.append(np.eye(3).ravel(), np.zeros(3)), False: np.append(2 * np.eye(3).ravel(), np.zeros(3))}
    body, planes = np.append(CUBE.vertices.ravel(), [*np.ones(8), 0.0]), np.append(CUBE.faces.ravel(), np.full(6, 0.5))
    box = np.concatenate([np.eye(3).ravel(), np.zeros(3), np.full(3, 0.5)])
    function = hdsdf_function(CUBE, CUBE)
    for a, b in ((True, True), (True, False), (False, True)):
        values = [
            function(
                np.eye(4) if a else np.diag([2.0, 2.0, 2.0, 1.0]), np.eye(4) if b else np.diag([1.0, 1.0, -1.0, 1.0])
            ),
            halfspace_distance(8, 6, 2, 1e-3)(flat[a], flat[b], body, planes)[0],
            swept_halfspace_distance(8, 6, 2, 1e-3)(flat[a], flat[True], flat[b], body, planes)[0],
            box_distance(2, 1e-3, "paper")(flat[a], flat[b], box, box, 0.0)[0],
        ]
        assert [bool(np.isnan(float(ca.DM(value)))) for value in values] == [not (a and b)] * 4
    for pose, _ in WRONG.values():
        if np.isrealobj(pose):
            far = np.abs(pose[:3, 3]).max() > 1e100 and np.isfinite(pose).all()
            assert np.isnan(float(function(HERE, pose))) != far
            assert np.isnan(float(function(pose, HERE))) != far


@pytest.mark.parametrize(
    "names",
    [("box", "box"), ("box", "capsule"), ("tetrahedron", "swept octahedron"), ("cylinder", "plate")],
    ids="-".join,
)
def test_a_touch_reads_as_a_gap_of_four_ulp_at_most(names):
    """Ulp of the bodies' extents and their distance from the origin; 2.8 is the most that was found."""
    body_a, body_b = (BODIES[name] for name in names)
    a, b = touching_poses(body_a, body_b, np.random.default_rng(7), 1000)
    size = body_a.reach + body_b.reach + np.maximum(np.abs(a[:, :3, 3]).max(1), np.abs(b[:, :3, 3]).max(1))
    for normals in ("paper", "paper+centre+edges"):
        found = separation(body_a, a, body_b, b, normals=normals)
        assert np.all(found <= 4 * ULP * size)
        value = hdsdf(body_a, a, body_b, b, normals=normals, gamma=1, shaping_length=1e-9)
        assert np.all(found[value > 0] > 0)
