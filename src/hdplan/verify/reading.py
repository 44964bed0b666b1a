"""Scene, robot and motion, read from their files into a world (`docs/world.md`), by readers that share nothing with
hdplan's."""

from __future__ import annotations

import copy
import functools
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from . import scene as scenes
from .balls import Pose, compose, named, need, rejecting
from .joints import Joints
from .left_out import staying
from .limits import limits, limits_of_other
from .loads import loads
from .maps import boxes_of
from .messages import message_of
from .motion import Rows
from .moveit import sections, sections_around
from .moving import joints_of
from .other_robot import NotClaimedError, OtherRobot
from .pairs import check_left_out, not_compared
from .robot import Tree
from .robot_files import DESCRIPTIONS, find_robot, given_robot
from .rviz import ENDING, exported
from .seen import balls_of, shape_of
from .semantics import Semantics
from .sizes import sizes
from .targets import Targets
from .text import Files, listing, mapping, row
from .world import VERSION

ROW_ROUNDING = 1e-6  # by which rows may be farther apart than a scene says
ROBOT = "name urdf srdf package_dirs xacro_args group base base_joints locked ignore_pairs check_pairs"
ROBOT += " tracking calibration"


@dataclass(frozen=True)
class Reading:
    """Contents of the files."""

    world: dict[str, Any]
    hashes: dict[str, str]  # of the files
    taken: tuple[str, ...]  # what the checker does not read, and took from the proof's own world
    passed: tuple[str, ...]  # what the files ask for and no world holds, in words
    left_out: dict[str, list[int]]  # of the balls of a cloud or image that was read, by its name, the rows


def read_world(
    scene: Path, motion: Path, claimed: Any = None, request: Path | None = None, robot: str | None = None
) -> Reading:
    """The world of a motion, in a scene of MoveIt's with its `request`, and with a `robot` in place of the scene's,
    which is its name or a file. What the checker does not read by itself (clouds, xacro, MJCF, other kinds of meshes)
    is taken from the world that a proof claims, and named. Raises RejectedError."""
    with rejecting():
        reader = Reader(scene, motion, claimed, request, robot)
        need("job" not in reader.top, "the scene holds a job, and the proof is that of a single motion")
        world = reader.world_of_other_robot() if isinstance(reader.joints, OtherRobot) else reader.world()
        return reader.reading(world)


@functools.lru_cache(maxsize=8)  # these two by the content of files, which are read each time
def tree_of(path: Path, data: bytes, base: str | None) -> Tree:
    """The links and joints of a URDF's content, on a planar base (JSON) if the scene has one."""
    return Tree(path, data, None if base is None else json.loads(base))


@functools.lru_cache(maxsize=8)
def semantics_of(data: bytes, tree: Tree) -> Semantics:
    """Contents of an SRDF for a tree of links."""
    return Semantics(data, tree.above, tree.links)


