"""The leaves of proofs in another arithmetic: mpmath's intervals, with kinematics as Pinocchio loads them. At times
drawn from each leaf, its plane keeps the two pieces as far apart as the proof claims, to the last bit."""

from __future__ import annotations

import json
import zlib
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pinocchio as pin
import pytest

import hdplan
import hdplan.verify as verify
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.proof.proof import world_of
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.yaml_format.reader import find_scene

iv = mpmath.iv
LEAVES, TIMES = 30, 4  # that are looked at, and times of each beside its ends


def frame_of(model: pin.Model, joint: int, q: list[Any]) -> tuple[Any, Any]:
    """Rotation (3, 3) and origin (3,) of a joint that turns about its z axis, for intervals of joint values."""
    if joint == 0:
        return iv.eye(3), iv.zeros(3, 1)
    turn, at = frame_of(model, int(model.parents[joint]), q)
    placed = model.jointPlacements[joint]
    at = at + turn * iv.matrix(placed.translation.tolist())
    cos, sin = iv.cos(q[joint - 1]), iv.sin(q[joint - 1])
    spin = iv.matrix([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    return turn * iv.matrix(placed.rotation.tolist()) * spin, at


@pytest.mark.parametrize("scene", ["panda_cage", "panda_carry"])
def test_planes_separate_in_interval_arithmetic(scene: str, tmp_path: Path) -> None:
    """Links from standing obstacles."""
    problem = hdplan.load_scene(scene)
    hdplan.plan(problem).save(tmp_path / "m.json")
    proof, setup = hdplan.prove(scene, tmp_path / "m.json"), Setup.of(problem)
    curve = curve_of(setup.robot, hdplan.Trajectory.load(tmp_path / "m.json"))
    clearance = json.loads(zlib.decompress(proof.data[len(verify.MAGIC) :]).partition(b"\n")[0])["clearance"]
    _, _, (counts, depths, normals, _, _) = verify.unpack(proof.data)
    world = world_of(setup, find_scene(scene), tmp_path / "m.json")
    ends, rng, seen, closest = np.cumsum(counts), np.random.default_rng(0), 0, np.inf
    for leaf in rng.permutation(len(depths)).tolist():
        pair = int(np.searchsorted(ends, leaf, side="right"))
        a, b = (world.pieces[i] for i in world.pairs[pair])
        spans = list(verify.leaves(depths[ends[pair] - counts[pair] : ends[pair]].tolist(), len(curve) - 1))
        low, high = spans[leaf - ends[pair] + counts[pair]]
        if world.pairs[pair, 1] < world.own:
            continue
        seen += 1
        n = iv.matrix(normals[leaf].tolist())
        far = _reach(b, n)
        for place in (low, high, *rng.uniform(low, high, TIMES)):
            row = min(int(place), len(curve) - 2)
            share, rows = iv.mpf(place) - row, curve.rows[row : row + 2].tolist()
            q = [x + share * (iv.mpf(y) - x) for x, y in zip(*rows, strict=True)]
            turn, at = frame_of(setup.robot.model, a.joint + 1, q)
            origin = turn * iv.matrix(a.pose[1].mid.tolist()) + at
            way = (turn * iv.matrix(a.pose[0].mid.tolist())).T * n
            near = sum(x * y for x, y in zip(n, origin, strict=True)) - _support(a, -way)
            gap = (near - far) / iv.sqrt(sum(x * x for x in n))
            assert gap.a >= clearance
            closest = min(closest, float(gap.b))
        if seen == LEAVES:
            break
    assert seen == LEAVES
    assert closest < 0.2


def _support(piece: verify.Piece, way: Any) -> Any:
    """Bounds of the greatest value of way · x over a piece, in its own frame."""
    values = [sum(iv.mpf(float(x)) * y for x, y in zip(corner, way, strict=True)) for corner in piece.corners]
    most = iv.mpf([max(v.a for v in values), max(v.b for v in values)])
    return most + iv.sqrt(sum((iv.mpf(float(x)) * y) ** 2 for x, y in zip(piece.sweep, way, strict=True)))


def _reach(piece: verify.Piece, n: Any) -> Any:
    """Bounds of the greatest value of n · x over a piece that stands."""
    turn = iv.matrix(piece.pose[0].mid.tolist())
    return _support(piece, turn.T * n) + sum(x * y for x, y in zip(n, piece.pose[1].mid.tolist(), strict=True))
