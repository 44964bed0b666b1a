"""The siege (benchmarks/siege.py): its judges against what can be worked out by hand, and a seeded minute of it all."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

BENCHMARKS = Path(__file__).resolve().parent.parent / "benchmarks"
sys.path.insert(0, str(BENCHMARKS))

from sieges import campaign, distance, gjk, judge, meshes, paper, poses, rows, threads  # noqa: E402
from sieges.machine import Machine, Mass  # noqa: E402
from sieges.world import World  # noqa: E402

ARM = """<robot name="arm">
<link name="base"/>
<link name="upper"><collision><origin xyz="0.5 0 0"/><geometry><box size="1 0.1 0.1"/></geometry></collision></link>
<link name="lower"><collision><origin xyz="0.5 0 0"/><geometry><cylinder radius="0.05" length="0.2"/></geometry>
</collision></link>
<joint name="a" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 -2 0"/>
<limit lower="-1" upper="2" effort="10" velocity="2"/></joint>
<joint name="b" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="1 0 0"/><axis xyz="0 -1 0"/>
<limit lower="-3" upper="3" effort="10" velocity="2"/></joint>
</robot>"""


def placed(position, rotation=None):
    pose = np.eye(4)
    pose[:3, 3] = position
    if rotation is not None:
        pose[:3, :3] = rotation
    return pose[None]


def apart(first, second, pose):
    """Return the judge's bounds on the distance of two pieces, the second one at a pose."""
    pieces = gjk.Pieces.of([(0, *first, np.eye(3)), (1, *second, np.eye(3))])
    low, high = gjk.distances(pieces, np.array([0]), placed([0, 0, 0]), np.array([1]), pose)
    return float(low[0]), float(high[0])


SEGMENT = np.array([[0, 0, -0.5], [0, 0, 0.5]])
CUBE = meshes.box(np.ones(3))[0]
POINT = np.zeros((1, 3))
TILTED = poses.turn(np.array([0.0, 0.0, 1.0]), np.array([np.pi / 4]))[0]


@pytest.mark.parametrize(
    ("first", "second", "pose", "truth"),
    [
        ((CUBE, 0.0, 0.0), (CUBE, 0.0, 0.0), placed([1.25, 0.3, 0.0]), 0.25),
        ((CUBE, 0.0, 0.0), (CUBE, 0.0, 0.0), placed([0.5 + 0.5**0.5 + 0.1, 0, 0], TILTED), 0.1),
        ((POINT, 0.2, 0.0), (SEGMENT, 0.1, 0.0), placed([0.7, 0, 0.8]), np.hypot(0.7, 0.3) - 0.3),
        ((POINT, 0.2, 0.0), (SEGMENT, 0.0, 0.3), placed([1.0, 0, 0.2]), 0.5),
        ((POINT, 0.2, 0.0), (SEGMENT, 0.0, 0.3), placed([1.3, 0, 1.5]), np.hypot(1.0, 1.0) - 0.2),
        ((CUBE, 0.1, 0.0), (CUBE, 0.2, 0.0), placed([2.0, 2.0, 2.0]), 3**0.5 - 0.3),
    ],
)
def test_the_judges_distances_are_those_worked_out_by_hand(first, second, pose, truth) -> None:
    low, high = apart(first, second, pose)
    assert low == pytest.approx(truth, abs=1e-7)
    assert high == pytest.approx(truth, abs=1e-7)
    assert low <= truth + 1e-12
    assert high >= truth - 1e-12


def test_overlapping_bodies_are_no_distance_apart() -> None:
    _, high = apart((CUBE, 0.0, 0.0), (SEGMENT, 0.05, 0.0), placed([0.5, 0.2, 0.3], TILTED))
    assert high <= -0.05 + 1e-12


@pytest.mark.parametrize("kind", meshes.KINDS)
def test_hostile_meshes_are_written_and_read(kind, tmp_path) -> None:
    mesh = meshes.hostile(kind, np.random.default_rng(5), 1.0)
    assert meshes.closed(mesh) == (kind != "open")
    for ending, close in (("obj", 0.0), ("ply", 0.0), ("stl", 1e-6)):
        meshes.write(tmp_path / f"m.{ending}", mesh)
        points, faces = meshes.read(tmp_path / f"m.{ending}")
        np.testing.assert_allclose(points[faces], mesh[0][mesh[1]], rtol=0, atol=close)


def test_winding_numbers_tell_the_inside() -> None:
    rng = np.random.default_rng(1)
    middle = np.zeros((1, 3))
    assert meshes.windings(meshes.hostile("box", rng, 1.0), middle)[0] == pytest.approx(1.0)
    assert meshes.windings(meshes.hostile("inverted", rng, 1.0), middle)[0] == pytest.approx(-1.0)
    assert meshes.windings(meshes.hostile("star", rng, 1.0), middle)[0] == pytest.approx(1.0)
    assert meshes.windings(meshes.hostile("hollow", rng, 1.0), middle)[0] == pytest.approx(0.0, abs=1e-9)
    assert meshes.windings(meshes.hostile("star", rng, 1.0), middle + 2.0)[0] == pytest.approx(0.0, abs=1e-9)


