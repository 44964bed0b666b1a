"""Re-check the motion of a job by code that shares nothing with hdplan's certificate: the scene as a file has it,
Pinocchio's kinematics, coal's distances, dense samples. It can refute a certificate, not give one.

Between two rows every joint is the quintic that has their positions, velocities and accelerations. What is held, what
may touch, and where what was let go stands is derived here from the stages. What may touch is looked at, too: it may
not press into each other. Fingers move in their own stages alone, to where these say; the arm stands still then. It
knows the stages of `picks`: `move` to poses, a held object upright or not, `line` by a shift, `grip`, `release`.
"""

from __future__ import annotations

import functools
import itertools
import json
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation
from sieges.machine import DATA, NAMED, SHARE
from sieges.poses import of_scene
from sieges.rows import Rows

STEP = 5e-3  # [s] between samples
REACH = 5e-3 + 1e-6  # [m] of a hand from what it takes
OFF, TURNED = 1e-3 + 1e-6, 1e-2 + 1e-6  # [m] and [rad] by which a pose, and a line, may be missed
DEEP = 3e-3  # [m] by which bodies that may touch may overlap
ROUNDING = 1e-6  # of a limit
STILL = 1e-9  # of joints that stand still


class RefutedError(Exception):
    """A certified property that does not hold, and the reason."""


@dataclass(frozen=True)
class Pairs:
    """Pairs of bodies that are compared, by numbers; of some a clearance is claimed, of others that they are apart."""

    one: np.ndarray
    other: np.ndarray
    cleared: np.ndarray


