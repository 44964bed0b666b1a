"""A third reader: Pinocchio's parser of URDF, coal's loader of meshes and SciPy's rotations find in the files what the
checker reads: placements, shapes, triangles, masses, torques and limits. Nothing of hdplan takes part, but for the
joints that a shipped scene moves, which are a matter of SRDFs."""

from __future__ import annotations

import copy
import json
import xml.etree.ElementTree as ElementTree
from contextlib import nullcontext
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest
import yaml
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation, Slerp

import hdplan
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.robot_files.library import description_of
from hdplan.scenes.yaml_format.reader import find_scene, shipped_scenes
from hdplan.verify import RejectedError
from hdplan.verify.balls import Ball
from hdplan.verify.effects import Line, torques
from hdplan.verify.kernel import Motion
from hdplan.verify.reading import Reading, read_world
from hdplan.verify.world import World

from .worlds import kind_of, scene_files

Random = np.random.Generator

DATA = metadata.distribution("example-robot-data")
LIBRARY = Path(str(DATA.locate_file("cmeel.prefix/share/example-robot-data/robots")))
FILES = sorted(str(x.relative_to(LIBRARY)) for x in LIBRARY.glob("*/*/*.urdf"))
QUICK = ("panda_description/urdf/panda.urdf", "tiago_pro_description/robots/tiago_pro.urdf")
SCENES = [name for name in shipped_scenes() if name != "panda_camera"]  # see `test_seen`
QUICK_SCENES = ("panda_conveyor", "ur5_payload", "panda_heavy", "panda_vase")
# Meshes of several materials: coal 3.0.3 numbers the corners of each from 0, so that all but the first get wrong ones.
# Here the first has as many triangles.
MATERIALS = {"icub_simple_collision_head.dae": 189}
CLOSE = 1e-9  # [m or rad]
SINGLE = 2.0**-21  # of a mesh's size: Assimp keeps all numbers in single precision
FREE = 3.0  # [rad or m] within which joints without limits are drawn
MOST = 40  # joints that move at once

SIZES = ("size", "radius", "radii", "length", "points")
WHEELS, WHEELED = ("base_x", "base_y", "base_yaw"), ("base_origin", "base_at_x", "base_at_y")

Shape = tuple[str, Array]  # kind, and sizes or corners of triangles (F, 3, 3)


# --- Pinocchio's and coal's reading -----------------------------------------------------------------------------------