@pytest.fixture
def arm(tmp_path: Path) -> Machine:
    (tmp_path / "arm.urdf").write_text(ARM)
    return Machine(tmp_path / "arm.urdf")


def test_a_planar_arm_is_where_trigonometry_says(arm: Machine) -> None:
    a, b = np.array([0.3, -0.7]), np.array([0.5, 1.1])
    tip = arm.frames({"a": a, "b": b}, np.eye(4))["lower"] @ [1.0, 0.0, 0.0, 1.0]
    np.testing.assert_allclose(tip[:, 0], np.cos(a) + np.cos(a + b), atol=1e-12)
    np.testing.assert_allclose(tip[:, 2], np.sin(a) + np.sin(a + b), atol=1e-12)


def test_torques_are_those_of_the_double_pendulum(arm: Machine) -> None:
    """M. W. Spong et al., Robot Modeling and Control, section 7.4: two links in a vertical plane, point masses at the
    ends."""
    rng = np.random.default_rng(2)
    q, v, u = rng.normal(size=(3, 50, 2))
    (m, n), g = (1.3, 0.7), 9.81
    masses = [Mass("upper", m, np.array([1.0, 0, 0]), np.zeros((3, 3)))]
    masses += [Mass("lower", n, np.array([1.0, 0, 0]), np.zeros((3, 3)))]
    values, rates, accelerations = ({"a": each[:, 0], "b": each[:, 1]} for each in (q, v, u))
    found = arm.torques(arm.motion(values, rates, accelerations, np.eye(4)), masses, ["a", "b"])
    cosine, sine = np.cos(q[:, 1]), np.sin(q[:, 1])
    first = (m + n + n + 2 * n * cosine) * u[:, 0] + (n + n * cosine) * u[:, 1]
    first += (
        -n * sine * (2 * v[:, 0] * v[:, 1] + v[:, 1] ** 2) + (m + n) * g * np.cos(q[:, 0]) + n * g * np.cos(q.sum(1))
    )
    second = (n + n * cosine) * u[:, 0] + n * u[:, 1] + n * sine * v[:, 0] ** 2 + n * g * np.cos(q.sum(1))
    np.testing.assert_allclose(found, np.stack([first, second], axis=1), atol=1e-10)


def test_curves_meet_their_rows_and_are_read_from_every_format(tmp_path) -> None:
    rng = np.random.default_rng(3)
    times = np.array([0.0, 0.3, 1.1, 1.2])
    q, v, a = rng.normal(size=(3, 4, 2))
    for rates in ((None, None), (v, None), (v, a)):
        motion = rows.Rows(("a", "b"), q, times, *rates)
        for ending in ("json", "csv", "npz"):
            rows.write(tmp_path / f"m.{ending}", motion)
            back = rows.read(tmp_path / f"m.{ending}")
            for name in ("positions", "times", "velocities", "accelerations"):
                assert np.array_equal(getattr(back, name), getattr(motion, name))
        starts, ends = (motion.at(np.arange(3), np.full(3, s)) for s in (0.0, 1.0))
        np.testing.assert_allclose(starts, q[:-1], atol=1e-12)
        np.testing.assert_allclose(ends, q[1:], atol=1e-12)
        for order, rate in enumerate(rates, start=1):
            if rate is not None:
                np.testing.assert_allclose(motion.at(np.arange(3), np.ones(3), order), rate[1:], atol=1e-9)
    polynomial = np.poly1d([0.3, -1.0, 0.2, 2.0, 0.0, 1.0])
    columns = [np.polyval(polynomial.deriv(k) if k else polynomial, times)[:, None] for k in range(3)]
    curve = rows.Rows(("a",), columns[0], times, columns[1], columns[2])
    interval, s = curve.grid(40)
    np.testing.assert_allclose(curve.at(interval, s, 3)[:, 0], polynomial.deriv(3)(curve.when(interval, s)), atol=1e-8)


def planted(tmp_path: Path, motion: rows.Rows, **sections) -> World:
    """Write a scene of the planar arm with whatever is planted in it."""
    (tmp_path / "arm.urdf").write_text(ARM)
    content = {"hdplan": 1, "robot": {"urdf": "arm.urdf"}, **sections}
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(content))
    return World(tmp_path / "scene.yaml", motion.names)


SWING = rows.Rows(("a", "b"), np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([0.0, 1.0]))


def ball(position, radius=0.1):
    return [{"name": "ball", "shape": {"type": "sphere", "radius": radius}, "pose": {"position": position}}]


