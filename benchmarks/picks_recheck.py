"""Re-check the motion of a job by code that shares nothing with hdplan's certificate: the scene as a file has it,
Pinocchio's kinematics, coal's distances, dense samples. It can refute a certificate, not give one.

Between two rows every joint is the quintic that has their positions, velocities and accelerations. What is held, what
may touch, and where what was let go stands is derived here from the stages. It knows the stages of `picks`: `move` to
poses, `line` by a shift, `grip`, `release`.
"""

from __future__ import annotations

import itertools
import json
import sysconfig
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

SHARE = Path(sysconfig.get_path("purelib")) / "cmeel.prefix" / "share"
DATA = SHARE / "example-robot-data" / "robots"
ROBOTS = {  # description, and pairs of links that its maker lets touch, or that this robot's meshes always do
    "panda": ("panda_description/urdf/panda.urdf", "panda_description/srdf/panda.srdf"),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "ur_description/srdf/ur5.srdf"),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", "xarm_description/srdf/xarm7.srdf"),
}
STEP = 5e-3  # [s] between samples
REACH = 5e-3 + 1e-6  # [m] of a hand from what it takes
OFF, TURNED = 1e-3 + 1e-6, 1e-2 + 1e-6  # [m] and [rad] that a pose, and a line, may be missed by
ROUNDING = 1e-6  # of a limit


class RefutedError(Exception):
    """What was certified does not hold, and why."""


class Scene:
    """The bodies of a scene, and the state of the job."""

    def __init__(self, scene: dict[str, Any], folder: Path) -> None:
        """Take a scene and the folder of its meshes."""
        urdf, srdf = (str(DATA / name) for name in ROBOTS[scene["robot"]["name"]])
        self.model = pin.buildModelFromUrdf(urdf)
        self.links = pin.buildGeomFromUrdf(self.model, urdf, pin.GeometryType.COLLISION, package_dirs=[str(SHARE)])
        self.links.addAllCollisionPairs()
        pin.removeCollisionPairs(self.model, self.links, srdf)
        self.data = self.model.createData()
        self.mimics = {
            str(joint.get("name")): str(mimic.get("joint"))
            for joint in ElementTree.parse(urdf).getroot().findall("joint")
            if (mimic := joint.find("mimic")) is not None
        }
        named = {str(frame.name): i for i, frame in enumerate(self.model.frames) if frame.type == pin.FrameType.BODY}
        self.frames = named
        owner = {i: str(self.model.frames[item.parentFrame].name) for i, item in enumerate(self.links.geometryObjects)}
        self.of_link = [owner[i] for i in range(len(owner))]
        ignored = {frozenset(pair) for pair in scene["robot"].get("ignore_pairs", ())}
        joint = [self.model.frames[named[link]].parentJoint for link in self.of_link]
        self.self_pairs = [
            (pair.first, pair.second)
            for pair in self.links.collisionPairs
            if frozenset((self.of_link[pair.first], self.of_link[pair.second])) not in ignored
            and joint[pair.first] != joint[pair.second]
            and self.model.parents[joint[pair.second]] != joint[pair.first]
            and self.model.parents[joint[pair.first]] != joint[pair.second]
        ]
        self.shapes = {each["name"]: _shape(each["shape"], folder) for each in scene["obstacles"]}
        self.places = {each["name"]: _matrix(each["pose"]) for each in scene["obstacles"]}
        self.held: dict[str, tuple[str, np.ndarray, set[str]]] = {}  # link, pose in it, links that hold it
        self.balls = [_ball(item.geometry) for item in self.links.geometryObjects]
        self.balls_of = {name: _ball(shape) for name, shape in self.shapes.items()}

    def place(self, q: np.ndarray) -> None:
        """Bring the links, and what is held, to where they are at joint values."""
        pin.framesForwardKinematics(self.model, self.data, q)
        for name, (link, pose, _) in self.held.items():
            self.places[name] = self.link(link) @ pose

    def link(self, name: str) -> np.ndarray:
        """Return the pose of a link, or of an object."""
        if name in self.places:
            return self.places[name]
        pose: np.ndarray = self.data.oMf[self.frames[name]].homogeneous.copy()
        return pose

    def _item(self, i: int) -> tuple[Any, np.ndarray, tuple[np.ndarray, float]]:
        item = self.links.geometryObjects[i]
        return item.geometry, (self.data.oMi[item.parentJoint] * item.placement).homogeneous, self.balls[i]

    def _thing(self, name: str) -> tuple[Any, np.ndarray, tuple[np.ndarray, float]]:
        return self.shapes[name], self.places[name], self.balls_of[name]

    def least(self, touch: set[frozenset[str]], claimed: float) -> tuple[float, tuple[str, str]]:
        """Return the least distance between what is compared, below what is claimed, and between which."""
        worst, between = claimed, ("", "")
        items = [self._item(i) for i in range(len(self.of_link))]
        things = {name: self._thing(name) for name in self.shapes}
        pairs: list[tuple[str, str, Any, Any]] = []
        apart = (
            set(things) - set(self.held) - {name for pair in touch for name in pair}
        )  # of which clearance is claimed
        for name, each in things.items():
            holding = self.held[name][2] if name in self.held else set()
            for link, item in zip(self.of_link, items, strict=True):
                if link not in holding and not _moves_with(self, link, name):
                    pairs.append((link, name, item, each))
            if name in self.held:
                pairs += [(name, other, each, there) for other, there in things.items() if other not in self.held]
        pairs += [(self.of_link[a], self.of_link[b], items[a], items[b]) for a, b in self.self_pairs]
        for one, other, (shape, pose, ball), (shape2, pose2, ball2) in pairs:
            if frozenset((one, other)) in touch:
                continue
            limit = worst if {one, other} & apart else min(worst, 0.0)
            middles = pose[:3, :3] @ ball[0] + pose[:3, 3], pose2[:3, :3] @ ball2[0] + pose2[:3, 3]
            if np.linalg.norm(middles[0] - middles[1]) - ball[1] - ball2[1] > limit:
                continue
            found = distance(shape, pose, shape2, pose2)
            if found < limit or found <= 0.0:  # of triangles that meet, coal says 0
                worst, between = found, (one, other)
        return worst, between


