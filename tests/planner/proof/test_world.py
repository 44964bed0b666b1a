"""Laws of worlds: complete, plain, the same for the same problem and another one for any other, and their numbers are
those with which Pinocchio and the certificate compute."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import yaml
from scipy.spatial.transform import Rotation

import hdplan
from hdplan import Attached, Cloud, InputError, Limits, Pose, RobotSpec, Scene, Timing, Trajectory, Voxels, load_robot
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.proof.world import not_compared, world_of
from hdplan.planner.proof.world_values import frame_of
from hdplan.planner.robot.link_frame import end_effector
from hdplan.planner.robot.self_pairs import ALWAYS_TOUCHING
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.shapes import Box, Capsule, Cylinder, Ellipsoid, Mesh, Points, Shape, Sphere
from hdplan.scenes.yaml_format.reader import load_scene, shipped_scenes
from hdplan.verify.compare import check_equal, plain

from ..linkage import linkage_urdf
from ..urdf import joint_text, link_text, write_robot

World = dict[str, Any]

ROOT = Path(__file__).resolve().parents[3]
PAGE = (ROOT / "docs" / "world.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| \[?(`.*?`)(?:\]\(.*?\))? \|", PAGE, re.MULTILINE)
KEYS = {key for row in ROWS for key in re.findall(r"`(\w+)`", row)}
REASONS = re.findall(r"`([^`]+)`", PAGE[PAGE.index("The reasons are") : PAGE.index("the first of them that holds")])
SHIPPED = list(shipped_scenes())
CORNERS = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]
TURNED = Pose.from_rpy((0.3, -0.2, 0.9), (3.0, 0.2, 0.5))


def straight(setup: Setup) -> Trajectory:
    """A motion of two rows at the start."""
    q = setup.robot.configuration(setup.scene.start, setup.scene.from_request)
    times = None if not setup.scene.timed else np.array([0.0, setup.scene.end_time or 1.0])
    return Trajectory(setup.robot.joint_names, np.stack([q, q]), {}, times)


def world(scene: Scene | str) -> World:
    setup = Setup.of(load_scene(scene) if isinstance(scene, str) else scene)
    return written(world_of(setup, straight(setup)))


def written(found: World) -> World:
    """A world as a file has it."""
    return json.loads(json.dumps(found, allow_nan=False, default=plain))


# --- its form ---------------------------------------------------------------------------------------------------------


def offs(value: Any) -> Iterator[float]:
    """All bounds within a world."""
    if isinstance(value, dict):
        yield from [value["off"]] if "off" in value else []
    for each in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        yield from offs(each)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", SHIPPED)
def test_worlds_are_plain_and_complete(name: str) -> None:
    """Pairs that are not listed as not compared are just those that the certificate compares."""
    setup = Setup.of(load_scene(name))
    found = world_of(setup, straight(setup))
    check_equal(found, written(found))
    assert {*found} | {"loads", "sizes"} == KEYS
    assert ("loads" in found) == ("torque" in setup.limits)
    assert ("sizes" in found) == (name == "panda_person")
    assert all(0.0 <= each <= 1e-9 for each in offs(found))
    for number, joint in enumerate(found["joints"]):
        assert -1 <= joint["parent"] < number
        assert np.linalg.norm(joint["axis"]) == pytest.approx(1.0, abs=1e-15)
    count = len(found["joints"])
    assert all(len(limit) == count for limit in (*found["limits"].values(), *found["motion"]["positions"]))
    own = {each["name"] for each in found["bodies"] if each["kind"] != "obstacle"}
    every = {(a, b) for a in own for b in own if a < b}
    pairs = [(a, b) for a, b, _ in found["not_compared"]]
    assert pairs == sorted({*pairs})
    assert {reason for *_, reason in found["not_compared"]} <= {*REASONS}
    sweep = Certifier(setup).sweep
    names, rows = sweep.bodies.names, zip(sweep.pairs.a.tolist(), sweep.pairs.b.tolist(), strict=True)
    compared = {tuple(sorted((names[a], names[b]))) for a, b in rows}
    assert {*pairs} == every - compared
    still = {each["name"] for each in found["bodies"] if each["joint"] == -1}
    still -= {each.name for each in setup.scene.moving}  # who may leave is compared with it
    assert not any({*pair} <= still for pair in compared)  # nor what stands still beside an obstacle that does


def test_shapes_are_those_of_the_page() -> None:
    cube = [[x, y, z] for x in (-0.05, 0.05) for y in (-0.1, 0.1) for z in (-0.15, 0.15)]
    ends = [[0.0, 0.0, -0.1], [0.0, 0.0, 0.1]]
    cells = [[x, y, z] for x in (0.0, 0.1) for y in (0.0, 0.1) for z in (0.0, 0.1)]
    shapes: dict[Shape | Cloud | Voxels, tuple[Any, Any, Any]] = {
        Box([0.1, 0.2, 0.3]): (cube, None, [[0.0] * 3]),
        Sphere(0.1): ([[0.0] * 3], None, [[0.1] * 3]),
        Ellipsoid([0.1, 0.2, 0.3]): ([[0.0] * 3], None, [[0.1, 0.2, 0.3]]),
        Cylinder(0.1, 0.2): (ends, None, [[0.1, 0.1, 0.0]]),
        Capsule(0.1, 0.2): (ends, None, [[0.1] * 3]),
        Points(CORNERS): (CORNERS, None, [[0.0] * 3]),
        Cloud(CORNERS, 0.01): (None, [[i] for i in range(4)], [[0.01] * 3] * 4),
        Voxels(np.ones((1, 1, 1), dtype=bool), 0.1): (cells, [[*range(8)]], [[0.0] * 3]),
    }
    scene = load_scene("panda_cup")
    scene = replace(scene, obstacles=[*shapes])
    found = [each["shape"] for each in world(scene)["bodies"] if each["kind"] == "obstacle"]
    names = re.findall(r"`(\w+)`", PAGE[PAGE.index("A **shape**") : PAGE.index("A mesh is scaled first")])
    for shape, (kind, (points, parts, sweep)) in zip(found, shapes.items(), strict=True):
        assert [*shape] == ["points", "parts", "sweep", "off"]
        assert type(kind).__name__.lower() in names
        assert points is None or np.abs(np.array(shape["points"]) - points).max() < 1e-15
        assert (shape["parts"], shape["sweep"]) == (parts, sweep)
        assert (0.0 < shape["off"] < 1e-10) == isinstance(kind, Cloud | Voxels)
        assert isinstance(kind, Cloud | Voxels) or shape["off"] == 0.0


# --- its numbers ------------------------------------------------------------------------------------------------------


def frames_of(found: World, rows: Array) -> Array:
    """Places of the joints (k, m, 4, 4) at rows (k, n) of joints that follow none, composed from a world's numbers."""
    free = iter(rows.T)
    values: list[Array] = [np.empty(0)] * len(found["joints"])
    for i, joint in enumerate(found["joints"]):
        if joint["follows"] is None:
            values[i] = next(free)
    for i, joint in enumerate(found["joints"]):
        if joint["follows"]:
            leader, factor, offset = joint["follows"]
            values[i] = factor * values[leader] + offset
    placed: list[Array] = []
    for joint, at in zip(found["joints"], values, strict=True):
        moved, axis = np.tile(np.eye(4), (len(rows), 1, 1)), np.array(joint["axis"])
        if joint["kind"] == "prismatic":
            moved[:, :3, 3] = at[:, None] * axis
        else:
            cross = np.cross(np.eye(3), axis)
            turn, lift = np.sin(at)[:, None, None], (1.0 - np.cos(at))[:, None, None]
            moved[:, :3, :3] += turn * cross + lift * cross @ cross
        above = np.eye(4) if joint["parent"] < 0 else placed[joint["parent"]]
        placed.append(above @ matrix(joint) @ moved)
    return np.stack([*placed, np.tile(np.eye(4), (len(rows), 1, 1))], axis=1)  # the last one, -1, is the world