def test_the_judge_refutes_what_is_planted_and_nothing_else(tmp_path) -> None:
    free = planted(tmp_path, SWING, obstacles=ball([1.0, 0.5, 0.8]))
    assert not judge.refute(free, SWING, 0.3, None)
    assert "ball" in judge.refute(free, SWING, 0.46, None)[0]  # its surface is 0.35 m away from the upper arm's side
    hit = planted(tmp_path, SWING, obstacles=ball([1.5 * float(np.cos(0.5)), 0.0, 1.5 * float(np.sin(0.5))], 0.01))
    assert "lower and ball" in judge.refute(hit, SWING, 1e-4, None)[0]
    fast = planted(tmp_path, SWING, limits={"velocity": {"a": 0.99}})
    assert "velocity" in judge.refute(fast, SWING, None, None)[0]
    far = planted(tmp_path, SWING, limits={"position": {"a": [-1.0, 1.0 - 1e-6]}})
    assert "limits of position" in judge.refute(far, SWING, None, None)[0]
    jump = planted(tmp_path, SWING, limits={"acceleration": 5.0})
    assert "infinite" in judge.refute(jump, SWING, None, None)[0]


def test_the_judge_sees_what_lies_within_a_solid_but_not_within_a_shell(tmp_path) -> None:
    for kind, within in (("star", True), ("hollow", False), ("open", False)):
        mesh = meshes.hostile(kind, np.random.default_rng(4), 1.0)
        if kind == "hollow":
            mesh = meshes.joined(meshes.box(np.full(3, 1.0)), meshes.inverted(meshes.box(np.full(3, 0.9))))
        meshes.write(tmp_path / "m.obj", mesh)
        around = [{"name": "m", "shape": {"type": "mesh", "file": "m.obj", "scale": 20.0}}]
        world = planted(tmp_path, SWING, obstacles=around)
        found = judge.refute(world, SWING, 1e-3, None)
        assert bool(found) == within, (kind, found)


def test_the_papers_distance_is_that_of_two_cubes_worked_out_by_hand() -> None:
    """Faces 0.5 m apart, gamma 2: 16 of the 64 differences along x are 0.5 and the others 1.5 and 2.5, and along the
    other axes nothing separates. Both bodies have this axis: it counts twice."""
    cube = paper.solids()["cube"]
    x = paper.separations(cube, placed([1.5, 0.0, 0.0]), cube, placed([0.0, 0.0, 0.0]), "paper")
    inner = (16 * 0.5**-3 + 32 * 1.5**-3 + 16 * 2.5**-3) ** (-1 / 3)
    shaped = inner**3 / (inner**2 + 1e-6)
    outer = (2 * shaped**3) ** (1 / 3)
    value, gap = paper.distance(x, 2, 1e-3)
    assert value[0] == pytest.approx(outer**3 / (outer**2 + 1e-6), rel=1e-12)
    assert gap[0] == pytest.approx(0.5)


def test_a_worker_that_dies_or_hangs_is_a_finding_and_the_rest_goes_on(tmp_path) -> None:
    script = tmp_path / "falls.py"
    script.write_text(
        "import os, sys\n"
        f"sys.path.insert(0, {str(BENCHMARKS)!r})\n"
        "from pathlib import Path\n"
        "from sieges.campaign import Outcome, serve\n"
        "def attack(rng, folder):\n"
        "    draw = int(rng.integers(10**9))\n"
        "    (folder / 'what.txt').write_text(str(draw))\n"
        "    if draw % 5 == 0: os.abort()\n"
        "    while draw % 5 == 1: pass\n"
        "    if draw % 5 == 2: raise ValueError('planted')\n"
        "    return Outcome('fine')\n"
        "serve(attack, sys.argv[1], int(sys.argv[3]), Path(sys.argv[5]))\n"
    )
    draws = [int(np.random.default_rng([0, sum(map(ord, "falls")), k]).integers(10**9)) % 5 for k in range(12)]
    tally = campaign.run("falls", 12, 0, tmp_path / "out", 0.5, jobs=2, script=script)
    assert {0, 1, 2} <= set(draws)
    words = dict(tally.findings)
    assert sorted(words) == [k for k, draw in enumerate(draws) if draw < 3]
    for k, finding in words.items():
        assert finding.startswith({0: "signal 6", 1: "limit of time", 2: "traceback ValueError"}[draws[k]])
        kept = tmp_path / "out" / f"case_{k:06d}"
        assert json.loads((kept / "judge.json").read_text())["finding"] == finding
        assert int((kept / "what.txt").read_text()) % 5 == draws[k]
    assert tally.kinds["fine"] == sum(draw > 2 for draw in draws)


SIEGES = {"certificate": 1, "input": 10, "semantics": 4, "meshes-files": 20, "control": 1, "robots-files": 7}


@pytest.mark.parametrize("times", [1, pytest.param(30, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", SIEGES)
def test_a_seeded_minute_of_the_siege_finds_nothing(name, times, tmp_path) -> None:
    count = SIEGES[name] * times
    tally = campaign.run(name, count, 0, tmp_path, 60.0)
    assert tally.cases == count
    assert tally.findings == []


@pytest.mark.parametrize("seed", range(3))
def test_distances_are_those_of_a_separate_implementation(seed, tmp_path) -> None:
    outcome = distance.attack(
        np.random.default_rng(seed), tmp_path, 300, ("reference", "signed_distance", "halfspaces")
    )
    assert outcome.finding == ""


def test_things_come_out_of_threads_as_they_do_alone(tmp_path) -> None:
    assert threads.attack(np.random.default_rng(0), tmp_path, ("certificate", "certificate", "nearest")).finding == ""