@dataclass
class Third:
    """A robot as Pinocchio and coal load it, every joint by itself."""

    model: pin.Model
    geometry: pin.GeometryModel
    base: pin.SE3
    rules: dict[str, tuple[str, float, float]]  # follower: leader, factor, offset

    @classmethod
    def of(cls, urdf: Path, base: pin.SE3) -> Third:
        model = pin.buildModelFromUrdf(str(urdf))
        model.gravity.linear = base.rotation.T @ [0.0, 0.0, -9.81]
        folders = [str(LIBRARY.parent.parent), str(LIBRARY), str(urdf.parent)]
        geometry = pin.buildGeomFromUrdf(model, str(urdf), pin.COLLISION, None, folders, coal.MeshLoader())
        rules = {}
        for joint in ElementTree.parse(urdf).getroot().findall("joint"):
            if (mimic := joint.find("mimic")) is not None and joint.get("type") != "fixed":
                factor, add = float(mimic.get("multiplier", "1")), float(mimic.get("offset", "0"))
                rules[joint.get("name", "")] = mimic.get("joint", ""), factor, add
        return cls(model, geometry, base, rules)

    @property
    def joints(self) -> list[str]:
        return list(self.model.names)[1:]

    def range_of(self, joint: str) -> list[float | None]:
        model, i = self.model, self.model.getJointId(joint)
        if model.nqs[i] == 2:  # turns without limits, by cosine and sine
            return [None, None]
        return [float(x[model.idx_qs[i]]) for x in (model.lowerPositionLimit, model.upperPositionLimit)]

    def rates(self, values: dict[str, float]) -> Array:
        """Velocities or accelerations of all joints."""
        found = np.zeros(self.model.nv)
        for name, x in values.items():
            found[self.model.idx_vs[self.model.getJointId(name)]] = x
        return found

    def q(self, values: dict[str, float]) -> Array:
        found: Array = pin.neutral(self.model)
        for name, x in values.items():
            i = self.model.getJointId(name)
            at = self.model.idx_qs[i]
            found[at : at + self.model.nqs[i]] = [np.cos(x), np.sin(x)] if self.model.nqs[i] == 2 else [x]
        return found

    def load(self, joint: int, moving: set[str], data: pin.Data) -> tuple[float, Array, Array]:
        """Mass, mass times centre and inertia about a joint's origin of what it carries up to the next that moves."""
        whole = pin.Inertia.Zero()
        for i, inertia in enumerate(self.model.inertias):
            at = i
            while at and self.model.names[at] not in moving:
                at = self.model.parents[at]
            if at == joint and inertia.mass:
                whole += data.oMi[joint].actInv(data.oMi[i]).act(inertia)
        lever = np.array(whole.lever)
        about = whole.inertia + whole.mass * (lever @ lever * np.eye(3) - np.outer(lever, lever))
        return whole.mass, whole.mass * lever, about

    def carry(self, top: dict[str, Any]) -> None:
        """Put a scene's payload and what its robot holds on the links that carry them."""
        bodies = []
        if section := top.get("payload"):
            six = np.array(section.get("inertia", [0.0] * 6))[np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])]
            inertia = pin.Inertia(section["mass"], np.array(section.get("com", [0.0] * 3)), six)
            bodies.append((section["link"], inertia, pin.SE3.Identity()))
        for each in top.get("attached", []):
            shape, mass = each["shape"], each.get("mass", 0.0)
            match shape["type"]:
                case "box":
                    inertia = pin.Inertia.FromBox(mass, *shape["size"])
                case "cylinder":
                    inertia = pin.Inertia.FromCylinder(mass, shape["radius"], shape["length"])
                case "sphere":
                    inertia = pin.Inertia.FromSphere(mass, shape["radius"])
                case kind:
                    assert not mass, kind
                    continue
            bodies.append((each["link"], inertia, pin.SE3(homogeneous(*pose_of(each.get("pose"))))))
        for link, inertia, place in bodies:
            frame = self.model.frames[self.links()[link]]
            self.model.appendBodyToJoint(frame.parentJoint, inertia, frame.placement * place)

    def room(self, joint: str) -> tuple[float, float]:
        """How far a joint can move, as far as its limits and those of what follows it go."""
        low, high = (x if x is not None else s * np.inf for x, s in zip(self.range_of(joint), (-1, 1), strict=True))
        for name, (leader, factor, offset) in self.rules.items():
            if leader == joint and factor:
                ends = [(x - offset) / factor for x in self.range_of(name) if x is not None] or [-np.inf, np.inf]
                low, high = max(low, min(ends)), min(high, max(ends))
        return low, high

    def links(self) -> dict[str, int]:
        frames = self.model.frames
        return {x.name: i for i, x in enumerate(frames) if x.type == pin.FrameType.BODY and x.name != "universe"}

    def bodies(self) -> list[tuple[str, int]]:
        """Links in the order of the alphabet, each with its geometry in the order of the URDF."""
        items = self.geometry.geometryObjects
        named = [(self.model.frames[x.parentFrame].name, int(x.name.rsplit("_", 1)[1]), i) for i, x in enumerate(items)]
        return [(link, i) for link, _, i in sorted(named)]


def shape_of(item: Any) -> Shape:
    """A geometry of Pinocchio's."""
    shape = item.geometry
    match type(shape).__name__:
        case "Box":
            return "box", 2 * np.array(shape.halfSide)
        case "Sphere":
            return "sphere", np.array([shape.radius])
        case "Ellipsoid":
            return "ellipsoid", np.array(shape.radii)
        case "Cylinder" | "Capsule" as kind:
            return kind.lower(), np.array([shape.radius, 2 * shape.halfLength])
    return "mesh", corners_of(shape, item.meshPath)