def matrix(frame: World) -> Array:
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = np.reshape(frame["rotation"], (3, 3)), frame["position"]
    return found


def placed_alike(setup: Setup) -> None:
    """Assert that links and bodies are where Pinocchio has them at 50 random configurations."""
    robot, found = setup.robot, world_of(setup, straight(setup))
    rows = robot.draw(np.random.default_rng(0), 50)
    frames, data, geometry = frames_of(found, rows), robot.model.createData(), pin.GeometryData(robot.collision)
    bodies = [each for each in found["bodies"] if each["kind"] != "obstacle"]
    links = {str(f.name): i for i, f in enumerate(robot.model.frames) if f.type == pin.FrameType.BODY}
    assert {*links} == {*found["links"]}
    held = [each.name for each in robot.attached]
    order = [*sorted({*robot.link_geometry} - {*held}), *held]
    rows_of = [i for name in order for i in robot.link_geometry[name]]
    assert [each["name"] for each in bodies] == [name for name in order for _ in robot.link_geometry[name]]
    for row, place in zip(robot.pin_q(rows), frames, strict=True):
        pin.framesForwardKinematics(robot.model, data, row)
        pin.updateGeometryPlacements(robot.model, data, robot.collision, geometry)
        for name, index in links.items():
            link = found["links"][name]
            np.testing.assert_allclose(place[link["joint"]] @ matrix(link), data.oMf[index].homogeneous, atol=1e-9)
        for body, i in zip(bodies, rows_of, strict=True):
            there = geometry.oMg[i]
            np.testing.assert_allclose(place[body["joint"]] @ matrix(body), there.homogeneous, atol=1e-9)


