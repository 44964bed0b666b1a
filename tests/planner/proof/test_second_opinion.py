"""The leaves of proofs in another arithmetic: the balls of Arb (python-flint), with kinematics as Pinocchio loads
them. At times drawn from each leaf, its plane keeps the two pieces apart as the proof claims, to the last bit."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import flint
import numpy as np
import pinocchio as pin
import pytest

import hdplan
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.yaml_format.reader import find_scene
from hdplan.verify.kernel import leaves, unpack
from hdplan.verify.world import Piece

from .worlds import read_and_planned

arb = flint.arb
LEAVES, TIMES = 30, 4  # that are examined, and times of each beside its ends


def matrix(rows: Any) -> Any:
    """Exact numbers (m, n) as balls; (n,) as one column."""
    rows = np.asarray(rows, dtype=float)
    return flint.arb_mat([[arb(x) for x in row] for row in (rows[:, None] if rows.ndim == 1 else rows).tolist()])


def frame_of(model: pin.Model, joint: int, q: list[Any]) -> tuple[Any, Any]:
    """Rotation (3, 3) and origin (3, 1) of a joint that turns about its z axis, for balls of joint values."""
    if joint == 0:
        return matrix(np.eye(3)), matrix(np.zeros(3))
    turn, at = frame_of(model, int(model.parents[joint]), q)
    placed = model.jointPlacements[joint]
    at = at + turn * matrix(placed.translation)
    cos, sin = q[joint - 1].cos(), q[joint - 1].sin()
    spin = flint.arb_mat([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    return turn * matrix(placed.rotation) * spin, at


@pytest.mark.parametrize("scene", ["panda_cage", "panda_carry"])
def test_planes_separate_in_interval_arithmetic(scene: str, tmp_path: Path) -> None:
    """Links from standing obstacles."""
    problem = hdplan.load_scene(scene)
    hdplan.plan(problem).save(tmp_path / "m.json")
    proof, setup = hdplan.prove(scene, tmp_path / "m.json"), Setup.of(problem)
    curve = curve_of(setup.robot, hdplan.Trajectory.load(tmp_path / "m.json"))
    head, _, _, (counts, depths, normals, _, _) = unpack(proof.data)
    clearance, world = head["clearance"], read_and_planned(setup, find_scene(scene), tmp_path / "m.json")
    spans, node, whole = leaves(counts, depths, len(curve) - 1)
    assert whole.all()
    ends, rng, seen, closest = np.cumsum(counts), np.random.default_rng(0), 0, np.inf
    for leaf in rng.permutation(len(depths)).tolist():
        pair = int(np.searchsorted(ends, leaf, side="right"))
        a, b = (world.pieces[i] for i in world.pairs[pair])
        low, high = spans[node[leaf]]
        if world.within[pair]:
            continue
        seen += 1
        n = matrix(normals[leaf])
        far = _reach(b, n)
        for place in (low, high, *rng.uniform(low, high, TIMES)):
            row = min(int(place), len(curve) - 2)
            share, rows = arb(float(place)) - row, curve.rows[row : row + 2].tolist()
            q = [x + share * (arb(y) - x) for x, y in zip(*rows, strict=True)]
            turn, at = frame_of(setup.robot.model, a.joint + 1, q)
            origin = turn * matrix(a.pose[1].mid) + at
            way = (turn * matrix(a.pose[0].mid)).transpose() * n
            near = (n.transpose() * origin)[0, 0] - _support(a, way * -1)
            gap = (near - far) / (n.transpose() * n)[0, 0].sqrt()
            assert gap >= clearance  # of balls: for all of their numbers
            closest = min(closest, float(gap))
        if seen == LEAVES:
            break
    assert seen == LEAVES
    assert closest < 0.2


def _support(piece: Piece, way: Any) -> Any:
    """A ball around the greatest value of way · x over a piece, in its own frame."""
    values = (matrix(piece.corners) * way).entries()
    most = functools.reduce(lambda x, y: x.max(y), values)
    squares = [(arb(float(x)) * y) ** 2 for x, y in zip(piece.sweep, way.entries(), strict=True)]
    return most + sum(squares, arb(0)).nonnegative_part().sqrt()


def _reach(piece: Piece, n: Any) -> Any:
    """A ball around the greatest value of n · x over a piece that stands."""
    turn, at = (matrix(x.mid) for x in piece.pose)
    return _support(piece, turn.transpose() * n) + (n.transpose() * at)[0, 0]
