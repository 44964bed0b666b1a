"""Random robots among random obstacles: for the checker every body is where hdplan has it, at every time, and the same
pairs are to be kept apart."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation, Slerp

import hdplan
from hdplan.planner.geometry.shape_table import operations
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.proof.planes import Planes
from hdplan.planner.robot.self_pairs import ALWAYS_TOUCHING, NEVER_TOUCHING
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.obstacle_motion import ObstacleMotion
from hdplan.scenes.yaml_format.reader import read_robot
from hdplan.verify.balls import Ball, dot
from hdplan.verify.kernel import Motion
from hdplan.verify.moving import joints_of
from hdplan.verify.scene import frame as frame_of, hull
from hdplan.verify.world import World

from .worlds import bare, read, read_and_planned

Random = np.random.Generator
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
KINDS = ["revolute", "continuous", "prismatic", "fixed", "mimic"]


def text(values: Any) -> str:
    return " ".join(repr(float(value)) for value in np.atleast_1d(values))


def origin(rng: Random) -> str:
    """Whole, in part, or none."""
    parts = [f'xyz="{text(rng.uniform(-0.3, 0.3, 3))}"', f'rpy="{text(rng.uniform(-3, 3, 3))}"']
    return f"<origin {' '.join(parts[rng.integers(2) : rng.integers(3)])}/>" * int(rng.integers(2))


def geometry(rng: Random) -> str:
    size = rng.uniform(0.02, 0.15, 3)
    mirrored = text(size * rng.choice([-1, 1], 3))
    kinds = [
        f'<box size="{text(size)}"/>', f'<sphere radius="{text(size[0])}"/>', f'<ellipsoid radii="{text(size)}"/>',
        f'<cylinder radius="{text(size[0])}" length="{text(size[1])}"/>',
        f'<capsule radius="{text(size[0])}" length="{text(size[1])}"/>', f'<mesh filename="m.obj" scale="{mirrored}"/>',
    ]  # fmt: skip
    return f"<collision>{origin(rng)}<geometry>{kinds[rng.integers(6)]}</geometry></collision>"


def urdf(rng: Random, count: int) -> tuple[str, list[str]]:
    """A tree of `count` joints of all kinds in any order, and the names of those that turn or slide."""
    lines, moving, following = ['<robot name="r">'], list[str](), list[str]()
    lines += [
        f'<link name="l{i}">{"".join(geometry(rng) for _ in range(rng.integers(3)))}</link>' for i in range(count + 1)
    ]
    for i in rng.permutation(count):
        kind, name, more = str(rng.choice(KINDS, p=[0.35, 0.1, 0.15, 0.15, 0.25])), f"j{rng.integers(1000)}_{i}", ""
        if kind == "mimic":
            numbers = f'multiplier="{text(rng.uniform(-2, 2))}" offset="{text(rng.uniform(-0.5, 0.5))}"'
            if moving:  # which may follow itself
                kind, more = str(rng.choice(KINDS[:3])), f'<mimic joint="{rng.choice(moving + following)}" {numbers}/>'
                following.append(name)
            else:
                kind = "fixed"
        elif kind != "fixed":
            moving.append(name)
        more += f'<axis xyz="{text(rng.uniform(-2, 2, 3))}"/>' * int(rng.integers(2))
        more += '<limit lower="-3" upper="3" velocity="2" effort="50"/>'
        ends = f'<parent link="l{rng.integers(i + 1)}"/><child link="l{i + 1}"/>'
        lines.append(f'<joint name="{name}" type="{kind}">{origin(rng)}{ends}{more}</joint>')
    return "\n".join([*lines, "</robot>"]), moving


def pose(rng: Random) -> dict[str, Any]:
    quaternion = rng.normal(size=4)
    quaternion *= rng.uniform(0.992, 1.008) / np.linalg.norm(quaternion)
    turns = [{}, {"rpy": rng.uniform(-3, 3, 3).tolist()}, {"quaternion_xyzw": quaternion.tolist()}]
    return {"position": rng.uniform(-1, 1, 3).tolist(), **turns[rng.integers(3)]}


def shape(rng: Random) -> dict[str, Any]:
    size = rng.uniform(0.02, 0.3, 3).tolist()
    return [
        {"type": "box", "size": size}, {"type": "sphere", "radius": size[0]}, {"type": "ellipsoid", "radii": size},
        {"type": "cylinder", "radius": size[0], "length": size[1]},
        {"type": "capsule", "radius": size[0], "length": size[1]},
        {"type": "points", "points": rng.uniform(-0.3, 0.3, (6, 3)).tolist()},
        {"type": "mesh", "file": "m.obj", "scale": [size, size[0]][rng.integers(2)]},
    ][rng.integers(7)]  # fmt: skip


def moving(rng: Random, end: float) -> dict[str, Any]:
    """An obstacle that drifts, or goes through poses at times that may lie beyond the motion's."""
    if rng.integers(2):
        return {"pose": pose(rng), "motion": {key: rng.uniform(-1, 1, 3).tolist() for key in ("velocity", "spin")}}
    times = np.sort(rng.uniform(0, 1.3 * end, rng.integers(2, 5))).tolist()
    poses = [pose(rng) for _ in times]
    if "rpy" in poses[0] and rng.integers(2):  # the same orientation in other words, or nearly
        turn = Rotation.from_euler("xyz", poses[0]["rpy"]) * Rotation.from_rotvec([0, rng.choice([0.0, 1e-9, 1e-6]), 0])
        poses[1] = {"position": poses[1]["position"], "quaternion_xyzw": (-turn.as_quat()).tolist()}
    return {"motion": {"times": times, "poses": poses}}