ROBOTS = {(spec.name, spec.urdf, spec.base): name for name in SHIPPED for spec in [load_scene(name).robot]}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ROBOTS.values())
def test_robots_of_shipped_scenes_are_where_pinocchio_has_them(name: str) -> None:
    placed_alike(Setup.of(load_scene(name)))


def lifter(folder: Path, **sections: Any) -> Scene:
    """A robot of which four joints follow others, two in a chain, on a turned base."""
    robot = RobotSpec(urdf=linkage_urdf(folder), base=TURNED)
    return Scene(robot=robot, start=[-1.0, 0.3, -0.5, 0.2, 0.4], goal=[1.0, 0.6, -0.2, 0.5, -0.4], **sections)


def test_robots_with_followers_or_a_base_that_moves_or_hangs_are_where_pinocchio_has_them(tmp_path: Path) -> None:
    wheels = hdplan.PlanarBase(x=(-2.0, 2.0), y=(-1.0, 1.0), yaw=(-3.0, 3.0))
    for spec in (RobotSpec(name="ur5", base=TURNED, base_joints=wheels), RobotSpec(name="ur5", base=TURNED)):
        n = load_robot(spec).n
        placed_alike(Setup.of(Scene(robot=spec, start=[0.0] * n, goal=[0.1] * n)))
    placed_alike(Setup.of(lifter(tmp_path)))