def corners_of(mesh: Any, file: str) -> Array:
    """Corners (F, 3, 3) of the triangles of coal's mesh."""
    corners = np.array([[x[0], x[1], x[2]] for x in map(mesh.tri_indices, range(mesh.num_tris))])
    first = MATERIALS.get(Path(file).name, len(corners))
    corners[first:] += corners[:first].max() + 1
    found: Array = np.asarray(mesh.vertices())[corners]
    return found


# --- the comparison ---------------------------------------------------------------------------------------------------


def same_shape(section: dict[str, Any], third: Shape, file: str = "") -> None:
    """Assert that a world's shape is coal's: kind and sizes, or triangles as sets of three points."""
    (own, sizes), (kind, numbers) = kind_of(section), third
    if kind == own != "mesh":
        np.testing.assert_allclose(sizes, np.ravel(numbers), rtol=1e-15)
        return
    assert own == kind
    corners = np.array(section["points"])[np.array(section["parts"])]
    off = 0.0 if binary(file) else SINGLE * np.abs(corners).max()
    proper = (numbers != np.roll(numbers, 1, axis=1)).any(axis=2).all(axis=1)
    one, two = _rows(corners), _rows(numbers[proper])
    assert _all_near(one, two, off)
    assert _all_near(two, one, 2 * off)
    assert off or len(one) == len(two)  # in single precision points may become equal


def binary(file: str) -> bool:
    """True if a mesh is a binary STL file, whose numbers are of single precision themselves."""
    data = Path(file).read_bytes()
    return file.lower().endswith(".stl") and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little")


def _rows(corners: Array) -> Array:
    """Triangles (F, 3, 3) as rows, in all six orders of their corners (6 F, 9)."""
    orders = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]]
    return np.concatenate([corners[:, x].reshape(-1, 9) for x in orders])


def _all_near(one: Array, two: Array, off: float) -> bool:
    """True if each row has one of the others within `off`, as far as it has three different corners then."""
    edges = np.abs(one.reshape(-1, 3, 3) - np.roll(one.reshape(-1, 3, 3), 1, axis=1)).max(axis=2).min(axis=1)
    rows = one[: len(one) // 6][edges[: len(one) // 6] > 2 * off]
    return bool((KDTree(two).query(rows, p=np.inf, distance_upper_bound=off + 1e-12)[0] <= off).all())


@dataclass
class Rows:
    """Values of joints in the middle between each two rows of a motion, and where the world has its frames there."""

    world: World
    frames: Array  # (k, n + 1, 4, 4), the last one the world's
    times: Array
    values: list[dict[str, float]]  # of all joints of the robot

    @classmethod
    def of(cls, reading: Reading, motion: dict[str, Any]) -> Rows:
        with np.errstate(all="ignore"):
            world = World(reading.world, {})
            k = len(world.control.mid)
            found = Motion(world, np.arange(k)[:, None] + [0.0, 1.0])
        frames = np.tile(np.eye(4), (k, len(world.joints) + 1, 1, 1))
        frames[:, :, :3, :3], frames[:, :, :3, 3] = found.turn.mid, found.at.mid
        given = motion["times"] or np.arange(len(motion["positions"])).tolist()
        times = np.array(given if world.times is None else world.times)
        times = (times[1:] + times[:-1]) / 2
        rows = zip(motion["joint_names"], np.transpose(motion["positions"]), strict=True)
        columns = {x: np.interp(times, given, y) for x, y in rows}
        values = [{x: float(y[i]) for x, y in columns.items()} for i in range(k)]
        return cls(world, frames, times, values)


def matrix(section: dict[str, Any]) -> Array:
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = np.reshape(section["rotation"], (3, 3)), section["position"]
    return found


def driven(values: dict[str, float]) -> Array:
    """Place of a mobile base, if the robot has one."""
    x, y, yaw = (values.get(name, 0.0) for name in WHEELS)
    return np.asarray(pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, yaw), np.array([x, y, 0.0])).homogeneous)