def write(rng: Random, folder: Path) -> bool:
    """Write a random scene with its robot and a motion; False where no joint is left to move."""
    count = int(rng.integers(2, 7))
    description, joints = urdf(rng, count)
    links = [f"l{i}" for i in range(count + 1)]
    (folder / "m.obj").write_text(TETRAHEDRON)
    (folder / "r.urdf").write_text(description)
    pairs = [(rng.choice(links), rng.choice([links[1], "tool", "tool", "none"])) for _ in range(3)]
    words = "".join(f'<disable_collisions link1="{a}" link2="{b}"/>' for a, b in pairs)
    (folder / "r.srdf").write_text(f'<robot name="r">{words}</robot>')
    robot: dict[str, Any] = {"urdf": "r.urdf", "base": pose(rng), "ignore_pairs": [["l0", "l2"]][: rng.integers(2)]}
    robot |= {"srdf": "r.srdf"} if rng.integers(2) else {}
    robot |= {"base_joints": {"x": [-2, 2], "y": [-2, 2], "yaw": [-3, 3]}} if rng.random() < 0.3 else {}
    if len(joints) > 1 and rng.integers(2):
        robot |= {"group": joints[1:], "locked": {joints[0]: rng.uniform(-1, 1)}}
    elif joints and rng.integers(2):
        robot |= {"group": joints}
    (folder / "robot.yaml").write_text(json.dumps({"robot": robot}))
    try:
        loaded = hdplan.load_robot(read_robot(folder / "robot.yaml")[0])
    except hdplan.InputError as error:
        assert "no joint left to plan" in str(error) or "leave no range" in str(error)  # noqa: PT017
        return False
    rows = rng.uniform(np.maximum(loaded.lower, -1), np.minimum(loaded.upper, 1), (5, loaded.n))
    times = np.cumsum(rng.uniform(0.2, 1.0, 5))
    kinds = [{"pose": pose(rng)}, moving(rng, times[-1]), moving(rng, times[-1])]
    held = {"name": "tool", "link": rng.choice(links), "shape": shape(rng), "pose": pose(rng), "touch_links": ["l1"]}
    scene = {
        "hdplan": 1, "robot": robot, "attached": [held], "timing": {"duration": times[-1] - times[0]},
        "limits": {"velocity": 9.0},
        "obstacles": [{"name": f"o{i}", "shape": shape(rng), **kind} for i, kind in enumerate(kinds)],
        "start": {"joints": rows[0].tolist()}, "goal": {"joints": rows[-1].tolist()},
    }  # fmt: skip
    (folder / "scene.yaml").write_text(json.dumps(scene))
    rates = rng.uniform(-1, 1, (2, 5, loaded.n))[: rng.integers(3)]
    hdplan.Trajectory(loaded.joint_names, rows, loaded.locked, times, *rates).save(folder / "motion.json")
    return True


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", [*range(12), *(pytest.param(x, marks=pytest.mark.slow) for x in range(12, 150))])
def test_every_body_is_where_hdplan_has_it(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    if not write(rng, tmp_path):
        return
    scene, motion = tmp_path / "scene.yaml", tmp_path / "motion.json"
    setup = Setup.of(hdplan.load_scene(scene))
    robot = setup.robot
    try:
        world = read_and_planned(setup, scene, motion)
    except hdplan.InputError as error:
        assert "always touch" in str(error)  # noqa: PT017
        world = read(scene, motion)
    curve = curve_of(robot, hdplan.Trajectory.load(motion))

    left_out = {frozenset(pair) for pair, why in robot.unchecked.items() if why in (ALWAYS_TOUCHING, NEVER_TOUCHING)}
    wanted = {frozenset(pair) for pair in robot.self_pairs}
    for obstacle in setup.scene.obstacles:
        wanted |= {frozenset((x, obstacle.name)) for x in robot.links if obstacle.motion or robot.link_joint[x]}
    found = {frozenset(world.pieces[i].name for i in pair) for pair in world.pairs.tolist()}
    assert wanted <= found <= wanted | left_out

    data, placed = robot.model.createData(), pin.GeometryData(robot.collision)
    planes, probe = Planes(world), coal.Sphere(1e-3)
    assert curve.times is not None
    for _ in range(3):
        row, share = int(rng.integers(4)), float(rng.integers(2**10)) / 2**10
        now = np.array([curve.times[row] + share * (curve.times[row + 1] - curve.times[row])])
        q = curve.at(np.array([row]), np.array([share]))[0]
        pin.updateGeometryPlacements(robot.model, data, robot.collision, placed, robot.pin_q(q))
        items = robot.collision.geometryObjects
        parts_of = ((link, robot.link_geometry[link]) for link in robot.links)
        bodies = {link: [(items[i].geometry, placed.oMg[i].homogeneous) for i in own] for link, own in parts_of}
        for x in setup.scene.obstacles:
            bodies[x.name] = [(operations(x.shape).coal(x.shape, x.name), ObstacleMotion.of(x).at(now)[0])]
        at = np.rint(np.interp(now[0], world.times, np.arange(len(world.times))) * 2.0**28) / 2.0**28
        moment = Motion(world, np.array([[at, at + 2.0**-29]]))
        for name, parts in bodies.items():
            other = coal.Transform3s(np.eye(3), rng.uniform(-6, 6, 3))

            def away(geometry: Any, place: Any, other: Any = other) -> float:
                here = coal.Transform3s(place[:3, :3], place[:3, 3])
                return float(coal.distance(geometry, here, probe, other, coal.DistanceRequest(), coal.DistanceResult()))

            own = []
            for i, piece in enumerate(world.pieces):
                if piece.name == name:
                    turn, place = moment.turn.mid[0, piece.joint], moment.at.mid[0, piece.joint]
                    turned, there = turn @ piece.pose[0].mid, turn @ piece.pose[1].mid + place
                    own.append(away(planes.shapes[i], np.column_stack([turned, there])) - planes.swollen[i])
            assert min(own) == pytest.approx(min(away(*part) for part in parts), abs=1e-4)


@pytest.mark.parametrize("count", [60, pytest.param(200, marks=pytest.mark.slow)])
def test_turns_of_any_angle_are_enclosed(count: int) -> None:
    """An obstacle turns hardly, or far, from pose to pose."""
    rng = np.random.default_rng(5)
    body = {"name": "o", "kind": "obstacle", "shape": hull([[0.0] * 3], 0.1, 0.1, 0.1)}
    for _ in range(count):
        turns = [Rotation.random(rng=rng)]
        for power in rng.uniform(-18, 0.48, 3):
            axis = rng.normal(size=3)
            turns.append(Rotation.from_rotvec(10.0**power * axis / np.linalg.norm(axis)) * turns[-1])
        times, off = [0.0, 1.0, 2.0, 3.0], float(rng.choice([1e-15, 1e-13]))
        poses = [(Ball(x.as_matrix(), off), Ball(rng.uniform(-1, 1, 3), off)) for x in turns]
        carriers, place = joints_of({"times": times, "poses": poses}, times, "o")
        carried = {**body, "joint": len(carriers), **frame_of(place)}
        tracks = [{**x, "parent": x["parent"] + 1 or -1} for x in carriers]
        world = World(bare([carried], [[0.0]] * 4, times=times, tracks=tracks), {})
        now = np.rint(rng.uniform(0, 3, 20) * 2**30) / 2**30
        found, piece = Motion(world, now[:, None] + [0.0, 2.0**-30]), world.pieces[0]
        turned = dot("kij,jl->kil", found.turn[:, piece.joint], piece.pose[0])
        away = np.abs(turned.mid - Slerp(times, Rotation.concatenate(turns))(now + 2.0**-31).as_matrix())
        assert (away <= turned.rad + 1e-14).all()
        assert turned.rad.max() <= 1e-5