def test_followers_and_what_limits_them(tmp_path: Path) -> None:
    """Each joint has its own limits; the planned ones are not narrowed by what follows them, nor are its velocities."""
    given = Limits(velocity={"lift": 0.5}, acceleration=2.0)
    found = world(lifter(tmp_path, limits=given, timing=Timing(duration=3.0)))
    names = [joint["name"] for joint in found["joints"]]
    follows = {joint["name"]: joint["follows"] for joint in found["joints"] if joint["follows"]}
    assert names == ["turn", "cylinder", "lift", "elbow", "roll", "bend", "slide", "piston", "rod"]
    lift, elbow = names.index("lift"), names.index("elbow")
    assert follows == {
        "cylinder": [lift, -0.25, 0.0], "piston": [lift, -1.25, 0.1], "rod": [elbow, -1.0, 0.0],
        "slide": [elbow, 0.05, 0.02],
    }  # fmt: skip
    limits = {key: dict(zip(names, each, strict=True)) for key, each in found["limits"].items()}
    none = [None, None]
    assert limits["position"] == {
        "turn": [-2.9, 2.9], "cylinder": none, "lift": [-1.1, 1.4], "elbow": [-2.5, 1.2], "roll": none,
        "bend": [-2.0, 2.0], "slide": [-0.07, 0.09], "piston": none, "rod": none,
    }  # fmt: skip
    velocities = {"lift": 0.5, "turn": 1.5, "elbow": 1.5, "bend": 1.5, "slide": 1.5, "roll": 3.0}
    assert limits["velocity"] == dict.fromkeys(names) | velocities
    assert limits["acceleration"] == dict.fromkeys(names, 2.0)
    assert found["duration"] == 3.0


@pytest.mark.parametrize("name", ["panda_heavy", "ur5_payload"])
def test_loads_give_pinocchios_inertia_and_gravity(name: str) -> None:
    """The mass matrix and the torques at rest, from a world's numbers: each joint's body by its Jacobian."""
    setup = Setup.of(load_scene(name))
    found, model = world_of(setup, straight(setup)), setup.loaded_model
    rows = setup.robot.draw(np.random.default_rng(1), 20)
    parents = [joint["parent"] for joint in found["joints"]]
    for q, frames in zip(rows, frames_of(found, rows), strict=True):
        inertia, gravity = np.zeros((len(q), len(q))), np.zeros(len(q))
        for j, load in enumerate(found["loads"]):
            turn, origin = frames[j][:3, :3], frames[j][:3, 3]
            jacobian, i = np.zeros((6, len(q))), j
            while i >= 0:  # velocity of the frame's origin, and spin, in the world
                axis = frames[i][:3, :3] @ found["joints"][i]["axis"]
                jacobian[:, i] = np.r_[np.cross(axis, origin - frames[i][:3, 3]), axis]
                i = parents[i]
            mass, moment = load["mass"], turn @ load["moment"]
            about = np.zeros((3, 3))
            about[np.triu_indices(3)] = load["inertia"]
            about = turn @ (about + np.triu(about, 1).T) @ turn.T
            cross = np.cross(np.eye(3), moment)
            spatial = np.block([[mass * np.eye(3), -cross], [cross, about]])
            inertia += jacobian.T @ spatial @ jacobian
            gravity += jacobian.T @ (spatial @ [0, 0, 9.81, 0, 0, 0])
        data = model.createData()
        expected = np.triu(pin.crba(model, data, q))
        np.testing.assert_allclose(inertia, expected + np.triu(expected, 1).T, atol=1e-9)
        np.testing.assert_allclose(gravity, pin.computeGeneralizedGravity(model, data, q), atol=1e-9)
    held = sum(each.mass or 0.0 for each in (*setup.scene.attached, setup.scene.payload) if each)
    assert sum(load["mass"] for load in found["loads"]) > held > 0.0