def completed(third: Third, values: dict[str, float], held: dict[str, float]) -> dict[str, float]:
    """Values of all joints: those that follow, from the URDF's rules; held ones as the world has them."""
    found = dict(values)

    def at(name: str) -> float:
        if name not in found:
            rule = third.rules.get(name)
            leads = rule is not None and rule[0] in third.joints and name not in free
            found[name] = rule[1] * at(rule[0]) + rule[2] if rule and leads else held[name]
        return found[name]

    free = {x for x in held if x not in third.rules}
    return {name: at(name) for name in third.joints}


def same_robot(reading: Reading, third: Third, rows: Rows) -> None:
    """Assert that links and bodies are where Pinocchio has them, and that their shapes are coal's."""
    world, data = reading.world, third.model.createData()
    placed, links = pin.GeometryData(third.geometry), third.links()
    bodies = [x for x in world["bodies"] if x["kind"] == "link"]
    assert {*world["links"]} - {*WHEELED} == {*links}
    assert [x["name"] for x in bodies] == [link for link, _ in third.bodies()]
    for body, (_, i) in zip(bodies, third.bodies(), strict=True):
        item = third.geometry.geometryObjects[i]
        same_shape(body["shape"], shape_of(item), item.meshPath)
    for frames, values in zip(rows.frames, rows.values, strict=True):
        q = third.q(completed(third, values, world["held"]))
        base = third.base.homogeneous @ driven(values)
        pin.framesForwardKinematics(third.model, data, q)
        pin.updateGeometryPlacements(third.model, data, third.geometry, placed)
        for name, i in links.items():
            link = world["links"][name]
            there = base @ data.oMf[i].homogeneous
            np.testing.assert_allclose(frames[link["joint"]] @ matrix(link), there, atol=CLOSE)
        for body, (_, i) in zip(bodies, third.bodies(), strict=True):
            there = base @ placed.oMg[i].homogeneous
            np.testing.assert_allclose(frames[body["joint"]] @ matrix(body), there, atol=CLOSE)


def same_dynamics(reading: Reading, third: Third, rows: Rows, rng: Random) -> None:
    """Assert that the kernel's bounds of torques are Pinocchio's torques, rounded up, and the masses its masses."""
    world, joints = reading.world, rows.world.joints[: rows.world.own]
    names = [x.name for x in joints]
    k, n = len(rows.values), len(names)
    whole = [completed(third, values, world["held"]) for values in rows.values]
    q = np.array([[values[name] for name in names] for values in whole])
    v, a = rng.uniform(-2, 2, (k, n)), rng.uniform(-5, 5, (k, n))
    parts = [((x["mass"], x["moment"], inertia_of(x)), x["off"]) for x in world["loads"]]
    loads = [[Ball(each, off) for each in three] for three, off in parts]
    with np.errstate(all="ignore"):
        bounds = torques(rows.world, loads, *(Line(x, np.zeros((k, n)), np.zeros((k, n))) for x in (q, v, a)))
    data, places = third.model.createData(), [third.model.idx_vs[third.model.getJointId(x)] for x in names]
    for i, values in enumerate(whole):
        rates = (third.rates(dict(zip(names, x[i], strict=True))) for x in (v, a))
        found = np.abs(pin.rnea(third.model, data, third.q(values), *rates))[places]
        scale = CLOSE * (1.0 + found.max())
        assert (found <= bounds[i] + scale).all()
        assert (bounds[i] <= found + scale).all()
    pin.forwardKinematics(third.model, data, third.q(whole[0]))
    for name, load in zip(names, world["loads"], strict=True):
        mass, moment, about = third.load(third.model.getJointId(name), {*names}, data)
        slack = CLOSE * (1.0 + np.abs(about).max() + mass)
        assert abs(load["mass"] - mass) <= slack
        np.testing.assert_allclose(load["moment"], moment, atol=slack, rtol=0)
        np.testing.assert_allclose(inertia_of(load), about, atol=slack, rtol=0)