class Scene:
    """The bodies of a scene, and the state of the job. Bodies are numbered: parts of links, then objects."""

    def __init__(self, scene: dict[str, Any], folder: Path) -> None:
        """Take a scene and the folder of its meshes."""
        self.model, self.links, self.mimics = _robot(scene["robot"]["name"])
        self.data, self.at = self.model.createData(), self.links.createData()
        named = {str(frame.name): i for i, frame in enumerate(self.model.frames) if frame.type == pin.FrameType.BODY}
        self.frames = named
        owner = {i: str(self.model.frames[item.parentFrame].name) for i, item in enumerate(self.links.geometryObjects)}
        self.of_link = [owner[i] for i in range(len(owner))]
        ignored = {frozenset(pair) for pair in scene["robot"].get("ignore_pairs", ())}
        joint, above = [self.model.frames[named[link]].parentJoint for link in self.of_link], self.model.parents
        self.self_pairs = [
            (a, b)
            for a, b in ((pair.first, pair.second) for pair in self.links.collisionPairs)
            if frozenset((self.of_link[a], self.of_link[b])) not in ignored
            and joint[a] not in (joint[b], above[joint[b]])
            and joint[b] != above[joint[a]]
        ]
        self.shapes = {each["name"]: _shape(each["shape"], folder) for each in scene["obstacles"]}
        self.places = {each["name"]: of_scene(each["pose"]) for each in scene["obstacles"]}
        self.held: dict[str, tuple[str, np.ndarray, set[str]]] = {}  # link, pose in it, links that hold it
        solids = [*(item.geometry for item in self.links.geometryObjects), *self.shapes.values()]
        self.solids, self.names = solids, [*self.of_link, *self.shapes]
        boxes = np.array([_box(solid) for solid in solids])
        self.middles, self.halves = boxes[:, 0], boxes[:, 1]
        self.radii = np.linalg.norm(self.halves, axis=1)

    def place(self, q: np.ndarray) -> None:
        """Bring the links, and what is held, to where they are at joint values."""
        pin.framesForwardKinematics(self.model, self.data, q)
        pin.updateGeometryPlacements(self.model, self.data, self.links, self.at)
        for name, (link, pose, _) in self.held.items():
            self.places[name] = self.link(link) @ pose

    def link(self, name: str) -> np.ndarray:
        """Return the pose of a link, or of an object."""
        if name in self.places:
            return self.places[name]
        pose: np.ndarray = self.data.oMf[self.frames[name]].homogeneous.copy()
        return pose

    def poses(self) -> np.ndarray:
        """Return the poses of all bodies (B, 4, 4)."""
        return np.array([*(at.homogeneous for at in self.at.oMg), *(self.places[name] for name in self.shapes)])

    def numbers(self, name: str) -> list[int]:
        """Return the bodies of a link or an object."""
        return [i for i, owner in enumerate(self.names) if owner == name]

    def pairs(self, touch: set[frozenset[str]]) -> Pairs:
        """Return the pairs that are compared in a stage in which some may touch, with what is held now."""
        free = set(self.shapes) - set(self.held) - {name for pair in touch for name in pair}
        found = [*self.self_pairs]
        for name in self.shapes:
            (number,) = self.numbers(name)
            holding = self.held[name][2] if name in self.held else set()
            for i, link in enumerate(self.of_link):
                if link not in holding and not _moves_with(self, link, name):
                    found.append((i, number))
            if name in self.held:
                others = [other for other in self.shapes if other not in self.held]
                found += [(number, i) for other in others for i in self.numbers(other)]
        kept = [pair for pair in found if frozenset(self.names[i] for i in pair) not in touch]
        one, other = np.array(kept).T
        return Pairs(one, other, np.array([bool({self.names[i] for i in pair} & free) for pair in kept]))

    def least(self, pairs: Pairs, claimed: float) -> tuple[float, tuple[str, str]]:
        """Return the least distance between what is compared, below what is claimed, and between which."""
        worst, between, poses = claimed, ("", ""), self.poses()
        bound = np.maximum(*(self._apart(poses, *each) for each in itertools.permutations((pairs.one, pairs.other))))
        for k in np.flatnonzero(bound <= np.where(pairs.cleared, worst, min(worst, 0.0))):
            i, j = pairs.one[k], pairs.other[k]
            found = distance(self.solids[i], poses[i], self.solids[j], poses[j])
            if found <= 0.0 or found < (worst if pairs.cleared[k] else min(worst, 0.0)):  # of triangles, coal says 0
                worst, between = found, (self.names[i], self.names[j])
        return worst, between

    def distance(self, one: int, other: int, poses: np.ndarray) -> float:
        """Return the distance between two bodies at some poses (B, 4, 4)."""
        return distance(self.solids[one], poses[one], self.solids[other], poses[other])

    def nearest(self, name: str, others: Iterable[str]) -> float:
        """Return the distance from a link or an object to the nearest of others."""
        poses, there = self.poses(), [j for other in others for j in self.numbers(other)]
        return min((self.distance(i, j, poses) for i in self.numbers(name) for j in there), default=np.inf)

    def _apart(self, poses: np.ndarray, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Return lower bounds on distances: of a ball around each of some bodies from a box around the other one."""
        middle = np.einsum("bij,bj->bi", poses[:, :3, :3], self.middles) + poses[:, :3, 3]
        local = np.einsum("bji,bj->bi", poses[other, :3, :3], middle[one] - poses[other, :3, 3]) - self.middles[other]
        outside = np.maximum(np.abs(local) - self.halves[other], 0.0)
        apart: np.ndarray = np.linalg.norm(outside, axis=1) - self.radii[one]
        return apart


@functools.cache
def _robot(name: str) -> tuple[pin.Model, pin.GeometryModel, dict[str, str]]:
    """Return a robot's model, its links, and joints that follow others."""
    urdf, srdf = (str(DATA / file) for file in NAMED[name])
    model = pin.buildModelFromUrdf(urdf)
    links = pin.buildGeomFromUrdf(model, urdf, pin.GeometryType.COLLISION, package_dirs=[str(SHARE)])
    links.addAllCollisionPairs()
    pin.removeCollisionPairs(model, links, srdf)
    pin.loadReferenceConfigurations(model, srdf)
    mimics = {
        str(joint.get("name")): str(mimic.get("joint"))
        for joint in ElementTree.parse(urdf).getroot().findall("joint")
        if (mimic := joint.find("mimic")) is not None
    }
    return model, links, mimics


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


def _box(shape: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the middle and half the size of a box around a shape, in its own frame."""
    shape.computeLocalAABB()
    low, high = np.array(shape.aabb_local.min_), np.array(shape.aabb_local.max_)
    return 0.5 * (low + high), 0.5 * (high - low)


def _shape(shape: dict[str, Any], folder: Path) -> Any:
    match shape["type"]:
        case "box":
            return coal.Box(*shape["size"])
        case "cylinder":
            return coal.Cylinder(shape["radius"], shape["length"])
        case "sphere":
            return coal.Sphere(shape["radius"])
        case "mesh":
            return coal.MeshLoader(coal.NODE_TYPE.BV_OBBRSS).load(str(folder / shape["file"]), np.ones(3))
    raise ValueError(shape["type"])


class Motion:
    """The motion of a file."""

    def __init__(
        self, model: pin.Model, motion: dict[str, Any], fixed: dict[str, float], mimics: dict[str, str]
    ) -> None:
        """Take it, values of joints that it does not have, and joints that stand where others do."""
        at = {str(name): model.joints[i].idx_q for i, name in enumerate(model.names) if i}
        self.followers = [(at[one], at[other]) for one, other in mimics.items() if one not in motion["joint_names"]]
        self.names, self.times = motion["joint_names"], np.array(motion["times"])
        self.q, v, a = (np.array(motion[key]) for key in ("positions", "velocities", "accelerations"))
        self.rows = Rows(tuple(self.names), self.q, self.times, v, a)
        known = {**fixed, **motion.get("locked", {})}
        self.base = pin.neutral(model)
        for name, value in known.items():
            self.base[model.joints[model.getJointId(name)].idx_q] = value
        self.columns = [model.joints[model.getJointId(name)].idx_q for name in self.names]

    def at(self, times: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return positions, velocities, accelerations and jerks at some times."""
        i = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        s = (times - self.times[i]) / (self.times[i + 1] - self.times[i])
        return tuple(self.rows.at(i, s, order) for order in range(4))

    def whole(self, q: np.ndarray) -> np.ndarray:
        """Return the values of all joints of the model; none of these robots has joints without limits."""
        found: np.ndarray = self.base.copy()
        found[self.columns] = q
        for follower, leader in self.followers:
            found[follower] = found[leader]
        return found


def recheck(scene: dict[str, Any], folder: Path, motion: Path, step: float = STEP) -> float:
    """Look at a motion again; return the least clearance that was met [m], over all stages. Raises RefutedError."""
    content = json.loads(motion.read_text())
    bodies = Scene(scene, folder)
    driven = Motion(bodies.model, content, scene["robot"].get("locked", {}), bodies.mimics)
    stages, marks = scene["job"], [each["row"] for each in content["stages"]]
    claims = {each["stage"]: each["clearance_m"] or 0.0 for each in content["verdict"]["stages"]}
    if [each["name"] for each in content["stages"]] != [each["name"] for each in stages]:
        raise RefutedError("stages are missing")
    least, fingers = np.inf, {joint for stage in stages for joint in _fingers(stage)}
    _begins(bodies, driven, scene["start"], fingers)
    for stage, (first, last) in zip(stages, itertools.pairwise([*marks, len(driven.times) - 1]), strict=True):
        begins, ends = driven.times[first], driven.times[last]
        times = np.append(np.arange(begins, ends, step), ends)
        rows = _driven(bodies.model, driven, times, stage, fingers, scene["limits"])
        touch = {
            frozenset((one, other))
            for one, others in stage.get("touch", ())
            for other in (others if isinstance(others, list) else [others])
        }
        poses, pairs = [], bodies.pairs(touch)
        for q in rows:
            bodies.place(driven.whole(q))
            found, between = bodies.least(pairs, claims[stage["name"]])
            if found < claims[stage["name"]] - 1e-6 or found <= 0.0 < len(between[0]):
                apart = f"{found * 1e3:.3f} mm apart, {claims[stage['name']] * 1e3:.3f} mm are claimed"
                raise RefutedError(f"{stage['name']}: {' and '.join(between)} are {apart}")
            for one, other in map(tuple, touch):
                if (deep := -bodies.nearest(one, [other])) > DEEP:
                    raise RefutedError(f"{stage['name']}: {one} and {other} overlap by {deep * 1e3:.3f} mm")
            least = min(least, found)
            poses.append({name: bodies.link(name) for name in _followed(stage)})
        _done(bodies, stage, poses)
    return float(least)


def _fingers(stage: dict[str, Any]) -> dict[str, float]:
    """Return the finger positions at the end of a stage."""
    hand = stage.get("grip") or stage.get("release") or {}
    found: dict[str, float] = hand.get("joints", {})
    return found


def _begins(bodies: Scene, driven: Motion, start: dict[str, Any], fingers: set[str]) -> None:
    """Check that a motion begins where the scene has the arm."""
    joints = [bodies.model.joints[bodies.model.getJointId(name)] for name in driven.names if name not in fingers]
    at = driven.whole(driven.q[0])[[joint.idx_q for joint in joints]]
    if "state" in start:
        expected = bodies.model.referenceConfigurations[start["state"]][[joint.idx_q for joint in joints]]
    else:
        expected = start["joints"]
    if np.abs(at - expected).max() > STILL:
        raise RefutedError("the motion begins elsewhere")


def _driven(
    model: pin.Model,
    driven: Motion,
    times: np.ndarray,
    stage: dict[str, Any],
    fingers: set[str],
    limits: dict[str, Any],
) -> np.ndarray:
    """Return positions at the times of a stage, in which only joints move that are to move, within their limits."""
    name, moved = stage["name"], _fingers(stage)
    rows, rates, *pushes = driven.at(times)
    model_joints = [model.joints[model.getJointId(joint)] for joint in driven.names]
    columns = [joint.idx_q for joint in model_joints]
    low, high = model.lowerPositionLimit[columns], model.upperPositionLimit[columns]
    if ((rows < low - STILL) | (rows > high + STILL)).any():
        raise RefutedError(f"{name}: position beyond its limit")
    still = [joint not in moved if stage.keys() & {"grip", "release"} else joint in fingers for joint in driven.names]
    if np.ptp(rows, axis=0)[still].max(initial=0.0) > STILL:
        raise RefutedError(f"{name}: joints move that are to stand still")
    fast = model.velocityLimit[[joint.idx_v for joint in model_joints]]
    most = {"velocity": fast, "acceleration": limits["acceleration"], "jerk": limits["jerk"]}
    for (what, limit), values in zip(most.items(), (rates, *pushes), strict=True):
        if (np.abs(values) > limit * (1 + ROUNDING) + STILL).any():
            raise RefutedError(f"{name}: {what} beyond its limit")
    if np.abs(rates[[0, -1]]).max() > STILL:
        raise RefutedError(f"{name}: does not begin and end at rest")
    ends = dict(zip(driven.names, rows[-1], strict=True))
    if any(joint in ends and abs(ends[joint] - at) > STILL for joint, at in moved.items()):
        raise RefutedError(f"{name}: fingers do not end where they are to")
    return rows


def _followed(stage: dict[str, Any]) -> set[str]:
    """Return the links whose way a stage describes."""
    sections = stage.get("line"), stage.get("path", {}).get("upright")
    return {each["link"] for each in sections if each}


def _done(bodies: Scene, stage: dict[str, Any], ways: list[dict[str, np.ndarray]]) -> None:
    """Check what a stage was to do, and do to objects what it does."""
    name = stage["name"]
    if section := stage.get("path", {}).get("upright"):
        axis = np.array([each[section["link"]][:3, "xyz".index(section["axis"])] for each in ways])
        if (tilt := np.arccos(np.clip(axis[:, 2].min(), -1.0, 1.0))) > section["tolerance"] + ROUNDING:
            raise RefutedError(f"{name}: tilts {section['link']} by {tilt:.4f} rad")
    if section := stage.get("move"):
        if not any(_reached(bodies.link(each["link"]), each) for each in section["poses"]):
            raise RefutedError(f"{name}: does not end at one of its poses")
    elif section := stage.get("line"):
        poses, way = [each[section["link"]] for each in ways], np.array(section["by"])
        if section.get("frame") == "tool":
            way = poses[0][:3, :3] @ way
        along = np.clip([(x[:3, 3] - poses[0][:3, 3]) @ way / (way @ way) for x in poses], 0.0, 1.0)
        off = [np.linalg.norm(x[:3, 3] - poses[0][:3, 3] - s * way) for x, s in zip(poses, along, strict=True)]
        turned = [Rotation.from_matrix(poses[0][:3, :3].T @ x[:3, :3]).magnitude() for x in poses]
        if max(off) > OFF or max(turned) > TURNED or along[-1] < 1.0 - OFF / np.linalg.norm(way):
            raise RefutedError(f"{name}: leaves its line by {max(off) * 1e3:.3f} mm, {max(turned):.4f} rad")
    elif section := stage.get("grip"):
        what, holding = section["object"], {each for pair in stage["touch"] for each in pair[1]}
        for link in holding:
            near = bodies.nearest(link, [what])
            if near > REACH:
                raise RefutedError(f"{name}: {link} is {near * 1e3:.2f} mm from {what}")
        bodies.held[what] = section["link"], np.linalg.inv(bodies.link(section["link"])) @ bodies.places[what], holding
    elif section := stage.get("release"):
        del bodies.held[what := section["object"]]
        above = bodies.nearest(what, set(bodies.shapes) - {what})
        if above > REACH:
            raise RefutedError(f"{name}: {what} is {above * 1e3:.2f} mm above what it is to stand on")


def _reached(pose: np.ndarray, section: dict[str, Any]) -> bool:
    goal = of_scene(section)
    if np.linalg.norm(pose[:3, 3] - goal[:3, 3]) > OFF:
        return False
    if section.get("free_rotation") == "z":
        return bool(np.arccos(np.clip(pose[:3, 2] @ goal[:3, 2], -1.0, 1.0)) <= TURNED)
    return bool(Rotation.from_matrix(goal[:3, :3].T @ pose[:3, :3]).magnitude() <= TURNED)