def test_meshes_are_those_of_their_files_in_order(tmp_path: Path) -> None:
    """Scaled and mirrored, with equal points once, without triangles that have lost a corner."""
    rng = np.random.default_rng(2)
    for k in range(12):
        points = rng.integers(-3, 4, size=(20, 3)) + rng.choice([0.0, 0.1, 1 / 3])
        rows = rng.integers(0, len(points), size=(60, 3))
        text = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in points.tolist())
        text += "".join(f"f {a} {b} {c}\n" for a, b, c in (rows + 1).tolist() if len({a, b, c}) == 3)
        rows = rows[[len({*row}) == 3 for row in rows.tolist()]]
        (tmp_path / f"soup{k}.obj").write_text(text)
        scale = rng.choice([-1.0, 1.0], 3) * rng.choice([0.001, 0.7, 1.0], 3)
        factors = " ".join(map(repr, scale.tolist()))
        (tmp_path / "soup.urdf").write_text(
            '<robot name="soup"><link name="base"/><link name="tip"><collision><geometry>'
            f'<mesh filename="soup{k}.obj" scale="{factors}"/></geometry></collision></link>'
            '<joint name="turn" type="continuous"><parent link="base"/><child link="tip"/></joint></robot>'
        )
        mesh = Mesh(tmp_path / f"soup{k}.obj", np.abs(scale))
        scene = Scene(robot=RobotSpec(urdf=tmp_path / "soup.urdf"), obstacles=[mesh], start=[0.0], goal=[0.1])
        for body, factors in zip(world(scene)["bodies"], (scale, np.abs(scale)), strict=True):
            expected = (points * factors)[rows[:, :: -1 if np.prod(factors) < 0 else 1]]
            proper = [len({tuple(corner) for corner in each}) == 3 for each in (expected + 0.0).tolist()]
            corners = np.array(body["shape"]["parts"])
            np.testing.assert_array_equal(np.array(body["shape"]["points"])[corners], expected[proper])
            first = np.unique(corners, return_index=True)[1]
            assert (np.diff(first) > 0).all()
            assert len({*map(tuple, body["shape"]["points"])}) == len(first) == len(body["shape"]["points"])


def test_bounds_hold_for_quaternions_that_are_kept_as_they_are(tmp_path: Path) -> None:
    """Their length is within 1e-12 of 1: of poses, and of the base far from the joints that it carries."""
    rng = np.random.default_rng(3)
    for _ in range(200):
        quaternion = rng.normal(size=4)
        quaternion *= (1.0 + rng.choice([-0.9e-12, 0.9e-12])) / np.linalg.norm(quaternion)
        pose = Pose(rng.choice([0.0, 1.0, 50.0]) * rng.normal(size=3), quaternion)
        exact = Rotation.from_quat(quaternion).as_matrix()
        off = np.abs(np.reshape(frame_of(pose)["rotation"], (3, 3)) - exact).max()
        assert off <= frame_of(pose)["off"]
    spec = RobotSpec(urdf=linkage_urdf(tmp_path), base=Pose((-30.0, 0.0, 0.0), (0.0, 0.0, 1.0 + 0.9e-12, 0.0)))
    text = spec.urdf.read_text().replace('<origin xyz="0 0 0.5"/>', '<origin xyz="-30 0 0.5"/>')
    spec.urdf.write_text(text)
    joint = world(Scene(robot=spec, start=[0.0] * 5, goal=[0.1] * 5))["joints"][0]
    assert 1e-12 < np.abs(np.subtract(joint["position"], [0.0, 0.0, 0.5])).max() <= joint["off"]


# --- what matters, and what does not ----------------------------------------------------------------------------------


def backwards(value: Any) -> Any:
    """The same with the keys of all mappings the other way round."""
    if isinstance(value, dict):
        return {key: backwards(value[key]) for key in reversed(value)}
    return [backwards(each) for each in value] if isinstance(value, list) else value


@pytest.mark.parametrize("name", ["panda_cup", "panda_heavy", "panda_conveyor", "baxter_bimanual_carry", "pr2_shelf"])
def test_order_and_origin_of_a_scene_do_not_change_its_world(name: str, tmp_path: Path) -> None:
    """The order of keys, scenes made in Python or read from a file, the order and the number of a motion's columns."""
    setup = Setup.of(load_scene(name))
    found, robot = written(world_of(setup, straight(setup))), setup.robot
    load_scene(name).save(tmp_path / "whole.yaml")
    whole = yaml.safe_load((tmp_path / "whole.yaml").read_text())
    (tmp_path / "turned.yaml").write_text(yaml.safe_dump(backwards(whole), sort_keys=False))
    assert world(load_scene(tmp_path / "turned.yaml")) == found
    assert world(load_scene(tmp_path / "whole.yaml")) == found
    assert world(replace(load_scene(name), name="other")) == found
    held = dict(list(robot.locked.items())[:2])
    names = (*reversed(robot.joint_names), *held)
    rows = straight(setup).positions[:, ::-1]
    more = Trajectory(names, np.hstack([rows, np.tile([*held.values()], (2, 1))]), robot.locked, straight(setup).times)
    assert written(world_of(setup, more)) == found