def inertia_of(load: dict[str, Any]) -> Array:
    """The matrix of a load's inertia."""
    found: Array = np.array(load["inertia"])[np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])]
    return found


def same_limits(reading: Reading, third: Third, given: dict[str, dict[str, float]]) -> None:
    """Assert that the limits are those of the URDF where the scene gives none of its own."""
    world = reading.world
    for i, joint in enumerate(world["joints"]):
        if (name := joint["name"]) in WHEELS:
            continue
        at = third.model.idx_vs[third.model.getJointId(name)]
        assert world["limits"]["position"][i] == third.range_of(name)
        for key, own in (("velocity", third.model.upperVelocityLimit), ("torque", third.model.upperEffortLimit)):
            urdf = float(own[at]) if 0 < own[at] < np.inf else None
            following = name in third.rules and key == "torque"
            assert world["limits"][key][i] == given[key].get(name, None if following else urdf)


# --- robots -----------------------------------------------------------------------------------------------------------

REFUSED = {  # by the checker, or by Pinocchio, in these words
    "hector_description/robots/quadrotor_base.urdf": "a joint appears twice, or there is none",  # it flies
    "iris_description/robots/iris_simple.urdf": "a joint appears twice, or there is none",
    "iris_description/robots/iris.urdf": "limit: '-1e\\+16' is not a number",  # numbers of a world are below 1e9
    "simple_humanoid_description/urdf/simple_humanoid.urdf": "<collision_checking> is not known",  # of capsules
    "ur_description/urdf/ur3.urdf": "does not contain a valid URDF model",  # macros
}


def written(folder: Path, scene: dict[str, Any], motion: dict[str, Any]) -> Reading:
    """A scene and a motion, written and read by the checker."""
    return read_world(*scene_files(folder, scene, motion))


def placed_base(rng: Random) -> tuple[dict[str, Any], pin.SE3]:
    """A pose of a base, in a scene's words and Pinocchio's."""
    position, rpy = rng.uniform(-1, 1, 3), rng.uniform(-3, 3, 3)
    return {"position": position.tolist(), "rpy": rpy.tolist()}, pin.SE3(pin.rpy.rpyToMatrix(rpy), position)