def _moves_with(scene: Scene, link: str, name: str) -> bool:
    """True if a link and an object cannot move against each other: held by the same joint, or both fast."""
    joint = scene.model.frames[scene.frames[link]].parentJoint
    if name in scene.held:
        return bool(joint == scene.model.frames[scene.frames[scene.held[name][0]]].parentJoint)
    return bool(joint == 0)


def distance(shape: Any, pose: np.ndarray, other: Any, pose2: np.ndarray) -> float:
    """Return coal's distance between two shapes; not above 0 where they meet."""
    result = coal.DistanceResult()
    at = [coal.Transform3s(np.asfortranarray(x[:3, :3]), x[:3, 3]) for x in (pose, pose2)]
    return float(coal.distance(shape, at[0], other, at[1], coal.DistanceRequest(), result))


def _ball(shape: Any) -> tuple[np.ndarray, float]:
    shape.computeLocalAABB()
    return np.array(shape.aabb_center), float(shape.aabb_radius)


def _shape(said: dict[str, Any], folder: Path) -> Any:
    match said["type"]:
        case "box":
            return coal.Box(*said["size"])
        case "cylinder":
            return coal.Cylinder(said["radius"], said["length"])
        case "sphere":
            return coal.Sphere(said["radius"])
        case "mesh":
            return coal.MeshLoader(coal.NODE_TYPE.BV_OBBRSS).load(str(folder / said["file"]), np.ones(3))
    raise ValueError(said["type"])


def _matrix(pose: dict[str, Any]) -> np.ndarray:
    found = np.eye(4)
    if "quaternion_xyzw" in pose:
        found[:3, :3] = Rotation.from_quat(pose["quaternion_xyzw"]).as_matrix()
    elif "rpy" in pose:
        found[:3, :3] = Rotation.from_euler("xyz", pose["rpy"]).as_matrix()
    found[:3, 3] = pose["position"]
    return found