def put(*path: Any, to: Any = None) -> Callable[[World], None]:
    """A change of one value of a scene's file; a function gets the old one, which is None where there was none."""

    def change(world: World) -> None:
        for key in path[:-1]:
            world = world[key] if isinstance(world, list) else world.setdefault(key, {})
        world[path[-1]] = to(world[path[-1]]) if callable(to) else to

    return change


def more(value: float) -> float:
    return value + 1e-6


PLACE = ("pose", "position", 0)
CHANGES: dict[str, tuple[str, Callable[[World], None], str]] = {  # scene, change, keys of the world that change
    "range": ("panda_cup", put("limits", "position", to={"panda_joint1": [-2.0, 2.0]}), "limits"),
    "pose": ("panda_cup", put("obstacles", 0, *PLACE, to=more), "bodies"),
    "size": ("panda_cup", put("obstacles", 0, "shape", "size", 1, to=more), "bodies"),
    "name": ("panda_cup", put("obstacles", 0, "name", to="other"), "bodies"),
    "scale": ("panda_table_pick", put("obstacles", 3, "shape", "scale", to=1.001), "bodies"),
    "own": ("panda_cup", put("obstacles", 0, "clearance", to=0.001), "clearances"),
    "clearance": ("panda_cup", put("planner", "clearance", to=0.0015), "clearances"),
    "self": ("panda_cup", put("self_collision", "clearance", to=0.001), "clearances"),
    "alone": ("panda_cup", put("self_collision", to=False), "not_compared"),
    "held": ("panda_cup", put("robot", "locked", "panda_finger_joint1", to=0.02), "held links bodies"),
    "base": ("panda_cup", put("robot", "base", to={"position": [0, 0, 1e-6]}), "joints links bodies"),
    "ignored": ("panda_cup", put("robot", "ignore_pairs", to=[["panda_hand", "panda_link2"]]), "not_compared"),
    "checked": ("panda_cup", put("robot", "check_pairs", to=[["panda_hand", "panda_link5"]]), "not_compared"),
    "cup": ("panda_cup", put("attached", 0, *PLACE, to=more), "bodies"),
    "touching": ("panda_cup", put("attached", 0, "touch_links", to=["panda_link5"]), "not_compared"),
    "start": ("panda_cup", put("start", "joints", 0, to=more), "start motion"),
    "goal": ("panda_cup", put("goal", "joints", 0, to=more), "goal"),
    "choice": ("panda_cup", put("goal", to={"any": [{"joints": [0.0, 0, 0, -1, 0, 1, 0]}]}), "goal"),
    "pose goal": ("panda_grasp", put("goal", *PLACE, to=more), "goal"),
    "upright": ("panda_cup", put("path", "upright", "tolerance", to=more), "path"),
    "pair": ("baxter_bimanual_carry", put("path", "relative", "position_tolerance", to=more), "path"),
    "objective": ("panda_cup", put("planner", "objective", to="smoothness"), "also"),
    "slower": ("ur5_payload", put("timing", to={"scale": 0.5}), "also"),
    "speed": ("panda_heavy", put("limits", "velocity", to=1.0), "limits"),
    "jerk": ("panda_heavy", put("limits", "jerk", to=999), "limits"),
    "torque": ("panda_heavy", put("limits", "torque", to=80), "limits"),
    "mass": ("panda_heavy", put("attached", 0, "mass", to=more), "loads"),
    "payload": ("ur5_payload", put("payload", "com", 0, to=more), "loads"),
    "speed of a carton": ("panda_conveyor", put("obstacles", 1, "motion", "velocity", 0, to=more), "tracks"),
    "way of a gate": ("panda_conveyor", put("obstacles", 3, "motion", "poses", 1, "position", 0, to=more), "tracks"),
    "duration": ("panda_conveyor", put("timing", "duration", to=more), "duration motion tracks"),
}