def no_bodies(urdf: Path) -> list[str]:
    """The links whose inertia no body has: of its principal moments one is negative, or above the others' sum."""
    found = []
    for link in ElementTree.parse(urdf).getroot().findall("link"):
        if (inertial := link.find("inertial")) is None:
            continue
        attributes = {**inertial.find("inertia").attrib, **inertial.find("mass").attrib}
        six = np.array([float(attributes[x]) for x in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")])
        moments = np.linalg.eigvalsh(inertia_of({"inertia": six}))
        room = 0.02 * np.abs(moments).max() + 2e-9
        good = moments[0] > -room and moments[2] < moments[0] + moments[1] + room
        if not good or (float(attributes["value"]) == 0 and moments[2] > 2e-9):
            found.append(link.get("name", ""))
    return found


def robot_compared(file: str, folder: Path, count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Read a robot at random configurations, some joints moving and the others held anywhere."""
    rng = np.random.default_rng(FILES.index(file))
    section, base = placed_base(rng)
    third = Third.of(LIBRARY / file, base)
    leading = [x for x in third.joints if x not in third.rules]
    ranges = {x: [FREE * s if abs(y) > 10 else y for y, s in zip(third.room(x), (-1, 1), strict=True)] for x in leading}
    drawn = {x: rng.uniform(min(y), max(y), count + 1) for x, y in ranges.items()}
    pin.computeSubtreeMasses(third.model, data := third.model.createData())
    heavy = {x for x in leading if data.mass[third.model.getJointId(x)] > 0}
    able = [x for x in leading if third.room(x)[0] < third.room(x)[1] and x in heavy] or leading
    group = sorted(rng.choice(able, min(MOST, -(-4 * len(able) // 5)), replace=False).tolist())
    spec: dict[str, Any] = {"urdf": str(LIBRARY / file), "base": section, "group": group}
    spec["locked"] = {x: float(drawn[x][0]) for x in leading if x not in group}
    wheels = {x: [-2.0, 2.0] for x in WHEELS} if rng.random() < 0.3 else {}
    if wheels:
        spec["base_joints"] = {x.removeprefix("base_"): y for x, y in wheels.items()}
        drawn |= {x: rng.uniform(-2, 2, count + 1) for x in wheels}
    columns = [*wheels, *group]
    motion = {"joint_names": columns, "positions": np.transpose([drawn[x] for x in columns]).tolist()}
    given: dict[str, dict[str, float]] = {"velocity": {}, "torque": {}}
    for key, own in (("velocity", third.model.upperVelocityLimit), ("torque", third.model.upperEffortLimit)):
        for name in columns:
            if name in wheels or not 0 < own[third.model.idx_vs[third.model.getJointId(name)]] < np.inf:
                given[key][name] = float(rng.uniform(1, 2))
    rest = {x: 0.0 for x in columns}
    scene = {"robot": spec, "limits": given, "start": {"joints": rest}, "goal": {"joints": rest}}
    timed = {**motion, "times": list(range(count + 1))}
    with monkeypatch.context() as patched:  # masses that no body has are compared all the same
        patched.setattr("hdplan.verify.loads.check_body", lambda *_: None)
        reading = written(folder, scene, timed)
    wrong = [x for x in no_bodies(LIBRARY / file) if reading.world["links"][x]["joint"] >= 0]
    with pytest.raises(RejectedError, match="no body has the inertia") if wrong else nullcontext():
        written(folder, scene, timed)
    assert not reading.taken
    rows = Rows.of(reading, timed)
    same_robot(reading, third, rows)
    same_limits(reading, third, given)
    if not wheels:
        same_dynamics(reading, third, rows, rng)


@pytest.mark.parametrize("file", QUICK)
def test_robots_are_those_of_pinocchio(file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    robot_compared(file, tmp_path, 5, monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize("file", FILES)
def test_every_robot_of_the_library_is_that_of_pinocchio(
    file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Some are refused, for the reason listed."""
    if file not in REFUSED:
        return robot_compared(file, tmp_path, 100, monkeypatch)
    with pytest.raises((RejectedError, ValueError), match=REFUSED[file]):
        robot_compared(file, tmp_path, 2, monkeypatch)
    return None


# --- scenes -----------------------------------------------------------------------------------------------------------


def pose_of(section: dict[str, Any] | None) -> tuple[Rotation, Array]:
    """A pose of a scene, by SciPy."""
    section = section or {}
    turn = Rotation.identity()
    if "rpy" in section:
        turn = Rotation.from_euler("xyz", section["rpy"])
    if "quaternion_xyzw" in section:
        turn = Rotation.from_quat(section["quaternion_xyzw"])
    return turn, np.array(section.get("position", [0.0, 0.0, 0.0]), dtype=float)


def homogeneous(turn: Rotation, at: Array) -> Array:
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = turn.as_matrix(), at
    return found


def place_of(entry: dict[str, Any], time: float) -> Array:
    """Place of an obstacle of a scene at a time."""
    turn, at = pose_of(entry.get("pose"))
    motion = entry.get("motion", {})
    if "times" in motion:
        poses, now = [pose_of(x) for x in motion["poses"]], np.clip(time, motion["times"][0], motion["times"][-1])
        turn = Slerp(motion["times"], Rotation.concatenate([x for x, _ in poses]))(now)
        at = np.array([np.interp(now, motion["times"], x) for x in np.transpose([x for _, x in poses])])
    elif motion:
        turn = Rotation.from_rotvec(time * np.array(motion.get("spin", [0.0] * 3))) * turn
        at = at + time * np.array(motion.get("velocity", [0.0] * 3))
    return homogeneous(turn, at)


def shape_in(section: dict[str, Any], folder: Path) -> tuple[Shape, str]:
    """A shape of a scene, meshes loaded by coal."""
    if section["type"] == "mesh":
        file = str(folder / section["file"])
        scale = np.broadcast_to(np.array(section.get("scale", 1.0), dtype=float), 3)
        return ("mesh", corners_of(coal.MeshLoader().load(file, np.array(scale)), file)), file
    sizes = [section[x] for x in SIZES if x in section]
    return (section["type"], np.hstack(sizes)), ""


def weighed(top: dict[str, Any], home: Path, folder: Path) -> Reading:
    """Read a scene of the folder `home` with a limit of all torques, and the motion in `folder`."""
    top = copy.deepcopy(top)
    top["limits"] = {**top.get("limits", {}), "torque": 1000}
    for section in (top["robot"], *(x["shape"] for x in top.get("obstacles", []) + top.get("attached", []))):
        section |= {x: str(home / section[x]) for x in ("urdf", "srdf", "file") if x in section}
    (folder / "scene.yaml").write_text(yaml.safe_dump(top))
    return read_world(folder / "scene.yaml", folder / "motion.json")


def scene_compared(name: str, folder: Path, count: int) -> None:
    """Read a shipped scene at random configurations, its robot, what that holds, and its obstacles at their times."""
    rng, file = np.random.default_rng(SCENES.index(name)), find_scene(name)
    top = yaml.safe_load(file.read_text())
    setup = Setup.of(hdplan.load_scene(name))
    lead = [*setup.robot.joint_names]
    turn, at = pose_of(top["robot"].get("base"))
    third = Third.of(description_of(setup.scene.robot)[1], pin.SE3(turn.as_matrix(), at))
    spans = [[FREE * s if x is None else x for x, s in zip(third.range_of(y), (-1, 1), strict=True)] for y in lead]
    times = np.cumsum(rng.uniform(0.01, 0.2, count + 1)).tolist()
    drawn = [rng.uniform(x[0], x[1], count + 1) for x in spans]
    motion = {"joint_names": lead, "positions": np.transpose(drawn).tolist(), "times": times}
    (folder / "motion.json").write_text(json.dumps({"hdplan_trajectory": 1, **motion}))
    reading = read_world(file, folder / "motion.json")
    assert not reading.taken
    rows = Rows.of(reading, motion)
    same_robot(reading, third, rows)
    third.carry(top)
    same_dynamics(weighed(top, file.parent, folder), third, rows, rng)
    held = [x for x in reading.world["bodies"] if x["kind"] == "held"]
    around = [x for x in reading.world["bodies"] if x["kind"] == "obstacle"]
    data, links = third.model.createData(), third.links()
    for body, entry in zip(held + around, top.get("attached", []) + top.get("obstacles", []), strict=True):
        assert body["name"] == entry["name"]
        same_shape(body["shape"], *shape_in(entry["shape"], file.parent))
        pieces = [x for x in rows.world.pieces if x.name == body["name"]]
        for frames, values, time in zip(rows.frames, rows.values, rows.times, strict=True):
            if body["kind"] == "held":
                q = third.q(completed(third, values, reading.world["held"]))
                pin.framesForwardKinematics(third.model, data, q)
                link = third.base.homogeneous @ data.oMf[links[entry["link"]]].homogeneous
                there = link @ homogeneous(*pose_of(entry.get("pose")))
            else:
                there = place_of(entry, time)
            piece = np.eye(4)
            piece[:3, :3], piece[:3, 3] = pieces[0].pose[0].mid, pieces[0].pose[1].mid
            np.testing.assert_allclose(frames[pieces[0].joint] @ piece, there, atol=CLOSE)


@pytest.mark.parametrize("name", QUICK_SCENES)
def test_scenes_are_those_of_scipy_and_coal(name: str, tmp_path: Path) -> None:
    scene_compared(name, tmp_path, 10)


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_every_shipped_scene_is_that_of_scipy_and_coal(name: str, tmp_path: Path) -> None:
    scene_compared(name, tmp_path, 100)