class Reader:
    """One scene and one motion."""

    def __init__(self, scene: Path, motion: Path, claimed: Any, request: Path | None, robot: str | None) -> None:
        self.files, self.claimed = Files(), scenes.Claimed(claimed)
        self.clouds, self.left_out = dict[str, dict[str, Any]](), dict[str, None]()  # what was seen, by its name
        self.rows_out = dict[str, list[int]]()  # of what was seen and read here
        self.folder = scene.absolute().parent
        data = self.files.read("scene", scene)
        self.top = scenes.read_scene(scene, data) if request is None else {}
        need("robot" in self.top or robot is not None, f"{scene}: has no robot")
        section, folder = (self.top["robot"], self.folder) if robot is None else given_robot(robot, self.files)
        spec = mapping(section, "robot", ROBOT)
        self.rows = Rows(motion, self.files.read("motion", motion))
        self.robot = find_robot(spec, folder)
        urdf, srdf = self.robot.urdf, self.robot.srdf
        description = self.files.read("urdf", urdf)
        words = self.files.read("srdf", srdf) if srdf else b"<robot/>"
        self.joints: Any = None
        around: Any = None
        plan_request: Any = None
        if request is not None:
            around = exported(data) if scene.suffix.lower() == ENDING else message_of(data)
            plan_request = message_of(self.files.read("request", request))
        if urdf.suffix.lower() in DESCRIPTIONS[1:]:
            self.claimed.taken[f"the robot ({named(urdf.name)}) with its limits and the pairs left out"] = None
            self.joints = OtherRobot(claimed, spec)
            if request is not None:
                robots = self.joints.at, {*self.joints.movable}, self.joints.solid
                self.top = sections_around(around, plan_request, spec, *robots)
            return
        need(not spec.get("xacro_args"), "robot.xacro_args: the file is not in xacro")
        base = spec.get("base_joints")
        base = None if base is None else json.dumps(mapping(base, "robot.base_joints", "kind x y yaw"))
        tree = tree_of(urdf, description, base)
        semantics = semantics_of(words, tree)
        if request is not None:
            self.top = sections(around, plan_request, spec, tree, semantics)
            spec = self.top["robot"]
        self.joints = Joints(spec, self.top["start"], tree, semantics)

    def of(self, top: dict[str, Any], rows: Rows) -> Reader:
        """These files with other sections and other rows, of one stage of a job."""
        other = copy.copy(self)
        other.top, other.rows = top, rows
        other.joints = Joints(top["robot"], top["start"], self.joints.tree, self.joints.semantics)
        return other

    def link_bodies(self) -> list[Any]:
        """The collision geometry of all links."""
        return [
            {"name": link, "kind": "link", **place, "shape": self.link_shape(link, i, kind, attributes)}
            for link, i, place, kind, attributes in self.joints.shapes
        ]

    def link_shape(self, link: str, number: int, kind: str, attributes: dict[str, str]) -> dict[str, Any]:
        """A shape of a link as a world has it."""
        where = f"link '{link}'"
        if kind == "mesh":
            scale = row(attributes.get("scale", "1 1 1"), 3, where)
            need(scale.all(), f"{where}: a mesh of scale 0")
            path = self.robot.mesh(attributes.get("filename", ""), where)
            body = (link, number, f"link {named(link)}")
            return scenes.mesh_of(path, scale, self.files, self.claimed, body, upright=False)
        sizes: dict[str, Any] = {
            x: float(row(y, 1, where)[0]) for x, y in attributes.items() if x in ("radius", "length")
        }
        sizes |= {x: row(y, 3, where).tolist() for x, y in attributes.items() if x in ("size", "radii")}
        need(np.hstack([*sizes.values(), 1]).min() > 0, f"{where}: a size is not above 0")
        return scenes.solid(kind, sizes)

    # --- the world ---

    def world(self) -> dict[str, Any]:
        """The whole of it."""
        top, joints = self.top, self.joints
        listed = joints.listed()
        held, touching, around, tracks, own = self.others(len(listed))
        own_bodies = [*self.link_bodies(), *held]
        targets = self.targets(held)
        found, off = limits(top, joints, targets), top.get("self_collision", True) is False
        return {
            "hdplan_world": VERSION,
            "joints": listed,
            "held": joints.held,
            "links": {link: joints.place(link) for link in joints.tree.links},
            "bodies": [*own_bodies, *around],
            "tracks": tracks,
            "not_compared": not_compared(joints, own_bodies, touching, off),
            "motion": self.rows.of(listed, joints.held),
            "limits": found,
            **({"loads": loads(top, joints)} if "torque" in found else {}),
            **sizes(top, joints),
            "path": scenes.path_of(top),
            "start": [targets.target(top["start"], "start")],
            "goal": targets.goals(top["goal"]),
            **self.wanted(own),
        }

    def others(self, count: int) -> tuple[list[Any], set[frozenset[str]], list[Any], list[Any], dict[str, Any]]:
        """Held objects and the pairs of them that may touch; obstacles, the joints that carry them, beside `count`
        of the robot, and their own clearances."""
        held, touching = self.held_bodies()
        around, motions, own = self.around()
        names = [x["name"] for x in [*held, *around]]
        for each in names:
            need(names.count(each) == 1, f"'{each}': the name is taken")
        tracks = list[Any]()
        for body in around:
            if body["name"] in motions:
                carriers, place = joints_of(motions[body["name"]], self.rows.times, body["name"])
                first = count + len(tracks)
                tracks += [{**x, "parent": first + x["parent"] if x["parent"] >= 0 else -1} for x in carriers]
                body |= {"joint": count + len(tracks) - 1, **scenes.frame(place)}
        return held, touching, around, tracks, own

    def around(self) -> tuple[list[Any], dict[str, Any], dict[str, Any]]:
        """Obstacles, the motions of some, and their own clearances."""
        return scenes.obstacles(self.top, self.folder, self.files, self.claimed, self.seen)

    def seen(self, name: str, kind: str, value: Any, pose: Pose) -> dict[str, Any]:
        """The shape of what was seen, once: what the checker does not read as the proof has it."""
        if name not in self.clouds:
            self.clouds[name] = self.read_seen(name, kind, value, pose)
        return self.clouds[name]

    def read_seen(self, name: str, kind: str, value: Any, pose: Pose) -> dict[str, Any]:
        """Balls of a cloud or a depth image, or boxes of a map."""
        what, where = f"{named(name)} ({kind})", (self.folder, self.files)
        if kind in ("voxels", "octomap") and value != "":  # as MoveIt's is
            return boxes_of(kind, value, what, *where, self.claimed.points(name))
        found = balls_of(kind, value, what, *where) if kind in ("cloud", "depth") else None
        ignores = found is not None and bool(value.get("ignore_robot") or value.get("ignore"))
        if found is None or (ignores and isinstance(self.joints, OtherRobot)):
            return self.claimed.shape(name, None, what)
        stay = staying(self, name, value, found[0], pose) if ignores else np.ones(len(found[1]), dtype=bool)
        self.rows_out[name] = np.flatnonzero(~stay).tolist()
        return shape_of(*found, stay)

    def held_bodies(self) -> tuple[list[Any], set[frozenset[str]]]:
        """Held objects, and the pairs that may touch."""
        held, touching, at = list[Any](), set[frozenset[str]](), self.joints.at
        entries = listing(self.top.get("attached"), "attached")
        every = [mapping(x, f"attached[{i}]", "name link shape pose touch_links mass") for i, x in enumerate(entries)]
        others = {scenes.word(entry.get("name", f"attached{i}"), f"attached[{i}]") for i, entry in enumerate(every)}
        for i, entry in enumerate(every):
            what = f"attached[{i}]"
            name, link = scenes.word(entry.get("name", f"attached{i}"), what), scenes.word(entry.get("link"), what)
            need(link in at and name not in at, f"{what}: its link is not known, or its name is taken")
            joint, pose = at[link]
            pose = compose(pose, scenes.pose_of(entry.get("pose"), what))
            shape = scenes.shape_of(entry.get("shape"), name, self.folder, self.files, self.claimed)
            held.append({"name": name, "kind": "held", "joint": joint, **scenes.frame(pose), "shape": shape})
            near = listing(entry.get("touch_links"), what)
            need(all(x in at or x in others for x in near), f"{what}: touch_links: names a link that there is not")
            touching |= {frozenset((name, x)) for x in near}
        return held, touching

    def targets(self, held: list[Any]) -> Targets:
        """The reader of start and goal, which may be about held objects that move."""
        moved = {x["name"] for x in held if x["joint"] >= 0}
        return Targets(self.joints, bool(self.top.get("from_request")), moved)

    def wanted(self, own: dict[str, Any]) -> dict[str, Any]:
        """Demands of the scene that need no robot."""
        timing, planner = self.top.get("timing", {}), self.top.get("planner", {})
        usual = scenes.one(planner.get("clearance", 0.0), "planner.clearance")
        self_collision = self.top.get("self_collision", True)
        among = mapping(self_collision, "self_collision", "clearance") if type(self_collision) is not bool else {}
        least = {"obstacles": usual, "own": own, "self": scenes.one(among.get("clearance", 0.0), "self_collision")}
        duration = scenes.one(timing["duration"], "timing.duration") if "duration" in timing else None
        slower = scenes.one(timing.get("scale", 1.0), "timing.scale") != 1
        also = ["planner.objective"] * ("objective" in planner) + ["timing.scale"] * slower
        return {"clearances": least, "duration": duration, "also": also}

    def world_of_other_robot(self) -> dict[str, Any]:
        """The world with a robot that the checker does not read, which is the proof's; all else is the scene's, but for
        what needs the robot's own words, such as a named state."""
        joints, top = self.joints, self.top
        held, touching, around, tracks, own = self.others(len(joints.claimed["joints"]))
        check_left_out(joints, touching, top.get("self_collision", True) is False)
        targets = self.targets(held)
        ends = dict[str, Any]()
        for end, read in (("start", lambda x: [targets.target(x, "start")]), ("goal", targets.goals)):
            try:
                ends[end] = read(top[end])
            except NotClaimedError:
                ends[end] = joints.claimed[end]
                self.claimed.taken[f"the {end}"] = None
        return {
            **{key: x for key, x in joints.claimed.items() if key != "sizes"},
            **sizes(top, joints),
            "bodies": [*joints.bodies, *held, *around],
            "tracks": tracks,
            "motion": self.rows.of(joints.claimed["joints"], joints.held),
            "limits": limits_of_other(top, joints),
            "path": scenes.path_of(top),
            **ends,
            **self.wanted(own),
        }

    def reading(self, world: dict[str, Any]) -> Reading:
        """A world that was read here, with what there is to say of it."""
        return Reading(world, self.files.hashes, tuple(self.claimed.taken), self.passed(world), self.rows_out)

    def passed(self, world: dict[str, Any]) -> tuple[str, ...]:
        """Remarks on an allowed collision matrix of MoveIt's that has more pairs of links compared, of rows
        that are farther apart than a scene says, and of held objects without a mass where torques are limited."""
        whose, *pairs = self.top.get("matrix", ("", [], []))
        left_out, claimed = world["not_compared"], [*pairs[0], *pairs[1]]
        found = [[one, two] for one, two, why in left_out if why != "moving as one" and [one, two] in claimed]
        words = ", ".join("-".join(map(named, pair)) for pair in found)
        of = f" of the robot {named(whose)}" if whose else ""
        notes = [*self.left_out]
        notes += [f"not compared, although MoveIt's allowed collision matrix{of} does: {words}"] * bool(found)
        times, rate = world["motion"]["times"], self.top.get("timing", {}).get("rate")
        gap = max(np.diff(times), default=0.0) if times else np.inf
        if rate is not None and not gap * scenes.one(rate, "timing.rate") <= 1 + ROW_ROUNDING:
            apart = f"rows are up to {float(gap)!r} s apart, {rate!r} in a second are required"
            notes.append(f"not kept, timing.rate: {apart}")
        light = [
            named(x.get("name", f"attached{i}"))
            for i, x in enumerate(listing(self.top.get("attached"), "attached"))
            if "torque" in world["limits"] and x.get("mass") is None and self.joints.at[x["link"]][0] >= 0
        ]
        notes += [f"torques do not include a mass of {', '.join(light)}, as none is given"] * bool(light)
        return tuple(notes)