@pytest.mark.parametrize("what", CHANGES)
def test_a_changed_input_changes_its_own_keys_of_the_world(what: str, tmp_path: Path) -> None:
    name, change, keys = CHANGES[what]
    load_scene(name).save(tmp_path / "whole.yaml")
    whole = yaml.safe_load((tmp_path / "whole.yaml").read_text())
    found = world(load_scene(tmp_path / "whole.yaml"))
    change(whole)
    (tmp_path / "changed.yaml").write_text(yaml.safe_dump(whole))
    other = world(load_scene(tmp_path / "changed.yaml"))
    assert {key for key in found if found[key] != other[key]} == {*keys.split()}


def test_the_first_reason_counts(tmp_path: Path) -> None:
    """Some pairs are left out for several; a pair to be checked is left out only where it moves as one."""
    links = {"base": "", "a": "base", "a_tip": "a", "b": "a", "c": "b", "d": "c"}
    parts = [link_text(name, sphere=0.02) for name in links]
    for name, parent in [each for each in links.items() if each[1]]:
        kind, at = ("fixed", "0 0.1 0") if name == "a_tip" else ("continuous", "0.05 0 0.15")
        parts.append(joint_text(f"to_{name}", parent, name, "1 0 0", kind=kind, at=at))
    write_robot(tmp_path / "r.urdf", *parts)
    off = (("a", "a_tip"), ("a", "b"), ("b", "c"), ("b", "d"), ("a", "d"), ("base", "c"))
    text = "".join(f'<disable_collisions link1="{a}" link2="{b}" reason="Never"/>' for a, b in off)
    (tmp_path / "r.srdf").write_text(f'<robot name="r">{text}</robot>')
    pairs = {"ignore_pairs": [("b", "d"), ("base", "d")], "check_pairs": [("a", "a_tip"), ("a", "d"), ("c", "d")]}
    spec = RobotSpec(urdf=tmp_path / "r.urdf", srdf=tmp_path / "r.srdf", **pairs)
    ball = Attached("ball", "d", Sphere(0.1), touch_links=["c", "d"])
    held = [ball, Attached("foot", "base", Sphere(0.1), touch_links=["ball"])]
    ends = {"start": [1.0] * 4, "goal": [0.0] * 4}
    moving = hdplan.Obstacle("drone", Sphere(0.1), motion=hdplan.SteadyMotion())
    scene = Scene(robot=spec, attached=held, obstacles=[Box([0.1] * 3, name="Box"), moving], **ends)
    reasons = {
        "moving as one": ["a a_tip", "ball d", "base foot"], "the SRDF": ["a b", "b c", "base c"],
        "robot.ignore_pairs": ["b d", "base d"], "touch_links": ["ball c", "ball foot"], "neighbours": ["a base"],
    }  # fmt: skip
    expected = [[*pair.split(), reason] for reason, pairs in reasons.items() for pair in pairs]
    assert not_compared(Setup.of(scene)) == sorted(expected)
    nothing = replace(scene, robot=replace(spec, check_pairs=()), self_collision=hdplan.SelfCollision(checked=False))
    alone = not_compared(Setup.of(nothing))
    own = ["a", "a_tip", "b", "ball", "base", "c", "d", "foot"]
    assert alone == [[one, other, "self_collision: false"] for i, one in enumerate(own) for other in own[i + 1 :]]