class Motion:
    """The motion of a file."""

    def __init__(self, model: pin.Model, told: dict[str, Any], fixed: dict[str, float], mimics: dict[str, str]) -> None:
        """Take it, values of joints that it does not have, and joints that stand where others do."""
        at = {str(name): model.joints[i].idx_q for i, name in enumerate(model.names) if i}
        self.followers = [(at[one], at[other]) for one, other in mimics.items() if one not in told["joint_names"]]
        self.times = np.array(told["times"])
        self.q, self.v, self.a = (np.array(told[key]) for key in ("positions", "velocities", "accelerations"))
        self.names = told["joint_names"]
        known = {**fixed, **told.get("locked", {})}
        self.base = pin.neutral(model)
        for name, value in known.items():
            self.base[model.joints[model.getJointId(name)].idx_q] = value
        self.columns = [model.joints[model.getJointId(name)].idx_q for name in self.names]

    def at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return positions, velocities and accelerations at some times."""
        i = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        h = (self.times[i + 1] - self.times[i])[:, None]
        s = (times - self.times[i])[:, None] / h
        p0, p1, v0, v1 = self.q[i], self.q[i + 1], self.v[i] * h, self.v[i + 1] * h
        a0, a1 = self.a[i] * h * h, self.a[i + 1] * h * h
        d, dv, da = p1 - p0 - v0 - 0.5 * a0, v1 - v0 - a0, a1 - a0
        c3, c4, c5 = 10 * d - 4 * dv + 0.5 * da, -15 * d + 7 * dv - da, 6 * d - 3 * dv + 0.5 * da
        q = p0 + s * (v0 + s * (0.5 * a0 + s * (c3 + s * (c4 + s * c5))))
        v = (v0 + s * (a0 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / h
        a = (a0 + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))) / (h * h)
        return q, v, a

    def whole(self, q: np.ndarray) -> np.ndarray:
        """Return the values of all joints of the model; none of these robots has joints without limits."""
        found: np.ndarray = self.base.copy()
        found[self.columns] = q
        for follower, leader in self.followers:
            found[follower] = found[leader]
        return found


def recheck(scene: dict[str, Any], folder: Path, motion: Path) -> float:
    """Look at a motion again; return the least clearance that was met [m], over all stages. Raises RefutedError."""
    told = json.loads(motion.read_text())
    bodies = Scene(scene, folder)
    driven = Motion(bodies.model, told, scene["robot"].get("locked", {}), bodies.mimics)
    stages, marks = scene["job"], [each["row"] for each in told["stages"]]
    claims = {each["stage"]: each["clearance_m"] or 0.0 for each in told["verdict"]["stages"]}
    if [each["name"] for each in told["stages"]] != [each["name"] for each in stages]:
        raise RefutedError("stages are missing")
    least, limits = np.inf, _limits(bodies.model, driven.names, scene["limits"])
    for stage, (first, last) in zip(stages, itertools.pairwise([*marks, len(driven.times) - 1]), strict=True):
        begins, ends = driven.times[first], driven.times[last]
        times = np.append(np.arange(begins, ends, STEP), ends)
        rows, rates, pushes = driven.at(times)
        fingers = stage.keys() & {"grip", "release"}
        for k, (what, values) in enumerate((("velocity", rates), ("acceleration", pushes))):
            if not fingers and (np.abs(values) > limits[k] * (1 + ROUNDING) + 1e-9).any():
                raise RefutedError(f"{stage['name']}: {what} beyond its limit")
        if np.abs(rates[[0, -1]]).max() > 1e-9:
            raise RefutedError(f"{stage['name']}: does not begin and end at rest")
        touch = {
            frozenset((one, other))
            for one, others in stage.get("touch", ())
            for other in (others if isinstance(others, list) else [others])
        }
        poses = []
        for q in rows:
            bodies.place(driven.whole(q))
            found, between = bodies.least(touch, claims[stage["name"]])
            if found < claims[stage["name"]] - 1e-6 or found <= 0.0 < len(between[0]):
                raise RefutedError(
                    f"{stage['name']}: {' and '.join(between)} are {found * 1e3:.3f} mm apart, "
                    f"{claims[stage['name']] * 1e3:.3f} mm are claimed"
                )
            least = min(least, found)
            if said := stage.get("line"):
                poses.append(bodies.link(said["link"]))
        _done(bodies, stage, poses)
    return float(least)


def _limits(model: pin.Model, names: list[str], said: dict[str, Any]) -> tuple[np.ndarray, float]:
    fast = [model.velocityLimit[model.joints[model.getJointId(name)].idx_v] for name in names]
    return np.array(fast), said["acceleration"]


def _done(bodies: Scene, stage: dict[str, Any], poses: list[np.ndarray]) -> None:
    """Check what a stage was to do, and do to objects what it does."""
    name = stage["name"]
    if said := stage.get("move"):
        if not any(_reached(bodies.link(each["link"]), each) for each in said["poses"]):
            raise RefutedError(f"{name}: does not end at one of its poses")
    elif said := stage.get("line"):
        way = np.array(said["by"])
        if said.get("frame") == "tool":
            way = poses[0][:3, :3] @ way
        along = np.clip([(x[:3, 3] - poses[0][:3, 3]) @ way / (way @ way) for x in poses], 0.0, 1.0)
        off = [np.linalg.norm(x[:3, 3] - poses[0][:3, 3] - s * way) for x, s in zip(poses, along, strict=True)]
        turned = [Rotation.from_matrix(poses[0][:3, :3].T @ x[:3, :3]).magnitude() for x in poses]
        if max(off) > OFF or max(turned) > TURNED or along[-1] < 1.0 - OFF / np.linalg.norm(way):
            raise RefutedError(f"{name}: leaves its line by {max(off) * 1e3:.3f} mm, {max(turned):.4f} rad")
    elif said := stage.get("grip"):
        what, holding = said["object"], {each for pair in stage["touch"] for each in pair[1]}
        for link in holding:
            near = min(
                distance(*bodies._item(i)[:2], *bodies._thing(what)[:2])
                for i, owner in enumerate(bodies.of_link)
                if owner == link
            )
            if near > REACH:
                raise RefutedError(f"{name}: {link} is {near * 1e3:.2f} mm from {what}")
        bodies.held[what] = said["link"], np.linalg.inv(bodies.link(said["link"])) @ bodies.places[what], holding
    elif said := stage.get("release"):
        del bodies.held[said["object"]]


def _reached(pose: np.ndarray, said: dict[str, Any]) -> bool:
    goal = _matrix(said)
    if np.linalg.norm(pose[:3, 3] - goal[:3, 3]) > OFF:
        return False
    if said.get("free_rotation") == "z":
        return bool(np.arccos(np.clip(pose[:3, 2] @ goal[:3, 2], -1.0, 1.0)) <= TURNED)
    return bool(Rotation.from_matrix(goal[:3, :3].T @ pose[:3, :3]).magnitude() <= TURNED)