def test_targets_say_what_they_name() -> None:
    """A state's values for held joints, unless the scene says where these stand; the link of a pose that names none;
    targets in their order."""
    found = world("empty")
    assert found["start"][0]["others"] == {}
    empty = load_scene("empty")
    free = world(replace(empty, robot=replace(empty.robot, locked={})))
    assert free["start"][0]["others"].keys() == {"panda_finger_joint1"}
    assert free["start"][0]["others"].items() <= free["held"].items()
    assert found["goal"] == [{"joints": [1.2, 0.4, -0.3, -1.6, 0.4, 2.0, 1.1], "others": {}}]
    assert found["held"] == {"panda_finger_joint1": 0.04, "panda_finger_joint2": 0.04}
    values = {f"panda_joint{i + 1}": value for i, value in enumerate(found["goal"][0]["joints"])}
    choice: list[Any] = [Pose((0.5, 0.0, 0.4)), values | {"panda_finger_joint2": 0.04}]
    bare = load_scene("empty").with_goal(choice)
    setup = Setup.of(bare)
    first, other = world_of(setup, straight(setup))["goal"]
    assert other == {"joints": [*values.values()], "others": {"panda_finger_joint2": 0.04}}
    (pose,) = first["poses"]
    assert pose["link"] == end_effector(setup.robot, "goal")
    assert (pose["position"], pose["rotation"], pose["off"]) == ([0.5, 0.0, 0.4], np.eye(3).ravel().tolist(), 0.0)
    assert world_of(Setup(bare, setup.robot), straight(setup))["goal"][0] == first


def test_the_motion_is_the_planned_one() -> None:
    """Rows of every rule are as they are planned."""
    for name, rule in (("planar_arm", "linear"), ("panda_conveyor", "cubic"), ("panda_heavy", "quintic")):
        setup = Setup.of(load_scene(name))
        q = setup.robot.draw(np.random.default_rng(4), 5)
        rates = [0.01 * q, 0.02 * q][: ("linear", "cubic", "quintic").index(rule)]
        motion = Trajectory(setup.robot.joint_names, q, {}, np.arange(5.0) if rates else None, *rates)
        found = world_of(setup, motion)["motion"]
        assert found["rule"] == rule
        assert found["positions"] == q.tolist()
        assert [found[key] for key in ("velocities", "accelerations") if key in found] == [x.tolist() for x in rates]
        assert found["times"] == ([0.0, 1.0, 2.0, 3.0, 4.0] if rates else None)
    result = hdplan.plan(load_scene("planar_arm"))
    setup = Setup.of(load_scene("planar_arm"))
    assert world_of(setup, result.trajectory)["motion"]["positions"] == result.trajectory.positions.tolist()


# --- what is refused --------------------------------------------------------------------------------------------------


def test_a_motion_or_robot_that_no_world_holds_is_refused(tmp_path: Path) -> None:
    scene = load_scene("planar_arm")
    setup = Setup.of(scene)
    with pytest.raises(InputError, match="joint 'nowhere' is not one of"):
        world_of(setup, Trajectory((*setup.robot.joint_names, "nowhere"), np.zeros((2, setup.robot.n + 1))))
    pair = setup.robot.self_pairs[0]
    unchecked = {**setup.robot.unchecked, pair: ALWAYS_TOUCHING}
    touching = replace(setup.robot, self_pairs=setup.robot.self_pairs[1:], unchecked=unchecked)
    words = f"links {pair[0]} and {pair[1]} always touch.*: name them in robot.ignore_pairs"
    with pytest.raises(InputError, match=words):
        not_compared(replace(setup, robot=touching))
    robot = load_robot(RobotSpec(urdf=linkage_urdf(tmp_path)))
    robot.model.jointPlacements[1].translation = np.ones(3)
    arm = Setup(lifter(tmp_path), robot)
    with pytest.raises(InputError, match="was changed after the robot was loaded"):
        world_of(arm, straight(arm))
